"""Reads the frames of a LiDAR's folder one by one for exports, and the provenance of the frames."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import yaml

from pyinfra.core.arrays import Points, Records
from pyinfra.core.boxes import points_in_boxes
from pyinfra.core.errors import Error, FormatError
from pyinfra.core.files import resolved, write
from pyinfra.core.vocabulary import LabelTime
from pyinfra.dataset.data_set import ids_are_tracks
from pyinfra.dataset.frame_readers import read_cameras, track_ids
from pyinfra.dataset.frames import PERIOD_S
from pyinfra.exchange.recording import records_of
from pyinfra.formats import kitti
from pyinfra.formats.kitti import Objects

NEW_IDS = 2**30  # first new id for objects without an id, if ids identify tracks
# Keys of dataset.yaml that are part of the provenance.
_KEYS = ("name", "preset", "aggregation", "label_time", "seed", "version")


@dataclass(frozen=True)
class FrameSeries:
    """Properties that all frames of a LiDAR's folder share."""

    lidar_folder: Path
    lidar: str
    scene: str
    provenance: dict[str, str]  # keys of dataset.yaml; empty if there is no dataset.yaml
    ids_are_tracks: bool  # whether an object has the same id in all frames
    period_s: float
    label_time: LabelTime
    T_world_lidar: kitti.WorldPose  # LiDAR pose; the identity if there is no lidar.yaml


@dataclass(frozen=True, eq=False)
class StoredFrame:
    """One frame, in the levelled LiDAR frame."""

    number: int
    start_s: float  # start of the frame since the start of the run
    middle_s: float  # time of the boxes; with label time `scan`, it is only approximate
    points: Points  # (n, 4) x y z intensity
    fields: Records | None  # (n,) records of kitti.FIELDS; None if the folder has no `fields`
    objects: Objects  # objects with boxes and points_in_box at the label time


def read_series(lidar_folder: Path) -> FrameSeries:
    """Reads the properties of a folder in the KITTI layout. lidar.yaml is optional.

    Raises FormatError with file and line.
    """
    has_lidar = (lidar_folder / "lidar.yaml").is_file()
    lidar = kitti.read_lidar(lidar_folder) if has_lidar else None
    folder = resolved(lidar_folder)
    provenance = _provenance(folder.parent / "dataset.yaml")
    name = lidar.name if lidar else folder.name
    scene = provenance.get("name", folder.parent.name)
    for file, part in ((folder / "lidar.yaml", name), (folder.parent / "dataset.yaml", scene)):
        if "/" in part:  # the name is used in file names
            raise FormatError(f"{file}: name: expected a name without '/', got '{part}'")
    has_objects = (folder / "training/objects").is_dir()
    return FrameSeries(
        lidar_folder=lidar_folder,
        lidar=name,
        scene=scene,
        provenance={key: provenance[key] for key in _KEYS if key in provenance},
        # Label files have no ids.
        ids_are_tracks=has_objects and ids_are_tracks(folder.parent),
        period_s=lidar.period_s if lidar else PERIOD_S,
        label_time=lidar.label_time if lidar else "frame",
        T_world_lidar=lidar.T_world_levelled if lidar else kitti.WorldPose(0, 0, 0, 0),
    )


def read_frames(series: FrameSeries, numbers: Sequence[int]) -> Iterator[StoredFrame]:
    """Yields the frames of ascending numbers, with one frame in memory at a time.

    If the folder has no `objects`, the boxes come from the labels. Their speed is NaN and their
    visibility is -1. Every box without an id gets a new one. Raises
    FileNotFoundError for an incomplete frame, FormatError, and Error if the numbers do not ascend.
    """
    folder, before = series.lidar_folder, -1
    named = NEW_IDS if series.ids_are_tracks else 0
    for number in numbers:
        if number <= before:
            raise Error(f"frames: expected ascending frame numbers, got {number} after {before}")
        points = kitti.read_points(kitti.frame_file(folder, "velodyne", number))
        objects = _boxes(series, number, points)
        unknown = objects.ids < 0
        ids = np.where(unknown, named + np.cumsum(unknown) - 1, objects.ids)
        named += int(unknown.sum())
        objects = replace(objects, ids=ids)
        yield StoredFrame(
            number=number,
            start_s=number * series.period_s,
            middle_s=(number + 0.5) * series.period_s,
            points=points,
            fields=read_fields(folder, number, len(points)),
            objects=objects,
        )
        before = number


def point_records(points: Points, fields: Records | None, names: Mapping[str, str]) -> Records:
    """Returns packed records (n,) of x, y, z, intensity, and the fields of the points if known.

    `names` maps the names of the records to those of kitti.FIELDS.
    """
    columns = dict(zip(("x", "y", "z", "intensity"), points.T, strict=True))
    if fields is not None:
        columns |= {name: fields[key] for name, key in names.items()}
    return records_of(columns)


def quaternion(yaw: float) -> tuple[float, float, float, float]:
    """Returns the quaternion x y z w of a rotation about +z."""
    return 0.0, 0.0, float(np.sin(yaw / 2)), float(np.cos(yaw / 2))


def nanoseconds(seconds: float) -> int:
    """Rounds seconds to whole nanoseconds, so that 0.3 s is exactly 300,000,000 ns."""
    return round(seconds * 1e9)


def copy_cloud(series: FrameSeries, number: int, to: Path) -> None:
    """Copies the .bin file of a frame unchanged."""
    write(to, kitti.frame_file(series.lidar_folder, "velodyne", number).read_bytes())


def _provenance(file: Path) -> dict[str, str]:
    if not file.is_file():
        return {}
    top = kitti.read_yaml(file).node
    if not isinstance(top, yaml.MappingNode):
        got = "a list or a text" if top else "an empty file"
        raise FormatError(f"{file}:1: expected keys with values, got {got}")
    return {k.value: v.value for k, v in top.value if isinstance(v, yaml.ScalarNode)}


def read_fields(folder: Path, number: int, count: int) -> Records | None:
    """Reads the fields of the points of a frame. Returns None if the folder has no `fields`.

    count: number of points. Raises FormatError if there are not as many records.
    """
    if not (folder / "training/fields").is_dir():
        return None
    file = kitti.frame_file(folder, "fields", number)
    return kitti.read_fields(file, count)


def _boxes(series: FrameSeries, number: int, points: Points) -> Objects:
    folder = series.lidar_folder
    if not (folder / "training/objects").is_dir():
        return _labels(series, number, points)
    objects = kitti.read_objects(kitti.frame_file(folder, "objects", number))
    objects = replace(objects, ids=track_ids(folder, objects.ids))
    if series.label_time == "frame":
        return objects
    return replace(objects, boxes=objects.scan_boxes, points_in_box=objects.points_in_scan_box)


def _labels(series: FrameSeries, number: int, points: Points) -> Objects:
    folder = series.lidar_folder
    camera = read_cameras(folder, [number]).different[0]
    labels = kitti.read_labels(kitti.frame_file(folder, "label_2", number), calibration=camera)
    k, boxes = len(labels), labels.boxes
    inside = points_in_boxes(points, boxes)
    return Objects(
        ids=np.full(k, -1),
        names=labels.names,
        boxes=boxes,
        speed=np.full(k, np.nan),
        points=inside,
        points_in_box=inside,
        distance=np.hypot(boxes[:, 0], boxes[:, 1]),
        visibility=np.full(k, -1.0),
        scan_boxes=boxes,
        scan_time_s=np.full(k, series.period_s / 2),
        points_in_scan_box=inside,
    )
