"""Turns the `lidar.yaml` of a data set into a LiDAR file that the simulator reads."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import yaml

from pyinfra.core.files import resolved
from pyinfra.formats.kitti import read_written_keys

Keys = dict[str, Any]
read = read_written_keys  # reads all keys of a `lidar.yaml`, with its preset applied

DESCRIPTIVE_KEYS = ("name", "model")
UNIT = ("yaw_deg", "pitch_deg", "pattern", "returns")
NOT_TURNED = {"yaw_deg": 0, "pitch_deg": 0}
FILE = "lidar.yaml"


def units_of(config: Keys) -> list[Keys]:
    """Returns, for each unit of a LiDAR, the keys that UNIT lists; empty for a recording.

    config: keys of a LiDAR file that a run or `infrasim check` wrote.
    """
    if config.get("bundle"):
        return [{key: unit[key] for key in UNIT} for unit in config["bundle"]]
    if "pattern" in config:
        return [NOT_TURNED | {key: config[key] for key in ("pattern", "returns")}]
    return []


def spins(config: Keys) -> bool:
    """Returns whether a unit of the LiDAR spins. Spinning units have a cut angle."""
    return any("spinning" in unit["pattern"] for unit in units_of(config))


def turned(unit: Keys, degrees: float) -> Keys:
    """Returns a unit with its cut angle turned left by `degrees`.

    A unit that does not spin is returned unchanged.
    """
    spinning = unit["pattern"].get("spinning")
    if not spinning:
        return unit
    cut_angle = (spinning["cut_angle_deg"] + degrees) % 360
    return unit | {"pattern": {"spinning": spinning | {"cut_angle_deg": cut_angle}}}


def table_files(config: Keys, folder: Path) -> list[Path]:
    """Returns the files with tables of directions; relative names are resolved in `folder`."""
    tables = [unit["pattern"].get("table") for unit in units_of(config)]
    return [resolved(folder / table["file"]) for table in tables if table]


def text(file: Path, turns_deg: Sequence[float] = ()) -> str:
    """Returns the text of a LiDAR file for the simulator, with all units as one bundle.

    file: lidar.yaml of a simulated LiDAR. turns_deg: angles by which the cut angles of the units
    are turned. The angles repeat if there are more units than angles.
    """
    config = read(file)
    units = units_of(config)
    if turns_deg:
        units = [turned(unit, turns_deg[i % len(turns_deg)]) for i, unit in enumerate(units)]
    total = config["price_total_usd"] | {"source": "the bundle", "date": "its own"}
    keys = {key: config[key] for key in DESCRIPTIVE_KEYS}
    keys["price_usd"] = config.get("price_usd", total)
    keys["bundle"] = [_with_whole_path(unit, file.parent) for unit in units]
    return str(yaml.safe_dump(keys, sort_keys=False))


def difference(config: Keys, shipped: Keys) -> str:
    """Returns the first key by which rays or returns of two LiDARs differ; empty if none does."""
    ours, other = units_of(config), units_of(shipped)
    if config["name"] != shipped["name"]:
        return "name"
    if len(ours) != len(other):
        return "bundle"
    pairs = list(zip(ours, other, strict=True))
    return next((key for key in UNIT if any(a[key] != b[key] for a, b in pairs)), "")


def _with_whole_path(unit: Keys, folder: Path) -> Keys:
    table = unit["pattern"].get("table")
    if table is None:
        return unit
    return unit | {"pattern": {"table": table | {"file": str(resolved(folder / table["file"]))}}}
