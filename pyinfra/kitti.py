"""Readers of what `infrasim run` writes: one folder per LiDAR in the KITTI object layout.

All results are in the levelled LiDAR frame: metres and radians, x forward, y left, z up, origin at
the sensor. The camera frame of `label_2` exists only in this file.
"""

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, NoReturn

import numpy as np
import numpy.typing as npt
import yaml

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
Names = npt.NDArray[np.str_]

Part = Literal["velodyne", "fields", "objects", "label_2", "calib"]

SUFFIXES: dict[Part, str] = {
    "velodyne": ".bin",
    "fields": ".bin",
    "objects": ".csv",
    "label_2": ".txt",
    "calib": ".txt",
}
FIELDS = np.dtype(
    [("time_s", "<f4"), ("ring", "<u2"), ("class", "<u2"), ("object_id", "<i4")],
)
OBJECT_COLUMNS = (
    "id,class,x,y,z,dx,dy,dz,heading,speed,points,points_in_box,distance,visibility".split(",")
)
LABEL_COLUMNS = "type truncated occluded alpha x1 y1 x2 y2 h w l x y z rotation_y".split()

_YAML_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # ten times faster where it is


class FormatError(ValueError):
    """A file holds something else than its format allows: `file:line: found, allowed`."""


@dataclass(frozen=True, eq=False)
class Objects:
    """The k vehicles in reach of a LiDAR in one frame, hit or not."""

    ids: IntArray  # (k,)
    names: Names  # (k,) class
    boxes: FloatArray  # (k, 7) x y z dx dy dz heading
    speed: FloatArray  # (k,) m/s
    points: IntArray  # (k,) returns from the vehicle
    points_in_box: IntArray  # (k,) those of them that lie in its box
    distance: FloatArray  # (k,) horizontal, sensor to box centre
    visibility: FloatArray  # (k,) [0, 1]; -1 outside the evaluation region

    def __len__(self) -> int:
        return len(self.ids)


@dataclass(frozen=True, eq=False)
class Labels:
    """The k boxes of a label or prediction file."""

    names: Names  # (k,) class
    boxes: FloatArray  # (k, 7) x y z dx dy dz heading
    scores: FloatArray | None  # (k,); None for labels

    def __len__(self) -> int:
        return len(self.names)


@dataclass(frozen=True)
class WorldPose:
    """T_world_levelled: where a levelled LiDAR stands in the world."""

    x: float
    y: float
    z: float
    yaw: float


@dataclass(frozen=True)
class FieldOfView:
    """What one unit of a LiDAR can see, in the unit's own frame, which is turned by `yaw` and
    then tilted by `pitch` (positive looks down) in the sensor's frame."""

    yaw: float
    pitch: float
    azimuth: tuple[float, float]
    elevation: tuple[float, float]
    range_m: tuple[float, float]


@dataclass(frozen=True)
class Lidar:
    """What `lidar.yaml` says of the LiDAR that took the frames beside it; angles in radians."""

    name: str
    model: str
    preset: str
    price_usd: tuple[float, float]  # low, high; the sum over the units
    period_s: float
    T_world_levelled: WorldPose
    field_of_view: tuple[FieldOfView, ...]  # one per unit


def frame_file(lidar_folder: Path, part: Part, frame: int) -> Path:
    """Where a part of a frame lies, whether it exists or not."""
    return lidar_folder / "training" / part / f"{frame:06d}{SUFFIXES[part]}"


def frames(lidar_folder: Path) -> list[int]:
    """The frames of a LiDAR, ascending; a frame exists if and only if its .bin does.

    Raises FileNotFoundError if the folder has no training/velodyne.
    """
    names = (path.name for path in (lidar_folder / "training/velodyne").iterdir())
    return sorted(int(name[:-4]) for name in names if re.fullmatch(r"\d{6,}\.bin", name))


def read_points(file: Path) -> npt.NDArray[np.float32]:
    """Returns of one frame: (n, 4) float32, x y z intensity, intensity in [0, 1].

    Raises FormatError if the file is cut short or a value is not finite.
    """
    points = _records(file, np.dtype(("<f4", 4)), "x y z intensity, float32")
    bad = np.flatnonzero(~np.isfinite(points).all(axis=1))
    if len(bad) > 0:
        raise FormatError(f"{file}: point {bad[0]}: found {points[bad[0]]}, allowed finite values")
    return points


def read_fields(file: Path) -> npt.NDArray[np.void]:
    """What else is known of each return, in the order of velodyne: (n,) records of FIELDS.

    time_s: since the start of the frame; ring: 0 at the lowest elevation; class: of the object or
    of the background's material; object_id: -1 for background.
    Raises FormatError if the file is cut short.
    """
    return _records(file, FIELDS, "time_s ring class object_id")


def read_objects(file: Path) -> Objects:
    """The vehicles of one frame; a frame without vehicles gives k = 0.

    Raises FormatError with file and line.
    """
    lines = _lines(file)
    header = lines[0] if lines else ""
    if header != ",".join(OBJECT_COLUMNS):
        raise FormatError(f"{file}:1: found '{header}', allowed '{','.join(OBJECT_COLUMNS)}'")
    rows = [line.split(",") for line in lines[1:]]
    table = _Table(file, 2, rows, OBJECT_COLUMNS, "class")
    table.check(["dx", "dy", "dz"], lambda v: v > 0, "more than 0")
    table.check(["id"], lambda v: v == np.floor(v), "a whole number")
    table.check(
        ["points", "points_in_box"],
        lambda v: (v >= 0) & (v == np.floor(v)),
        "a whole number from 0",
    )
    table.check(["visibility"], lambda v: (v == -1) | ((v >= 0) & (v <= 1)), "0 to 1, or -1")
    return Objects(
        ids=table["id"].astype(np.int64),
        names=table.names,
        boxes=np.stack([table[c] for c in OBJECT_COLUMNS[2:9]], axis=1),
        speed=table["speed"],
        points=table["points"].astype(np.int64),
        points_in_box=table["points_in_box"].astype(np.int64),
        distance=table["distance"],
        visibility=table["visibility"],
    )


def read_labels(file: Path, *, scores: bool = False) -> Labels:
    """The boxes of a label file, or with `scores` of a prediction file, in the LiDAR frame.

    The file's camera stands at the sensor and looks along x, as `infrasim run` writes it; other
    calibrations are not read. DontCare regions are left out; an empty file gives k = 0.
    Raises FormatError with file and line, also for scores in a label file and none in predictions.
    """
    columns = [*LABEL_COLUMNS, "score"] if scores else LABEL_COLUMNS
    table = _Table(file, 1, [line.split() for line in _lines(file)], columns, "type")
    keep = table.names != "DontCare"
    table.check(["h", "w", "l"], lambda v: (v > 0) | ~keep, "more than 0")
    height = table["h"]
    heading = _wrap(-table["rotation_y"] - math.pi / 2)
    # Camera x right, y down, z forward; its location is the middle of the bottom face.
    centre = [table["z"], -table["x"], height / 2 - table["y"]]
    boxes = np.stack([*centre, table["l"], table["w"], height, heading], axis=1)
    return Labels(table.names[keep], boxes[keep], table["score"][keep] if scores else None)


def read_lidar(lidar_folder: Path) -> Lidar:
    """What the run wrote about the LiDAR of a folder; keys that are not needed are left alone.

    Raises FormatError with file and line.
    """
    file = lidar_folder / "lidar.yaml"
    try:
        root = yaml.compose("\n".join(_lines(file)), Loader=_YAML_LOADER)
    except yaml.MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark else 1
        raise FormatError(f"{file}:{line}: is not YAML: {error.problem}") from None
    top = _Yaml(file, root, "")
    world = top.at("T_world_levelled")
    price = top.at("price_total_usd")
    return Lidar(
        name=top.at("name").text(),
        model=top.at("model").text(),
        preset=top.at("preset").text(),
        price_usd=(price.at("low").number(), price.at("high").number()),
        period_s=top.at("period_s").number(),
        T_world_levelled=WorldPose(
            x=world.at("x_m").number(),
            y=world.at("y_m").number(),
            z=world.at("z_m").number(),
            yaw=math.radians(world.at("yaw_deg").number()),
        ),
        field_of_view=tuple(
            FieldOfView(
                yaw=math.radians(unit.at("yaw_deg").number()),
                pitch=math.radians(unit.at("pitch_deg").number()),
                azimuth=_radians(unit.at("azimuth_deg").interval()),
                elevation=_radians(unit.at("elevation_deg").interval()),
                range_m=unit.at("range_m").interval(),
            )
            for unit in top.at("field_of_view").items()
        ),
    )


def _records(file: Path, record: np.dtype[Any], what: str) -> npt.NDArray[Any]:
    size = file.stat().st_size
    if size % record.itemsize != 0:
        raise FormatError(
            f"{file}: found {size} bytes, allowed a multiple of {record.itemsize} ({what})"
        )
    return np.fromfile(file, dtype=record)


def _lines(file: Path) -> list[str]:
    try:
        return file.read_text(encoding="utf-8").splitlines()
    except UnicodeDecodeError as error:
        raise FormatError(f"{file}: found byte {error.start} that is not UTF-8") from None


def _wrap(angle: FloatArray) -> FloatArray:
    """The same angle in [-pi, pi)."""
    wrapped: FloatArray = (angle + math.pi) % (2 * math.pi) - math.pi
    return wrapped


def _radians(pair: tuple[float, float]) -> tuple[float, float]:
    return math.radians(pair[0]), math.radians(pair[1])


class _Table:
    """Rows of numbers with one column of names; errors name file, line and column."""

    def __init__(
        self,
        file: Path,
        first_line: int,
        rows: Sequence[Sequence[str]],
        columns: Sequence[str],
        name_column: str,
    ) -> None:
        self.file, self.first_line = file, first_line
        self.columns = [c for c in columns if c != name_column]
        at = columns.index(name_column)
        for i, row in enumerate(rows):
            if len(row) != len(columns):
                self._fail(i, f"found {len(row)} columns", f"{len(columns)}: {' '.join(columns)}")
            if not row[at]:
                self._fail(i, f"{name_column}: found nothing", "a name")
        self.names: Names = np.array([row[at] for row in rows], dtype=np.str_)
        cells = [[*row[:at], *row[at + 1 :]] for row in rows]
        try:
            values = np.array(cells, dtype=np.float64).reshape(len(rows), len(self.columns))
        except ValueError:
            self._fail_at_word(cells)
        self.values: FloatArray = values
        self.check(self.columns, np.isfinite, "a finite number")

    def __getitem__(self, column: str) -> FloatArray:
        return self.values[:, self.columns.index(column)]

    def check(
        self, columns: Sequence[str], ok: Callable[[FloatArray], npt.NDArray[np.bool_]], rule: str
    ) -> None:
        for column in columns:
            bad = np.flatnonzero(~ok(self[column]))
            if len(bad) > 0:
                self._fail(int(bad[0]), f"{column}: found {self[column][bad[0]]:g}", rule)

    def _fail(self, row: int, found: str, allowed: str) -> NoReturn:
        raise FormatError(f"{self.file}:{self.first_line + row}: {found}, allowed {allowed}")

    def _fail_at_word(self, cells: Sequence[Sequence[str]]) -> NoReturn:
        for i, row in enumerate(cells):
            for column, cell in zip(self.columns, row, strict=True):
                try:
                    float(cell)
                except ValueError:
                    self._fail(i, f"{column}: found '{cell}'", "a number")
        raise AssertionError(cells)


class _Yaml:
    """A node of a YAML file that knows its place; errors name file, line and key."""

    def __init__(self, file: Path, node: yaml.Node | None, key: str) -> None:
        self.file, self.node, self.key = file, node, key

    def at(self, key: str) -> "_Yaml":
        path = f"{self.key}.{key}" if self.key else key
        if not isinstance(self.node, yaml.MappingNode):
            self._fail(f"found no mapping, allowed one with {key}")
        for name, node in self.node.value:
            if name.value == key:
                return _Yaml(self.file, node, path)
        self._fail(f"found no key '{key}', it is needed")

    def items(self) -> "list[_Yaml]":
        if not isinstance(self.node, yaml.SequenceNode) or not self.node.value:
            self._fail("found no list, allowed one with an entry or more")
        return [_Yaml(self.file, n, f"{self.key}[{i}]") for i, n in enumerate(self.node.value)]

    def text(self) -> str:
        if not isinstance(self.node, yaml.ScalarNode):
            self._fail("found a collection, allowed one value")
        return str(self.node.value)

    def number(self) -> float:
        text = self.text()
        try:
            return float(text.replace(".inf", "inf"))
        except ValueError:
            self._fail(f"found '{text}', allowed a number")

    def interval(self) -> tuple[float, float]:
        values = [item.number() for item in self.items()]
        if len(values) != 2 or values[0] > values[1]:
            self._fail(f"found {values}, allowed two numbers in ascending order")
        return values[0], values[1]

    def _fail(self, what: str) -> NoReturn:
        line = self.node.start_mark.line + 1 if self.node is not None else 1
        place = f"{self.file}:{line}: {self.key}: " if self.key else f"{self.file}:{line}: "
        raise FormatError(place + what)
