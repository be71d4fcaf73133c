"""Frames with the road at z = 0, for tools whose ranges and anchors expect the road at z = 0.

For a sensor on a 6 m pole, vehicles are at z = -6. Common configurations ignore points at this
height. Therefore clouds and boxes are moved up by the height of the sensor above the road, which is
written to `sensor.yaml` beside them.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pyinfra.core.arrays import FloatArray, NameArray, Points
from pyinfra.core.errors import Error
from pyinfra.core.files import write
from pyinfra.core.vocabulary import VEHICLE_TYPES
from pyinfra.dataset.frame_readers import read_cameras
from pyinfra.dataset.frames import frame_numbers
from pyinfra.formats import kitti
from pyinfra.formats.kitti import Labels

# Class names of OpenPCDet and MMDetection3D. Objects of other classes are left out.
CLASSES = ("Vehicle", "Pedestrian", "Cyclist")
SENSOR_FILE = "sensor.yaml"
PARTS = ("train", "val")
TRAIN_SHARE = 0.8  # share of frames, from the first, that are `train` if there are no ImageSets


@dataclass(frozen=True, eq=False)
class RoadFrame:
    """A frame with the road at z = 0."""

    number: int
    points: Points  # (n, 4) x y z intensity
    names: NameArray  # (k,) names from CLASSES
    boxes: FloatArray  # (k, 7) x y z dx dy dz heading


@dataclass(frozen=True, eq=False)
class RoadSite:
    """The vehicles of all exported frames, with the road at z = 0."""

    floor_z: float  # z of the road in the LiDAR frame
    vehicles: FloatArray  # boxes (m, 7) of the vehicles


def read_labels(folder: Path, frames: Sequence[int]) -> list[Labels]:
    """Reads the labels of the frames, with the names of CLASSES. Other classes are dropped."""
    cameras = read_cameras(folder, frames)
    per_frame = []
    for frame, camera in zip(frames, cameras.of_frame, strict=True):
        file = kitti.frame_file(folder, "label_2", frame)
        labels = kitti.read_labels(file, calibration=cameras.different[camera])
        names = np.where(np.isin(labels.names, VEHICLE_TYPES), "Vehicle", labels.names)
        keep = np.isin(names, CLASSES)
        per_frame.append(Labels(names[keep], labels.boxes[keep], None))
    return per_frame


def site_of(folder: Path, labels: Sequence[Labels]) -> RoadSite:
    """Returns the road's height, and the vehicles with z above the road.

    Raises Error if there is no vehicle.
    """
    boxes = np.concatenate([np.empty((0, 7)), *(k.boxes[k.names == "Vehicle"] for k in labels)])
    if len(boxes) == 0:
        raise Error(
            f"{folder}: expected one or more vehicles in the labels of the frames, got none; the "
            "level of the road, the ranges and the anchors are computed from vehicles"
        )
    floor = round(float(np.median(boxes[:, 2] - boxes[:, 5] / 2)), 4)
    boxes[:, 2] -= floor
    return RoadSite(floor, boxes)


def road_frames(
    folder: Path, frames: Sequence[int], labels: Sequence[Labels], site: RoadSite
) -> Iterator[RoadFrame]:
    """Yields the frames with the road at z = 0."""
    for frame, frame_labels in zip(frames, labels, strict=True):
        points = kitti.read_points(kitti.frame_file(folder, "velodyne", frame))
        points[:, 2] -= np.float32(site.floor_z)
        boxes = frame_labels.boxes.copy()
        boxes[:, 2] -= site.floor_z
        yield RoadFrame(frame, points, frame_labels.names, boxes)


def write_sensor(out: Path, site: RoadSite) -> None:
    """Writes the sensor's pose in the exported frames to sensor.yaml."""
    text = (
        "# z in this folder = z in the LiDAR frame + z_m. Subtract z_m from z of predictions.\n"
        f"T_road_lidar: {{x_m: 0, y_m: 0, z_m: {-site.floor_z:g}, yaw_deg: 0}}\n"
    )
    write(out / SENSOR_FILE, text)


def read_sensor_height(folder: Path) -> float:
    """Reads the sensor's height above z = 0 from sensor.yaml. Raises FormatError.

    The height is 0 if the file does not exist.
    """
    file = folder / SENSOR_FILE
    if not file.is_file():
        return 0.0
    return kitti.read_yaml(file).at("T_road_lidar").at("z_m").number()


def train_and_val(folder: Path, frames: Sequence[int]) -> dict[str, list[int]]:
    """Returns the frames of train and val, as listed in ImageSets.

    If there are no ImageSets, the first 80 % of the frames are train, and the others are val. A
    random split is not used, because neighbouring frames show the same vehicles. Raises Error if
    one of the two lists is missing.
    """
    missing = [part for part in PARTS if not (folder / f"ImageSets/{part}.txt").is_file()]
    if len(missing) == 1:
        raise Error(f"{folder}/ImageSets: expected train.txt and val.txt, got no {missing[0]}.txt")
    if missing:
        count = round(TRAIN_SHARE * len(frames))
        return {"train": list(frames[:count]), "val": list(frames[count:])}
    chosen = set(frames)
    lists = {part: frame_numbers(folder, part) for part in PARTS}
    return {part: [k for k in members if k in chosen] for part, members in lists.items()}
