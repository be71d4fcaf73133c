"""Reads `lidar.yaml`, the description of a LiDAR in the folder of its frames."""

import math
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, get_args

from pyinfra.core.vocabulary import LabelTime
from pyinfra.formats.earlier_names import with_current_keys
from pyinfra.formats.kitti.layout import FARTHEST_M
from pyinfra.formats.yaml_file import YamlNode, parse_yaml, read_keys, read_yaml

RECORDED = "recorded"  # preset name of recordings, which were not simulated
PERIOD_S = (0.001, 60.0)  # minimum and maximum frame period, in seconds
_EARTH_M = 1e8  # largest coordinate in the world frame, in metres
_STEEP_M = 1e3  # largest absolute value of each coefficient of a road shape


@dataclass(frozen=True)
class WorldPose:
    """T_world_levelled: the pose of a levelled LiDAR in the world frame. Metres, radians."""

    x: float
    y: float
    z: float
    yaw: float


@dataclass(frozen=True)
class Tilt:
    """T_levelled_sensor: pitch (positive looks down) and roll of a sensor. Radians."""

    pitch: float
    roll: float


@dataclass(frozen=True)
class RoadShape:
    """The road surface of a recording: a quadratic polynomial in the levelled frame, metres.

    z = level_m + slope_x x + slope_y y + bend_xx x^2 + bend_xy x y + bend_yy y^2. Beyond a certain
    distance, `pyinfra.dataset.ground.shape_heights` continues the surface linearly.
    """

    level_m: float
    slope_x: float
    slope_y: float
    bend_xx_per_m: float
    bend_xy_per_m: float
    bend_yy_per_m: float


@dataclass(frozen=True)
class SensorPose:
    """The pose of one sensor of a fused data set in its levelled frame. Metres, radians."""

    x: float
    y: float
    z: float
    yaw: float
    pitch: float
    roll: float


@dataclass(frozen=True)
class FieldOfView:
    """The field of view of one unit of a LiDAR, in the unit's frame. Metres, radians.

    The unit is rotated in the sensor's frame by `yaw`, then by `pitch` (positive looks down).
    """

    yaw: float
    pitch: float
    azimuth: tuple[float, float]
    elevation: tuple[float, float]
    range_m: tuple[float, float]
    # Pose of this unit's sensor. None stands for the origin, with the tilt that all units share.
    at: SensorPose | None = None


@dataclass(frozen=True)
class Lidar:
    """The content of `lidar.yaml`, with angles in radians."""

    name: str
    model: str
    preset: str
    price_usd: tuple[float, float]  # lowest and highest total price of all units; NaN if unknown
    period_s: float
    T_world_levelled: WorldPose
    field_of_view: tuple[FieldOfView, ...]  # field of view of each unit
    label_time: LabelTime = "frame"  # instant at which the labels hold

    @property
    def sensors(self) -> tuple[SensorPose, ...]:
        """Returns the sensors' poses in the levelled frame.

        A fused data set has several sensors. Any other data set has one, at the origin.
        """
        origin = SensorPose(0, 0, 0, 0, 0, 0)
        return tuple(dict.fromkeys(unit.at or origin for unit in self.field_of_view)) or (origin,)


def read_written_keys(file: Path) -> dict[str, Any]:
    """Returns all keys of a `lidar.yaml` or `dataset.yaml`. Keys of 0.3 get their current names.

    Raises FormatError with file and line.
    """
    return {name: with_current_keys(value) for name, value in read_keys(file).items()}


def read_lidar(lidar_folder: Path) -> Lidar:
    """Reads the LiDAR description of a folder. Unknown keys are ignored.

    Raises FormatError with file and line.
    """
    return _lidar(read_yaml(lidar_folder / "lidar.yaml"))


def parse_lidar(text: str, name: str) -> tuple[Lidar, Tilt]:
    """Reads the LiDAR and the sensor's tilt from the text of a lidar.yaml.

    Messages show `name` in place of the file.
    """
    top = parse_yaml(text, name)
    return _lidar(top), _tilt(top)


def _lidar(top: YamlNode) -> Lidar:
    price = top.at("price_total_usd")
    low, high = (price.at(key).number(0, or_nan=True) for key in ("low", "high"))
    if low > high:
        price.fail(f"expected `low` to be at most `high`, got low {low:g} and high {high:g}")
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
    """Returns the label time of a folder. It is `frame` if the folder has no lidar.yaml.

    Raises FormatError with file and line.
    """
    file = lidar_folder / "lidar.yaml"
    return _label_time(read_yaml(file)) if file.is_file() else "frame"


def read_tilt(lidar_folder: Path) -> Tilt:
    """Reads the tilt of a folder's sensor. Raises FormatError with file and line."""
    return _tilt(read_yaml(lidar_folder / "lidar.yaml"))


def _tilt(top: YamlNode) -> Tilt:
    sensor = top.at("T_levelled_sensor")
    pitch, roll = (sensor.at(key).number(-180, 180) for key in ("pitch_deg", "roll_deg"))
    return Tilt(math.radians(pitch), math.radians(roll))


def read_road_shape(lidar_folder: Path) -> RoadShape | None:
    """Reads the road shape of a recording. Returns None if lidar.yaml has none.

    Raises FormatError with file and line.
    """
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
        f"expected {' or '.join(words)}, got '{text[:40]}'"
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
