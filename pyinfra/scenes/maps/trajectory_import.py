"""Converts recorded trajectories to tracks: smooth, at 10 Hz, without gaps, with constant size."""

import math
import re
import shlex
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np

from pyinfra.core.arrays import FloatArray
from pyinfra.core.errors import FormatError
from pyinfra.scenes.maps.fcd import Recorded
from pyinfra.scenes.maps.geographic import (
    Projection,
    centred_on,
    check_near_site,
    in_degrees,
)
from pyinfra.scenes.maps.recorded_boxes import BoxTrack
from pyinfra.scenes.maps.smoothing import smooth, unsmoothed, within_limits
from pyinfra.scenes.maps.tracks import CLASSES, STEP_S, FrontPath, Track, from_zero

FILLED_S = 1.0  # gaps up to this length are filled; longer gaps split a track
_FASTEST_M_S = 70.0  # maximum plausible speed; faster steps are clock jumps or other objects
_SHORTEST_S = 1.0  # minimum duration of a track
_SAME_SIZE_M = 0.05  # larger variations of an object's size are reported
_LONGEST_S = 7200.0  # maximum duration of a recording
_SIDEWAYS_DEG = 30.0  # largest plausible median angle between headings and motion
_LEAST_STEPS = 20  # minimum number of movements from which the median angle is computed
_MOVED_M = 0.5  # minimum movement from which a heading is derived

# Maps class names of this package, SUMO's classes and SUMO's default types to classes of this
# package. A SUMO class without a counterpart maps to a class of similar size.
_SUMO_TYPES = {
    **{name: name for name in CLASSES},
    **{row.sumo_class: name for name, row in CLASSES.items()},
    "DEFAULT_VEHTYPE": "Car",
    "DEFAULT_PEDTYPE": "Pedestrian",
    "DEFAULT_BIKETYPE": "Cyclist",
    "DEFAULT_TAXITYPE": "Car",
    **dict.fromkeys("private taxi emergency authority army vip hov evehicle".split(), "Car"),
    **{"coach": "Bus", "trailer": "Truck", "moped": "Motorcycle"},
}
_BY_LOWER_CASE = {name.lower(): ours for name, ours in _SUMO_TYPES.items()}
_WITHOUT_TYPE = {"vehicle": "Car", "person": "Pedestrian"}


@dataclass
class ImportedTracks:
    """Tracks, and a note about each change or omission."""

    tracks: list[Track] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


def import_fcd(
    objects: list[Recorded],
    classes: dict[str, str],
    offset_m: FloatArray,
    projection: Projection | None = None,
    *,
    has_site: bool = False,
) -> ImportedTracks:
    """Converts SUMO's front bumper positions to tracks, with the mean sizes of their classes.

    `classes` maps SUMO types that are not known by name to classes of this package. `offset_m` (3,)
    is subtracted from the file's coordinates. `projection` is the site's projection of longitude
    and latitude. Without a site, longitude and latitude become metres from their middle. Raises
    FormatError for a type without a class.
    """
    out = ImportedTracks()
    start = min(float(o.rows[0, 0]) for o in objects)
    _check_length(start, max(float(o.rows[-1, 0]) for o in objects))
    of_type = _classes(objects, classes, out)
    to_metres = _to_metres(objects, offset_m, projection, has_site, out)
    for o in objects:
        object_class = of_type[o.kind, o.type_name]
        size = np.array(CLASSES[object_class].mean_m)
        positions = np.column_stack([to_metres(o.rows[:, 1:4]), o.rows[:, 4]])
        for first, piece in _pieces(o.name, o.rows[:, 0] - start, positions, out):
            heading = piece[:, 3]
            if not np.isfinite(heading).all():
                if object_class != "Pedestrian" and not _moves(piece):
                    out.notes.append(f"{o.name}: left out: it has no angle and never moves")
                    continue
                heading = _headings(piece)
            path = FrontPath(o.name, object_class, size, first, piece[:, :3], heading)
            _take(path, smooth(path), out)
    return _from_zero(out)


def _classes(
    objects: list[Recorded], classes: dict[str, str], out: ImportedTracks
) -> dict[tuple[str, str], str]:
    """Returns the class for each kind and type. Adds a note for guesses. Raises FormatError."""
    class_of: dict[tuple[str, str], str] = {}
    unknown: dict[str, str] = {}
    for o in objects:
        if (o.kind, o.type_name) in class_of:
            continue
        ours = classes.get(o.type_name) or _SUMO_TYPES.get(o.type_name)
        if ours is None and (ours := _guessed_class(o)):
            of = f"type '{o.type_name}'" if o.type_name else f"{o.kind}s without a type"
            out.notes.append(f"{of}: read as {ours}")
        if ours not in CLASSES:
            unknown.setdefault(o.type_name, o.name)
        class_of[o.kind, o.type_name] = ours or ""
    if unknown:
        hint = shlex.quote(",".join(f"{name}=Car" for name in unknown))
        first, name = next(iter(unknown.items()))
        raise FormatError(
            f"object '{name[:40]}': expected one of the types {', '.join(_SUMO_TYPES)}; got type "
            f"'{first[:40]}'; to map it to a class, use for example `class_of` {hint}"
        )
    return class_of


def _guessed_class(o: Recorded) -> str | None:
    """Guesses the class from the type's name, or from its last word, in upper or lower case.

    For example, the last word of `veh_passenger` is `passenger`.
    """
    if not o.type_name:
        return _WITHOUT_TYPE[o.kind]
    words = re.split(r"[^a-z0-9]+", o.type_name.lower())
    return _BY_LOWER_CASE.get(o.type_name.lower()) or _BY_LOWER_CASE.get(words[-1])


def _to_metres(
    objects: list[Recorded],
    offset_m: FloatArray,
    projection: Projection | None,
    has_site: bool,
    out: ImportedTracks,
) -> Callable[[FloatArray], FloatArray]:
    """Returns a function that converts positions (n, 3) of the file to the site's frame.

    Raises FormatError.
    """
    motions = [(o.rows[:, 0], o.rows[:, 1:3], o.speeds) for o in objects]
    if not in_degrees(motions, projection):
        return lambda positions: np.asarray(positions - offset_m)
    lon_lat = np.concatenate([o.rows[:, 1:3] for o in objects])
    if projection is not None:
        check_near_site(lon_lat, projection)
        out.notes.append(
            "positions were longitude and latitude: projected like the map of the site"
        )
    elif has_site:
        raise FormatError(
            "x, y: expected metres, got longitude and latitude; the site's map has no projection, "
            "so write the file without SUMO's option fcd-output.geo"
        )
    else:
        projection = centred_on(lon_lat)
        lon, lat = projection.centre
        out.notes.append(
            f"positions were longitude and latitude: converted to metres from {lon:g} {lat:g}"
        )
    known = projection
    return lambda positions: np.column_stack([known.metres(positions[:, :2]), positions[:, 2]])


def _moves(positions: FloatArray) -> bool:
    return bool(np.hypot(*(positions[:, :2] - positions[0, :2]).T).max() >= _MOVED_M)


def _headings(positions: FloatArray) -> FloatArray:
    """Returns the headings (n,) in rad of moving positions (n, 4), or 0 without motion."""
    heading = np.zeros(len(positions))
    i = 0
    for k in range(1, len(positions)):
        step = positions[k, :2] - positions[i, :2]
        if math.hypot(*step) >= _MOVED_M:
            heading[i:k] = heading[k:] = math.atan2(step[1], step[0])
            i = k
    return np.unwrap(heading)


def import_boxes(objects: list[BoxTrack], offset_m: FloatArray) -> ImportedTracks:
    """Converts boxes to tracks. A track within the limits of motion is not smoothed.

    `offset_m` (3,) is subtracted from the boxes' coordinates. Raises FormatError.
    """
    out = ImportedTracks()
    start = min(float(o.times[0]) for o in objects)
    _check_length(start, max(float(o.times[-1]) for o in objects))
    motions = [(o.times, o.boxes[:, :2], np.full(len(o.times), np.nan)) for o in objects]
    if in_degrees(motions, None):
        raise FormatError("x, y: expected metres, got values that look like longitude and latitude")
    _check_boxes(objects)
    if count := sum(o.has_mean_size for o in objects):
        out.notes.append(f"sizes of 0 of {count} objects: the mean of the class is used")
    for o in objects:
        size = np.median(o.boxes[:, 3:6], axis=0)
        apart = float(np.abs(o.boxes[:, 3:6] - size).max())
        if apart > _SAME_SIZE_M:
            out.notes.append(f"{o.name}: its size varied by {apart:.2f} m: the median is used")
        positions = o.boxes[:, [0, 1, 2, 6]].copy()
        ahead = np.stack([np.cos(positions[:, 3]), np.sin(positions[:, 3])], axis=1)
        positions[:, :2] += ahead * size[0] / 2
        positions[:, 2] -= size[2] / 2
        positions[:, :3] -= offset_m
        for first, piece in _pieces(o.name, o.times - start, positions, out):
            path = FrontPath(o.name, o.object_class, size, first, piece[:, :3], piece[:, 3])
            as_is = unsmoothed(path)
            _take(path, as_is if within_limits(as_is) else smooth(path), out)
    return _from_zero(out)


def _check_boxes(objects: list[BoxTrack]) -> None:
    """Raises FormatError if vehicles drive sideways, or most of them are wider than long.

    Reversing vehicles, and boxes that point backwards, are accepted.
    """
    vehicles = [o for o in objects if o.object_class != "Pedestrian"]
    sideways: list[float] = []
    for o in vehicles:
        rows = [0]  # rows that are apart by at least _MOVED_M
        for k, xy in enumerate(o.boxes[:, :2]):
            if math.dist(xy, o.boxes[rows[-1], :2]) >= _MOVED_M:
                rows.append(k)
        steps = np.diff(o.boxes[rows, :2], axis=0)
        off = np.arctan2(steps[:, 1], steps[:, 0]) - o.boxes[rows[1:], 6]
        sideways += np.abs(np.degrees(np.arcsin(np.sin(off)))).tolist()
    if len(sideways) >= _LEAST_STEPS and (angle := float(np.median(sideways))) > _SIDEWAYS_DEG:
        raise FormatError(
            "heading: expected the direction of motion, in radians from x towards y, got headings "
            f"that are off by {angle:.0f} degrees (median); for degrees, set `degrees`"
        )
    lengths, widths = (
        np.array([np.median(o.boxes[:, 3:5], axis=0) for o in vehicles]).reshape(-1, 2).T
    )
    if (wide := int((lengths < widths).sum())) > len(vehicles) / 2:
        raise FormatError(
            f"dx, dy: expected length and width, got {wide} of {len(vehicles)} vehicles that are "
            "wider than long; the columns may be swapped"
        )


def _take(path: FrontPath, track: Track | None, out: ImportedTracks) -> None:
    if track is None:
        at = path.first * STEP_S
        out.notes.append(
            f"{path.name}: the track that begins at {at:.1f} s was dropped, because it turns or "
            "accelerates too fast"
        )
    else:
        out.tracks.append(track)


def _from_zero(out: ImportedTracks) -> ImportedTracks:
    """Shifts the time so that the first track starts at 0. Raises FormatError without a track."""
    if not out.tracks:
        why = out.notes[0] if out.notes else "no rows"
        raise FormatError(f"expected one or more usable tracks, got none ({why})")
    out.tracks = from_zero(out.tracks)
    return out


def _pieces(
    name: str, times: FloatArray, positions: FloatArray, out: ImportedTracks
) -> Iterator[tuple[int, FloatArray]]:
    """Yields first instant and x y z heading (n, 4) at 10 Hz for each part without a long gap."""
    gap_s = np.diff(times)
    step_m = np.linalg.norm(np.diff(positions[:, :3], axis=0), axis=1)
    long = gap_s > FILLED_S + 1e-6
    jump = ~long & (step_m > _FASTEST_M_S * gap_s)
    for k in np.flatnonzero(long | jump):
        cause = f"gap of {gap_s[k]:.1f} s" if long[k] else f"jump of {step_m[k]:.1f} m"
        out.notes.append(f"{name}: cut at {times[k]:.1f} s: {cause}")
    cuts = np.flatnonzero(long | jump) + 1
    for t, rows in zip(np.split(times, cuts), np.split(positions, cuts), strict=True):
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
            f"expected at most {_LONGEST_S:g} s in total, got times from {start:g} to {end:g} s; "
            "the clock may have jumped, or the times may be in another unit"
        )
