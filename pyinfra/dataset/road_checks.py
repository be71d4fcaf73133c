"""Compares the roads of a data set with those of its scene."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from pyinfra.core.errors import Error
from pyinfra.dataset.frames import data_set_of
from pyinfra.dataset.roads import Road, read_roads
from pyinfra.dataset.simulated_frames import roads_of_world
from pyinfra.formats.yaml_file import read_keys

# Keys of a scene on which its evaluation region depends.
KEYS = ("name", "mounts", "roads", "region_half_length_m", "regions", "profile", "junctions")
TRAFFIC = {  # arbitrary values, because a scene must have traffic
    "vehicles_per_km_lane": 1,
    "speed": {"mean_km_h": 50, "std_km_h": 1},
    "class_shares": {"Car": 1},
}
MOST_M = 0.02  # tolerance in metres, because the coordinates in roads.csv are rounded


def other_roads(lidar_folder: Path) -> str | None:
    """Returns a message if roads.csv differs from the scene in dataset.yaml, else None.

    A scene with lanes from a file is not checked, because the data set does not have that file.
    """
    data_set = data_set_of(lidar_folder)
    description, file = data_set / "dataset.yaml", data_set / "roads.csv"
    if not (description.is_file() and file.is_file()):
        return None
    keys = read_keys(description)
    if not keys.get("roads") or not keys.get("mounts"):
        return None
    roads = {road.name: road for road in read_roads(file)}
    differences = [_difference(roads, _expected(keys, mount)) for mount in keys["mounts"]]
    if "" in differences:  # the file has the roads of one of the mounts
        return None
    return (
        f"{file}: expected the roads of the scene in {description.name}, got {differences[0]}; "
        "this file defines the evaluation region"
    )


def _expected(keys: Mapping[str, Any], mount: str) -> dict[str, Road] | None:
    """Returns the roads of a scene at a mount, by name; None if the scene cannot be built."""
    from pyinfra.dataset import simulation

    some = {key: keys[key] for key in KEYS if key in keys} | {"traffic": TRAFFIC}
    try:
        world = simulation.make_world(some, mount=mount)
    except Error:  # the scene was written for another version of the simulator
        return None
    return {road.name: road for road in roads_of_world(world, "roads.csv")}


def _difference(found: Mapping[str, Road], expected: Mapping[str, Road] | None) -> str:
    """Describes the first difference between roads; empty if there is none."""
    for name, road in (expected or {}).items():
        if name not in found:
            return f"no road {name}"
        given = found[name]
        if len(given.s) != len(road.s) or not np.allclose(given.s, road.s, atol=MOST_M):
            return (
                f"road {name} with {len(given.s)} rows from s = {given.s[0]:g} to "
                f"{given.s[-1]:g} m instead of {len(road.s)} rows from {road.s[0]:g} to "
                f"{road.s[-1]:g} m"
            )
        if not np.allclose(given.xy, road.xy, atol=MOST_M):
            return f"road {name} at a different position"
    return ""
