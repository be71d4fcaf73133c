"""Makes a recording of files that each hold one cloud with named fields."""

from collections.abc import Callable, Sequence
from functools import cached_property
from pathlib import Path

import numpy as np

from pyinfra.core.arrays import AnyArray, FloatArray, Points, Records, unchecked
from pyinfra.core.errors import FormatError
from pyinfra.exchange.frame_times import seconds_of_stamp
from pyinfra.exchange.label_files import clouds_in, open_labels
from pyinfra.exchange.pcd import FIRST, readable
from pyinfra.exchange.point_fields import (
    TIMES,
    PointFields,
    cloud_notes,
    intensity_field,
    map_offset,
    named_fields,
)
from pyinfra.exchange.recording import (
    NO_BOXES,
    Boxes,
    Options,
    RecordedFrame,
    Recording,
    as_points,
    stem,
)

ReadRecords = Callable[[Path], Records]


class RecordClouds:
    """The clouds of a recording, whose files are read into records with named fields."""

    def __init__(self, files: Sequence[Path], read: ReadRecords, options: Options) -> None:
        self.files, self.read, self.options = files, read, options

    @cached_property
    def _first(self) -> list[Records]:
        return list(readable(self.read, self.files[:FIRST]))

    @cached_property
    def fields(self) -> PointFields:
        return PointFields(self._first)

    @cached_property
    def offset(self) -> FloatArray:
        return map_offset(self._first)

    def frame(self, i: int, boxes: Boxes = NO_BOXES) -> RecordedFrame:
        """Reads a cloud by its index. Raises FormatError."""
        file, records = self.files[i], self.read(self.files[i])
        points = points_of(str(file), records, self.options, self.offset)
        return RecordedFrame(points, boxes, self.fields.read(str(file), records))

    def unread_parts(self) -> list[str]:
        """Returns a text with the fields of the first clouds that are not read."""
        return self.fields.unread(self._first)

    def times(self) -> FloatArray | None:
        """Returns the first absolute time of each cloud, or None if the first ones have none."""
        if all(np.isnan(start_of(records)) for records in self._first):
            return None
        return np.array([self._start(file) for file in self.files])

    def _start(self, file: Path) -> float:
        return next((start_of(records) for records in readable(self.read, [file])), np.nan)

    def notes(self) -> list[str]:
        """Describes the assumptions about offset, intensity and point times."""
        return cloud_notes(self.fields, self.offset, self._first)


def read_clouds(
    source: Path, suffixes: Sequence[str], read: ReadRecords, options: Options
) -> Recording:
    """Opens a file, or a folder of files with one of the suffixes. Labels are optional.

    Raises FileNotFoundError, and Error if there is no such file. Reading a frame raises
    FormatError.
    """
    files = clouds_in(source, suffixes)
    labels = open_labels(files, source, options)
    files = labels.clouds if labels else files
    clouds = RecordClouds(files, read, options)
    names = tuple(stem(file) for file in files)
    return Recording(
        names,
        lambda i: clouds.frame(i, labels.read(names[i]) if labels else NO_BOXES),
        labelled=labels is not None,
        tracks_sha256=labels.tracks_sha256 if labels else "",
        times=clouds.times,
        notes=lambda: [*(labels.notes if labels else ()), *clouds.notes()],
        reads=(*files, *(labels.files if labels else ())),
        unread_parts=clouds.unread_parts,
    )


@unchecked
def points_of(
    location: str, records: Records, options: Options, offset: FloatArray | None = None
) -> Points:
    """Returns the points (n, 4) of records. Raises FormatError that begins with `location`."""
    axes = [next(iter(named_fields(records.dtype, [axis])), None) for axis in "xyz"]
    if None in axes:
        names = " ".join(records.dtype.names or ())
        raise FormatError(f"{location}: expected the fields x, y and z, got {names[:200]}")
    columns: list[AnyArray] = [records[name].astype(np.float64) for name in axes if name]
    if offset is not None and offset.any():
        columns = [column - o for column, o in zip(columns, offset, strict=True)]
    intensity = intensity_field(records)
    columns.append(np.zeros(len(records)) if intensity is None else records[intensity])
    return as_points(Path(location), columns, options)


def start_of(records: Records) -> float:
    """Returns the least absolute time of points in seconds since 1970, or NaN."""
    for name in named_fields(records.dtype, TIMES):
        values = records[name]
        values = values[np.isfinite(values) & (values > 0)]
        if len(values) > 0 and (start := seconds_of_stamp(float(values.min()))) is not None:
            return start
    return float("nan")
