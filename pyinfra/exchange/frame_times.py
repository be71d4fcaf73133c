"""Determines the times of a recording's frames, and finds errors of the recording's clock."""

import math
import re
from dataclasses import replace

import numpy as np

from pyinfra.core.arrays import BoolArray, FloatArray, IntArray
from pyinfra.dataset.frames import PERIOD_S as USUAL_S
from pyinfra.exchange.name_times import EARLIEST_S, LATEST_S, REGULAR, share_regular, times_in
from pyinfra.exchange.recording import Recording
from pyinfra.formats.kitti.lidar import PERIOD_S

STAMP_UNITS_S = (1.0, 1e-3, 1e-6, 1e-9)
MOST_NUMBER = 999_999
MOST_UNKNOWN = 0.1  # maximum share of frames with unknown times that are interpolated
AROUND = 4  # maximum number of steps between a long step and the short step that compensates it
MOST_OFF = 0.05  # relative tolerance between steps of the clock and of the numbers in names


def seconds_of_stamp(value: float) -> float | None:
    """Converts a time of unknown unit to seconds since 1970.

    Returns None if no unit gives a plausible time.
    """
    return next((value * u for u in STAMP_UNITS_S if EARLIEST_S < value * u < LATEST_S), None)


def timed(recording: Recording, period_s: float | None = None) -> tuple[Recording, list[str]]:
    """Orders a recording by time, and derives frame period and frame numbers from its clock.

    The frame period is the time from one frame number to the next. Numbers in names are kept if
    they follow the clock, and replaced if they do not.

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
        if share_regular(np.diff(times[order])) < 1:
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
    if not period_s:
        notes.append(
            f"{why}, so the time between frames is set to {USUAL_S:g} s; `period_s` sets another "
            "time"
        )
    if _is_named(recording) and (apart := int(np.gcd.reduce(np.diff(recording.numbers())))) > 1:
        notes.append(
            f"the numbers in the names are {apart} apart, so the clouds are "
            f"{apart * (period_s or USUAL_S):g} s apart: `period_s` is the time from one number to "
            "the next"
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
    """Returns the times (n,), with unknown times interpolated between the known times."""
    known = np.flatnonzero(has_time)
    usual = float(np.median(np.diff(times[known])))
    first, last = known[0], known[-1]
    at = np.arange(len(times))
    inside = np.interp(at, known, times[known])
    beyond = np.minimum(at - first, 0) + np.maximum(at - last, 0)
    return np.asarray(inside + beyond * usual, dtype=np.float64)


def _reordered(recording: Recording, order: IntArray) -> Recording:
    names, read = recording.names, recording.read
    return replace(
        recording,
        names=tuple(names[i] for i in order),
        read=lambda i: read(int(order[i])),
        times=lambda: None,
        slots=tuple(range(len(names))),
    )


def _is_named(recording: Recording) -> bool:
    """Returns whether the frame numbers are the numbers in the frames' names."""
    return recording.slots is None and not recording.counted


def _near(period_s: float, other_s: float) -> bool:
    return REGULAR[0] < period_s / other_s < REGULAR[1]


def _missing(late: FloatArray) -> IntArray:
    """Returns the number of frames that are missing in each step; negative if there are too many.

    late: (n,) how much each step is too long, in steps. A late or early time is not a missing frame
    if the steps around it compensate the error.
    """
    rest = late.tolist()
    for apart in range(1, AROUND + 1):
        for i in range(len(rest) - apart):
            first, second = rest[i], rest[i + apart]
            if first * second < 0:
                part = math.copysign(min(abs(first), abs(second)), first)
                rest[i], rest[i + apart] = first - part, second + part
    return np.floor(np.array(rest) + 0.5).astype(np.int64)


def _by_clock(
    recording: Recording, steps: FloatArray, period_s: float | None, notes: list[str]
) -> tuple[Recording, list[str]]:
    usual = float(np.median(steps))
    names, is_named = recording.names, _is_named(recording)
    if (steps == 0).any():
        at = int((steps == 0).argmax())
        notes.append(
            f"{int((steps == 0).sum())} frames, such as {names[at + 1]}, have the same time as the "
            "frame before them"
        )
    if usual <= 0:
        why = f"the median step of the clock is {usual:.4g} s, which is no frame period"
        return recording, [*notes, *_without_clock(recording, period_s, why)]
    apart = np.diff(recording.numbers())
    unit = float(np.median(steps / np.maximum(apart, 1)))  # time from one frame number to the next
    off = np.abs(_missing((steps - unit * apart) / usual)) > MOST_OFF * apart
    # Numbers of key frames are more than 1 apart. If the user's period is the time between key
    # frames, the period does not fit the numbers.
    is_of_clouds = bool(period_s and _near(period_s, usual) and not _near(period_s, unit))
    anew = is_named and (bool(off.any()) or is_of_clouds)
    is_kept = is_named and not anew
    unit = usual if anew else unit
    if not PERIOD_S[0] <= unit <= PERIOD_S[1]:
        why = f"the median step of the clock is {usual:.4g} s, which is no frame period"
        return recording, [*notes, *_without_clock(recording, period_s, why)]
    if period_s and not _near(period_s, unit):
        notes.append(
            f"`period_s` is {period_s:g} s, but the median step of the clock is {unit:.4g} s; "
            "`period_s` is used"
        )
    missing = np.maximum(_missing(steps / usual - 1), 0)
    slots = (0, *np.cumsum(1 + missing).tolist())
    fits = slots[-1] <= MOST_NUMBER
    if anew:
        at = int(off.argmax())
        notes.append(
            f"frames are numbered by the clock, which the numbers in the names do not follow: "
            f"{names[at + 1]} is {steps[at]:.4g} s after {names[at]}; `sources.csv` has the names"
        )
    if missing.any():
        at = int(steps.argmax())
        notes.append(
            f"frames are missing at {int((missing > 0).sum())} places, and the longest gap is "
            f"{steps[at]:.4g} s after {names[at]}; the frame numbers "
            + ("have the same gaps" if fits or is_kept else "have no gaps")
        )
    if anew or (missing.any() and not is_kept):
        recording = replace(recording, slots=slots if fits else tuple(range(len(names))))
    return replace(recording, period_s=period_s or round(unit, 4)), notes
