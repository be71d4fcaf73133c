"""`lidar.yaml`: what a run wrote about the LiDAR that took the frames beside it."""

import math
from dataclasses import dataclass, fields
from pathlib import Path
from typing import get_args

from pyinfra.core.vocabulary import LabelTime
from pyinfra.formats.kitti.layout import FARTHEST_M
from pyinfra.formats.yaml_file import YamlNode, parse_yaml, read_yaml

RECORDED = "recorded"  # preset of a LiDAR that was not simulated
PERIOD_S = (0.001, 60.0)  # of a frame, least and most
_EARTH_M = 1e8  # farther from the world's origin is nothing
_STEEP_M = 1e3  # a road's level, slopes and bends are less


@dataclass(frozen=True)
class WorldPose:
    """T_world_levelled: where a levelled LiDAR stands in the world."""

    x: float
    y: float
    z: float
    yaw: float


@dataclass(frozen=True)
class Tilt:
    """T_levelled_sensor: how a sensor leans; a positive pitch looks down. Radians."""

    pitch: float
    roll: float


@dataclass(frozen=True)
class RoadShape:
    """A recording's road: z = level + slopes times x, y + bends times x^2, x y, y^2.

    Levelled frame, metres; as far as `pyinfra.dataset.ground.shape_heights` follows it.
    """

    level_m: float
    slope_x: float
    slope_y: float
    bend_xx_per_m: float
    bend_xy_per_m: float
    bend_yy_per_m: float


@dataclass(frozen=True)
class SensorPose:
    """Where a sensor of a fused data set stands in its levelled frame. Metres, radians."""

    x: float
    y: float
    z: float
    yaw: float
    pitch: float
    roll: float


@dataclass(frozen=True)
class FieldOfView:
    """What one unit of a LiDAR can see, in the unit's own frame, which is turned by `yaw` and
    then tilted by `pitch` (positive looks down) in the sensor's frame."""

    yaw: float
    pitch: float
    azimuth: tuple[float, float]
    elevation: tuple[float, float]
    range_m: tuple[float, float]
    at: SensorPose | None = None  # None: the sensor stands at the origin and leans as all do


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
    label_time: LabelTime = "frame"  # when the labels hold

    @property
    def sensors(self) -> tuple[SensorPose, ...]:
        """Where they stand in the levelled frame: of a fused data set all, else one, its origin."""
        origin = SensorPose(0, 0, 0, 0, 0, 0)
        return tuple(dict.fromkeys(unit.at or origin for unit in self.field_of_view)) or (origin,)


def read_lidar(lidar_folder: Path) -> Lidar:
    """What the run wrote about the LiDAR of a folder; keys that are not needed are left alone.

    Raises FormatError with file and line.
    """
    return _lidar(read_yaml(lidar_folder / "lidar.yaml"))


def parse_lidar(text: str, name: str) -> tuple[Lidar, Tilt]:
    """The same from the text of a lidar.yaml, and how the sensor leans; name: for messages."""
    top = parse_yaml(text, name)
    return _lidar(top), _tilt(top)


def _lidar(top: YamlNode) -> Lidar:
    price = top.at("price_total_usd")
    low, high = (price.at(key).number(0, or_nan=True) for key in ("low", "high"))
    if low > high:
        price.fail(f"found low {low:g} above high {high:g}, allowed at most that")
    return Lidar(
        name=top.at("name").text(),
        model=top.at("model").text(),
        preset=top.at("preset").text(),
        price_usd=(low, high),
        period_s=top.at("period_s").number(*PERIOD_S),
        T_world_levelled=_pose(top.at("T_world_levelled")),
        label_time=_label_time(top),
        field_of_view=tuple(_view(unit) for unit in top.at("field_of_view").items()),
    )


def read_label_time(lidar_folder: Path) -> LabelTime:
    """When the labels of a folder hold; `frame` of one without lidar.yaml.

    Raises FormatError with file and line.
    """
    file = lidar_folder / "lidar.yaml"
    return _label_time(read_yaml(file)) if file.is_file() else "frame"


def read_tilt(lidar_folder: Path) -> Tilt:
    """How the sensor of a folder leans. Raises FormatError with file and line."""
    return _tilt(read_yaml(lidar_folder / "lidar.yaml"))


def _tilt(top: YamlNode) -> Tilt:
    sensor = top.at("T_levelled_sensor")
    pitch, roll = (sensor.at(key).number(-180, 180) for key in ("pitch_deg", "roll_deg"))
    return Tilt(math.radians(pitch), math.radians(roll))


def read_road_shape(lidar_folder: Path) -> RoadShape | None:
    """The road of a recording, if it was found to be no plane. Raises FormatError as read_tilt."""
    node = read_yaml(lidar_folder / "lidar.yaml").maybe("road_shape")
    if node is None:
        return None
    return RoadShape(
        *(node.at(field.name).number(-_STEEP_M, _STEEP_M) for field in fields(RoadShape))
    )


def _label_time(top: YamlNode) -> LabelTime:
    node = top.at("label_time")
    words: tuple[LabelTime, ...] = get_args(LabelTime)
    text = node.text()
    return next((word for word in words if word == text), None) or node.fail(
        f"found '{text[:40]}', allowed {' or '.join(words)}"
    )


def _pose(world: YamlNode) -> WorldPose:
    x, y, z = (world.at(key).number(-_EARTH_M, _EARTH_M) for key in ("x_m", "y_m", "z_m"))
    return WorldPose(x, y, z, math.radians(world.at("yaw_deg").number(-360, 360)))


def _view(unit: YamlNode) -> FieldOfView:
    return FieldOfView(
        yaw=math.radians(unit.at("yaw_deg").number(-360, 360)),
        pitch=math.radians(unit.at("pitch_deg").number(-180, 180)),
        azimuth=_radians(unit.at("azimuth_deg").interval(-720, 720)),
        elevation=_radians(unit.at("elevation_deg").interval(-90, 90)),
        range_m=unit.at("range_m").interval(0, FARTHEST_M),
        at=_sensor_pose(unit.maybe("at")),
    )


def _sensor_pose(at: YamlNode | None) -> SensorPose | None:
    if at is None:
        return None
    x, y, z = (at.at(key).number(-_EARTH_M, _EARTH_M) for key in ("x_m", "y_m", "z_m"))
    turns = (at.at(key).number(-360, 360) for key in ("yaw_deg", "pitch_deg", "roll_deg"))
    return SensorPose(x, y, z, *map(math.radians, turns))


def _radians(pair: tuple[float, float]) -> tuple[float, float]:
    return math.radians(pair[0]), math.radians(pair[1])
