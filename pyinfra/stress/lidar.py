"""The LiDAR of a data set, from its `lidar.yaml`, as files that the simulator reads."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from pyinfra.kitti import FormatError

Keys = dict[str, Any]

ABOUT = ("name", "model", "random_phase")
UNIT = ("yaw_deg", "pitch_deg", "pattern", "returns")
NOT_TURNED = {"yaw_deg": 0, "pitch_deg": 0}
FILE = "lidar.yaml"


def read(file: Path) -> Keys:
    """All keys of a `lidar.yaml`, its preset applied. Raises FormatError."""
    found = yaml.safe_load(file.read_text("utf-8"))
    if not isinstance(found, dict):
        raise FormatError(f"{file}:1: found no mapping, allowed the keys of a LiDAR")
    return found


def units_of(config: Keys) -> list[Keys]:
    """The keys UNIT of each unit, of what a run or `infrasim check` wrote; none of a recording."""
    if config.get("bundle"):
        return [{key: unit[key] for key in UNIT} for unit in config["bundle"]]
    if "pattern" not in config:
        return []
    # A bundle of one may stand there as a single LiDAR, and its turn in the field of view alone.
    turn = config.get("field_of_view", [NOT_TURNED])[0]
    keys = config | {key: turn[key] for key in NOT_TURNED}
    return [{key: keys[key] for key in UNIT}]


def table_files(config: Keys, folder: Path) -> list[Path]:
    """Where the lists of directions are looked for: beside `lidar.yaml`, if not by a whole path."""
    tables = [unit["pattern"].get("table") for unit in units_of(config)]
    return [(folder / table["file"]).resolve() for table in tables if table]


def texts(file: Path) -> dict[str, str]:
    """What the simulator reads instead of a `lidar.yaml`: texts by name, FILE and any units.

    Raises FormatError for a LiDAR that was not simulated.
    """
    config = read(file)
    units = units_of(config)
    if not units:
        raise FormatError(f"{file}: found no pattern, needed to simulate again")
    about = {key: config[key] for key in ABOUT}
    parts = [_part(config, unit, len(units), file.parent) for unit in units]
    if len(parts) == 1 and units[0]["yaw_deg"] == units[0]["pitch_deg"] == 0:
        return {FILE: _text(about | parts[0])}
    bundle = [
        {"lidar": f"unit_{i}.yaml"} | {key: unit[key] for key in NOT_TURNED}
        for i, unit in enumerate(units)
    ]
    named = {f"unit_{i}.yaml": _text({"name": f"unit_{i}"} | p) for i, p in enumerate(parts)}
    return {FILE: _text(about | {"bundle": bundle})} | named


def difference(config: Keys, shipped: Keys) -> str:
    """The first key in which two LiDARs cast other rays or return other points, else nothing."""
    own, other = units_of(config), units_of(shipped)
    for key in ("name", "random_phase"):
        if config[key] != shipped[key]:
            return key
    if len(own) != len(other):
        return "bundle"
    pairs = list(zip(own, other, strict=True))
    return next((key for key in UNIT if any(a[key] != b[key] for a, b in pairs)), "")


def _part(config: Keys, unit: Keys, of: int, folder: Path) -> Keys:
    """A unit on its own, with its share of the price; relative paths become whole."""
    total = config["price_total_usd"]
    share = {
        "low": total["low"] / of,
        "high": total["high"] / of,
        "source": "the bundle",
        "date": "its own",
    }
    pattern = unit["pattern"]
    if "table" in pattern:
        file = (folder / pattern["table"]["file"]).resolve()
        pattern = {"table": pattern["table"] | {"file": str(file)}}
    return {
        "price_usd": config.get("price_usd", share),
        "pattern": pattern,
        "returns": unit["returns"],
    }


def _text(keys: Keys) -> str:
    return str(yaml.safe_dump(keys, sort_keys=False))
