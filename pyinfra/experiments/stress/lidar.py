"""The LiDAR of a data set, from its `lidar.yaml`, as a file that the simulator reads."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import yaml

from pyinfra.core.errors import FormatError
from pyinfra.formats.kitti import read_keys

Keys = dict[str, Any]

DESCRIPTIVE_KEYS = ("name", "model")
UNIT = ("yaw_deg", "pitch_deg", "pattern", "returns")
NOT_TURNED = {"yaw_deg": 0, "pitch_deg": 0}
FILE = "lidar.yaml"


def read(file: Path) -> Keys:
    """All keys of a `lidar.yaml`, its preset applied. Raises FormatError."""
    return read_keys(file)


def units_of(config: Keys) -> list[Keys]:
    """The keys UNIT of each unit, of what a run or `infrasim check` wrote; none of a recording."""
    if config.get("bundle"):
        return [{key: unit[key] for key in UNIT} for unit in config["bundle"]]
    if "pattern" in config:
        return [NOT_TURNED | {key: config[key] for key in ("pattern", "returns")}]
    return []


def spins(config: Keys) -> bool:
    """Whether a unit turns, so that it has a seam."""
    return any("spinning" in unit["pattern"] for unit in units_of(config))


def turned(unit: Keys, degrees: float) -> Keys:
    """A unit whose turns begin so much further left; one that does not spin stays as it is."""
    spinning = unit["pattern"].get("spinning")
    if not spinning:
        return unit
    seam = (spinning["seam_deg"] + degrees) % 360
    return unit | {"pattern": {"spinning": spinning | {"seam_deg": seam}}}


def table_files(config: Keys, folder: Path) -> list[Path]:
    """Where the lists of directions are looked for: beside `lidar.yaml`, if not by a whole path."""
    tables = [unit["pattern"].get("table") for unit in units_of(config)]
    return [(folder / table["file"]).resolve() for table in tables if table]


def text(file: Path, turns_deg: Sequence[float] = ()) -> str:
    """What the simulator reads instead of a `lidar.yaml`: all units as one bundle, maybe of one.

    turns_deg: by which the units' seams are turned, over and over.
    Raises FormatError for a LiDAR that was not simulated.
    """
    config = read(file)
    units = units_of(config)
    if not units:
        raise FormatError(f"{file}: found no pattern, needed to simulate again")
    if turns_deg:
        units = [turned(unit, turns_deg[i % len(turns_deg)]) for i, unit in enumerate(units)]
    total = config["price_total_usd"] | {"source": "the bundle", "date": "its own"}
    keys = {key: config[key] for key in DESCRIPTIVE_KEYS}
    keys["price_usd"] = config.get("price_usd", total)
    keys["bundle"] = [_with_whole_path(unit, file.parent) for unit in units]
    return str(yaml.safe_dump(keys, sort_keys=False))


def difference(config: Keys, shipped: Keys) -> str:
    """The first key in which two LiDARs cast other rays or return other points, else nothing."""
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
    file = (folder / table["file"]).resolve()
    return unit | {"pattern": {"table": table | {"file": str(file)}}}
