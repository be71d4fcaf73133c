"""Areas that the user draws: crossings, stop lines. They have a weight and a line in the answer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import yaml

from pyinfra.core.arrays import BoolArray, FloatArray
from pyinfra.core.errors import Error, FormatError
from pyinfra.core.names import suggestion
from pyinfra.dataset.roads import Road
from pyinfra.formats.csv_table import read_csv

CLASSES = ("vehicle", "person", "any")
CROSSINGS = "the crossings"
BESIDE_M = 10.0  # width beside a carriageway in which people walk
CROSSING_M = 6.0  # radius around the middle of a crossing of a map
ENDS = ("low", "high", "in_choice", "in_rain", "simulated")  # of columns of the plan's tables
COLUMNS = ("name", "x_m", "y_m", "radius_m")


@dataclass(frozen=True)
class Area:
    """A disc in the world frame, the objects that count in it, and their weight."""

    name: str
    x_m: float
    y_m: float
    radius_m: float
    weight: float = 1.0
    object_class: str = "any"

    def holds(self, objects: pd.DataFrame) -> BoolArray:
        """Returns which objects (columns x, y, person) count in the area: (n,)."""
        inside = np.hypot(objects.x - self.x_m, objects.y - self.y_m) <= self.radius_m
        if self.object_class == "any":
            return np.asarray(inside)
        return np.asarray(inside & (objects.person == (self.object_class == "person")))


def read_areas(file: Path) -> tuple[Area, ...]:
    """Reads areas from a CSV file.

    Columns: name, x_m, y_m, radius_m; optional weight (default 1) and class (vehicle, person or
    any, the default). Areas of one name are one area. Raises FormatError with file, line, column.
    """
    table = read_csv(file, {"name", "class"})
    for name in COLUMNS:
        if name not in table:
            raise FormatError(f"{file}:1: expected the column {name}, got {', '.join(table)}")
    for name in table:
        if name not in (*COLUMNS, "class", "weight"):
            near = suggestion(name, [*COLUMNS, "class", "weight"])
            raise FormatError(f"{file}:1: expected known columns, got '{name}'{near}")
    if table.empty:
        raise FormatError(f"{file}: expected one area or more, got none")
    names = [f"{name}_" for name in table["name"]]
    taken = {f"{stem}{end}" for stem in ("", *names) for end in ENDS}
    areas = []
    for row, one in enumerate(table.to_dict("records"), start=2):
        area = Area(
            str(one["name"]),
            float(one["x_m"]),
            float(one["y_m"]),
            float(one["radius_m"]),
            float(one.get("weight", 1.0)),
            str(one.get("class", "any")),
        )
        if not isinstance(one["name"], str):
            raise FormatError(f"{file}:{row}: name: expected a name, got none")
        if area.name in taken or area.name.startswith("within_"):
            raise FormatError(
                f"{file}:{row}: name: expected a name of which no other column of options.csv is "
                f"made, got '{area.name}'"
            )
        if not np.isfinite([area.x_m, area.y_m]).all():
            raise FormatError(f"{file}:{row}: x_m, y_m: expected numbers, got none")
        for key, low, value in (
            ("radius_m", 0.1, area.radius_m),
            ("weight", 0.0, area.weight),
        ):
            if not low <= value <= 1e4:
                raise FormatError(f"{file}:{row}: {key}: expected {low:g} to 10000, got {value:g}")
        if area.object_class not in CLASSES:
            raise FormatError(
                f"{file}:{row}: class: expected {', '.join(CLASSES)}, got '{area.object_class}'"
            )
        areas.append(area)
    return tuple(areas)


def check_on_roads(areas: tuple[Area, ...], roads: Sequence[Road]) -> None:
    """Raises Error for an area that is beside all roads of the evaluation region."""
    for area in areas:
        at = np.array([area.x_m, area.y_m])
        away = min(float((np.hypot(*(road.xy - at).T) - road.half_width).min()) for road in roads)
        if away > area.radius_m + BESIDE_M:
            raise Error(
                f"areas: expected areas in the evaluation region, got '{area.name}' at "
                f"({area.x_m:g}, {area.y_m:g}), {away:.0f} m from its nearest road"
            )


def crossings_of(folder: Path, weight: float) -> tuple[Area, ...]:
    """Returns the pedestrian crossings of an imported map as one area, for people.

    The result is empty without map.yaml. Raises FormatError.
    """
    file = folder / "map.yaml"
    if not file.is_file():
        return ()
    try:
        features = (yaml.safe_load(file.read_text(encoding="utf-8")) or {}).get("features") or {}
        return tuple(
            Area(CROSSINGS, float(one["x_m"]), float(one["y_m"]), CROSSING_M, weight, "person")
            for one in features.get("crossing", ())
        )
    except (yaml.YAMLError, AttributeError, KeyError, TypeError, ValueError) as error:
        raise FormatError(f"{file}: features: expected lists with x_m and y_m by kind") from error


def of_name(areas: tuple[Area, ...], name: str, objects: pd.DataFrame) -> BoolArray:
    """Returns which objects count in the areas of a name: (n,)."""
    return np.asarray(np.any([one.holds(objects) for one in areas if one.name == name], axis=0))


def weighted(objects: pd.DataFrame, weight: FloatArray, areas: tuple[Area, ...]) -> FloatArray:
    """Returns the weights of objects; in an area, the largest weight of the areas there."""
    out = weight.copy()
    inside = np.zeros(len(out), bool)
    for area in areas:
        here = area.holds(objects)
        out[here] = np.where(inside[here], np.maximum(out[here], area.weight), area.weight)
        inside |= here
    return out
