"""Writes tracks as cuboids in a JSON file of ASAM OpenLABEL 1.0.0.

Frames, coordinates and attributes are those of `openlabel`, which writes the labels of frames.
Frames count from 0, and `timestamp` is the time of the boxes. Attributes are speed (m/s), score and
whether the frame has a box of the object (`seen`: 1 or 0).
"""

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from pyinfra.core.version import __version__
from pyinfra.dataset.object_rows import BOX
from pyinfra.exchange.openlabel import Item, Json, Presence, cuboid, write_document

FrameTracks = tuple[int, float, pd.DataFrame]  # number of a frame, its time, and its tracks


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
