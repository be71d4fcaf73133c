"""`pyinfra.count`: traffic statistics of tracks by movement, line, lane, class and interval."""

from __future__ import annotations

import os
import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from pyinfra.core.errors import Error, FindingWarning
from pyinfra.core.names import path_of
from pyinfra.core.present import Presented
from pyinfra.core.public import CALLER, public
from pyinfra.core.vocabulary import KM_H
from pyinfra.dataset.frame_sequence import FrameSequence
from pyinfra.dataset.frames import usual_step
from pyinfra.formats.csv_table import write_tables
from pyinfra.tracking.lines import AnyLines, Line, frames_of, lines_of
from pyinfra.tracking.movements import movements
from pyinfra.tracking.passages import UNSEEN_S, passages
from pyinfra.tracking.queues import interval_numbers, queues
from pyinfra.tracking.table_file import NUMBER_FORMAT, check_columns, read_tracks, with_time_text

TABLES = ("passages", "flows", "movements", "travel", "queues")
MOST_UNSEEN = 0.2  # largest share of unseen passages of a line without a warning
FAR_M = 20.0  # distance from the nearest track above which an empty line gives a warning
_NEEDED = ("frame", "t_s", "id", "type", "x", "y", "dx", "speed_m_s")


@dataclass(frozen=True, eq=False, repr=False)
class Counts(Presented):
    """Passages of tracks over lines, and tables made of them.

    Attributes
    ----------
    lines : the lines, in the levelled LiDAR frame
    seconds : duration of the recording, from start_s to end_s
    passages : one row per passage: t_s, line, direction, lane, id, type, speed_km_h, length_m,
        position, headway_s (centre to centre), gap_s (without the length of the vehicle before) and
        unseen: 1 without a speed if the track has no box for more than 1.5 s around, else 0
    flows : one row per interval, line, direction, lane and type: count, flow_per_h, mean_km_h,
        p85_km_h, std_km_h, headway_s, gap_s (medians) and occupancy_percent
    movements : one row per interval, movement and type: count and flow_per_h
    travel : one row per movement: count, mean_s, p85_s of the time between both lines
    queues : one row per interval and line of a junction: mean and highest queue_m and queued
        (vehicles that stand before the line)
    """

    lines: list[Line]
    seconds: float
    passages: pd.DataFrame
    flows: pd.DataFrame
    movements: pd.DataFrame
    travel: pd.DataFrame
    queues: pd.DataFrame

    def facts(self) -> dict[str, object]:
        return {
            "passages": len(self.passages),
            "lines": len(self.lines),
            "seconds": f"{self.seconds:g}",
        }

    def save(self, folder: str | os.PathLike[str]) -> Path:
        """Writes each table as a CSV file, such as flows.csv, and returns the folder."""
        out = path_of(folder, "folder")
        tables = {name: with_time_text(getattr(self, name)) for name in TABLES}
        write_tables(out, tables, NUMBER_FORMAT)
        return out


@public()
def count(
    tracks: pd.DataFrame | str | os.PathLike[str],
    site: AnyLines,
    *,
    interval_s: float = 900.0,
    start_s: float | None = None,
    end_s: float | None = None,
) -> Counts:
    """Counts the tracks that pass lines, and measures speeds, headways, queues and travel times.

    Parameters
    ----------
    tracks : table of `track`, or a file tracks.csv
    site : where to count: frames or a LiDAR's folder, whose roads give the lines (one before each
        arm of a junction, one across each other road); or lines in the levelled LiDAR frame, as
        `{name: [[x, y], [x, y]]}` or as a YAML file with these under `lines_m`
    interval_s : length of an interval in seconds; the first one begins at start_s
    start_s, end_s : start and end of the recording, in the time of the tracks. By default, they are
        those of the frames of `site` if these contain all tracks, else the times of the first and
        the last track, and flows of sparse traffic are too high

    Returns
    -------
    Counts : tables of passages, flows, movements, travel times and queues. A track that crosses a
        line and returns over it, as after a U-turn, is not counted at this line

    Raises
    ------
    Error : for a table without the columns of tracks, tracks outside the recording, lines without
        length, or no line

    Examples
    --------
    >>> import pyinfra as pi
    >>> frames = pi.simulate(pi.load_scene("highway", seed=1), "helios_16", range(30))
    >>> tracks = pi.track(frames.objects.assign(score=0.9), frames)
    >>> counts = pi.count(tracks, {"gantry": [[30, 25], [30, -25]]})
    >>> sorted(set(counts.passages.direction))
    ['E', 'W']
    """
    table = tracks if isinstance(tracks, pd.DataFrame) else read_tracks(path_of(tracks, "tracks"))
    check_columns(table, _NEEDED, "tracks")
    if not 0 < interval_s < np.inf:
        raise Error(f"interval_s: expected a number above 0, got {interval_s:g}")
    frames = frames_of(site)
    lines = lines_of(site if frames is None else frames)
    start, end = recording(table, frames, start_s, end_s)
    passed = passages(table, lines)
    moved = movements(passed, lines)
    for text in (_unseen(passed), _unreached(table, passed, lines, drawn=frames is None)):
        if text:
            warnings.warn(text, FindingWarning, stacklevel=CALLER)
    return Counts(
        lines,
        end - start,
        passed,
        flows(passed, start, end, interval_s),
        movement_table(moved, start, end, interval_s),
        travel_table(moved),
        queues(table, lines, start, end, interval_s),
    )


def recording(
    table: pd.DataFrame, frames: FrameSequence | None, start_s: float | None, end_s: float | None
) -> tuple[float, float]:
    """Returns start and end of a recording: as given, else of its frames, else of its tracks."""
    first, last = (float(table.t_s.min()), float(table.t_s.max())) if len(table) else (0.0, 0.0)
    start, end = first, last
    if frames is not None and len(frames):
        numbers = np.array(frames.numbers)
        after = int(numbers[-1]) + usual_step(frames.numbers)
        begin, stop = int(numbers[0]) * frames.period_s, after * frames.period_s
        if (np.isin(table.frame, numbers) & table.t_s.between(begin, stop)).all():
            start, end = begin, stop
    start, end = start if start_s is None else start_s, end if end_s is None else end_s
    if len(table) and not -np.inf < start <= first:
        raise Error(f"start_s: expected {first:.6f} s or less (first track), got {start:.6f}")
    if len(table) and not last <= end < np.inf:
        raise Error(f"end_s: expected {last:.6f} s or more (last track), got {end:.6f}")
    if not 0 <= end - start < np.inf:
        raise Error(f"end_s: expected {start:.6f} s (`start_s`) or more, got {end:.6f}")
    return start, end


def _unseen(passed: pd.DataFrame) -> str:
    """Returns a warning for lines with too many passages in gaps between boxes; empty if none."""
    found = passed.astype({"unseen": int}).groupby("line").unseen.agg(["sum", "size"])
    found = found[found["sum"] > MOST_UNSEEN * found["size"]]
    listed = ", ".join(f"{row.Index} ({row[1]} of {row[2]})" for row in found.itertuples())
    return listed and (
        f"passages in gaps of more than {UNSEEN_S:g} s between the boxes of a track: {listed}; "
        "the sensor may not see the road there"
    )


def _unreached(table: pd.DataFrame, passed: pd.DataFrame, lines: list[Line], *, drawn: bool) -> str:
    """Returns a warning for lines without passages that no track comes near; empty if none."""
    xy = table[["x", "y"]].to_numpy(np.float64)
    counted = set(passed.line)
    empty = [line for line in lines if len(xy) and line.name not in counted]
    apart = {line.name: float(line.distance(xy).min()) for line in empty}
    listed = "; ".join(
        f"line {name}: no track comes within {np.floor(m):.0f} m"
        for name, m in apart.items()
        if m > FAR_M
    )
    frame = "; coordinates of lines are in the levelled LiDAR frame" if drawn else ""
    return listed and listed + frame


def flows(passed: pd.DataFrame, start: float, end: float, interval_s: float) -> pd.DataFrame:
    """Returns counts, speeds, headways and occupancy by interval, line, direction, lane, type."""
    keys = ["start_s", "line", "direction", "lane", "type"]
    table = in_intervals(passed, start, end, interval_s)
    table = table.assign(over_s=table.length_m / np.maximum(table.speed_km_h / KM_H, 0.5))
    groups = table.groupby(keys, sort=True)  # passages without a speed get the mean over_s
    out = groups.agg(
        count=("id", "size"),
        mean_km_h=("speed_km_h", "mean"),
        p85_km_h=("speed_km_h", lambda v: v.quantile(0.85)),
        std_km_h=("speed_km_h", "std"),
        headway_s=("headway_s", "median"),
        gap_s=("gap_s", "median"),
        over_s=("over_s", lambda v: v.fillna(v.mean()).sum(min_count=1)),
    ).reset_index()
    seconds = seconds_of(out, end, interval_s)
    out.insert(6, "flow_per_h", 3600 * out["count"] / seconds)
    return out.assign(occupancy_percent=100 * out.pop("over_s") / seconds)


def movement_table(
    moved: pd.DataFrame, start: float, end: float, interval_s: float
) -> pd.DataFrame:
    """Returns counts by interval, movement and type."""
    keys = ["start_s", "movement", "start", "end", "type"]
    out = (
        in_intervals(moved, start, end, interval_s)
        .groupby(keys)
        .size()
        .rename("count")
        .reset_index()
    )
    return out.assign(flow_per_h=3600 * out["count"] / seconds_of(out, end, interval_s))


def travel_table(moved: pd.DataFrame) -> pd.DataFrame:
    """Returns the travel times of movements between two lines."""
    timed = moved.dropna(subset=["travel_s"]).groupby("movement").travel_s
    return timed.agg(count="size", mean_s="mean", p85_s=lambda v: v.quantile(0.85)).reset_index()


def in_intervals(table: pd.DataFrame, start: float, end: float, interval_s: float) -> pd.DataFrame:
    """Adds start_s, the begin of the interval of each row. Intervals count from the start.

    A row at the end of the recording belongs to the last interval.
    """
    number = interval_numbers(table.t_s.to_numpy(np.float64), start, end, interval_s)
    return table.assign(start_s=start + interval_s * number)


def seconds_of(table: pd.DataFrame, end: float, interval_s: float) -> pd.Series:
    """Returns the recorded seconds of each row's interval; the last interval may be shorter."""
    return np.minimum(interval_s, np.maximum(end - table.start_s, 1e-3))
