"""Measures the motion of SUMO's vehicles, bicycles and pedestrians before and after smoothing.

The command makes two runs on a generated crossing with signals, and two on each given site:

    python -m reproduction traffic sites/town

It writes two rows per run to out/traffic.csv: before smoothing and after smoothing.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import traffic_data

from pyinfra.core.arrays import FloatArray
from pyinfra.formats.yaml_file import read_keys
from pyinfra.scenes.maps.smoothing import unsmoothed
from pyinfra.scenes.maps.traffic import cleaned, record
from pyinfra.scenes.maps.traffic_demand import Demand
from pyinfra.scenes.maps.traffic_figures import TrafficFigures, traffic_figures
from reproduction import add_out, provenance

VERSION = 1  # of the results of this file; raise it with a change that alters them

SEEDS = (1, 2)
ON_FOOT = ("Pedestrian",)


@dataclass(frozen=True)
class Place:
    """A road network and the pole positions."""

    name: str
    net: Path
    feet: FloatArray  # (k, 2)


def place_of(site: Path) -> Place:
    mounts = read_keys(site / "site.yaml")["mounts"].values()
    feet = np.array([[mount["x_m"], mount["y_m"]] for mount in mounts])
    return Place(site.name, site / "map.net.xml", feet)


def rows(place: Place, demand: Demand, seconds: float, seed: int) -> Iterator[dict[str, object]]:
    start = time.perf_counter()
    sumo_run = record(place.net, place.feet, demand, seconds, seed)
    after = cleaned(sumo_run, place.feet)
    elapsed_s = time.perf_counter() - start
    end = sumo_run.start + sumo_run.count
    raw = [unsmoothed(path).between(sumo_run.start, end) for path in sumo_run.paths]
    before = [track for track in raw if track is not None]
    facts = {"net": place.name, "seed": seed, "run_s": round(elapsed_s, 1)}
    left_out = len(after.overlapping) + len(after.rough)
    for stage, tracks, out in (("SUMO", before, 0), ("smoothed", after.tracks, left_out)):
        figures = row(traffic_figures(tracks, place.feet))
        yield facts | {"stage": stage} | figures | {"left_out": out}


def row(figures: TrafficFigures) -> dict[str, object]:
    return {
        "vehicles_and_riders": sum(n for c, n in figures.classes.items() if c not in ON_FOOT),
        "pedestrians": sum(figures.classes.get(name, 0) for name in ON_FOOT),
        "turn_deg": round(figures.turn_deg, 2),
        "acceleration_m_s2": round(figures.acceleration_m_s2, 2),
        "overlap_percent": round(100 * figures.overlap_share, 4),
        "appearing": figures.appearing,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("sites", type=Path, nargs="*", help="site folders of `pyinfra site import`")
    parser.add_argument(
        "--vehicles-per-hour",
        type=float,
        default=1500,
        help="vehicles per hour (default: %(default)s)",
    )
    parser.add_argument(
        "--people-per-hour",
        type=float,
        default=300,
        help="pedestrians per hour; the number of cyclists is the same (default: %(default)s)",
    )
    parser.add_argument(
        "--seconds",
        type=float,
        default=500,
        help="duration of the traffic in seconds (default: %(default)s)",
    )
    add_out(parser, "traffic.csv")
    args = parser.parse_args()
    demand = Demand(args.vehicles_per_hour, args.people_per_hour, args.people_per_hour)
    with tempfile.TemporaryDirectory() as folder:
        crossing = Place("crossing", traffic_data.crossing(Path(folder)), np.array([[12.0, 12.0]]))
        places = [crossing, *map(place_of, args.sites)]
        records = [
            row for place in places for seed in SEEDS
            for row in rows(place, demand, args.seconds, seed)
        ]  # fmt: skip
    table = pd.DataFrame(records).assign(
        **provenance(
            f"traffic {' '.join(map(str, args.sites))} --seconds {args.seconds:g} "
            f"--vehicles-per-hour {args.vehicles_per_hour:g} "
            f"--people-per-hour {args.people_per_hour:g}"
        )
    )
    table.to_csv(args.out, index=False)
    print(table.drop(columns=["version", "machine", "command"]).to_string(index=False))
