"""Converts the structured object rows of the simulator to tables of objects."""

import numpy as np
import pandas as pd

from pyinfra.core.arrays import AnyArray
from pyinfra.core.vocabulary import OBJECT_NAMES, LabelTime
from pyinfra.dataset.frame_tables import Vehicles, without_points

BOX = ["x", "y", "z", "dx", "dy", "dz", "heading"]
LABEL_COLUMNS = ["type", *BOX, "id", "points", "visibility", "vx", "vy"]


def table_of(vehicles: Vehicles) -> pd.DataFrame:
    """Converts objects to a table with the columns LABEL_COLUMNS."""
    table = pd.DataFrame({"type": vehicles.names.astype(object)})
    table[BOX] = vehicles.boxes
    speed, heading = vehicles.speed, vehicles.boxes[:, 6]
    return table.assign(
        id=vehicles.ids,
        points=vehicles.points,
        visibility=vehicles.visibility,
        vx=speed * np.cos(heading),
        vy=speed * np.sin(heading),
    )


def vehicles_of(rows: AnyArray, frame: int, label_time: LabelTime) -> Vehicles:
    """Converts the structured object rows of one simulated frame; `frame` is the frame's index."""
    at = "scan_" if label_time == "scan" else ""
    labelled = [f"{at}x", f"{at}y", f"{at}z", "dx", "dy", "dz", f"{at}heading"]
    return Vehicles(
        frame=np.full(len(rows), frame, dtype=np.int64),
        ids=rows["id"].astype(np.int64),
        names=type_names(rows),
        boxes=np.stack([rows[name] for name in labelled], axis=1).reshape(-1, 7),
        mid_frame=np.stack([rows[name] for name in BOX], axis=1).reshape(-1, 7),
        points=rows["points"].astype(np.int64),
        visibility=rows["visibility"].astype(np.float64),
        speed=rows["speed"].astype(np.float64),
    )


def scene_objects(rows: AnyArray, frame: int) -> Vehicles:
    """Converts the result of `World.objects` for one frame. `frame` is the index of the frame."""
    boxes = np.stack([rows[name] for name in BOX], axis=1).reshape(-1, 7)
    index = np.full(len(rows), frame, dtype=np.int64)
    return without_points(index, rows["id"].astype(np.int64), type_names(rows), boxes)


def type_names(rows: AnyArray) -> AnyArray:
    """Returns the types (k,) of structured object rows."""
    return np.array([OBJECT_NAMES[int(c)] for c in rows["class_id"]], dtype="<U12")
