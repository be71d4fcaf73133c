"""`pyinfra sites --seed S --count N --out DIR`: writes generated sites and draws their plans."""

import argparse
from pathlib import Path

import yaml

from pyinfra.cli.messages import note
from pyinfra.core.errors import Error
from pyinfra.core.files import replacing
from pyinfra.core.progress import track
from pyinfra.scenes.generator.generate import make_site

SHEET = "sheet.png"
MOST_ON_A_SHEET = 48
DPI = 130


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = (
        "Generates random sites, writes each as a scene file, and draws a sheet of their plans. "
        "`pyinfra train --sites` trains on such sites."
    )
    parser.epilog = "example: pyinfra sites --seed 0 --count 24 --out out/sites"
    parser.add_argument("--seed", type=int, default=0, help="seed of the first site; default: 0")
    parser.add_argument(
        "--count",
        type=int,
        default=24,
        help="number of sites; each has the next seed; default: 24",
    )
    parser.add_argument("--out", type=Path, required=True, help="folder for the files")


def run(args: argparse.Namespace) -> int:
    if args.count < 1:
        raise Error(f"--count: expected 1 or more, got {args.count}")
    if args.seed < 0:
        raise Error(f"--seed: expected 0 or more, got {args.seed}")
    from pyinfra.viz.site_sheet import sheet

    args.out.mkdir(parents=True, exist_ok=True)
    sites = [make_site(seed) for seed in track(range(args.seed, args.seed + args.count), "site")]
    for site in sites:
        file = args.out / f"{site['name']}.yaml"
        with replacing(file) as beside:
            text = yaml.safe_dump(site, sort_keys=False, default_flow_style=None, width=100)
            beside.write_text(text)
        print(file)
    with replacing(args.out / SHEET) as beside:
        sheet(sites[:MOST_ON_A_SHEET]).savefig(beside, format="png", dpi=DPI)
    print(args.out / SHEET)
    if len(sites) > MOST_ON_A_SHEET:
        note(f"{SHEET} shows the first {MOST_ON_A_SHEET} of {len(sites)} sites", args)
    return 0
