"""An artificial recording in which every value is known, for the tests of the exports."""

import math
import shutil
from pathlib import Path

import numpy as np

from pyinfra.formats import kitti

LIDARS = ("ruby_plus", "livox_avia", "pandar_64", "helios_16")
LIDAR = """name: "pole"
model: "made up"
preset: "none"
price_total_usd: {low: 1, high: 1}
label_time: frame
period_s: 0.1
T_world_levelled: {x_m: 10, y_m: 20, z_m: 6, yaw_deg: 90}
T_levelled_sensor: {pitch_deg: 0, roll_deg: 0}
field_of_view:
  - {yaw_deg: 0, pitch_deg: 0, azimuth_deg: [-180, 180], elevation_deg: [-60, 15], range_m: [0, 99]}
"""
DATASET = """name: "made_up"
seed: 7
aggregation: "exact"
preset: "none"
version: "0.1.0"
"""
# Frame 5 has the objects 3 and 8, frame 6 has none, and frame 7 has object 3 again.
FRAMES = {5: (3, 8), 6: (), 7: (3,)}
BOXES = {
    3: (30.0, -4.0, -5.25, 4.0, 2.0, 1.5, 0.5),
    8: (-12.0, 6.0, -4.0, 10.0, 2.5, 3.0, -3.0),
}
NAMES = {3: "Car", 8: "Truck"}


def write_recording(data_set: Path, *, fields: bool = True, objects: bool = True) -> Path:
    """Writes the folder of the LiDAR `pole`. Each frame has ten points, of which three are in each
    box."""
    folder = data_set / "pole"
    for frame, ids in FRAMES.items():
        kitti.write_frame(
            folder,
            frame,
            points(frame),
            kitti.Labels(names_of(ids), boxes_of(ids), None),
            objects=objects_of(ids) if objects else None,
            fields=fields_of(frame) if fields else None,
        )
    (folder / "lidar.yaml").write_text(LIDAR)
    (data_set / "dataset.yaml").write_text(DATASET)
    return folder


def points(frame: int) -> np.ndarray:
    """Returns the points of a frame: (10, 4). Three lie at the centre of each box, and four lie on
    the road far from both boxes."""
    steps = np.array([[0, 0, 0], [0.4, 0.2, 0.1], [-0.3, 0.1, -0.2]])
    near = [np.array(box[:3]) + steps for box in BOXES.values()]
    far = np.array([[50 + frame, 9, -6], [51, 9, -6], [52, 9, -6], [53.25, 9, -6]])
    xyz = np.concatenate([*near, far])
    return np.column_stack([xyz, np.linspace(0, 1, 10)]).astype(np.float32)


def fields_of(frame: int) -> np.ndarray:
    out = np.zeros(10, dtype=kitti.FIELDS)
    out["time_s"] = np.linspace(0, 0.09, 10)
    out["ring"] = np.arange(10) + frame
    out["class"] = [1] * 3 + [3] * 3 + [20] * 4
    out["object_id"] = [3] * 3 + [8] * 3 + [-1] * 4
    return out


def names_of(ids: tuple[int, ...]) -> np.ndarray:
    return np.array([NAMES[i] for i in ids], dtype=np.str_)


def boxes_of(ids: tuple[int, ...]) -> np.ndarray:
    return np.array([BOXES[i] for i in ids], dtype=np.float64).reshape(len(ids), 7)


def objects_of(ids: tuple[int, ...]) -> kitti.Objects:
    """Returns the objects of a frame. The car moves and is half visible. The truck stands and has
    an unknown visibility."""
    boxes, k = boxes_of(ids), len(ids)
    return kitti.Objects(
        ids=np.array(ids, dtype=np.int64),
        names=names_of(ids),
        boxes=boxes,
        speed=np.array([{3: 15.0, 8: 0.0}[i] for i in ids]),
        points=np.full(k, 4),
        points_in_box=np.full(k, 3),
        distance=np.hypot(boxes[:, 0], boxes[:, 1]),
        visibility=np.array([{3: 0.5, 8: -1.0}[i] for i in ids]),
        scan_boxes=boxes + np.array([0.5, 0, 0, 0, 0, 0, 0]),
        scan_time_s=np.full(k, 0.08),
        points_in_scan_box=np.full(k, 4),
    )


def to_world(xyz: np.ndarray) -> np.ndarray:
    """Transforms points (n, 3) of the LiDAR of `write_recording` to the world. The LiDAR looks
    along the world's y."""
    x, y, z = np.asarray(xyz, dtype=np.float64).T
    return np.column_stack([10 - y, 20 + x, 6 + z])


def rotation(quaternion_xyzw: object) -> np.ndarray:
    """Returns the rotation matrix of a unit quaternion: (3, 3)."""
    x, y, z, w = (float(v) for v in quaternion_xyzw)  # type: ignore[attr-defined]
    assert math.isclose(x * x + y * y + z * z + w * w, 1)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def heading(quaternion_xyzw: object) -> float:
    """Returns the direction of the x axis after a rotation about +z."""
    turn = rotation(quaternion_xyzw)
    assert np.allclose(turn[2], [0, 0, 1])
    return math.atan2(turn[1, 0], turn[0, 0])


def without(folder: Path, data_set: Path, *parts: str) -> Path:
    """Copies a LiDAR's folder without some of its parts and without dataset.yaml."""
    copy = shutil.copytree(folder, data_set / folder.name)
    for part in parts:
        shutil.rmtree(copy / "training" / part)
    return Path(copy)
