"""Reads frames of one LiDAR for a viewer: points and boxes in the world frame."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from pyinfra.core.arrays import (
    Float32Array,
    FloatArray,
    Floats,
    Int32Array,
    IntArray,
    NameArray,
    Points,
    Records,
)
from pyinfra.core.progress import track
from pyinfra.core.vocabulary import KM_H
from pyinfra.dataset.frame_readers import read_cameras, read_predictions, read_vehicles
from pyinfra.dataset.frames import PERIOD_S
from pyinfra.dataset.ground import ground_of
from pyinfra.dataset.object_rows import BOX
from pyinfra.dataset.simulated_frames import SimulatedFrames
from pyinfra.dataset.world_frame import boxes_to_world, to_world
from pyinfra.formats import kitti
from pyinfra.formats.kitti import Labels, WorldPose
from pyinfra.metrics.prediction_checks import find_files
from pyinfra.tracking.table_file import read_tracks

TRAIL_S = 3.0  # length of the drawn path of a track


@dataclass(frozen=True, eq=False)
class ViewFrame:
    """One frame of one LiDAR; metres, radians, world frame."""

    frame: int
    period_s: float  # frame period; the frame starts at frame * period_s
    sensor: WorldPose
    points: Points  # (n, 3) x, y, z
    intensity: Float32Array  # (n,) intensity of each point, 0 to 1
    boxes: FloatArray  # (k, 7) boxes of the labelled objects
    names: NameArray  # (k,) class of each labelled object
    hits: IntArray | None  # (k,) returns from each object; None if only labels are known
    time_s: Float32Array | None = None  # (n,) time of each point from the start of the frame
    object_id: Int32Array | None = None  # (n,) object of each point; -1 for background
    predictions: Labels | None = None  # predicted boxes, world frame; None if there is no file
    trails: Sequence[FloatArray] = ()  # (n, 3) past positions of the predicted tracks
    road_z: float | None = None  # z of a recording's road at the sensor, world frame, if known


def read_view_frames(
    lidar_folder: Path, frames: Sequence[int], predictions: Path | None = None
) -> list[ViewFrame]:
    """Reads frames of a folder in the KITTI layout.

    If there is no lidar.yaml, the sensor is at the origin. Point times and object ids are known
    only if the frame has a `fields` file. predictions: folder of NNNNNN.txt or NNNNNN.csv, or a
    tracks.csv. Raises OSError and FormatError.
    """
    has_lidar = (lidar_folder / "lidar.yaml").is_file()
    lidar = kitti.read_lidar(lidar_folder) if has_lidar else None
    pose = lidar.T_world_levelled if lidar else WorldPose(0, 0, 0, 0)
    is_recorded = lidar is not None and lidar.preset == kitti.RECORDED
    ground = ground_of(lidar_folder) if is_recorded else None
    road_z = None if ground is None else float(ground.height(np.zeros((1, 3)))[0]) + pose.z
    vehicles = read_vehicles(lidar_folder, frames)
    counted = (lidar_folder / "training/objects").is_dir()
    tracks = read_tracks(predictions) if predictions and predictions.is_file() else None
    if tracks is not None:
        per_frame: list[Labels | None] = [_of_tracks(tracks, frame, pose) for frame in frames]
    else:
        per_frame = _predictions(lidar_folder, frames, predictions, pose)
    views = []
    for i, frame in enumerate(track(frames, "frame")):
        points = kitti.read_points(kitti.frame_file(lidar_folder, "velodyne", frame))
        in_frame = vehicles.select(vehicles.frame == i)
        fields = _fields(lidar_folder, frame, len(points))
        views.append(
            ViewFrame(
                frame=frame,
                period_s=lidar.period_s if lidar else PERIOD_S,
                sensor=pose,
                points=_in_world(points[:, :3], pose).astype(np.float32),
                intensity=points[:, 3],
                boxes=boxes_to_world(in_frame.boxes, pose),
                names=in_frame.names,
                hits=in_frame.points if counted else None,
                time_s=None if fields is None else fields["time_s"],
                object_id=None if fields is None else fields["object_id"],
                predictions=per_frame[i],
                trails=() if tracks is None else _trails(tracks, frame, pose),
                road_z=road_z,
            )
        )
    return views


def simulated_view(frames: SimulatedFrames, number: int) -> ViewFrame:
    """Returns a simulated frame."""
    frame, pose = frames.frame(number), frames.lidar.T_world_levelled
    labels = frame.labels
    return ViewFrame(
        frame=number,
        period_s=frames.period_s,
        sensor=pose,
        points=_in_world(frame.points[:, :3], pose).astype(np.float32),
        intensity=frame.points[:, 3],
        boxes=boxes_to_world(labels[BOX].to_numpy(float), pose),
        names=labels.type.to_numpy(str),
        hits=labels.points.to_numpy(np.int64),
    )


def _in_world(points: Floats, pose: WorldPose) -> FloatArray:
    exact = points.astype(np.float64)
    return np.column_stack([to_world(exact, pose), exact[:, 2] + pose.z])


def _fields(lidar_folder: Path, frame: int, points: int) -> Records | None:
    file = kitti.frame_file(lidar_folder, "fields", frame)
    return kitti.read_fields(file, points) if file.is_file() else None


def _of_tracks(tracks: pd.DataFrame, frame: int, pose: WorldPose) -> Labels:
    """Returns the tracks of a frame. A name is the class, the id and the speed."""
    part = tracks[tracks.frame == frame]
    columns = zip(part.type, part.id, part.speed_m_s, part.state, strict=True)
    names = [
        f"{kind} {number} at {KM_H * speed:.0f} km/h{'' if state == 'seen' else f' ({state})'}"
        for kind, number, speed, state in columns
    ]
    boxes = boxes_to_world(part[BOX].to_numpy(np.float64), pose)
    return Labels(np.array(names, dtype=str), boxes, part.score.to_numpy(np.float64))


def _trails(tracks: pd.DataFrame, frame: int, pose: WorldPose) -> list[FloatArray]:
    """Returns the positions of the last TRAIL_S of each track of a frame, world frame."""
    now = tracks[tracks.frame == frame]
    since = now.t_s.iloc[0] - TRAIL_S if len(now) else 0.0
    part = tracks[(tracks.frame <= frame) & (tracks.t_s >= since) & tracks.id.isin(now.id)]
    xyz = _in_world(part[["x", "y", "z"]].to_numpy(np.float64), pose)
    return [xyz[rows] for rows in part.groupby("id").indices.values() if len(rows) > 1]


def _predictions(
    lidar_folder: Path, frames: Sequence[int], folder: Path | None, pose: WorldPose
) -> list[Labels | None]:
    """Returns the predictions of each frame, None for a frame without a file."""
    if folder is None:
        return [None] * len(frames)
    known = kitti.frames(lidar_folder)
    files = find_files(folder, frames, known, lidar_folder=lidar_folder, allow_missing=True).files
    cameras = read_cameras(lidar_folder, frames)
    table = read_predictions(files, cameras)
    views: list[Labels | None] = []
    for i, file in enumerate(files):
        in_frame = table.select(table.frame == i)
        labels = Labels(in_frame.names, boxes_to_world(in_frame.boxes, pose), in_frame.scores)
        views.append(None if file is None else labels)
    return views
