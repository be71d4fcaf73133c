"""Reads and writes the KITTI object layout, one folder per LiDAR.

Both KITTI's own folders and those of `infrasim run` are supported. All results are in the levelled
LiDAR frame: metres and radians, x forward, y left, z up, origin at the sensor. Only
`pyinfra.formats.kitti.camera` deals with the camera frame of `label_2`. The package needs neither
torch nor the extension `pyinfra._core`.
"""

from pyinfra.formats.kitti.camera import (
    Calibration,
    boxes_from_camera,
    boxes_to_camera,
    read_calibration,
    simulated,
)
from pyinfra.formats.kitti.layout import (
    FIELDS,
    LABEL_COLUMNS,
    OBJECT_COLUMNS,
    Labels,
    Objects,
    Part,
    extent,
    frame_file,
    frames,
)
from pyinfra.formats.kitti.lidar import (
    RECORDED,
    FieldOfView,
    Lidar,
    RoadShape,
    Tilt,
    WorldPose,
    parse_lidar,
    read_label_time,
    read_lidar,
    read_road_shape,
    read_tilt,
    read_written_keys,
)
from pyinfra.formats.kitti.read import read_fields, read_labels, read_objects, read_points
from pyinfra.formats.kitti.write import (
    write_calibration,
    write_fields,
    write_frame,
    write_labels,
    write_objects,
    write_points,
)
from pyinfra.formats.yaml_file import read_keys, read_yaml

__all__ = [
    "FIELDS",
    "LABEL_COLUMNS",
    "OBJECT_COLUMNS",
    "RECORDED",
    "Calibration",
    "FieldOfView",
    "Labels",
    "Lidar",
    "Objects",
    "Part",
    "RoadShape",
    "Tilt",
    "WorldPose",
    "boxes_from_camera",
    "boxes_to_camera",
    "extent",
    "frame_file",
    "frames",
    "parse_lidar",
    "read_calibration",
    "read_fields",
    "read_keys",
    "read_label_time",
    "read_labels",
    "read_lidar",
    "read_objects",
    "read_points",
    "read_road_shape",
    "read_tilt",
    "read_written_keys",
    "read_yaml",
    "simulated",
    "write_calibration",
    "write_fields",
    "write_frame",
    "write_labels",
    "write_objects",
    "write_points",
]
