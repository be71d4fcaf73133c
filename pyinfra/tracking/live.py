"""Tracks of frames that arrive one after the other, from a growing folder or as JSON lines.

Memory stays bounded: a frame that arrives while the machine is busy replaces the waiting one.
"""

import json
import re
import threading
import time
import warnings
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from pyinfra.core.arrays import IntArray
from pyinfra.core.errors import Error, FindingWarning, FormatError
from pyinfra.dataset.object_rows import BOX
from pyinfra.tracking.state import TYPES, Boxes, Tracks
from pyinfra.tracking.tracker import Tracker
from pyinfra.tracking.tracks import boxes_of, table_of

POLL_S = 0.02
WAITING = 2  # maximum number of lines that were read but not yet processed
CLOUDS = (".bin", ".pcd")
FRAMES = 1e11  # if the period is known, smaller whole numbers in file names are frame numbers
SINCE_1970_S = (5e8, 5e9)  # plausible seconds since 1970: the years 1985 to 2128
UNORDERED = 10  # number of successive late frames after which a jump back of the clock is assumed
_NUMBER = re.compile(r"(?<!\d)(?<!\d\.)\d+(?:\.\d+)?$")  # number at the end of a name
_UNITS = (1, 1e3, 1e6, 1e9)  # units per second of times in file names: s, ms, us and ns
_SHOWN = [
    "id",
    "type",
    *BOX,
    "vx_m_s",
    "vy_m_s",
    "speed_m_s",
    "acceleration_m_s2",
    "score",
    "state",
]


@dataclass(frozen=True)
class Arrival:
    """A frame that has arrived: content, time, and number of frames dropped before it."""

    item: Any
    arrived_s: float  # time of arrival, from time.time()
    dropped: int


def new_clouds(folder: Path, *, idle_s: float = np.inf) -> Iterator[Arrival]:
    """Yields the newest complete cloud file of a growing folder; older ones are dropped.

    Files that exist at the start are not read. New files count in the order of their names. A file
    is complete when its size has not changed for a poll, or a later file exists. Ends after idle_s
    seconds of waiting without a new file.
    """
    known, changed, since = _clouds(folder), -1, time.monotonic()
    dropped, sizes = 0, dict[str, int]()
    while time.monotonic() - since < idle_s:
        stamp = folder.stat().st_mtime_ns
        if stamp == changed and not sizes:
            time.sleep(POLL_S)
            continue
        changed = stamp
        present = _clouds(folder)
        known &= present
        names = sorted(present - known, key=_in_time)
        sizes, before = {}, sizes
        ready = names[:-1]
        if names:
            size = (folder / names[-1]).stat().st_size
            if size and before.get(names[-1]) == size:
                ready = names
            else:
                sizes = {names[-1]: size}
        if not ready:
            time.sleep(POLL_S)
            continue
        dropped += len(ready) - 1
        known |= set(ready)
        file = folder / ready[-1]
        yield Arrival(file, file.stat().st_mtime, dropped)
        since = time.monotonic()  # excludes the time in which the caller processed the file


def _clouds(folder: Path) -> set[str]:
    """Returns the names of clouds, without hidden files, which are still being written."""
    names = {file.name for file in folder.iterdir() if file.suffix.lower() in CLOUDS}
    return {name for name in names if not name.startswith(".")}


def _in_time(name: str) -> tuple[float, str]:
    """Returns a key that sorts names by the number at their end: frame_99 before frame_100."""
    match = _NUMBER.search(Path(name).stem)
    return float(match[0]) if match else -1.0, name


def time_of(file: Path, period_s: float | None) -> float:
    """Returns the time of a cloud in seconds, from the number at the end of its name.

    A whole number is a frame if there is a period. Else a number is a time since 1970 in s, ms, us
    or ns, or a time with decimals in s. Raises Error for other names.
    """
    match = _NUMBER.search(file.stem)
    if match is None:
        raise Error(f"{file}: expected a time or a frame number at the end of the name, got none")
    value, is_whole = float(match[0]), "." not in match[0]
    if is_whole and period_s is not None and value < FRAMES:
        return (value + 0.5) * period_s
    first, last = SINCE_1970_S
    for unit in _UNITS:
        if first <= value / unit < last:
            return value / unit
    if is_whole and value < first:
        raise Error(f"{file}: expected a time in the name, got a frame number; set `period_s`")
    if value >= last:
        raise Error(
            f"{file}: expected a time since 1970 in s, ms, us or ns, of the years 1985 to 2128, "
            f"got {match[0]}"
        )
    return value


def new_lines(stream: Iterable[str], *, drop: bool = True) -> Iterator[Arrival]:
    """Yields lines of a stream. With `drop`, only the newest WAITING lines wait."""
    if not drop:
        for line in stream:
            yield Arrival(line, time.time(), 0)
        return
    waiting: deque[tuple[str, float]] = deque(maxlen=WAITING)
    state, ready = {"read": 0, "open": 1}, threading.Condition()
    failed = list[Exception]()

    def read() -> None:
        try:
            for line in stream:
                with ready:
                    waiting.append((line, time.time()))
                    state["read"] += 1
                    ready.notify()
        except Exception as error:  # raised again below, after the lines that were read
            failed.append(error)
        with ready:
            state["open"] = 0
            ready.notify()

    threading.Thread(target=read, daemon=True).start()
    taken = 0
    while True:
        with ready:
            ready.wait_for(lambda: waiting or not state["open"])
            if not waiting:
                break
            line, arrived_s = waiting.popleft()
            taken += 1
            dropped = state["read"] - taken - len(waiting)
        yield Arrival(line, arrived_s, dropped)
    if failed:
        raise failed[0]


def boxes_of_line(line: str) -> tuple[float, Boxes]:
    """Parses `{"t_s": 1.5, "boxes": [{"type": "vehicle", "x": 1, ..., "score": 0.9}]}`.

    Raises FormatError.
    """
    try:
        value = json.loads(line.removeprefix("\ufeff"))  # some programs write this mark first
        time_s, rows = float(value["t_s"]), list(value["boxes"])
        table = pd.DataFrame(rows, columns=["type", *BOX, "score"])
        table[[*BOX, "score"]] = table[[*BOX, "score"]].astype(float)
        if other := [name for name in table["type"] if not isinstance(name, str)]:
            raise TypeError(f"type: expected text, got {other[0]}")
    except (ValueError, KeyError, TypeError) as error:
        raise FormatError(
            f"expected a line with t_s and boxes of type, {', '.join(BOX)} and score, got "
            f"'{line.strip()[:60]}': {error}"
        ) from None
    if not np.isfinite(time_s):
        raise FormatError(f"t_s: expected a finite time, got {time_s}")
    return time_s, boxes_of(table)


def live_lines(
    arrivals: Iterable[Arrival], read: Callable[[Any], tuple[float, Boxes]], tracker: Tracker
) -> Iterator[str]:
    """Yields a JSON line for each frame that arrives.

    It has t_s, delay_s (from the arrival to the line), dropped (frames so far) and tracks. A frame
    that is not later than the latest one is left out, and counts as `unordered`. If a frame is
    earlier by more than gap_s, or the last of UNORDERED such frames, the clock has jumped back: all
    tracks end, with a warning.
    """
    unordered = late = 0
    gap_s = tracker.settings.gap_s
    for arrival in arrivals:
        time_s, boxes = read(arrival.item)
        step_s = np.nan if tracker.time_s is None else time_s - tracker.time_s
        late = late + 1 if step_s <= 0 else 0
        if late and step_s >= -gap_s and late < UNORDERED:
            unordered += 1
            continue
        if late or step_s > gap_s:
            text = f"t_s: expected steps of 0 to {gap_s:g} s, got {step_s:g} s; all tracks ended"
            warnings.warn(text, FindingWarning, stacklevel=2)
        if late:
            tracker.restart()
            late = 0
        tracks = tracker.step(time_s, boxes)
        line = {
            "t_s": round(time_s, 6),
            "delay_s": round(max(time.time() - arrival.arrived_s, 0.0), 3),
            "dropped": arrival.dropped,
            "unordered": unordered,
            "tracks": records(tracks, time_s),
        }
        yield json.dumps(line)


def records(tracks: Tracks, time_s: float) -> list[dict[str, object]]:
    """Returns the confirmed tracks as dicts, with lengths in m, rounded to 1 mm."""
    rows: IntArray = np.flatnonzero(tracks.confirmed)
    chosen = tracks.select(rows)
    frame = np.zeros(len(rows), np.int64)
    table = table_of(chosen, frame, np.full(len(rows), time_s))[_SHOWN]
    return [dict(row) for row in table.round(3).to_dict("records")]


def boxes_of_detections(values: Any, scores: Any, names: Any) -> Boxes:
    """Converts boxes of a detector: values (n, 7), scores (n,) and names (n,) of types."""
    kinds = pd.Index(TYPES).get_indexer(names)
    known = kinds >= 0
    votes = np.zeros((int(known.sum()), len(TYPES)))
    votes[np.arange(len(votes)), kinds[known]] = np.clip(np.asarray(scores)[known], 0, 1)
    return Boxes(np.asarray(values, np.float64)[known], votes)
