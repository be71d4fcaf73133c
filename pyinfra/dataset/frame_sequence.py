"""Sequences of frames of one LiDAR, simulated on demand or read from a folder.

A sequence provides the points and all other inputs of an evaluation: the LiDAR and its pose, the
objects, and the roads that define the evaluation region. Only the last few clouds stay in memory.
A sequence can therefore be larger than the memory.
"""

from __future__ import annotations

from abc import abstractmethod
from collections import OrderedDict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, overload

import numpy as np
import pandas as pd
import yaml

from pyinfra.core.arrays import AnyArray, Float32Array, FloatArray, Records
from pyinfra.core.files import regular_files_only, resolved
from pyinfra.core.names import StrPath
from pyinfra.core.present import Presented, extent_of
from pyinfra.core.progress import track
from pyinfra.core.rows import concatenated
from pyinfra.core.version import __version__
from pyinfra.core.vocabulary import LabelTime
from pyinfra.dataset.frame_readers import read_vehicles
from pyinfra.dataset.frame_tables import Vehicles, no_vehicles
from pyinfra.dataset.frames import PERIOD_S, frame_numbers
from pyinfra.dataset.frames_version import number_at
from pyinfra.dataset.ground import Ground, ground_of, ground_of_roads
from pyinfra.dataset.object_rows import scene_objects, table_of, vehicles_of
from pyinfra.dataset.outlines import outlines_of
from pyinfra.dataset.regions import Region, region_of, roads_region
from pyinfra.dataset.returns import counted, returned
from pyinfra.dataset.roads import Road, roads_of
from pyinfra.formats import kitti

if TYPE_CHECKING:
    from pyinfra.dataset import simulation

Result = TypeVar("Result")
KEPT = 16  # clouds that a sequence keeps in memory


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


@dataclass(eq=False, repr=False)
class SimulatedFrames(FrameSequence):
    """Frames that are simulated on demand and not written to disk.

    `beside` maps the name of each other LiDAR in the same scene to its sequence. `kept` is the
    number of clouds that stay in memory.
    """

    world: simulation.World
    unit: simulation.Lidar
    numbers: tuple[int, ...]
    threads: int | None = None
    kept: int = KEPT
    beside: Mapping[str, SimulatedFrames] = field(default_factory=dict)
    rows: dict[int, AnyArray] = field(default_factory=dict)  # objects of all simulated frames
    # The points and fields of the last `kept` simulated frames.
    clouds: OrderedDict[int, tuple[Float32Array, Records]] = field(default_factory=OrderedDict)
    returns: Callable[..., Any] | None = None  # the user's function of hits (dataset/returns.py)

    def __getstate__(self) -> dict[str, Any]:
        return {**vars(self), "clouds": OrderedDict()}

    @property
    def name(self) -> str:
        return self.unit.name

    @cached_property
    def keys(self) -> dict[str, Any]:
        """The resolved keys of the scene."""
        return dict(yaml.safe_load(self.world.dump()))

    @property
    def scene(self) -> str:
        return str(self.keys["name"])

    @cached_property
    def described(self) -> tuple[kitti.Lidar, kitti.Tilt]:
        """LiDAR and tilt, as `infrasim run` writes them to lidar.yaml."""
        return kitti.parse_lidar(self.world.lidar_yaml(self.unit), f"{self.name}/lidar.yaml")

    @property
    def lidar(self) -> kitti.Lidar:
        return self.described[0]

    @property
    def tilt(self) -> kitti.Tilt:
        """The sensor's pitch and roll."""
        return self.described[1]

    @cached_property
    def roads(self) -> tuple[Road, ...]:
        return tuple(roads_of_world(self.world, "roads.csv"))

    @cached_property
    def outlines(self) -> tuple[FloatArray, ...]:
        return outlines_of(self.keys)

    @property
    def of_lanes(self) -> bool:
        """Whether the scene has `lanes` from a file instead of roads."""
        return bool(self.keys.get("lanes"))

    @cached_property
    def ground(self) -> Ground:
        return ground_of_roads(self.roads, self.lidar.T_world_levelled)

    @cached_property
    def region(self) -> Region:
        return roads_region(list(self.roads), self.lidar.T_world_levelled, self.outlines)

    @property
    def versions(self) -> tuple[str, str]:
        """The `frames_version` of the simulator, and the version of the package."""
        from pyinfra.dataset import simulation

        return str(simulation.frames_version()), __version__

    @property
    def frames_version(self) -> str:
        return self.versions[0]

    @property
    def known(self) -> Sequence[int]:
        return range(self.world.frames_of(self.unit.period_s))

    def of(self, numbers: Sequence[int]) -> SimulatedFrames:
        beside = {
            name: replace(other, numbers=tuple(numbers), beside={})
            for name, other in self.beside.items()
        }
        return replace(self, numbers=tuple(numbers), beside=beside)

    def points_of(self, number: int) -> Float32Array:
        return self._cloud(number)[0].copy()

    def fields_of(self, number: int) -> Records:
        return self._cloud(number)[1].copy()

    def objects_of(self, number: int) -> Vehicles:
        if number not in self.rows:
            self._cloud(number)
        return vehicles_of(self.rows[number], 0, self.label_time)

    def _cloud(self, number: int) -> tuple[Float32Array, Records]:
        if number in self.clouds:
            return self.clouds[number]
        ((_, cloud),) = self._cast([number])
        return cloud

    def __iter__(self) -> Iterator[LidarFrame]:
        return (self.frame(number) for number, _ in self._cast(self.numbers))

    def vehicles(self) -> Vehicles:
        missing = [k for k in self.numbers if k not in self.rows]
        for _ in track(self._cast(missing), "frame"):
            pass
        label_time = self.label_time
        parts = [vehicles_of(self.rows[k], i, label_time) for i, k in enumerate(self.numbers)]
        return concatenated([no_vehicles(), *parts])

    def everybody(self) -> Vehicles:
        """Returns all objects of the scene, at any distance.

        Their boxes are the boxes at mid-frame, and `points` is 0.
        """
        period_s = self.unit.period_s
        parts = [
            scene_objects(self.world.objects(k, period_s), i) for i, k in enumerate(self.numbers)
        ]
        return concatenated([no_vehicles(), *parts])

    @property
    def label_time(self) -> LabelTime:
        from pyinfra.dataset import simulation

        return simulation.label_time(self.world, self.unit)

    def _cast(self, numbers: Sequence[int]) -> Iterator[tuple[int, tuple[Float32Array, Records]]]:
        """Simulates frames. Yields the number, the points and the fields of each frame.

        Stores the objects of each frame in `rows`.
        """
        from pyinfra.dataset import simulation

        unit = self.unit if self.returns is None else self.unit.with_every_hit()
        stream = simulation.simulate(self.world, [unit], numbers, threads=self.threads)
        for number, (frame,) in stream:
            self.rows[number] = frame.objects
            cloud = simulation.points(frame), simulation.fields(frame)
            if self.returns is not None:
                cloud = returned(self.returns, number, *cloud)
                self.rows[number] = counted(frame.objects, cloud[0], cloud[1]["object_id"])
            self.clouds[number] = cloud
            while len(self.clouds) > self.kept:
                self.clouds.popitem(last=False)
            yield number, cloud


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

    clouds: tuple[Float32Array, ...]  # (n, 4) each
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


def roads_of_world(world: simulation.World, name: str) -> list[Road]:
    """Returns the roads of a scene. Messages show `name` as the file."""
    return roads_of(world.roads_csv().splitlines(), Path(name))
