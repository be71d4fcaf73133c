"""Writes MMDetection3D's custom layout: points/*.bin and info files.

The layout follows the public guide "Customize Datasets" (version 1.4). A box position is the centre
of the bottom face. The format requires pickles as info files. The written pickles contain only
lists, dicts, numbers and texts. This package never reads a pickle.
"""

import pickle
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pyinfra.core.boxes import points_in_boxes
from pyinfra.core.files import write
from pyinfra.core.version import __version__
from pyinfra.exchange.recording import write_splits
from pyinfra.exchange.road_level import (
    CLASSES,
    RoadFrame,
    read_labels,
    road_frames,
    site_of,
    train_and_val,
    write_sensor,
)

PROTOCOL = 4  # pickle protocol that Python 3.4 and later can read
METAINFO = {
    "classes": list(CLASSES),
    "categories": {name: i for i, name in enumerate(CLASSES)},
    "dataset": "custom",
    "info_version": "1.1",
    "source": f"infrasim {__version__}",
}


def export(lidar_folder: Path, frames: Sequence[int], out: Path) -> None:
    """Writes the frames with the road moved to z = 0. Raises Error if no frame has a vehicle."""
    labels = read_labels(lidar_folder, frames)
    site = site_of(lidar_folder, labels)
    lists = train_and_val(lidar_folder, frames)
    write_splits(out / "ImageSets", lists)
    write_sensor(out, site)
    (out / "points").mkdir()
    infos = {}
    for frame in road_frames(lidar_folder, frames, labels, site):
        write(out / f"points/{frame.number:06d}.bin", frame.points.tobytes())
        infos[frame.number] = _info(frame)
    for part, numbers in lists.items():
        content = {"metainfo": METAINFO, "data_list": [infos[k] for k in numbers]}
        write(out / f"custom_infos_{part}.pkl", pickle.dumps(content, protocol=PROTOCOL))


def _info(frame: RoadFrame) -> dict[str, Any]:
    boxes = frame.boxes.copy()
    boxes[:, 2] -= boxes[:, 5] / 2  # from the box centre to the centre of the bottom face
    counts = points_in_boxes(frame.points, frame.boxes)
    return {
        "sample_idx": frame.number,
        "lidar_points": {"num_pts_feats": 4, "lidar_path": f"{frame.number:06d}.bin"},
        "instances": [
            {
                "bbox_3d": [float(value) for value in box],
                "bbox_label_3d": CLASSES.index(str(name)),
                "num_lidar_pts": int(count),
            }
            for name, box, count in zip(frame.names, boxes, counts, strict=True)
        ],
    }
