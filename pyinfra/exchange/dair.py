"""Reads the roadside part of DAIR-V2X: velodyne/*.pcd, label/virtuallidar/*.json, data_info.json.

The reader follows the public description of the data set. Points are in the frame of the *virtual
LiDAR*. According to the description, its x-y plane is parallel to the ground. Intensities are 0 to
255.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

from pyinfra.core.arrays import FloatArray
from pyinfra.exchange.frame_times import seconds_of_stamp
from pyinfra.exchange.json_boxes import read_json
from pyinfra.exchange.label_files import object_labels
from pyinfra.exchange.pcd import Clouds
from pyinfra.exchange.recording import Options, Recording, sorted_files

SIDES = ("single-infrastructure-side", "infrastructure-side", ".")
LABELS = ("label/virtuallidar", "label/lidar")


def read(source: Path, options: Options) -> Recording:
    """Opens a folder that contains `velodyne`, directly or in an infrastructure-side subfolder.

    Raises FileNotFoundError, and Error for labels that do not pair with clouds. Reading a frame
    raises FormatError.
    """
    side = next((source / n for n in SIDES if (source / n / "velodyne").is_dir()), source)
    clouds = sorted_files(side / "velodyne", [".pcd"])
    label_folders = (side / name for name in LABELS if (side / name).is_dir())
    folder = options.labels or next(label_folders, None)
    # The labels of V2X-Seq have track ids, those of DAIR-V2X have none.
    recording = Clouds(object_labels(clouds, folder), options).recording()
    info = side / "data_info.json"
    return replace(
        recording,
        times=lambda: _times(info, recording.names),
        reads=(*recording.reads, info),
    )


def _times(file: Path, names: tuple[str, ...]) -> FloatArray | None:
    """Reads pointcloud_timestamp of data_info.json in seconds. None if a frame has no such time."""
    rows = read_json(file) if file.is_file() else []
    stamps = {}
    for row in rows if isinstance(rows, list) else []:
        stamp = row.get("pointcloud_timestamp") if isinstance(row, dict) else None
        if str(stamp).isdecimal() and len(str(stamp)) < 20:
            stamps[Path(str(row.get("pointcloud_path"))).stem] = seconds_of_stamp(float(str(stamp)))
    times = [stamps.get(name) for name in names]
    return None if None in times else np.array(times, dtype=np.float64)
