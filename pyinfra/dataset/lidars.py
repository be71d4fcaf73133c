"""Summaries of LiDAR files: price, lines, field of view and range, resolved by the simulator."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from pyinfra.core.vocabulary import PRESETS
from pyinfra.dataset import catalogue
from pyinfra.dataset.runs import SimulatorError, infrasim
from pyinfra.formats import kitti

UNCONFIRMED = "unconfirmed"  # word in the source of a price that no vendor has confirmed


@dataclass(frozen=True)
class LidarSheet:
    """A LiDAR under one preset. Numbers are NaN or None if the LiDAR could not be resolved."""

    name: str
    model: str
    presets: tuple[str, ...]
    preset: str  # preset for which the following values hold
    price_low_usd: float
    price_high_usd: float
    price_source: str
    price_date: str
    lines: int | None = None  # None for a scan pattern without lines, and for a bundle
    horizontal_fov_deg: float = math.nan
    vertical_fov_deg: float = math.nan
    range_m: float = math.nan  # maximum range
    # Range at 10 % reflectance; NaN if the preset has none.
    range_at_10_percent_m: float = math.nan
    # Number of published ranges, for different reflectances and ambient light. It includes the
    # range at 10 %. If it is 1, the ranges at other reflectances are assumptions.
    published_ranges: int = 0
    problem: str = ""  # reason why the LiDAR could not be resolved


def sum_source(sources: Iterable[str]) -> str:
    """Returns the source of a bundle's price. It is unconfirmed if the price of a unit is."""
    unsure = any(UNCONFIRMED in source for source in sources)
    return "sum of the units" + (f", {UNCONFIRMED}" if unsure else "")


def catalogue_files() -> list[Path]:
    """Returns the files of all LiDARs that the package ships."""
    return sorted((catalogue.configs() / "lidars").glob("*.yaml"))


def presets_of(file: Path) -> tuple[str, ...]:
    """Returns the names of a LiDAR's presets. A bundle has the presets of its first unit."""
    presets: tuple[str, ...] = _plain(file)["presets"]
    return presets


def read_sheet(file: Path, preset: str = "") -> LidarSheet:
    """Returns a LiDAR's summary. The default preset is `datasheet` if the LiDAR has that preset.

    Raises SimulatorError if the LiDAR cannot be resolved, and FileNotFoundError if the file does
    not exist.
    """
    infrasim("check", file)  # raises an error that names the line of a wrong key
    plain = _plain(file)
    chosen = preset or _preset_of(plain["presets"])
    resolved = yaml.safe_load(infrasim("check", file, *(["--preset", chosen] if chosen else [])))
    units = _field_of_view(file, chosen)
    widths = [math.degrees(unit.azimuth[1] - unit.azimuth[0]) for unit in units]
    return LidarSheet(
        **plain,
        preset=chosen,
        lines=_lines(resolved),
        horizontal_fov_deg=min(360.0, sum(widths)),
        vertical_fov_deg=max(math.degrees(u.elevation[1] - u.elevation[0]) for u in units),
        range_m=max(unit.range_m[1] for unit in units),
        range_at_10_percent_m=float(_detection(resolved).get("range_at_10_percent_m", math.nan)),
        published_ranges=_published_ranges(_detection(resolved)),
    )


def read_catalogue(preset: str = "") -> list[LidarSheet]:
    """Returns the summaries of all shipped LiDARs.

    If a LiDAR cannot be resolved, its `problem` states why; for example, a table is missing.
    """
    return [_read_or_say(file, preset) for file in catalogue_files()]


def _read_or_say(file: Path, preset: str) -> LidarSheet:
    try:
        return read_sheet(file, preset)
    except SimulatorError as error:
        plain = _plain(file)
        return LidarSheet(
            **plain, preset=preset or _preset_of(plain["presets"]), problem=str(error)
        )


def _plain(file: Path) -> dict[str, Any]:
    """Returns the keys of a LiDAR file that depend on no preset: name, model, presets, price."""
    top = yaml.safe_load(file.read_text(encoding="utf-8"))
    units = [
        _plain(file.parent / unit["lidar"]) for unit in top.get("bundle", []) if "lidar" in unit
    ]
    price = top.get("price_usd") or {
        "low": sum(unit["price_low_usd"] for unit in units),
        "high": sum(unit["price_high_usd"] for unit in units),
        "source": sum_source(unit["price_source"] for unit in units),
    }
    return {
        "name": top["name"],
        "model": top.get("model", top["name"]),
        "presets": tuple(top.get("presets", units[0]["presets"] if units else ())),
        "price_low_usd": price["low"],
        "price_high_usd": price["high"],
        "price_source": price.get("source", ""),
        "price_date": str(price.get("date", "")),
    }


def _preset_of(presets: Sequence[str]) -> str:
    return next((name for name in reversed(PRESETS) if name in presets), "".join(presets[:1]))


def _field_of_view(file: Path, preset: str) -> tuple[kitti.FieldOfView, ...]:
    """Returns the field of view of each unit, as `infrasim run` writes it to lidar.yaml."""
    words = ["--preset", preset] if preset else []
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "data"
        scene = catalogue.scene_file(catalogue.FLAT)
        infrasim("run", scene, "--lidar", file, *words, "--frames", "0:1", "--out", out)
        (description,) = out.glob("*/lidar.yaml")
        return kitti.read_lidar(description.parent).field_of_view


def _lines(resolved: dict[str, Any]) -> int | None:
    channels = resolved.get("pattern", {}).get("spinning", {}).get("channels", {})
    return channels.get("count") or len(channels.get("table", ())) or None


def _detection(resolved: dict[str, Any]) -> dict[str, Any]:
    """Returns the detection keys of the first unit.

    Returns an empty dict if every ray that hits a surface gives a point.
    """
    detection = (resolved.get("bundle") or [resolved])[0].get("returns", {}).get("detection", {})
    return dict(detection)


def _published_ranges(detection: dict[str, Any]) -> int:
    return 1 + len(detection.get("further_ranges", ())) if detection else 0
