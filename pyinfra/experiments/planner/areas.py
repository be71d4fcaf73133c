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
from pyinfra.dataset.roads import Road
from pyinfra.formats.csv_table import check_columns, expect, read_csv

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
    table = read_csv(file, {"name", "class"}, COLUMNS)
    check_columns(file, table, [*COLUMNS, "class", "weight"])
    if table.empty:
        raise FormatError(f"{file}: expected one area or more, got none")
    if "weight" not in table:
        table["weight"] = 1.0
    if "class" not in table:
        table["class"] = "any"
    table = table.astype(dict.fromkeys((*COLUMNS[1:], "weight"), float))
    name = table["name"]
    expect(file, name, name.notna(), "a name")
    taken = {f"{stem}{end}" for stem in ("", *(name + "_")) for end in ENDS}
    free = ~name.isin(taken) & ~name.str.startswith("within_")
    expect(file, name, free, "a name of which no other column of options.csv is made")
    for axis in ("x_m", "y_m"):
        expect(file, table[axis], np.isfinite(table[axis]), "a number")
    expect(file, table.radius_m, table.radius_m.between(0.1, 1e4), "0.1 to 10000")
    expect(file, table.weight, table.weight.between(0, 1e4), "0 to 10000")
    expect(file, table["class"], table["class"].isin(CLASSES), ", ".join(CLASSES))
    rows = table[[*COLUMNS, "weight", "class"]].itertuples(index=False, name=None)
    return tuple(Area(*row) for row in rows)


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


def weighted(
    objects: pd.DataFrame, near: BoolArray, people: float, areas: tuple[Area, ...]
) -> FloatArray:
    """Returns the weights of objects (n,): 1 for a vehicle that is near, `people` for a pedestrian.

    In an area it is the largest weight of the areas there.
    """
    out = np.asarray(np.where(objects.person, people, 1.0) * near)
    inside = np.zeros(len(out), bool)
    for area in areas:
        here = area.holds(objects)
        out[here] = np.where(inside[here], np.maximum(out[here], area.weight), area.weight)
        inside |= here
    return out
