"""A data set that `infrasim run` wrote: what was simulated, its LiDARs and what they can see."""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml

from pyinfra import kitti
from pyinfra.arrays import BoolArray, FloatArray, IntArray

MIN_VISIBILITY = 0.2
FULL_CIRCLE_DEG = 359.0


@dataclass(frozen=True)
class Tilt:
    """T_levelled_sensor: how a sensor leans; a positive pitch looks down. Radians."""

    pitch: float
    roll: float


@dataclass(frozen=True)
class DataSet:
    """A folder that `infrasim run` wrote: what was simulated, its LiDARs and its frames."""

    folder: Path
    scene: str
    preset: str
    aggregation: str
    seed: int
    version: str
    lidars: tuple[kitti.Lidar, ...]  # by name
    tilts: tuple[Tilt, ...]  # one per LiDAR
    frames: tuple[int, ...]  # ascending, the same for every LiDAR

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(lidar.name for lidar in self.lidars)

    @property
    def period_s(self) -> float:
        return self.lidars[0].period_s

    def lidar_folder(self, name: str) -> Path:
        return self.folder / name


def read_data_set(folder: Path) -> DataSet:
    """What a data set holds, without its frames' contents.

    Raises FileNotFoundError if it is none, kitti.FormatError for a wrong file, and ValueError if
    it has no LiDAR or no frame, or if the LiDARs have different frames.
    """
    if not (folder / "dataset.yaml").is_file():
        raise FileNotFoundError(2, "No dataset.yaml in it, as `infrasim run` writes", str(folder))
    top = _mapping(folder / "dataset.yaml")
    files = sorted(folder.glob("*/lidar.yaml"))
    if not files:
        raise ValueError(f"{folder}: found no LiDAR, allowed a folder with a lidar.yaml or more")
    frames = [tuple(kitti.frames(file.parent)) for file in files]
    for file, own in zip(files, frames, strict=True):
        if own != frames[0]:
            raise ValueError(
                f"{folder}: {file.parent.name} has {len(own)} frames and {files[0].parent.name} "
                f"has {len(frames[0])}, or others; allowed the same frames for every LiDAR"
            )
    if not frames[0]:
        raise ValueError(f"{folder}: found no frame, allowed one or more")
    return DataSet(
        folder=folder,
        scene=_text(top, "name", folder),
        preset=_text(top, "preset", folder),
        aggregation=_text(top, "aggregation", folder),
        seed=int(_text(top, "seed", folder)),
        version=_text(top, "version", folder),
        lidars=tuple(kitti.read_lidar(file.parent) for file in files),
        tilts=tuple(sensor_tilt(file) for file in files),
        frames=frames[0],
    )


def field_of_view_mask(
    lidar: kitti.Lidar, tilt: Tilt, centre: FloatArray
) -> tuple[BoolArray, BoolArray]:
    """Which points a LiDAR can see at all, by any of its units.

    centre: (n, 3) levelled frame; returns (n,) inside the angles, and (n,) inside the angles and
    range (slant, from the sensor) of one unit.
    """
    angles = np.zeros(len(centre), dtype=np.bool_)
    ranges = np.zeros(len(centre), dtype=np.bool_)
    slant = np.linalg.norm(centre, axis=1)
    for unit in lidar.field_of_view:
        turned = centre @ _rotation(0, tilt.pitch, tilt.roll) @ _rotation(unit.yaw, unit.pitch, 0)
        azimuth = np.arctan2(turned[:, 1], turned[:, 0])
        elevation = np.arctan2(turned[:, 2], np.hypot(turned[:, 0], turned[:, 1]))
        low, high = unit.azimuth
        turn = (azimuth - low) % (2 * math.pi)
        inside = turn <= (high - low)
        if high - low >= math.radians(FULL_CIRCLE_DEG):
            inside = np.ones(len(centre), dtype=np.bool_)
        inside &= (elevation >= unit.elevation[0]) & (elevation <= unit.elevation[1])
        angles |= inside
        ranges |= inside & (slant >= unit.range_m[0]) & (slant <= unit.range_m[1])
    return angles, ranges


def road_level(data: DataSet, lidar: kitti.Lidar) -> float:
    """z of the roads in the levelled frame, metres. Raises ValueError if they are not level."""
    file = data.folder / "roads.csv"
    header = file.read_text(encoding="utf-8").partition("\n")[0].split(",")
    z = np.loadtxt(file, delimiter=",", skiprows=1, usecols=header.index("z"), ndmin=1)
    if np.ptp(z) > 0.01:
        raise ValueError(f"{file}: found roads from z = {z.min():g} to {z.max():g}, allowed level")
    return float(z.mean()) - lidar.T_world_levelled.z


def read_owners(folder: Path, frame: int, count: int) -> IntArray:
    """object_id of each of the `count` returns of a frame, -1 for background: (count,).

    Raises FileNotFoundError without `fields`, and FormatError if there are more or less of them.
    """
    file = kitti.frame_file(folder, "fields", frame)
    owner = kitti.read_fields(file)["object_id"].astype(np.int64)
    if len(owner) != count:
        raise kitti.FormatError(
            f"{file}: found {len(owner)} records, allowed one for each of {count} points"
        )
    return owner


def _rotation(yaw: float, pitch: float, roll: float) -> FloatArray:
    """Yaw about z, then pitch about the new y, then roll about the new x: (3, 3)."""
    cy, sy = math.cos(yaw), math.sin(yaw)
    cp, sp = math.cos(pitch), math.sin(pitch)
    cr, sr = math.cos(roll), math.sin(roll)
    about_z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    about_y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    about_x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    return np.asarray(about_z @ about_y @ about_x, dtype=np.float64)


def _mapping(file: Path) -> dict[str, object]:
    try:
        found = yaml.safe_load(file.read_text(encoding="utf-8"))
    except yaml.YAMLError as error:
        raise kitti.FormatError(f"{file}: {' '.join(str(error).split())}") from None
    if not isinstance(found, dict):
        raise kitti.FormatError(f"{file}:1: found no mapping, allowed keys and values")
    return found


def _text(top: dict[str, object], key: str, folder: Path) -> str:
    if key not in top:
        raise kitti.FormatError(f"{folder / 'dataset.yaml'}:1: found no key '{key}', it is needed")
    return str(top[key])


def sensor_tilt(file: Path) -> Tilt:
    sensor = _mapping(file).get("T_levelled_sensor")
    if not isinstance(sensor, dict):
        raise kitti.FormatError(f"{file}:1: found no key 'T_levelled_sensor', it is needed")
    return Tilt(math.radians(sensor["pitch_deg"]), math.radians(sensor["roll_deg"]))
