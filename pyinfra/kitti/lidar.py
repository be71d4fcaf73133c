"""`lidar.yaml`: what a run wrote about the LiDAR that took the frames beside it."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

import yaml

from pyinfra.config import compose
from pyinfra.kitti.layout import FormatError
from pyinfra.kitti.table import lines_of


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
    price_usd: tuple[float, float]  # low, high; the sum over the units; nan: not known
    period_s: float
    T_world_levelled: WorldPose
    field_of_view: tuple[FieldOfView, ...]  # one per unit


def read_lidar(lidar_folder: Path) -> Lidar:
    """What the run wrote about the LiDAR of a folder; keys that are not needed are left alone.

    Raises FormatError with file and line.
    """
    top = read_yaml(lidar_folder / "lidar.yaml")
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


def read_yaml(file: Path) -> "YamlNode":
    """The root of a YAML file that a run wrote. Raises FormatError with file and line."""
    try:
        root = compose("\n".join(lines_of(file)))
    except yaml.MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark else 1
        raise FormatError(f"{file}:{line}: is not YAML: {error.problem}") from None
    return YamlNode(file, root, "")


def _radians(pair: tuple[float, float]) -> tuple[float, float]:
    return math.radians(pair[0]), math.radians(pair[1])


class YamlNode:
    """A node of a YAML file that knows its place; errors name file, line and key."""

    def __init__(self, file: Path, node: yaml.Node | None, key: str) -> None:
        self.file, self.node, self.key = file, node, key

    def at(self, key: str) -> "YamlNode":
        path = f"{self.key}.{key}" if self.key else key
        if not isinstance(self.node, yaml.MappingNode):
            self._fail(f"found no mapping, allowed one with {key}")
        for name, node in self.node.value:
            if name.value == key:
                return YamlNode(self.file, node, path)
        self._fail(f"found no key '{key}', it is needed")

    def items(self) -> "list[YamlNode]":
        if not isinstance(self.node, yaml.SequenceNode) or not self.node.value:
            self._fail("found no list, allowed one with an entry or more")
        return [YamlNode(self.file, n, f"{self.key}[{i}]") for i, n in enumerate(self.node.value)]

    def entries(self, key: str) -> "list[YamlNode]":
        """The entries of a list; none if it is empty or not there."""
        node = self.node
        names = [name.value for name, _ in node.value] if isinstance(node, yaml.MappingNode) else []
        found = self.at(key) if key in names else None
        return found.items() if found and found.node and found.node.value else []

    def text(self) -> str:
        if not isinstance(self.node, yaml.ScalarNode):
            self._fail("found a collection, allowed one value")
        return str(self.node.value)

    def number(self) -> float:
        text = self.text()
        try:
            return float(text.replace(".inf", "inf").replace(".nan", "nan"))
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
