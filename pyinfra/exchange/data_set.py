"""Writes a recording as one LiDAR of a data set, in the layout of `infrasim run`.

A recording has no scene, so roads.csv and trajectories.csv are missing. docs/own_data.md describes
what each command does in this case.
"""

import csv
import io
import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field, replace
from hashlib import sha256
from pathlib import Path

import numpy as np
import yaml
from scipy.spatial.transform import Rotation

from pyinfra.core.arrays import BoolArray, FloatArray, NameArray, Points, Records
from pyinfra.core.boxes import points_in_boxes
from pyinfra.core.errors import Error, FormatError
from pyinfra.core.files import write
from pyinfra.core.version import __version__
from pyinfra.core.vocabulary import VEHICLE_TYPES
from pyinfra.dataset.frames import PERIOD_S, lidars_in
from pyinfra.dataset.health import HEALTH_FILE, write_health
from pyinfra.exchange.import_summary import ImportSummary
from pyinfra.exchange.object_types import types_of
from pyinfra.exchange.recording import Boxes, RecordedFrame, Recording, write_splits
from pyinfra.formats import kitti
from pyinfra.formats.csv_table import plain_cell
from pyinfra.formats.kitti import RECORDED, Labels, Objects, RoadShape, WorldPose

HEIGHT_OFF_M = 0.5  # tolerated difference between the pose's z and the height above vehicle bottoms
SEEN = 1.0  # visibility of a labelled object if the recording states none


@dataclass(frozen=True)
class LidarFacts:
    """Properties of the LiDAR that the user set or that were estimated. None means unknown."""

    name: str
    scene: str
    model: str | None = None
    price_usd: tuple[float, float] | None = None
    period_s: float | None = None
    height_m: float | None = None  # height of the sensor above the road
    tilt: tuple[float, float] | None = None  # pitch (positive is downwards) and roll, radians
    shape: RoadShape | None = None  # road shape, if the road is not a plane
    types: Mapping[str, str] = field(default_factory=dict)
    assumed: tuple[str, ...] = ()  # texts that describe all assumptions
    not_read: tuple[str, ...] = ()  # files and folders of the recording that are not read


def write_lidar(
    recording: Recording,
    out: Path,
    facts: LidarFacts,
    indices: Iterable[int] | None = None,
    *,
    strict: bool = False,
    skip_bad: bool = False,
) -> ImportSummary:
    """Writes frames, ImageSets and lidar.yaml to the folder `out`, and returns a summary.

    `indices` are the positions in the recording of the frames to write; the default is all. Objects
    that cannot be read are left out and counted; with `strict`, they raise FormatError. Raises the
    errors of reading the frames; with `skip_bad`, such frames are left out and counted. Raises
    Error if both `recording` and `facts` have a tilt, or
    if no frame has a return.
    """
    if facts.tilt and recording.tilt:
        raise Error("tilt_deg: the recording states the tilt; leave `tilt_deg` out")
    tilt = recording.tilt or facts.tilt or (0.0, 0.0)
    T_levelled_sensor = Rotation.from_euler("ZYX", [0, *tilt]).as_matrix()
    numbers = recording.numbers()
    summary = ImportSummary(assumed=facts.assumed)
    digests: set[bytes] = set()
    summary.monitor.period_s = facts.period_s or recording.period_s or PERIOD_S
    for i in range(len(numbers)) if indices is None else indices:
        try:
            frame = recording.read(i)
        except FormatError as error:
            if not skip_bad:
                raise FormatError(f"{error}; `skip_bad` leaves out such frames") from None
            summary.bad.append(f"frame {recording.names[i]}: {error}")
            continue
        if strict and frame.boxes.left_out:
            raise FormatError(frame.boxes.left_out[0])
        summary.left_out += frame.boxes.left_out
        summary.unread_keys |= frame.boxes.unread
        digest = sha256(frame.points.tobytes()).digest()
        if digest in digests and len(frame.points) > 0:
            summary.doubled.append(recording.names[i])
            if not recording.labelled:
                continue
        digests.add(digest)
        if facts.tilt:
            frame = levelled(frame, T_levelled_sensor)
        before = summary.points
        _write_frame(out, numbers[i], frame, facts, summary, T_levelled_sensor)
        if summary.points == before:
            summary.empty.append(recording.names[i])
    if summary.points == 0:
        first = recording.reads[0] if recording.reads else "frames"
        bad = f"; {summary.bad[0]}" if summary.bad else ""
        raise Error(f"{first}: expected one or more returns in the recording, got none{bad}")
    _write_lists(out, recording, numbers)
    summary.not_read = [*facts.not_read, *recording.unread_parts()]
    if summary.unread_keys:
        summary.not_read.append(f"keys of labels: {', '.join(sorted(summary.unread_keys))}")
    pose = _pose(recording, facts, summary)
    write(out / "lidar.yaml", _lidar_yaml(pose, facts, summary, tilt))
    summary.health = summary.monitor.report()
    if summary.health:
        write_health(out / HEALTH_FILE, summary.health)
    return summary


def write_description(data: Path, scene: str, tracks_sha256: str, *, tracked: bool = False) -> None:
    """Writes dataset.yaml, unless the data set already has a LiDAR.

    `tracks_sha256` is that of `Recording`. tracked: whether ids identify tracks even if there is no
    digest. Raises Error if the data set has a LiDAR and the
    new LiDAR cannot be added. This is the case if the data set is simulated, or if the LiDARs do
    not share the ids of tracks.
    """
    file = data / "dataset.yaml"
    if file.exists() and lidars_in(data):
        tracks = kitti.read_yaml(file).maybe("tracks_sha256")
        if tracks is None or tracks.text() != tracks_sha256:
            raise Error(
                f"{data}: expected a new folder, or a data set with the same track ids as this "
                "recording, got a data set without these track ids"
            )
        return
    lines = {
        "name": scene,
        "preset": RECORDED,
        "aggregation": RECORDED,
        "seed": 0,
        "version": __version__,
        "ids": "tracks" if tracks_sha256 or tracked else "unknown",
    }
    if tracks_sha256:
        lines["tracks_sha256"] = tracks_sha256
    write(file, yaml.safe_dump(lines, sort_keys=False))


def levelled(frame: RecordedFrame, T_levelled_sensor: FloatArray) -> RecordedFrame:
    """Rotates points and boxes of a tilted sensor to the levelled frame. Boxes become upright."""
    points = frame.points.copy()
    points[:, :3] = points[:, :3] @ T_levelled_sensor.T.astype(np.float32)
    b = frame.boxes
    boxes = b.boxes.copy()
    boxes[:, :3] = boxes[:, :3] @ T_levelled_sensor.T
    ahead = np.column_stack([np.cos(boxes[:, 6]), np.sin(boxes[:, 6]), np.zeros(len(boxes))])
    ahead = ahead @ T_levelled_sensor.T
    boxes[:, 6] = np.arctan2(ahead[:, 1], ahead[:, 0])
    return RecordedFrame(points, replace(b, boxes=boxes), frame.fields)


def upright(recording: Recording, tilt: tuple[float, float] | None) -> Recording:
    """Returns the recording in the levelled frame. tilt: pitch and roll of the sensor, or None."""
    if tilt is None:
        return recording
    T_levelled_sensor = Rotation.from_euler("ZYX", [0, *tilt]).as_matrix()
    read = recording.read
    return replace(recording, read=lambda i: levelled(read(i), T_levelled_sensor), tilt=tilt)


def _write_frame(
    out: Path,
    number: int,
    frame: RecordedFrame,
    facts: LidarFacts,
    summary: ImportSummary,
    T_levelled_sensor: FloatArray,
) -> None:
    keep = has_return(frame.points)
    points = np.ascontiguousarray(frame.points[keep], dtype=np.float32)
    dark = ~np.isfinite(points[:, 3])
    points[dark, 3] = 0
    summary.without_intensity += int(dark.sum())
    fields = None if frame.fields is None else frame.fields[keep]
    types = types_of(frame.boxes.names, facts.types)
    labels = Labels(types, frame.boxes.boxes, None)
    boxes = frame.boxes if fields is None else with_ids(frame.boxes, points, fields)
    objects = objects_of(points, boxes, types, summary.monitor.period_s)
    kitti.write_frame(out, number, points, labels, objects=objects, fields=fields)
    summary.frames += 1
    summary.points += len(points)
    summary.without_return += len(keep) - len(points)
    summary.types.update(types.tolist())
    summary.tracked += int((objects.ids >= 0).sum())
    vehicles = labels.boxes[np.isin(types, VEHICLE_TYPES)]
    summary.wide += int((vehicles[:, 3] < vehicles[:, 4]).sum())
    summary.bottoms.append(vehicles[:, 2] - vehicles[:, 5] / 2)
    summary.monitor.add(number, points, fields)
    summary.coverage.add(points[:, :3] @ T_levelled_sensor.astype(np.float32))


def has_return(points: Points) -> BoolArray:
    """Returns (n,) whether each point (n, 4) is a return, that is, finite and not 0 0 0."""
    # Testing whether the sum is finite is ten times as fast as np.isfinite(...).all(axis=1).
    finite = np.isfinite(points[:, :3] @ np.ones(3, dtype=np.float32))
    x, y, z = points[:, 0], points[:, 1], points[:, 2]
    return np.asarray(finite & ((x != 0) | (y != 0) | (z != 0)))


def objects_of(points: Points, boxes: Boxes, types: NameArray, period_s: float) -> Objects:
    """Returns the labelled objects, with the number of points in their boxes.

    Annotators draw boxes around the points, so the boxes show the objects at scan time. The scan
    time is unknown, so the boxes are also used as the boxes at mid-frame. Recordings do not state
    which point belongs to which object, so all counts are the number of points in the box. The
    speed is unknown and written as 0, and an unknown id as -1.
    """
    n = len(boxes)
    counts = points_in_boxes(points, boxes.boxes)
    return Objects(
        ids=np.full(n, -1) if boxes.ids is None else boxes.ids,
        names=types,
        boxes=boxes.boxes,
        speed=np.zeros(n),
        points=counts,
        points_in_box=counts,
        distance=np.hypot(boxes.boxes[:, 0], boxes.boxes[:, 1]),
        visibility=np.full(n, SEEN) if boxes.visibility is None else boxes.visibility,
        scan_boxes=boxes.boxes,
        scan_time_s=np.full(n, period_s / 2),
        points_in_scan_box=counts,
    )


def with_ids(boxes: Boxes, points: Points, fields: Records) -> Boxes:
    """Gives boxes without ids the ids that the points inside them have in `fields`.

    An id belongs to the box with most of its points, and a box has the id of most points. The ids
    of all other boxes are -1 (unknown). Boxes with ids are returned unchanged.
    """
    owners = np.unique(fields["object_id"][fields["object_id"] >= 0])
    if boxes.ids is not None or len(owners) == 0 or len(boxes) == 0:
        return boxes
    inside = [
        points_in_boxes(points[fields["object_id"] == owner], boxes.boxes) for owner in owners
    ]
    counts = np.stack(inside, axis=1)  # number of points of each owner in each box, (boxes, owners)
    best = counts.argmax(axis=1)
    k = np.arange(len(boxes))
    agreed = (counts.argmax(axis=0)[best] == k) & (counts[k, best] > 0)
    return replace(boxes, ids=np.where(agreed, owners[best].astype(np.int64), -1))


def _write_lists(out: Path, recording: Recording, numbers: tuple[int, ...]) -> None:
    """Writes the recording's ImageSets, and sources.csv with the source name of each frame."""
    written = set(kitti.frames(out))
    of_name = dict(zip(recording.names, numbers, strict=True))
    splits = {part: {of_name[name] for name in names} for part, names in recording.splits.items()}
    present = {part: sorted(written & numbers) for part, numbers in splits.items()}
    write_splits(out / "ImageSets", present)
    rows = [(n, plain_cell(name)) for name, n in of_name.items() if n in written]
    table = io.StringIO()
    csv.writer(table, lineterminator="\n").writerows([("frame", "source"), *rows])
    write(out / "sources.csv", table.getvalue())


def _lidar_yaml(
    pose: WorldPose, facts: LidarFacts, summary: ImportSummary, tilt: tuple[float, float]
) -> str:
    view = summary.coverage.measured()
    low, high = facts.price_usd or (math.nan, math.nan)
    degrees = [[round(math.degrees(v), 6) for v in pair] for pair in (view.azimuth, view.elevation)]
    content = {
        "name": facts.name,
        "model": facts.model or facts.name,
        "preset": RECORDED,
        "price_total_usd": {"low": low, "high": high},
        "label_time": "scan",
        "period_s": summary.monitor.period_s,
        "T_world_levelled": {
            "x_m": float(pose.x),
            "y_m": float(pose.y),
            "z_m": float(pose.z),
            "yaw_deg": math.degrees(pose.yaw),
        },
        "T_levelled_sensor": {
            "pitch_deg": math.degrees(tilt[0]),
            "roll_deg": math.degrees(tilt[1]),
        },
        "field_of_view": [
            {
                "yaw_deg": 0,
                "pitch_deg": 0,
                "azimuth_deg": degrees[0],
                "elevation_deg": degrees[1],
                "range_m": list(view.range_m),
            }
        ],
    }
    if facts.shape:
        content["road_shape"] = asdict(facts.shape)
    if summary.assumed:
        content["assumed"] = list(summary.assumed)
    if summary.not_read:
        content["not_read"] = summary.not_read
    return str(yaml.safe_dump(content, sort_keys=False, allow_unicode=True, width=1000))


def _pose(recording: Recording, facts: LidarFacts, summary: ImportSummary) -> WorldPose:
    """Returns the pose in the world, in which the road is at z = 0.

    The user's height above the road takes precedence over the recording's pose, and the pose over
    the height above the bottoms of the labelled vehicles. If z of the pose differs from the
    latter, for example because z counts from sea level, the latter is used and added to `assumed`.
    """
    below, height = summary.below_m, facts.height_m
    if recording.pose is None:
        return WorldPose(0.0, 0.0, round(below or 0.0, 3) if height is None else height, 0.0)
    z = recording.pose.z
    if height is None and below is not None and abs(below - z) > HEIGHT_OFF_M:
        height = below
        summary.assumed += (
            f"the sensor is at z = {z:.2f} m in the world of the recording, but the vehicles' "
            f"bottoms are {below:.2f} m below it: z is measured from the road",
        )
    return recording.pose if height is None else replace(recording.pose, z=round(height, 3))
