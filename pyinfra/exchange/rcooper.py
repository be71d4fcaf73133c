"""Reads one LiDAR of a sequence of RCooper: data/SCENE/POLE/seq-N/lidar/TIME.pcd and labels.

The reader follows RCooper's public converters. Labels are in label(s)/SCENE/POLE/seq-N/TIME.json,
in the LiDAR's frame. calib/lidar2world/POLE.json contains the pose and tilt of the LiDAR.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

from pyinfra.core.errors import Error, FormatError
from pyinfra.core.files import resolved
from pyinfra.exchange.data_set import upright
from pyinfra.exchange.json_boxes import read_json, shown
from pyinfra.exchange.label_files import object_labels
from pyinfra.exchange.nuscenes_tables import angles_of
from pyinfra.exchange.pcd import Clouds
from pyinfra.exchange.recording import Options, Recording, sorted_files
from pyinfra.formats.kitti import WorldPose

LABELS = ("label", "labels")


def is_sequence(source: Path) -> bool:
    """Returns whether a path is that of a sequence, .../SCENE/POLE/seq-N."""
    path = resolved(source)
    return path.name.startswith("seq-") and len(path.parents) > 3


def read(source: Path, options: Options) -> Recording:
    """Opens the folder of a sequence in data/SCENE/POLE.

    Raises FileNotFoundError, and Error for a folder without this path, and for labels that do not
    pair with clouds. Reading a frame raises FormatError.
    """
    clouds = sorted_files(source / "lidar", [".pcd"])
    if len(resolved(source).parents) <= 3:
        raise Error(f"{source}: expected a folder data/SCENE/POLE/seq-N, got {resolved(source)}")
    scene, pole, sequence = resolved(source).parts[-3:]
    top = resolved(source).parents[3]
    beside = (top / name / scene / pole / sequence for name in LABELS)
    folder = options.labels or next((path for path in beside if path.is_dir()), None)
    labels = object_labels(clouds, folder)
    pose, tilt = _pose(top / f"calib/lidar2world/{pole}.json")
    return replace(upright(Clouds(labels, options).recording(), tilt), pose=pose)


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
