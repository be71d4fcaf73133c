"""Queues of standing vehicles before the lines of a junction."""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from pyinfra.core.vocabulary import PERSON_TYPES
from pyinfra.tracking.lines import Line

STANDS_M_S = 1.5  # slower vehicles stand in a queue
SPACING_M = 15.0  # a queue ends where the next standing vehicle is farther away
COLUMNS = ["start_s", "line", "mean_queue_m", "max_queue_m", "mean_queued", "max_queued"]


def queues(
    tracks: pd.DataFrame, lines: Sequence[Line], first_s: float, interval_s: float
) -> pd.DataFrame:
    """Returns the queues by interval and line.

    A queue are the standing vehicles before a line, within its width, each at most SPACING_M behind
    the one before. Its length is from the line to the centre of the last vehicle.
    """
    times = np.unique(tracks.t_s.to_numpy(np.float64))
    slow = tracks[(tracks.speed_m_s < STANDS_M_S) & ~tracks.type.isin(PERSON_TYPES)]
    parts = []
    for line in lines:
        if not line.group:
            continue
        start, end = np.array(line.start), np.array(line.end)
        along = (end - start) / line.length_m
        xy = slow[["x", "y"]].to_numpy(np.float64) - start
        before, offset = -(xy @ np.array([-along[1], along[0]])), xy @ along
        within = (before > 0) & (offset >= 0) & (offset <= line.length_m)
        rows = pd.DataFrame({"t_s": slow.t_s.to_numpy()[within], "before": before[within]})
        rows = rows.sort_values(["t_s", "before"])
        gap = rows.groupby("t_s").before.diff().fillna(rows.before)
        joined = (gap <= SPACING_M).groupby(rows.t_s).cummin()
        queue = rows[joined].groupby("t_s").before.agg(["max", "size"])
        queue = queue.reindex(times, fill_value=0).rename_axis("t_s").reset_index()
        queue["start_s"] = first_s + interval_s * np.floor((queue.t_s - first_s) / interval_s)
        part = queue.groupby("start_s").agg(
            mean_queue_m=("max", "mean"),
            max_queue_m=("max", "max"),
            mean_queued=("size", "mean"),
            max_queued=("size", "max"),
        )
        parts.append(part.reset_index().assign(line=line.name))
    table = pd.concat(parts) if parts else pd.DataFrame(columns=COLUMNS)
    return table[COLUMNS].sort_values(["start_s", "line"], ignore_index=True)
