"""Reads one LiDAR of a sequence of RCooper: data/SCENE/POLE/seq-N/lidar/TIME.pcd and labels.

The reader follows RCooper's public converters. Labels are in label(s)/SCENE/POLE/seq-N/TIME.json,
in the LiDAR's frame. calib/lidar2world/POLE.json contains the pose and tilt of the LiDAR.
"""

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from pyinfra.core.errors import FormatError
from pyinfra.core.files import resolved
from pyinfra.exchange.data_set import levelled
from pyinfra.exchange.json_boxes import read_json, read_objects, shown, track_digest
from pyinfra.exchange.nuscenes_tables import angles_of
from pyinfra.exchange.pcd import Clouds
from pyinfra.exchange.recording import (
    NO_BOXES,
    Options,
    RecordedFrame,
    Recording,
    check_pairs,
    sorted_files,
    stem,
)
from pyinfra.formats.kitti import WorldPose

LABELS = ("label", "labels")


def read(source: Path, options: Options) -> Recording:
    """Opens the folder of a sequence in data/SCENE/POLE.

    Raises FileNotFoundError, and Error for labels that do not pair with clouds. Reading a frame
    raises FormatError.
    """
    clouds = sorted_files(source / "lidar", [".pcd"])
    scene, pole, sequence = resolved(source).parts[-3:]
    top = resolved(source).parents[3]
    beside = (top / name / scene / pole / sequence for name in LABELS)
    folder = options.labels or next((path for path in beside if path.is_dir()), None)
    tracks = ""
    if folder is not None:
        labels = sorted_files(folder, [".json"])
        check_pairs(clouds, labels)
        tracks = track_digest(labels)
    names = tuple(stem(file) for file in clouds)
    pose, tilt = _pose(top / f"calib/lidar2world/{pole}.json")
    leaning = Rotation.from_euler("ZYX", [0, *(tilt or (0.0, 0.0))]).as_matrix()
    ids: dict[str, int] | None = {} if tracks else None
    contents = Clouds(clouds, options, labelled=folder is not None)

    def frame(i: int) -> RecordedFrame:
        boxes = read_objects(folder / f"{names[i]}.json", ids) if folder is not None else NO_BOXES
        recorded = contents.frame(i, boxes)
        return levelled(recorded, leaning) if tilt else recorded

    return Recording(
        names,
        frame,
        folder is not None,
        pose=pose,
        tilt=tilt,
        tracks_sha256=tracks,
        notes=contents.notes,
        origin=contents.origin,
        reads=(*clouds, *([folder] if folder else ())),
        unread_parts=contents.unread_parts,
    )


def _pose(file: Path) -> tuple[WorldPose | None, tuple[float, float] | None]:
    """Reads the LiDAR's pose and tilt; both are None if the file is missing. Raises FormatError."""
    if not file.is_file():
        return None, None
    content = read_json(file)
    try:
        turn = np.array(content["rotation"], dtype=np.float64).reshape(3, 3)
        x, y, z = (float(v) for v in np.array(content["translation"], dtype=np.float64).ravel())
    except (KeyError, TypeError, ValueError):
        raise FormatError(
            f"{file}: expected the keys rotation (3 x 3) and translation (3), got {shown(content)}"
        ) from None
    if not np.allclose(turn @ turn.T, np.eye(3), atol=0.01) or np.linalg.det(turn) < 0:
        raise FormatError(f"{file}: rotation: expected a rotation matrix, got {turn.tolist()}")
    yaw, pitch, roll = angles_of(turn)
    return WorldPose(x, y, z, yaw), (pitch, roll)
