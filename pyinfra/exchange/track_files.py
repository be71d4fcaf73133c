"""Writes tracks as JSON lines, or in the formats of other tools.

A line of the KITTI tracking format is frame, track id, and then the columns of a KITTI result:
type truncated occluded alpha, image box (4), h w l, x y z rotation_y, score. Boxes are in the
camera frame of a simulated LiDAR, as in predictions without calibration. `occluded` is 0 for a
frame with a box, and 2 (largely occluded) for others.

Frames, coordinates and attributes of OpenLABEL are those of `openlabel`, which writes the labels of
frames. Frames count from 0, and `timestamp` is the time of the boxes. Attributes are speed (m/s),
score and whether the frame has a box of the object (`seen`: 1 or 0).
"""

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from pyinfra.core.files import write
from pyinfra.core.version import __version__
from pyinfra.dataset.object_rows import BOX
from pyinfra.exchange.formats import module
from pyinfra.exchange.openlabel import Item, Json, Presence, cuboid, write_document
from pyinfra.formats import kitti
from pyinfra.formats.csv_table import rounded
from pyinfra.formats.kitti.camera import boxes_to_camera
from pyinfra.formats.kitti.write import image_columns

FrameTracks = tuple[int, float, pd.DataFrame]  # number of a frame, its time, and its tracks
FORMATS = {
    ".jsonl": "a JSON line per frame",
    ".txt": "KITTI tracking",
    ".json": "OpenLABEL",
    ".mcap": "ROS 2 messages",
}


def write_other_format(
    file: Path, tracks: pd.DataFrame, lidar: str, times: Mapping[int, float]
) -> None:
    """Writes a table of `track` in the format of the file's ending, one of FORMATS.

    lidar: the name of the LiDAR, which is the frame of the boxes. times: the time of each frame
    number, also of frames without a track; those of the table may be missing. Raises ImportError if
    packages for MCAP are missing.
    """
    frames = _by_frame(tracks, times)
    writers: dict[str, Callable[[], None]] = {
        ".jsonl": lambda: write_json_lines(file, frames),
        ".txt": lambda: write_kitti_tracking(file, tracks),
        ".json": lambda: write_openlabel(file, frames, lidar),
        ".mcap": lambda: module("track_mcap", "exchange").write_mcap(file, frames, lidar),
    }
    writers[file.suffix]()


def _by_frame(tracks: pd.DataFrame, times: Mapping[int, float]) -> list[FrameTracks]:
    """Returns number, time and tracks of each frame, in ascending order."""
    known = dict(times) | dict(zip(tracks.frame.tolist(), tracks.t_s.tolist(), strict=True))
    parts = dict(iter(tracks.groupby("frame")))
    return [(number, known[number], parts.get(number, tracks[:0])) for number in sorted(known)]


def write_json_lines(file: Path, frames: Sequence[FrameTracks]) -> None:
    """Writes a line per frame: frame, t_s and the columns of each track, rounded to 1 mm."""
    lines = []
    for number, time_s, part in frames:
        rows = rounded(part.drop(columns=["frame", "t_s"])).to_dict("records")
        lines.append(json.dumps({"frame": number, "t_s": time_s, "tracks": rows}))
    write(file, "".join(f"{line}\n" for line in lines))


def write_openlabel(file: Path, frames: Sequence[FrameTracks], lidar: str) -> None:
    """Writes the tracks of the LiDAR `lidar`."""
    presence = Presence()
    parts: dict[str, Json | Iterable[Item]] = {
        "metadata": {
            "schema_version": "1.0.0",
            "name": f"tracks, {lidar}",
            "annotator": f"pyinfra {__version__}",
        },
        "coordinate_systems": {lidar: {"type": "sensor_cs", "parent": "", "children": []}},
        "frames": _frames(frames, lidar, presence),
        # `objects` must follow the frames, because iterating over the frames fills `presence`.
        "objects": presence.objects(lidar),
    }
    write_document(file, parts, len(frames))


def _frames(frames: Sequence[FrameTracks], lidar: str, presence: Presence) -> Iterator[Item]:
    for index, (_, time_s, part) in enumerate(frames):
        presence.add(index, zip(part.id.tolist(), part.type.tolist(), strict=True))
        boxes, seen = part[BOX].to_numpy(np.float64).tolist(), (part.state == "seen").astype(int)
        columns = zip(part.id, boxes, part.speed_m_s, part.score, seen, strict=True)
        objects = {
            str(number): cuboid(lidar, box, {"speed": speed, "score": score, "seen": here})
            for number, box, speed, score, here in columns
        }
        yield str(index), {"frame_properties": {"timestamp": f"{time_s:.9f}"}, "objects": objects}


def write_kitti_tracking(file: Path, tracks: pd.DataFrame) -> None:
    """Writes one label file of the KITTI tracking benchmark with scores."""
    camera = boxes_to_camera(tracks[BOX].to_numpy(np.float64), kitti.simulated())
    image = image_columns(camera)
    image[:, 1] = np.where(tracks.state == "seen", 0, 2)
    heads = zip(tracks.frame, tracks.id, tracks.type, strict=True)
    lines = []
    for (frame, number, kind), i, c, score in zip(heads, image, camera, tracks.score, strict=True):
        words = [str(frame), str(number), str(kind), f"{i[0]:.0f}", f"{i[1]:.0f}", f"{i[2]:.6f}"]
        words += [*(f"{v:.2f}" for v in i[3:]), *(f"{v:.4f}" for v in c[:6]), f"{c[6]:.6f}"]
        lines.append(" ".join([*words, f"{score:.6f}"]))
    write(file, "".join(f"{line}\n" for line in lines))
