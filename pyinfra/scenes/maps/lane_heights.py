"""Compares the heights of vehicles with those of a site's lanes."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from pyinfra.formats.csv_table import read_csv
from pyinfra.scenes.maps.tracks import Track

LANES = "lanes.csv"
ON_LANE_M = 3.0  # maximum distance of a vehicle from a point of a lane's centreline
LEAST_ROWS = 20  # minimum number of positions on lanes from which a height is computed
OFF_M = 0.4  # largest plausible median distance of the bottoms from the lanes


def height_notes(site: Path, tracks: Sequence[Track]) -> list[str]:
    """Returns a note if most vehicles are above or below the lanes of a site.

    Raises FormatError for a wrong lanes.csv.
    """
    vehicles = [track for track in tracks if track.object_class != "Pedestrian"]
    if not vehicles or not (site / LANES).is_file():
        return []
    lanes = read_csv(site / LANES, {"lane"})
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
