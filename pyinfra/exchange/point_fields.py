"""Reads time, ring and intensity of points, whose names and units differ between drivers.

Known names and units of drivers of LiDARs:
    Velodyne   time       seconds (float32), counted from the start or to the end of the frame
    Ouster     t          nanoseconds (uint32) from the start of the frame
    Hesai      timestamp  seconds since 1970 (float64)
    RoboSense  timestamp  seconds since 1970 (float64)
    Livox      offset_time nanoseconds (uint32) from the start, or timestamp in nanoseconds
A file states neither the unit nor the start of the count, so both are estimated from the values.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pyinfra.core.arrays import AnyArray, FloatArray, Records, unchecked
from pyinfra.core.errors import FormatError
from pyinfra.formats import kitti

TIMES = (
    *("time", "timestamp", "t", "offset_time", "time_stamp", "time_offset", "time_s", "gps_time"),
    *("offset_ns", "timestamp_ns", "time_ns", "timestamp_us", "time_us"),
)
RINGS = (
    *("ring", "line", "channel", "laser_id", "laser", "ring_id", "beam", "beam_id", "laserid"),
    *("laser_channel", "scan_channel"),
)
# Fields in order of preference. Makers calibrate the reflectivity, but often not the intensity.
INTENSITIES = (
    *("reflectivity", "intensity", "i", "intensities", "reflectance", "remission"),
    *("signal", "signal_photons"),
)
# Maps kitti.FIELDS of exported files to the names in these files.
OWN = {"class": ("class", "class_id"), "object_id": ("object_id",), "echo": ("echo",)}
UNITS = {1.0: "seconds", 1e-3: "milliseconds", 1e-6: "microseconds", 1e-9: "nanoseconds"}
# Plausible duration between the first and last point of a frame. The upper limit is 1000 times the
# lower limit, so that exactly one unit fits.
DURATION_S = (0.003, 3.0)
LEAST_MAP_M = 1e5  # coordinates above this are map coordinates, such as UTM
MOST_ROUNDING_S = 1e-3  # largest accepted rounding error of the times of points
# A cloud with all of these fields was written by `pyinfra export`. Its times are in seconds.
EXPORTED = {"time", "ring", "object_id", "class", "echo"}


@dataclass(frozen=True)
class PointTimes:
    """The field with the times of a recording's points, its unit, and its zero."""

    field: str
    unit_s: float
    is_absolute: bool  # whether times are counted from an epoch, such as 1970
    is_shifted: bool  # whether the time of the first point of a frame is subtracted

    @unchecked
    def seconds(self, records: Records) -> FloatArray:
        """Returns the time (n,) of each point since the start of the frame; 0 if it is invalid."""
        values = records[self.field]
        valid = np.isfinite(values)
        if self.is_absolute:  # the absolute time 0 means a ray without a return
            valid &= values > 0
        out = np.zeros(len(values))
        if valid.any():
            # The conversion to float64 rounds large integers, so the subtraction comes first.
            least = values[valid].min() if self.is_shifted else 0
            out[valid] = (values[valid] - least).astype(np.float64) * self.unit_s
        return out


class PointFields:
    """The fields and the offset of all points of a recording, decided from some of its clouds."""

    @unchecked
    def __init__(self, clouds: Iterable[Records]) -> None:
        self.clouds = list(clouds)
        self.offset = map_offset(self.clouds)
        samples = [records for records in self.clouds if len(records) > 0]
        names = set(samples[0].dtype.names or ()) if samples else set()
        self.times, self.notes = _point_times(samples)
        if names >= EXPORTED:
            self.times, self.notes = PointTimes("time", 1.0, False, False), []
        self.ring, notes = _ring(samples)
        self.notes += notes
        if samples and (self.times is None) != (self.ring is None):
            has, lacks = ("time", "ring") if self.ring is None else ("ring", "time")
            field = self.ring or (self.times.field if self.times else "")
            self.notes.append(
                f"points have a {has} (`{field}`), but no {lacks} is known: {has} is not used"
            )

    def unread(self) -> list[str]:
        """Returns a text with the fields of clouds that are not read; empty if all are read."""
        read = {self.ring, self.times.field if self.times else None}
        names: dict[str, None] = {}
        for records in self.clouds:
            own = named_fields(records.dtype, [*"xyz", *OWN, *(a for n in OWN.values() for a in n)])
            used = {*own, intensity_field(records), *read}
            names |= dict.fromkeys(n for n in records.dtype.names or () if n not in used)
        kept = [name for name in names if not name.startswith("_")]
        return [f"fields of points: {', '.join(kept)}"] if kept else []

    def cloud_notes(self) -> list[str]:
        """Describes the assumptions about offset, intensity and point times of a recording."""
        notes = list(self.notes)
        if self.offset.any():
            notes.append(offset_note(self.offset))
        if any(intensity_field(records) is None for records in self.clouds):
            notes.append("clouds without an intensity: intensities are set to 0")
        return notes

    @unchecked
    def read(self, location: str, records: Records) -> Records | None:
        """Returns records (n,) of kitti.FIELDS, or None if time or ring is unknown.

        A point without class and object id counts as background. Raises FormatError that begins
        with `location`.
        """
        names = records.dtype.names or ()
        if self.times is None or self.ring is None:
            return None
        if self.times.field not in names or self.ring not in names:
            return None
        out = np.zeros(len(records), dtype=kitti.FIELDS)
        out["object_id"] = -1
        seconds = self.times.seconds(records)
        bad = np.flatnonzero(~((seconds >= 0) & (seconds <= DURATION_S[1])))
        if len(bad) > 0:
            raise FormatError(
                f"{location}: point {bad[0]}: {self.times.field}: expected 0 to {DURATION_S[1]:g} "
                f"s after the start of the frame, got {seconds[bad[0]]:g} s"
            )
        out["time_s"] = seconds
        columns = {"ring": self.ring}
        for key, aliases in OWN.items():
            if name := next((alias for alias in aliases if alias in names), None):
                columns[key] = name
        for key, name in columns.items():
            out[key] = _whole(location, records[name], name, kitti.FIELDS[key])
        return out


def intensity_field(records: Records) -> str | None:
    """Returns the field that holds the intensity, or None.

    An empty reflectivity is skipped, because some drivers do not fill it.
    """
    present = named_fields(records.dtype, INTENSITIES)
    filled = (name for name in present if len(present) > 1 and np.any(records[name]))
    return next(filled, present[0] if present else None)


def named_fields(kind: np.dtype[np.void], names: Sequence[str]) -> list[str]:
    """Returns the fields with one value per point named in `names`, in the order of `names`.

    CloudCompare prefixes names with `scalar_`. Letter case does not matter.
    """
    of_small: dict[str, str] = {}
    for name in kind.names or ():
        if kind[name].shape == () and kind[name].kind in "fiu":
            of_small.setdefault(name.lower().removeprefix("scalar_"), name)
    return [of_small[name] for name in names if name in of_small]


@unchecked
def map_offset(samples: Iterable[Records]) -> FloatArray:
    """Returns the offset (3,) of map coordinates, such as UTM; 0 for coordinates of a sensor.

    float32 would round map coordinates to half a metre. Coordinates count as map coordinates if
    they are far from 0 compared with their spread.
    """
    for records in samples:
        axes = [name for axis in "xyz" for name in named_fields(records.dtype, [axis])]
        if len(axes) < 3 or len(records) == 0:
            continue
        values = np.stack([records[name].astype(np.float64) for name in axes], axis=1)
        values = values[np.isfinite(values).all(axis=1)]
        if len(values) == 0:
            continue
        low, middle, high = np.percentile(values, (5, 50, 95), axis=0)
        is_map = (np.abs(middle) > LEAST_MAP_M) & (high - low < np.abs(middle) / 2)
        return np.round(middle) if is_map[:2].any() else np.zeros(3)
    return np.zeros(3)


def offset_note(offset: FloatArray) -> str:
    x, y, z = offset
    return (
        f"coordinates are those of a map: ({x:.0f}, {y:.0f}, {z:.0f}) is subtracted. The sensor is "
        "probably not at the origin"
    )


def _point_times(samples: Sequence[Records]) -> tuple[PointTimes | None, list[str]]:
    notes: list[str] = []
    for name in dict.fromkeys(n for records in samples for n in named_fields(records.dtype, TIMES)):
        columns = [records[name] for records in samples if name in (records.dtype.names or ())]
        times = _counted(name, columns)
        if isinstance(times, str):
            notes.append(f"field `{name}` is not used as the time of points: {times}")
            continue
        plain = times.unit_s == 1 and not times.is_shifted
        if not plain:
            start = " since an epoch such as 1970" if times.is_absolute else ""
            start = " to the end of the frame" if times.is_shifted and not start else start
            anew = "; times are counted from the first point of each frame"
            notes.append(
                f"the field `{name}` is the time of points, in unit {UNITS[times.unit_s]}{start}"
                + (anew if times.is_shifted else "")
            )
        return times, notes
    return None, notes


def _counted(name: str, columns: Sequence[AnyArray]) -> PointTimes | str:
    """Returns unit and zero of a time field, or why it cannot be the time of points."""
    spans, firsts, absolutes = [], [], []
    for column in columns:
        values = column[np.isfinite(column)]
        above = values[values > 0]
        span = float(above.max()) - float(above.min()) if len(above) > 0 else 0.0
        is_absolute = bool(len(above) > 0 and not (values < 0).any() and above.min() > 2 * span)
        values = above if is_absolute else values
        if len(values) > 1:
            spans.append(float(values.max() - values.min()))
            firsts.append(float(values.min()))
            absolutes.append(is_absolute)
    if not spans:
        return "it has no values"
    span, first = float(np.median(spans)), float(np.median(firsts))
    absolute = bool(np.median(absolutes) > 0.5)
    if span == 0:
        why = f"it has too few digits ({columns[0].dtype})" if columns[0].dtype == "f4" else ""
        return "it is the same for all points of a frame" + (f", or {why}" if why and first else "")
    unit = next((u for u in UNITS if DURATION_S[0] <= span * u < DURATION_S[1]), None)
    if unit is None:
        low, high = DURATION_S
        return f"expected {low:g} to {high:g} s from first to last point, got {span:g} s"
    if columns[0].dtype.kind == "f":
        rounding = float(np.spacing(np.asarray(first + span, dtype=columns[0].dtype))) * unit
        if rounding > MOST_ROUNDING_S:
            return f"its type {columns[0].dtype} rounds times to {rounding:.2g} s"
    return PointTimes(name, unit, absolute, absolute or first * unit < -1e-6)


def _ring(samples: Sequence[Records]) -> tuple[str | None, list[str]]:
    ends = np.iinfo(np.uint16)
    notes: list[str] = []
    for name in dict.fromkeys(n for records in samples for n in named_fields(records.dtype, RINGS)):
        columns = [records[name] for records in samples if name in (records.dtype.names or ())]
        values = np.concatenate([column.astype(np.float64) for column in columns])
        if ((values >= ends.min) & (values <= ends.max) & (values == np.floor(values))).all():
            return name, notes
        notes.append(
            f"field `{name}` is not used as the ring of points: expected whole numbers from 0 to "
            f"{ends.max}, got {values.min():g} to {values.max():g}"
        )
    return None, notes


def _whole(location: str, column: AnyArray, name: str, kind: np.dtype[Any]) -> AnyArray:
    ends = np.iinfo(kind)
    bad = np.flatnonzero(~((column >= ends.min) & (column <= ends.max)))
    if len(bad) > 0:
        problem = f"{location}: point {bad[0]}: {name}: expected {ends.min} to {ends.max}"
        raise FormatError(f"{problem}, got {column[bad[0]]:g}")
    return column
