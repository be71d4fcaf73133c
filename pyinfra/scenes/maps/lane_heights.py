"""Compares the heights of vehicles with those of a site's lanes."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from pyinfra.core.arrays import FloatArray
from pyinfra.formats.csv_table import read_csv
from pyinfra.scenes.maps.recorded_boxes import BoxTrack
from pyinfra.scenes.maps.tracks import Track

LANES = "lanes.csv"
ON_LANE_M = 3.0  # maximum distance of a vehicle from a point of a lane's centreline
LEAST_ROWS = 20  # minimum number of positions on lanes from which a height is computed
OFF_M = 0.4  # largest plausible median distance of the vehicles' bottoms from the lanes


def on_lanes(
    site: Path, objects: list[BoxTrack], offset_m: FloatArray
) -> tuple[list[BoxTrack], list[str]]:
    """Sets z of boxes without a height, so that they stand on the nearest lane of the site.

    z is NaN in such boxes. Without lanes, the road is at z = 0. `offset_m` (3,) is the
    offset from site coordinates to those of the boxes. Returns the objects, and a list of notes.
    """
    if not any(np.isnan(o.boxes[:, 2]).any() for o in objects):
        return objects, []
    lanes = read_csv(site / LANES, {"lane"}) if (site / LANES).is_file() else None
    out = []
    for o in objects:
        boxes = o.boxes.copy()
        ground = np.zeros(len(boxes))
        if lanes is not None:
            tree = cKDTree(lanes[["x", "y"]].to_numpy(float))
            ground = lanes.z.to_numpy(float)[tree.query(boxes[:, :2] - offset_m[:2])[1]]
        absent = np.isnan(boxes[:, 2])
        boxes[absent, 2] = (ground + offset_m[2] + boxes[:, 5] / 2)[absent]
        out.append(replace(o, boxes=boxes))
    where = "of the nearest lane" if lanes is not None else "0, because the folder has no lanes"
    return out, [f"no column z: the height of the road is that {where}"]


def height_notes(site: Path, tracks: Sequence[Track]) -> list[str]:
    """Returns a note if most vehicles are above or below the lanes of a site.

    Raises FormatError for a wrong lanes.csv.
    """
    vehicles = [track for track in tracks if track.object_class != "Pedestrian"]
    if not vehicles or not (site / LANES).is_file():
        return []
    lanes = read_csv(site / LANES, {"lane"}, required=("x", "y", "z"))
    centres = np.concatenate([track.states[:, :3] for track in vehicles])
    heights = np.repeat([track.size_m[2] for track in vehicles], [len(t.states) for t in vehicles])
    away, nearest = cKDTree(lanes[["x", "y"]].to_numpy(float)).query(centres[:, :2])
    off = (centres[:, 2] - heights / 2 - lanes.z.to_numpy(float)[nearest])[away <= ON_LANE_M]
    if len(off) < LEAST_ROWS or abs(middle := float(np.median(off))) <= OFF_M:
        return []
    side = "above" if middle > 0 else "below"
    return [
        f"the bottoms of vehicles on lanes are {abs(middle):.2f} m {side} the lanes (median); z of "
        "a box is that of its centre"
    ]
