"""Writes tracks as an MCAP file of ROS 2 messages, for Foxglove and RViz.

Topics, each with one message per frame, stamped with the time of the boxes:
    /NAME/tracks         vision_msgs/Detection3DArray     the id of a detection is that of its track
    /NAME/track_markers  visualization_msgs/MarkerArray   a cube per track, and its id and speed

NAME is the LiDAR, and the frame of the messages, as in the file that `mcap` writes of the clouds.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from mcap_ros2.writer import Writer

from pyinfra.core.files import replacing
from pyinfra.core.vocabulary import KM_H
from pyinfra.dataset.object_rows import BOX
from pyinfra.exchange.ros_definitions import (
    DEFINITIONS,
    Message,
    cube,
    header,
    marker_array,
    pose,
    xyz,
)
from pyinfra.exchange.series import nanoseconds
from pyinfra.exchange.track_files import FrameTracks

DETECTIONS, MARKERS = "vision_msgs/msg/Detection3DArray", "visualization_msgs/msg/MarkerArray"
COLOUR = {"r": 0.0, "g": 0.62, "b": 0.45, "a": 0.5}
TEXT, TEXT_M, WHITE = 9, 1.0, {"r": 1.0, "g": 1.0, "b": 1.0, "a": 1.0}  # values of text markers


def write_mcap(file: Path, frames: Sequence[FrameTracks], lidar: str) -> None:
    """Writes the tracks of the LiDAR `lidar`."""
    with replacing(file) as beside, beside.open("wb") as stream, Writer(stream) as writer:
        schemas = {
            name: writer.register_msgdef(name, DEFINITIONS[name]) for name in (DETECTIONS, MARKERS)
        }
        for number, time_s, part in frames:
            stamp, ns = header(time_s, lidar), nanoseconds(time_s)
            for topic, kind, message in (
                ("tracks", DETECTIONS, _detections(stamp, part)),
                ("track_markers", MARKERS, _markers(stamp, part)),
            ):
                writer.write_message(
                    f"/{lidar}/{topic}", schemas[kind], message, ns, sequence=number
                )


def _detections(stamp: Message, part: pd.DataFrame) -> Message:
    boxes = part[BOX].to_numpy(np.float64)
    variances = part[["x_var_m2", "xy_cov_m2", "xy_cov_m2", "y_var_m2"]].to_numpy(np.float64)
    # Covariance (6, 6) of x y z and three rotations. Entries without an estimate are 0.
    covariances = np.pad(variances.reshape(-1, 2, 2), ((0, 0), (0, 4), (0, 4)))
    columns = zip(part.id, part.type, part.score, boxes, covariances, strict=True)
    return {
        "header": stamp,
        "detections": [
            {
                "header": stamp,
                "results": [
                    {
                        "hypothesis": {"class_id": str(kind), "score": float(score)},
                        "pose": {"pose": pose(box), "covariance": covariance.ravel().tolist()},
                    }
                ],
                "bbox": {"center": pose(box), "size": xyz(box[3:6].tolist())},
                "id": str(number),
            }
            for number, kind, score, box, covariance in columns
        ],
    }


def _markers(stamp: Message, part: pd.DataFrame) -> Message:
    boxes = part[BOX].to_numpy(np.float64)
    markers = []
    for number, kind, speed, box in zip(part.id, part.type, part.speed_m_s, boxes, strict=True):
        marker = cube(stamp, str(kind), int(number), box, COLOUR)
        above = box + np.eye(7)[2] * (box[5] / 2 + TEXT_M)
        text = {
            "ns": f"{kind} text",
            "type": TEXT,
            "pose": pose(above),
            "scale": xyz((0.0, 0.0, TEXT_M)),
            "color": WHITE,
            "text": f"{number}: {KM_H * speed:.0f} km/h",
        }
        markers += [marker, marker | text]
    return marker_array(stamp, markers)
