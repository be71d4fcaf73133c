"""Measures the motion of SUMO's vehicles, bicycles and pedestrians before and after smoothing.

The command makes two runs on a generated crossing with signals, and two on each given site:

    python -m reproduction traffic sites/town

It writes two rows per run to out/traffic.csv: before smoothing and after smoothing.
"""

import tempfile
from collections.abc import Iterator, Sequence
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
from reproduction import provenance
from reproduction.arguments import Out, command

SEEDS = (1, 2)
ON_FOOT = ("Pedestrian",)


@dataclass(frozen=True)
class Place:
    """A road network and the pole positions."""

    name: str
    net: Path
    feet: FloatArray  # (k, 2) x, y of the foot of each pole


def place_of(site: Path) -> Place:
    mounts = read_keys(site / "site.yaml")["mounts"].values()
    feet = np.array([[mount["x_m"], mount["y_m"]] for mount in mounts])
    return Place(site.name, site / "map.net.xml", feet)


def rows(place: Place, demand: Demand, seconds: float, seed: int) -> Iterator[dict[str, object]]:
    sumo_run = record(place.net, place.feet, demand, seconds, seed)
    after = cleaned(sumo_run, place.feet)
    end = sumo_run.start + sumo_run.count
    raw = [unsmoothed(path).between(sumo_run.start, end) for path in sumo_run.paths]
    before = [track for track in raw if track is not None]
    facts = {"net": place.name, "seed": seed}
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


@command
def main(
    sites: Sequence[Path] = (),
    *,
    vehicles_per_hour: float = 1500,
    people_per_hour: float = 300,
    seconds: float = 500,
    out: Out = Path("traffic.csv"),
) -> None:
    """
    Parameters
    ----------
    sites : site folders of `pyinfra site import`
    vehicles_per_hour : vehicles per hour (default: %(default)s)
    people_per_hour : pedestrians per hour; the number of cyclists is the same (default:
        %(default)s)
    seconds : duration of the traffic in seconds (default: %(default)s)
    """
    demand = Demand(vehicles_per_hour, people_per_hour, people_per_hour)
    with tempfile.TemporaryDirectory() as folder:
        crossing = Place("crossing", traffic_data.crossing(Path(folder)), np.array([[12.0, 12.0]]))
        places = [crossing, *map(place_of, sites)]
        records = [
            row for place in places for seed in SEEDS
            for row in rows(place, demand, seconds, seed)
        ]  # fmt: skip
    table = pd.DataFrame(records).assign(
        **provenance(
            f"traffic {' '.join(map(str, sites))} --seconds {seconds:g} "
            f"--vehicles-per-hour {vehicles_per_hour:g} "
            f"--people-per-hour {people_per_hour:g}"
        )
    )
    table.to_csv(out, index=False)
    print(table.drop(columns=["version", "machine", "command"]).to_string(index=False))
