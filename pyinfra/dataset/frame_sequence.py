"""Sequences of frames of one LiDAR: the base class, recordings and arrays.

A sequence provides the points and all other inputs of an evaluation: the LiDAR and its pose, the
objects, and the roads that define the evaluation region. Only the last few clouds stay in memory.
A sequence can therefore be larger than the memory.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, wraps
from pathlib import Path
from typing import Any, TypeVar, overload

import numpy as np
import pandas as pd

from pyinfra.core.arrays import Float32Array, Records
from pyinfra.core.files import regular_files_only, resolved
from pyinfra.core.names import StrPath
from pyinfra.core.present import Presented, extent_of
from pyinfra.dataset.frame_readers import read_vehicles
from pyinfra.dataset.frame_tables import Vehicles, no_vehicles
from pyinfra.dataset.frames import PERIOD_S, frame_numbers
from pyinfra.dataset.frames_version import number_at
from pyinfra.dataset.ground import Ground, ground_of
from pyinfra.dataset.object_rows import table_of
from pyinfra.dataset.regions import Region, region_of
from pyinfra.formats import kitti

Result = TypeVar("Result")
KEPT = 16  # number of clouds that a sequence keeps in memory


class LidarFrame(Presented):
    """One frame of one LiDAR, in the levelled LiDAR frame, metres and radians.

    The frame reads or simulates its contents when they are used, and keeps none of them. Each
    access returns arrays of its own, which can be changed without any effect on other frames.

    Attributes
    ----------
    number : frame number in the scene or folder
    points : (n, 4) float32, x y z intensity
    objects : type, box, id, points and visibility of each known object, with or without points;
        the id is -1 if it is unknown
    labels : the objects with at least one point, with their boxes at the label time
    fields : (n,) records of the points: time_s since the start of the frame, ring, class, echo and
        object_id (-1 for background); None if the folder has no fields
    """

    def __init__(self, number: int, sequence: FrameSequence) -> None:
        self.number, self._sequence = number, sequence

    def alone(self) -> FrameSequence:
        """Returns the sequence of this frame alone."""
        return self._sequence.of([self.number])

    @property
    def points(self) -> Float32Array:
        return self._sequence.points_of(self.number)

    @property
    def fields(self) -> Records | None:
        return self._sequence.fields_of(self.number)

    @property
    def objects(self) -> pd.DataFrame:
        return table_of(self._sequence.objects_of(self.number))

    @property
    def labels(self) -> pd.DataFrame:
        objects = self.objects
        return objects[objects.points > 0].reset_index(drop=True)

    def facts(self) -> dict[str, object]:
        return {"lidar": self._sequence.name, "number": self.number}


class FrameSequence(Presented, Sequence[LidarFrame]):
    """Frames of one LiDAR, in ascending order.

    Attributes
    ----------
    numbers : frame numbers, ascending
    """

    numbers: tuple[int, ...]

    @property
    @abstractmethod
    def name(self) -> str:
        """Name of the LiDAR."""

    @property
    def lidar(self) -> kitti.Lidar | None:
        """The LiDAR's pose, field of view and price; None for a folder without lidar.yaml."""
        return None

    @property
    def ground(self) -> Ground | None:
        """Height of the road; None if it is unknown."""
        return None

    @property
    def region(self) -> Region | None:
        """The evaluation region; None if it is unknown."""
        return None

    @property
    def known(self) -> Sequence[int]:
        """Numbers of all frames in the scene or folder, including frames outside this sequence."""
        return self.numbers

    @property
    def frames_version(self) -> str:
        """The frames_version of the frames; empty for a recording."""
        return ""

    @property
    def scene(self) -> str:
        """Name of the scene or data set."""
        return ""

    @property
    def period_s(self) -> float:
        """Frame period in seconds."""
        return self.lidar.period_s if self.lidar else PERIOD_S

    @abstractmethod
    def vehicles(self) -> Vehicles:
        """Returns the objects of all frames as arrays. `frame` is an index into `numbers`."""

    @abstractmethod
    def of(self, numbers: Sequence[int]) -> FrameSequence:
        """Returns a sequence of the same LiDAR with the given frame numbers."""

    @abstractmethod
    def points_of(self, number: int) -> Float32Array:
        """Returns the points (n, 4) of a frame, as an array of its own."""

    @abstractmethod
    def fields_of(self, number: int) -> Records | None:
        """Returns the fields (n,) of a frame; None if they are unknown."""

    @abstractmethod
    def objects_of(self, number: int) -> Vehicles:
        """Returns the objects of a frame."""

    def save(self, folder: StrPath, format: str = "kitti") -> Path:
        """Writes the frames to a new folder, as `pyinfra.export`, and returns its path.

        By default the folder is a data set, which `load_dataset` opens.
        """
        import pyinfra

        return pyinfra.export(self, format, folder)

    def frame(self, number: int) -> LidarFrame:
        """Returns the frame with a given number."""
        return LidarFrame(number, self)

    def facts(self) -> dict[str, object]:
        return {"lidar": self.name, "frames": extent_of(self.numbers), "period_s": self.period_s}

    def __len__(self) -> int:
        return len(self.numbers)

    @overload
    def __getitem__(self, index: int) -> LidarFrame: ...
    @overload
    def __getitem__(self, index: slice) -> FrameSequence: ...
    def __getitem__(self, index: int | slice) -> LidarFrame | FrameSequence:
        if isinstance(index, slice):
            return self.of(self.numbers[index])
        return self.frame(self.numbers[index])

    @property
    def objects(self) -> pd.DataFrame:
        """All objects of all frames: frame, type, box, id, points, visibility."""
        vehicles = self.vehicles()
        table = table_of(vehicles)
        table.insert(0, "frame", np.array(self.numbers, dtype=np.int64)[vehicles.frame])
        return table

    @property
    def labels(self) -> pd.DataFrame:
        """All objects with at least one point of this LiDAR, with boxes at the label time."""
        table = self.objects
        return table[table.points > 0].reset_index(drop=True)


def _regular(read: Callable[..., Result]) -> Callable[..., Result]:
    """Makes a method of RecordedFrames refuse FIFOs and devices in its folder."""

    @wraps(read)
    def call(self: RecordedFrames, *args: Any) -> Result:
        with regular_files_only([self.folder]):
            return read(self, *args)

    return call


@dataclass(eq=False, repr=False)
class RecordedFrames(FrameSequence):
    """Frames of a LiDAR's folder in the KITTI layout."""

    folder: Path
    numbers: tuple[int, ...]

    @property
    def name(self) -> str:
        return self.lidar.name if self.lidar else self.folder.name

    @cached_property
    @_regular
    def lidar(self) -> kitti.Lidar | None:
        return kitti.read_lidar(self.folder) if (self.folder / "lidar.yaml").is_file() else None

    @cached_property
    @_regular
    def ground(self) -> Ground | None:
        return ground_of(self.folder) if self.lidar else None

    @cached_property
    @_regular
    def region(self) -> Region | None:
        return region_of(self.folder, self.lidar.T_world_levelled) if self.lidar else None

    @property
    def scene(self) -> str:
        return resolved(self.folder).parent.name

    @property
    @_regular
    def frames_version(self) -> str:
        return number_at(self.folder)

    @property
    def known(self) -> Sequence[int]:
        return frame_numbers(self.folder, "all")

    def of(self, numbers: Sequence[int]) -> RecordedFrames:
        return RecordedFrames(self.folder, tuple(numbers))

    @_regular
    def points_of(self, number: int) -> Float32Array:
        return kitti.read_points(kitti.frame_file(self.folder, "velodyne", number))

    @_regular
    def fields_of(self, number: int) -> Records | None:
        file = kitti.frame_file(self.folder, "fields", number)
        return kitti.read_fields(file) if file.is_file() else None

    @_regular
    def objects_of(self, number: int) -> Vehicles:
        return read_vehicles(self.folder, [number])

    @_regular
    def vehicles(self) -> Vehicles:
        return read_vehicles(self.folder, self.numbers)


@dataclass(eq=False, repr=False)
class ArrayFrames(FrameSequence):
    """Clouds in memory without labels, numbered from 0."""

    clouds: tuple[Float32Array, ...]  # points (n, 4) of each frame
    numbers: tuple[int, ...]

    @property
    def name(self) -> str:
        return "arrays"

    def of(self, numbers: Sequence[int]) -> ArrayFrames:
        return ArrayFrames(self.clouds, tuple(numbers))

    def points_of(self, number: int) -> Float32Array:
        return self.clouds[number].copy()

    def fields_of(self, number: int) -> None:
        return None

    def objects_of(self, number: int) -> Vehicles:
        return no_vehicles()

    def vehicles(self) -> Vehicles:
        return no_vehicles()
