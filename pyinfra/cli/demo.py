"""`pyinfra demo --out DIR`."""

import argparse
import os
import shlex
from pathlib import Path

from pyinfra.api import benchmark
from pyinfra.cli.messages import progress
from pyinfra.cli.parser import argument, usage
from pyinfra.core.errors import Error
from pyinfra.core.vocabulary import Tier
from pyinfra.viz.report.contents import page
from pyinfra.viz.report.page import write_page
from pyinfra.viz.report.report_data import read_material

BENCHMARK = "junction"  # name of a benchmark in configs/benchmarks
TIER: Tier = "quick"


add_arguments = usage(
    "Simulates four LiDARs at a junction, runs the pretrained detector on their frames and "
    "writes a report, in about a minute on two cores. Run the same command again to resume.",
    "example: pyinfra demo --out demo",
    argument("--out", type=Path, default=Path("demo"), help="output folder; default: demo"),
)


def run(args: argparse.Namespace) -> int:
    out: Path = args.out
    jobs = len(os.sched_getaffinity(0))
    table = benchmark(
        BENCHMARK, out / "results", work=out / "work", tier=TIER, jobs=jobs, progress=progress
    )
    if "reason" in table and table.reason.notna().any():
        raise Error(f"{out}: an experiment failed; the messages above state the cause")
    data = out / "work/data" / f"{table.scene[0]}_{table.preset[0]}"
    material = read_material(out / "results", [data], [], TIER)
    report = page(material)
    file = write_page(report, out / "report.html")
    best = table.loc[table.ap_r1000.idxmax()]
    print(report.sections[0].lead)
    print(f"report: {file}")
    print(f"next: {shlex.join(view_command(out, data, best.lidar))}")
    return 0


def view_command(out: Path, data: Path, lidar: str) -> list[str]:
    """Returns a command that shows the boxes of one LiDAR in 3-D."""
    (run_folder,) = (out / "work/runs").glob(f"*_{lidar}_*/predictions")
    files = [str(data / lidar), "--pred", str(run_folder), "--out", str(out / "view.html")]
    return ["pyinfra", "view", *files]
