"""Determines the times of a recording's frames, and finds errors of the recording's clock."""

import re
from dataclasses import replace

import numpy as np

from pyinfra.core.arrays import BoolArray, FloatArray, IntArray
from pyinfra.dataset.frames import PERIOD_S as USUAL_S
from pyinfra.exchange.name_times import EARLIEST_S, LATEST_S, REGULAR, times_in
from pyinfra.exchange.recording import Recording
from pyinfra.formats.kitti.lidar import PERIOD_S

STAMP_UNITS_S = (1.0, 1e-3, 1e-6, 1e-9)
MOST_NUMBER = 999_999
MOST_UNKNOWN = 0.1  # share of frames whose unknown times are interpolated


def seconds_of_stamp(value: float) -> float | None:
    """Converts a time of unknown unit to seconds since 1970.

    Returns None if no unit gives a plausible time.
    """
    for unit in STAMP_UNITS_S:
        if EARLIEST_S < value * unit < LATEST_S:
            return value * unit
    return None


def timed(recording: Recording, period_s: float | None = None) -> tuple[Recording, list[str]]:
    """Orders a recording by time, and derives frame period and frame numbers from its clock.

    Returns the recording and notes on its clock. `period_s` takes precedence over the clock. Times
    come from the files, else from the file names. If there are no times, or their median step
    cannot be a frame period, the recording is returned unchanged. If times step back, the function
    looks at the steps between the sorted times. If all of these steps are 0.5 to 1.5 times the
    median step, the function sorts the frames by time. Otherwise the clock is assumed to be wrong,
    and the frames stay in the order of their names.
    """
    if len(recording.names) < 2:
        return recording, []
    times, notes = _times(recording)
    if times is None:
        return recording, [*notes, *_without_clock(recording, period_s, "no times are known")]
    steps = np.diff(times)
    if (steps < 0).any():
        order = np.argsort(times, kind="stable")
        if not _regular(np.diff(times[order])):
            before = int(steps.argmin())
            notes.append(
                f"the clock steps back by {-steps[before]:.3g} s after {recording.names[before]}: "
                "the clock is not used, and frames are in the order of their names"
            )
            return recording, [*notes, *_without_clock(recording, period_s, "the clock is wrong")]
        late = int((steps < 0).sum())
        notes.append(
            f"frames are out of order ({late} frames are older than the frame before them), so the "
            "import sorts them by time"
        )
        recording, times = _reordered(recording, order), times[order]
        steps = np.diff(times)
    return _by_clock(recording, steps, period_s, notes)


def _without_clock(recording: Recording, period_s: float | None, why: str) -> list[str]:
    """Returns notes on an assumed frame period, and on gaps between the numbers in names."""
    notes = []
    if not (period_s or recording.period_s):
        notes.append(
            f"{why}, so the time between frames is set to {USUAL_S:g} s; `period_s` sets another "
            "time"
        )
    parts = [re.fullmatch(r"(\D*)(\d+)(\D*)", name) for name in recording.names]
    numbers = [int(match[2]) for match in parts if match]
    alike = len({(match[1], match[3]) if match else None for match in parts}) == 1
    if alike and numbers and recording.counted and recording.slots is None:
        steps = np.diff(np.array(numbers, dtype=object))
        gaps = np.flatnonzero(steps > steps.min())
        if steps.min() > 0 and len(gaps) > 0:
            notes.append(
                f"frames are missing at {len(gaps)} places, such as after "
                f"{recording.names[gaps[0]]}; the frame numbers have no gaps"
            )
    return notes


def _times(recording: Recording) -> tuple[FloatArray | None, list[str]]:
    """Returns the times from the files, else from the file names, and notes on missing times."""
    times, notes = recording.times(), []
    if times is not None and not (has_time := np.isfinite(times)).all():
        first = recording.names[int(has_time.argmin())]
        few = bool((~has_time).mean() <= MOST_UNKNOWN)
        notes.append(
            f"{int((~has_time).sum())} of {len(times)} frames, such as {first}, have no time: "
            + ("it is interpolated" if few else "the times of the other frames are not used")
        )
        times = _interpolated(times, has_time) if few else None
    return times_in(recording.names) if times is None else times, notes


def _interpolated(times: FloatArray, has_time: BoolArray) -> FloatArray:
    """Returns the times (n,), where unknown ones lie between those of the frames around them."""
    known = np.flatnonzero(has_time)
    usual = float(np.median(np.diff(times[known])))
    first, last = known[0], known[-1]
    at = np.arange(len(times))
    inside = np.interp(at, known, times[known])
    beyond = np.minimum(at - first, 0) + np.maximum(at - last, 0)
    return np.asarray(inside + beyond * usual, dtype=np.float64)


def _regular(steps: FloatArray) -> bool:
    usual = float(np.median(steps))
    return bool(((steps > REGULAR[0] * usual) & (steps < REGULAR[1] * usual)).all())


def _reordered(recording: Recording, order: IntArray) -> Recording:
    names, read = recording.names, recording.read
    return replace(
        recording,
        names=tuple(names[i] for i in order),
        read=lambda i: read(int(order[i])),
        times=lambda: None,
        slots=tuple(range(len(names))),
    )


def _by_clock(
    recording: Recording, steps: FloatArray, period_s: float | None, notes: list[str]
) -> tuple[Recording, list[str]]:
    usual = float(np.median(steps))
    names = recording.names
    if (steps == 0).any():
        at = int((steps == 0).argmax())
        notes.append(
            f"{int((steps == 0).sum())} frames, such as {names[at + 1]}, have the same time as the "
            "frame before them"
        )
    if not PERIOD_S[0] <= usual <= PERIOD_S[1]:
        why = f"the median step of the clock is {usual:.4g} s, which is no frame period"
        return recording, [*notes, *_without_clock(recording, period_s, why)]
    if period_s and not REGULAR[0] < period_s / usual < REGULAR[1]:
        notes.append(
            f"`period_s` is {period_s:g} s, but the median step of the clock is {usual:.4g} s; "
            "`period_s` is used"
        )
    period = period_s or recording.period_s or round(usual, 4)
    apart = np.maximum(np.round(steps / usual), 1).astype(np.int64)
    slots = [0, *np.cumsum(apart).tolist()]
    if (apart > 1).any():
        at = int(steps.argmax())
        numbered = slots[-1] <= MOST_NUMBER and (recording.counted or recording.slots is not None)
        notes.append(
            f"frames are missing at {int((apart > 1).sum())} places, and the longest gap is "
            f"{steps[at]:.4g} s after {names[at]}; the frame numbers "
            + ("have the same gaps" if numbered else "have no gaps")
        )
        if numbered:
            recording = replace(recording, slots=tuple(slots))
    return replace(recording, period_s=period), notes
