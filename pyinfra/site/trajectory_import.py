"""Others' trajectories to tracks of ours: 10 Hz, no gaps, one size each, smooth."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from pyinfra.arrays import FloatArray
from pyinfra.kitti import FormatError
from pyinfra.site.fcd import Recorded
from pyinfra.site.recorded_boxes import BoxTrack
from pyinfra.site.smoothing import smooth, unsmoothed, within_limits
from pyinfra.site.tracks import CLASSES, STEP_S, FrontPath, Track, from_zero

FILLED_S = 1.0  # gaps up to this are filled, longer ones cut a track
_FASTEST_M_S = 70.0  # what is faster is another object, or a clock that jumped
_SHORTEST_S = 1.0
_SAME_SIZE_M = 0.05
_LONGEST_S = 7200.0

# SUMO's own types, and its classes.
_SUMO_TYPES = {
    **{name: name for name in CLASSES},
    **{row.sumo_class: name for name, row in CLASSES.items()},
    "DEFAULT_VEHTYPE": "Car",
    "DEFAULT_PEDTYPE": "Pedestrian",
    "DEFAULT_BIKETYPE": "Cyclist",
}


@dataclass
class ImportedTracks:
    """Tracks, and what became of what was not taken as it was: a line each."""

    tracks: list[Track] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


def import_fcd(
    objects: list[Recorded], classes: dict[str, str], offset_m: FloatArray
) -> ImportedTracks:
    """SUMO's front bumpers; sizes are the means of their classes.

    classes: SUMO's types to ours, past those that say it themselves; offset_m: (3,), taken from
    the file's coordinates. Raises FormatError for a type without a class.
    """
    out = ImportedTracks()
    start = min(float(o.rows[0, 0]) for o in objects)
    _check_length(start, max(float(o.rows[-1, 0]) for o in objects))
    for o in objects:
        found = classes.get(o.type_name) or _SUMO_TYPES.get(o.type_name)
        if found not in CLASSES:
            raise FormatError(
                f"object '{o.name[:40]}': found type '{o.type_name[:40]}', allowed "
                f"{', '.join(_SUMO_TYPES)}, or --class-of {o.type_name[:40]}=Car"
            )
        size = np.array(CLASSES[found].mean_m)
        places = np.column_stack([o.rows[:, 1:4] - offset_m, o.rows[:, 4]])
        for first, piece in _pieces(o.name, o.rows[:, 0] - start, places, out):
            path = FrontPath(o.name, found, size, first, piece[:, :3], piece[:, 3])
            _take(path, smooth(path), out)
    return _from_zero(out)


def import_boxes(objects: list[BoxTrack], offset_m: FloatArray) -> ImportedTracks:
    """Boxes by their centres; what moves well already stays as it is. offset_m: as above."""
    out = ImportedTracks()
    start = min(float(o.times[0]) for o in objects)
    _check_length(start, max(float(o.times[-1]) for o in objects))
    for o in objects:
        size = np.median(o.boxes[:, 3:6], axis=0)
        apart = float(np.abs(o.boxes[:, 3:6] - size).max())
        if apart > _SAME_SIZE_M:
            out.notes.append(f"{o.name}: its size varied by {apart:.2f} m: the median was taken")
        places = o.boxes[:, [0, 1, 2, 6]].copy()
        ahead = np.stack([np.cos(places[:, 3]), np.sin(places[:, 3])], axis=1)
        places[:, :2] += ahead * size[0] / 2
        places[:, 2] -= size[2] / 2
        places[:, :3] -= offset_m
        for first, piece in _pieces(o.name, o.times - start, places, out):
            path = FrontPath(o.name, o.object_class, size, first, piece[:, :3], piece[:, 3])
            as_is = unsmoothed(path)
            _take(path, as_is if within_limits(as_is) else smooth(path), out)
    return _from_zero(out)


def _take(path: FrontPath, track: Track | None, out: ImportedTracks) -> None:
    if track is None:
        at = path.first * STEP_S
        out.notes.append(
            f"{path.name}: dropped: it turns or accelerates too hard (from {at:.1f} s)"
        )
    else:
        out.tracks.append(track)


def _from_zero(out: ImportedTracks) -> ImportedTracks:
    """The clock starts with the first track that was kept."""
    if not out.tracks:
        why = out.notes[0] if out.notes else "no rows"
        raise FormatError(f"found no track that can be used ({why}), allowed one or more")
    out.tracks = from_zero(out.tracks)
    return out


def _pieces(
    name: str, times: FloatArray, places: FloatArray, out: ImportedTracks
) -> Iterator[tuple[int, FloatArray]]:
    """First instant and places (n, 4) x y z heading at 10 Hz, of each part without a long gap."""
    gap_s = np.diff(times)
    step_m = np.linalg.norm(np.diff(places[:, :3], axis=0), axis=1)
    long = gap_s > FILLED_S + 1e-6
    jump = ~long & (step_m > _FASTEST_M_S * gap_s)
    for k in np.flatnonzero(long | jump):
        what = f"gap of {gap_s[k]:.1f} s" if long[k] else f"jump of {step_m[k]:.1f} m"
        out.notes.append(f"{name}: cut at {times[k]:.1f} s: {what}")
    cuts = np.flatnonzero(long | jump) + 1
    for t, rows in zip(np.split(times, cuts), np.split(places, cuts), strict=True):
        first, last = int(np.ceil(t[0] / STEP_S - 1e-6)), int(np.floor(t[-1] / STEP_S + 1e-6))
        if (last - first) * STEP_S < _SHORTEST_S - 1e-6:
            out.notes.append(f"{name}: dropped {len(t)} rows from {t[0]:.1f} s: shorter than 1 s")
            continue
        at = np.arange(first, last + 1) * STEP_S
        heading = np.interp(at, t, np.unwrap(rows[:, 3]))
        xyz = [np.interp(at, t, rows[:, i]) for i in range(3)]
        yield first, np.column_stack([*xyz, heading])


def _check_length(start: float, end: float) -> None:
    if end - start > _LONGEST_S:
        raise FormatError(
            f"found times from {start:g} to {end:g} s, allowed {_LONGEST_S:g} s together: "
            "does the clock jump, or is it in another unit?"
        )
