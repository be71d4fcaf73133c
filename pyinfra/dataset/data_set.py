"""A data set folder of `infrasim run`: its scene, LiDARs, frames and fields of view."""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pyinfra.core.arrays import BoolArray, FloatArray, IntArray
from pyinfra.core.errors import Error, FormatError, not_found
from pyinfra.core.vocabulary import LabelTime
from pyinfra.dataset.frames import check_data_set, data_set_of, lidars_in
from pyinfra.dataset.outlines import OUTLINES_FILE
from pyinfra.dataset.roads import read_roads
from pyinfra.dataset.world_frame import rotation
from pyinfra.formats import kitti
from pyinfra.formats.kitti import Tilt

MIN_VISIBILITY = 0.2  # vehicles with a smaller visibility are not in the subsets `all` and `common`
FULL_CIRCLE_DEG = 359.0  # a field of view at least this wide contains all azimuths


@dataclass(frozen=True)
class DataSet:
    """The description of a data set folder of `infrasim run`, without the content of its frames."""

    folder: Path
    scene: str
    preset: str
    aggregation: str
    seed: int
    version: str
    lidars: tuple[kitti.Lidar, ...]  # LiDARs of the data set, sorted by name
    tilts: tuple[Tilt, ...]  # tilt of each LiDAR
    frames: tuple[int, ...]  # frame numbers, ascending; every LiDAR has the same frames

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(lidar.name for lidar in self.lidars)

    @property
    def label_time(self) -> LabelTime:
        return self.lidars[0].label_time

    @property
    def period_s(self) -> float:
        return self.lidars[0].period_s

    def lidar_folder(self, name: str) -> Path:
        return self.folder / name


def read_data_set(folder: Path) -> DataSet:
    """Reads the description of a data set, without the content of its frames.

    Raises FileNotFoundError if the folder has no dataset.yaml, and FormatError for a wrong file.
    Raises Error if there is no LiDAR or no frame, or if the LiDARs have different frames.
    """
    if not (folder / "dataset.yaml").is_file():
        check_data_set(folder)
        raise not_found(folder, "The folder has no dataset.yaml; `infrasim run` writes it")
    top = kitti.read_yaml(folder / "dataset.yaml")
    folders = lidars_in(folder)
    if not folders:
        raise Error(f"{folder}: expected folders with a lidar.yaml, got none")
    lidars, tilts = zip(*read_lidars(folder), strict=True)
    frames = [tuple(kitti.frames(path)) for path in folders]
    for lidar, numbers in zip(folders, frames, strict=True):
        if numbers != frames[0]:
            raise Error(
                f"{folder}: expected the same frames for every LiDAR, got {len(numbers)} frames of "
                f"{lidar.name} and {len(frames[0])} of {folders[0].name}"
            )
    if not frames[0]:
        raise Error(f"{folder}: expected one or more frames, got none")
    preset = top.at("preset")
    if preset.text() != lidars[0].preset:
        preset.fail(f"expected '{lidars[0].preset}' as in the LiDARs, got '{preset.text()}'")
    # The dataset.yaml of an imported recording has no `label_time`.
    declared, label_time = top.maybe("label_time"), lidars[0].label_time
    if declared is not None and declared.text() != label_time:
        declared.fail(f"expected '{label_time}' as in the LiDARs, got '{declared.text()}'")
    return DataSet(
        folder=folder,
        scene=top.at("name").text(),
        preset=preset.text(),
        aggregation=top.at("aggregation").text(),
        seed=top.at("seed").whole(2**64 - 1),
        version=top.at("version").text(),
        lidars=lidars,
        tilts=tilts,
        frames=frames[0],
    )


def read_lidars(folder: Path) -> tuple[tuple[kitti.Lidar, Tilt], ...]:
    """Reads the LiDARs of a data set and their tilts, sorted by folder name.

    All LiDARs must have the same preset, period and label time. Each LiDAR must have the name of
    its folder, and each folder with frames must have a lidar.yaml. Raises FormatError with file
    and line.
    """
    for frames in sorted(folder.glob("[!.]*/training/velodyne")):
        if not (file := frames.parents[1] / "lidar.yaml").is_file():
            raise FormatError(f"{file}: expected this file for each LiDAR of a data set, got none")
    folders = lidars_in(folder)
    lidars = tuple((kitti.read_lidar(path), kitti.read_tilt(path)) for path in folders)
    for path, (lidar, _) in zip(folders, lidars, strict=True):
        first, top = lidars[0][0], kitti.read_yaml(path / "lidar.yaml")
        allowed = {
            "name": path.name,
            "preset": first.preset,
            "period_s": first.period_s,
            "label_time": first.label_time,
        }
        for key, value in allowed.items():
            if getattr(lidar, key) != value:
                why = "the name of the folder" if key == "name" else f"as in {folders[0]}"
                top.at(key).fail(f"expected {value}, {why}, got {getattr(lidar, key)}")
    return lidars


def is_of_lanes(data_set: Path) -> bool:
    """Returns whether the scene has `lanes` from a file instead of roads. Raises FormatError."""
    description = data_set / "dataset.yaml"
    return description.is_file() and kitti.read_yaml(description).maybe("lanes") is not None


def ids_are_tracks(data_set: Path) -> bool:
    """Returns False if dataset.yaml states that object ids are no track numbers, else True.

    Raises FormatError.
    """
    description = data_set / "dataset.yaml"
    ids = kitti.read_yaml(description).maybe("ids") if description.is_file() else None
    return ids is None or ids.text() not in ("rows", "unknown")


def without_region(lidar_folder: Path) -> str | None:
    """Returns a message if a file that defines a folder's evaluation region is missing, else None.

    The file is lidar.yaml, roads.csv or regions.csv. A recording needs no roads.csv. A folder
    without lidar.yaml needs none of these files if its data set has no dataset.yaml.
    """
    file = lidar_folder / "lidar.yaml"
    data_set = data_set_of(lidar_folder)
    description, roads = data_set / "dataset.yaml", data_set / "roads.csv"
    if not file.is_file():
        if not description.is_file():
            return None
        return (
            f"{file}: expected this file of the data set, got none; the region is therefore unknown"
        )
    if roads.is_file():
        return _without_outlines(data_set)
    preset = kitti.read_yaml(file).at("preset")
    if preset.text() == kitti.RECORDED:
        return None
    return (
        f"{preset.location()}: expected the file {roads} for simulated frames, got none; without "
        "it, vehicles outside the evaluation region are included; copy the file from the original "
        "data set"
    )


def _without_outlines(data_set: Path) -> str | None:
    """Returns a message if the scene has region outlines but their file is missing, else None."""
    description, file = data_set / "dataset.yaml", data_set / OUTLINES_FILE
    named = kitti.read_yaml(description).maybe("regions") if description.is_file() else None
    if named is None or file.is_file():
        return None
    return (
        f"{named.location()}: expected the file {file} with the outlines, got none; copy it from "
        "the original data set"
    )


def field_of_view_mask(
    lidar: kitti.Lidar, tilt: Tilt, centre: FloatArray
) -> tuple[BoolArray, BoolArray]:
    """Tests which points are inside the field of view of at least one unit of a LiDAR.

    The points `centre` (n, 3) are in the levelled frame. Returns two masks (n,). The first is True
    for points within the angles of a unit. The second mask is True for points that are also within
    the slant range of the same unit.
    """
    angles = np.zeros(len(centre), dtype=np.bool_)
    ranges = np.zeros(len(centre), dtype=np.bool_)
    for unit in lidar.field_of_view:
        if at := unit.at:
            local = (centre - (at.x, at.y, at.z)) @ rotation(at.yaw, at.pitch, at.roll)
        else:
            local = centre @ rotation(0, tilt.pitch, tilt.roll)
        slant = np.linalg.norm(local, axis=1)
        turned = local @ rotation(unit.yaw, unit.pitch, 0)
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
    """Returns z of the roads in the levelled frame, metres. Raises Error if they are not level."""
    file = data.folder / "roads.csv"
    z = np.concatenate([road.z for road in read_roads(file)])
    if np.ptp(z) > 0.01:
        raise Error(f"{file}: expected level roads, got z from {z.min():g} to {z.max():g} m")
    return float(z.mean()) - lidar.T_world_levelled.z


def read_owners(folder: Path, frame: int, count: int) -> IntArray:
    """Returns the object_id (count,) of each point of a frame. The id of background is -1.

    Raises FileNotFoundError if `fields` has no file of the frame, and FormatError if the file does
    not have `count` records.
    """
    fields = kitti.read_fields(kitti.frame_file(folder, "fields", frame), count)
    return fields["object_id"].astype(np.int64)
