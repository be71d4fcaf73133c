"""Tries the doors of a checkout: what is wrong, handed in as a user would.

    .venv/bin/python tests/doors --out out/doors.csv
    .venv/bin/python tests/doors --checkout ../before --doors 9 11 --mutants 200

Prints a line a try and writes them as CSV, below those of other versions. Exit code 1 if one is
open.
"""

from __future__ import annotations

import argparse
import csv
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import asdict, fields
from pathlib import Path

from checkout import Checkout
from doors import DOORS, Finding, findings
from mutants import configurations, files
from small_site import Site, build


def all_findings(site: Site, doors: list[int], mutants: int, seed: int) -> Iterator[Finding]:
    for number in doors:
        yield from findings(site, number)
    if mutants:
        yield from configurations(site, mutants, seed)
        yield from files(site, mutants, seed)


def write(file: Path, version: str, found: list[Finding]) -> None:
    """The findings, below those of other versions that the file has."""
    rows = []
    if file.is_file():
        with file.open(newline="") as stream:
            rows = [row for row in csv.DictReader(stream) if row["version"] != version]
    rows += [{"version": version, **asdict(finding)} for finding in found]
    file.parent.mkdir(parents=True, exist_ok=True)
    with file.open("w", newline="") as stream:
        writer = csv.DictWriter(stream, ["version", *(f.name for f in fields(Finding))])
        writer.writeheader()
        writer.writerows(rows)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    here = Path(__file__).resolve().parents[2]
    parser.add_argument(
        "--checkout", type=Path, default=here, help="built source tree; default: this"
    )
    parser.add_argument("--doors", type=int, nargs="*", choices=DOORS, default=list(DOORS))
    parser.add_argument(
        "--mutants", type=int, default=0, help="of configurations, and of data files"
    )
    parser.add_argument("--seed", type=int, default=1, help="of the mutants")
    parser.add_argument("--out", type=Path, help="CSV")
    args = parser.parse_args()
    found = []
    with tempfile.TemporaryDirectory(prefix="doors_") as folder:
        site = build(Checkout(args.checkout.resolve()), Path(folder))
        version = site.checkout.pyinfra("--version").out.split()[-1]
        for finding in all_findings(site, args.doors, args.mutants, args.seed):
            state = "shut" if finding.shut else "OPEN"
            print(f"{finding.door:3} {state}  {finding.tried}: {finding.found}", flush=True)
            found.append(finding)
    if args.out:
        write(args.out, version, found)
    return 0 if all(f.shut for f in found) else 1


if __name__ == "__main__":
    sys.exit(main())
