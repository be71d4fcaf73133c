"""Queues of standing vehicles before the lines of a junction."""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from pyinfra.core.arrays import FloatArray
from pyinfra.core.vocabulary import PERSON_TYPES
from pyinfra.tracking.lines import Line

STANDS_M_S = 1.5  # speed below which a vehicle counts as standing in a queue
GAP_M = 15.0  # maximum gap between successive standing vehicles of a queue
COLUMNS = ["start_s", "line", "mean_queue_m", "max_queue_m", "mean_queued", "max_queued"]


def interval_count(start_s: float, end_s: float, interval_s: float) -> int:
    return max(int(np.ceil((end_s - start_s) / interval_s - 1e-9)), 1)


def interval_numbers(
    times: FloatArray, start_s: float, end_s: float, interval_s: float
) -> FloatArray:
    """Returns the number of the interval of each time; the end belongs to the last interval."""
    last = interval_count(start_s, end_s, interval_s) - 1
    return np.asarray(np.minimum(np.floor((times - start_s) / interval_s), last))


def queues(
    tracks: pd.DataFrame, lines: Sequence[Line], start_s: float, end_s: float, interval_s: float
) -> pd.DataFrame:
    """Returns the queues by interval and line.

    A queue consists of the standing vehicles before a line, within its width. The gap from the
    front of each vehicle to the line, or to the vehicles before it, is at most GAP_M. The length of
    a queue is from the line to the centre of the last vehicle. Means are over all frames from
    start_s to end_s; a frame without tracks has no queue.
    """
    times = np.unique(tracks.t_s.to_numpy(np.float64))
    step_s = np.median(np.diff(times)) if len(times) > 1 else np.inf
    number = interval_numbers(times, start_s, end_s, interval_s)
    count = interval_count(start_s, end_s, interval_s)
    starts = start_s + interval_s * np.arange(count)
    recorded = np.round(np.minimum(interval_s, end_s - starts) / step_s)
    frames = np.maximum(np.bincount(number.astype(int), minlength=count), np.maximum(recorded, 1))
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
        half_m = slow.dx.to_numpy(np.float64)[within] / 2
        rows["front"], rows["rear"] = rows.before - half_m, rows.before + half_m
        rows = rows.sort_values(["t_s", "front"])
        reached = rows.groupby("t_s").rear.cummax().groupby(rows.t_s).shift(fill_value=0)
        joined = (rows.front - reached <= GAP_M).groupby(rows.t_s).cummin()
        queue = rows[joined].groupby("t_s").before.agg(["max", "size"])
        groups = queue.reindex(times, fill_value=0).groupby(number)
        sums, most = (g.reindex(range(count), fill_value=0) for g in (groups.sum(), groups.max()))
        part = pd.DataFrame({"start_s": starts, "line": line.name})
        part["mean_queue_m"], part["max_queue_m"] = sums["max"] / frames, most["max"]
        part["mean_queued"], part["max_queued"] = sums["size"] / frames, most["size"]
        parts.append(part)
    table = pd.concat(parts) if parts else pd.DataFrame(columns=COLUMNS)
    return table[COLUMNS].sort_values(["start_s", "line"], ignore_index=True)
