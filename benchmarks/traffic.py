"""How traffic of SUMO moves before and after smoothing: two runs on a crossing with signals.

Prints a table; with --net and --foot those of a network of one's own:
    .venv/bin/python benchmarks/traffic.py
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests/python"))

from pyinfra.arrays import FloatArray
from pyinfra.site.smoothing import unsmoothed
from pyinfra.site.traffic import cleaned, record
from pyinfra.site.traffic_demand import Demand
from pyinfra.site.traffic_figures import traffic_figures

SEEDS = (1, 2)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--net", type=Path, help="a .net.xml; default: a crossing, made here")
    parser.add_argument("--foot", type=float, nargs=2, default=(12.0, 12.0), metavar=("X", "Y"))
    parser.add_argument("--vehicles-per-hour", type=float, default=1500)
    parser.add_argument("--seconds", type=float, default=200)
    args = parser.parse_args()
    demand, feet = Demand(args.vehicles_per_hour), np.array([args.foot])
    with tempfile.TemporaryDirectory() as folder:
        net = args.net or _crossing(Path(folder))
        for seed in SEEDS:
            _print_run(net, feet, demand, args.seconds, seed)


def _crossing(folder: Path) -> Path:
    import traffic_data

    return traffic_data.crossing(folder)


def _print_run(net: Path, feet: FloatArray, demand: Demand, seconds: float, seed: int) -> None:
    start = time.perf_counter()
    sumo_run = record(net, feet, demand, seconds, seed)
    after = cleaned(sumo_run, feet)
    took = time.perf_counter() - start
    end = sumo_run.start + sumo_run.count
    raw = [unsmoothed(path).between(sumo_run.start, end) for path in sumo_run.paths]
    before = [track for track in raw if track is not None]
    rows = zip(
        traffic_figures(before, feet).rows(),
        traffic_figures(after.tracks, feet).rows(),
        strict=True,
    )
    print(f"seed {seed}: {took:.1f} s, {len(after.overlapping)} left out for overlaps,")
    print(f"  {len(after.rough)} for motion")
    for (name, old), (_, new) in rows:
        print(f"  {name:45} {old:>48} | {new}")


if __name__ == "__main__":
    main()
