"""Summaries of LiDAR files: price, lines, field of view and range, resolved by the simulator."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from pyinfra.core.vocabulary import PRESETS
from pyinfra.dataset import catalogue
from pyinfra.dataset.runs import SimulatorError, infrasim

_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # CSafeLoader is faster

UNCONFIRMED = "unconfirmed"  # word in the source of a price that no vendor has confirmed


@dataclass(frozen=True)
class LidarSheet:
    """The summary of a LiDAR under one preset; NaN or None where the LiDAR cannot be resolved."""

    name: str
    model: str
    presets: tuple[str, ...]
    preset: str  # preset for which the following values hold
    price_low_usd: float
    price_high_usd: float
    price_source: str
    price_date: str
    lines: int | None = None  # number of scan lines; None for a pattern without lines or a bundle
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
    """Returns a text that describes the source of a bundle's price.

    The text contains UNCONFIRMED if the price of any unit is unconfirmed.
    """
    unsure = any(UNCONFIRMED in source for source in sources)
    return "sum of the units" + (f", {UNCONFIRMED}" if unsure else "")


def catalogue_files() -> list[Path]:
    """Returns the files of all LiDARs that the package ships."""
    return list(catalogue.shipped("lidars").values())


def presets_of(file: Path) -> tuple[str, ...]:
    """Returns the names of a LiDAR's presets. A bundle has the presets of its first unit."""
    return tuple(_plain(file)["presets"])


def price_source(file: Path) -> str:
    """Returns the source of a LiDAR's price; for a bundle, the sources of all its units."""
    return str(_plain(file)["price_source"])


def read_sheet(file: Path, preset: str = "", *, every_preset: bool = True) -> LidarSheet:
    """Returns a LiDAR's summary.

    preset: by default the first of `datasheet`, `equal` and `paper` that the LiDAR has.
    every_preset: whether to check all presets of the file, and not only the chosen preset.
    Raises SimulatorError if the LiDAR cannot be resolved. Raises FileNotFoundError if the file does
    not exist.
    """
    from pyinfra.dataset import simulation

    if every_preset:
        infrasim("check", file)  # raises an error that names the line of a wrong key
    plain = _plain(file)
    chosen = preset or _preset_of(plain["presets"])
    try:
        lidar = simulation.load_lidar(file, chosen or "datasheet")
        views = lidar.fields_of_view()
    except (simulation.ConfigError, simulation.IoError) as error:
        raise SimulatorError(str(error), 2) from None
    resolved = yaml.load(lidar.dump(), _LOADER)
    detection = _detection(resolved)
    return LidarSheet(
        **plain,
        preset=chosen,
        lines=_lines(resolved),
        horizontal_fov_deg=min(360.0, sum(round(view[1] - view[0], 2) for view in views)),
        vertical_fov_deg=max(round(view[3] - view[2], 2) for view in views),
        range_m=max(float(unit["returns"]["max_range_m"]) for unit in _units(resolved)),
        range_at_10_percent_m=float(detection.get("range_at_10_percent_m", math.nan)),
        published_ranges=1 + len(detection.get("further_ranges", ())) if detection else 0,
    )


def read_catalogue(preset: str = "") -> list[LidarSheet]:
    """Returns the summaries of all shipped LiDARs.

    If a LiDAR cannot be resolved, its `problem` states why; for example, a table is missing.
    """
    return [_read_or_say(file, preset) for file in catalogue_files()]


def _read_or_say(file: Path, preset: str) -> LidarSheet:
    try:
        return read_sheet(file, preset, every_preset=False)
    except SimulatorError as error:
        plain = _plain(file)
        return LidarSheet(
            **plain, preset=preset or _preset_of(plain["presets"]), problem=str(error)
        )


def _plain(file: Path) -> dict[str, Any]:
    """Returns name, model, presets and price of a LiDAR file, which no preset changes."""
    top = yaml.load(file.read_text(encoding="utf-8-sig"), _LOADER)
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


def _units(resolved: dict[str, Any]) -> list[dict[str, Any]]:
    return list(resolved.get("bundle") or [resolved])


def _lines(resolved: dict[str, Any]) -> int | None:
    channels = resolved.get("pattern", {}).get("spinning", {}).get("channels", {})
    return channels.get("count") or len(channels.get("table", ())) or None


def _detection(resolved: dict[str, Any]) -> dict[str, Any]:
    """Returns the keys of `returns.detection` of a LiDAR's first unit.

    Returns an empty dict if every ray that hits a surface gives a point.
    """
    return dict(_units(resolved)[0].get("returns", {}).get("detection", {}))
