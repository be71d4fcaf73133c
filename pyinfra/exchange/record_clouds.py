"""Makes a recording of files that each hold one cloud with named fields."""

import contextlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import TypeVar

import numpy as np

from pyinfra.core.arrays import AnyArray, FloatArray, Points, Records, unchecked
from pyinfra.core.errors import FormatError
from pyinfra.exchange.frame_times import seconds_of_stamp
from pyinfra.exchange.label_files import LabelFiles, clouds_in, open_labels
from pyinfra.exchange.point_fields import TIMES, PointFields, intensity_field, named_fields
from pyinfra.exchange.recording import Options, RecordedFrame, Recording, as_points, stem

_Item = TypeVar("_Item")
_Read = TypeVar("_Read")
ReadRecords = Callable[[Path], Records]
# Number of clouds, from the first, whose values decide what the fields mean. A single cloud is not
# enough, because it may be empty.
FIRST = 3


def readable(read: Callable[[_Item], _Read], items: Iterable[_Item]) -> Iterator[_Read]:
    """Yields the results of `read`, without those items (such as files) that it cannot read."""
    for item in items:
        with contextlib.suppress(FormatError):
            yield read(item)


class RecordClouds:
    """The clouds of a recording, whose files are read into records with named fields."""

    def __init__(self, labels: LabelFiles, read: ReadRecords, options: Options) -> None:
        self.labels, self.read, self.options = labels, read, options

    @cached_property
    def fields(self) -> PointFields:
        return PointFields(readable(self.read, self.labels.clouds[:FIRST]))

    def points(self, file: Path, records: Records) -> Points:
        return points_of(str(file), records, self.options, self.fields.offset)

    def recording(self) -> Recording:
        """Returns the recording, without times. Reading a frame raises FormatError."""
        labels, names = self.labels, tuple(stem(file) for file in self.labels.clouds)

        def frame(i: int) -> RecordedFrame:
            file, boxes = labels.clouds[i], labels.read(names[i])
            records = self.read(file)
            points = self.points(file, records)
            return RecordedFrame(points, boxes, self.fields.read(str(file), records))

        return Recording(
            names,
            frame,
            labels.labelled,
            tracks_sha256=labels.tracks_sha256,
            notes=lambda: [*labels.notes, *self.notes()],
            reads=(*labels.clouds, *labels.files),
            unread_parts=lambda: self.fields.unread(),
        )

    def times(self) -> FloatArray | None:
        """Returns the first absolute time of each cloud, or None if the sampled ones have none."""
        if all(np.isnan(self.start(records)) for records in self.fields.clouds):
            return None
        first = (readable(self.read, [file]) for file in self.labels.clouds)
        return np.array([next(map(self.start, clouds), np.nan) for clouds in first])

    def start(self, records: Records) -> float:
        return start_of(records, named_fields(records.dtype, TIMES))

    def notes(self) -> list[str]:
        """Describes the assumptions about offset, intensity and point times."""
        return self.fields.cloud_notes()


def read_clouds(
    source: Path, suffixes: Sequence[str], read: ReadRecords, options: Options
) -> Recording:
    """Opens a file, or a folder of files with one of the suffixes. Labels are optional.

    Raises FileNotFoundError, and Error if there is no such file. Reading a frame raises
    FormatError.
    """
    labels = open_labels(clouds_in(source, suffixes), source, options)
    clouds = RecordClouds(labels, read, options)
    return replace(clouds.recording(), times=clouds.times)


@unchecked
def points_of(
    location: str,
    records: Records,
    options: Options,
    offset: FloatArray | None = None,
    move: Callable[[list[AnyArray]], list[AnyArray]] | None = None,
) -> Points:
    """Returns the points (n, 4) of records. Raises FormatError that begins with `location`.

    `offset` (3,) is subtracted from x, y, z, which `move` then transforms. The intensity is 0 if no
    field has it.
    """
    axes = [next(iter(named_fields(records.dtype, [axis])), None) for axis in "xyz"]
    if None in axes:
        names = " ".join(records.dtype.names or ())
        raise FormatError(
            f"{location}: expected the fields x, y and z with one value each, got {names[:200]}"
        )
    columns: list[AnyArray] = [records[name].astype(np.float64) for name in axes if name]
    if offset is not None and offset.any():
        columns = [column - o for column, o in zip(columns, offset, strict=True)]
    if move is not None:
        columns = move(columns)
    intensity = intensity_field(records)
    columns.append(np.zeros(len(records)) if intensity is None else records[intensity])
    return as_points(Path(location), columns, options)


def start_of(records: Records, names: Sequence[str]) -> float:
    """Returns the minimum absolute time of points in seconds since 1970, or NaN.

    The time is that of the first of the named fields that has absolute times.
    """
    for name in names:
        values = records[name]
        values = values[np.isfinite(values) & (values > 0)]
        if len(values) > 0 and (start := seconds_of_stamp(float(values.min()))) is not None:
            return start
    return float("nan")
