"""Simulates traffic with SUMO for a site folder."""

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import yaml

from pyinfra.core.errors import Error
from pyinfra.core.files import write
from pyinfra.formats.yaml_file import read_keys
from pyinfra.scenes.maps import site_folder
from pyinfra.scenes.maps.lane_comparison import AGAINST
from pyinfra.scenes.maps.site_folder import MAP, NET, SCENE
from pyinfra.scenes.maps.tracks import Track, lasts_s
from pyinfra.scenes.maps.traffic import simulate
from pyinfra.scenes.maps.traffic_demand import Demand
from pyinfra.scenes.maps.traffic_figures import report_lines
from pyinfra.scenes.maps.trajectory_file import NAME, write_trajectories

RECORD = "traffic.yaml"  # file with the arguments of the simulation that wrote the trajectories
DRIVEN = "vehicles_per_hour_driven"  # key in traffic.yaml of the simulated vehicles per hour
LEAST_SHARE = 0.8  # if a smaller share of the requested vehicles drives, the network is full
NO_VEHICLES = ("Pedestrian", "Cyclist")


def has_traffic(site: Path, demand: Demand, seconds: float, seed: int) -> bool:
    """Returns whether a site already has trajectories: recorded, or simulated with these arguments.

    Raises Error if the trajectories were simulated with different arguments.
    """
    if not (site / NAME).is_file():
        return False
    stored = read_keys(site / RECORD) if (site / RECORD).is_file() else {}
    for key, value in _arguments(demand, seconds, seed).items():
        if stored.get(key, value) != value:
            raise Error(
                f"{key}: expected {stored[key]}, as for the existing trajectories of {site}, got "
                f"{value}; choose a different folder, or set `vehicles_per_hour` to 0 to keep them"
            )
    return True


def _arguments(demand: Demand, seconds: float, seed: int) -> dict[str, Any]:
    rates = {name: value for name, value in asdict(demand).items() if name != "class_shares"}
    return {**rates, "seconds": seconds, "seed": seed}


def _check_directions(site: Path) -> None:
    """Raises Error if most lanes of the map run against SUMO's network.

    This is the case if only some of the roads have left-hand traffic.
    """
    record = read_keys(site / MAP) if (site / MAP).is_file() else {}
    notes = record.get("not_understood") or []
    against = [str(note) for note in notes if AGAINST in str(note)]
    if len(against) > int(record.get("lanes") or 0) / 2:
        raise Error(
            f"{site}: expected lanes with the direction that they have in SUMO's network, got "
            f"{len(against)} lanes with the opposite direction; if the map has left-hand traffic, "
            'set rule="LHT" on all of its roads, otherwise use recorded trajectories'
        )


def driven_per_hour(tracks: Sequence[Track], seconds: float) -> int:
    """Returns the number of vehicles per hour that appear after the first instant."""
    names = {t.name for t in tracks if t.first > 0 and t.object_class not in NO_VEHICLES}
    return round(len(names) * 3600 / seconds)


def lacking_traffic(site: Path) -> str:
    """Returns a text if fewer vehicles drive at a site than were asked for, else "".

    If the network is full, the remaining vehicles wait outside it.
    """
    record = read_keys(site / RECORD) if (site / RECORD).is_file() else {}
    wanted, driven = (float(record.get(key) or 0) for key in ("vehicles_per_hour", DRIVEN))
    if DRIVEN not in record or driven >= LEAST_SHARE * wanted:
        return ""
    return (
        f"{wanted:,.0f} vehicles an hour were asked for, and {driven:,.0f} drive: the network "
        "cannot carry more"
    )


def write_traffic(site: Path, demand: Demand, seconds: float, seed: int) -> list[str]:
    """Writes trajectories.csv of a site, sets its duration, and returns the lines of a report.

    traffic.yaml beside it has the arguments. Raises Error for a demand out of range, MissingPackage
    if SUMO is not installed, and OSError.
    """
    _check_directions(site)
    if (site / SCENE).is_file() and not (site / NET).is_file():
        raise Error(
            f"{site}: expected {NET}, got none: a Lanelet2 map has no network for SUMO. Use "
            "recorded trajectories, or convert the map to OpenDRIVE, for example with the "
            "CommonRoad Scenario Designer"
        )
    feet = site_folder.feet(site)
    traffic = simulate(site / NET, feet, demand, seconds, seed)
    write_trajectories(site / NAME, traffic.tracks)
    driven = driven_per_hour(traffic.tracks, seconds)
    arguments = {**_arguments(demand, seconds, seed), DRIVEN: driven}
    write(site / RECORD, yaml.safe_dump(arguments, sort_keys=False))
    site_folder.set_duration(site, lasts_s(traffic.tracks))
    notes = [f"{name}: left out: smoothing failed" for name in traffic.rough]
    if traffic.unrouted:
        notes.insert(
            0, f"{len(traffic.unrouted)} of {traffic.asked} trips left out: no valid route"
        )
    notes += [f"{name}: left out: it overlaps another object" for name in traffic.overlapping]
    if text := lacking_traffic(site):
        notes.insert(0, text)
    return list(report_lines(site / NAME, traffic.tracks, feet, notes))
