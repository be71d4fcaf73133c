"""Sequences of frames of one LiDAR, simulated on demand or read from a folder.

A sequence provides the points and all other inputs of an evaluation: the LiDAR and its pose, the
objects, and the roads that define the evaluation region. Only the last few clouds stay in memory.
A sequence can therefore be larger than the memory.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import OrderedDict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

import numpy as np
import pandas as pd
import yaml

from pyinfra.core.arrays import AnyArray, Float32Array, FloatArray, Records
from pyinfra.core.version import __version__
from pyinfra.core.vocabulary import OBJECT_NAMES, LabelTime
from pyinfra.dataset.frame_readers import read_vehicles
from pyinfra.dataset.frame_tables import Vehicles, concatenated, no_vehicles, without_points
from pyinfra.dataset.frames import PERIOD_S, frame_numbers
from pyinfra.dataset.frames_version import number_at
from pyinfra.dataset.ground import Ground, ground_of, ground_of_roads
from pyinfra.dataset.outlines import outlines_of
from pyinfra.dataset.regions import Region, region_of, roads_region
from pyinfra.dataset.roads import Road, roads_of
from pyinfra.formats import kitti

if TYPE_CHECKING:
    from pyinfra.dataset import simulation

BOX = ["x", "y", "z", "dx", "dy", "dz", "heading"]
LABEL_COLUMNS = ["type", *BOX, "id", "points", "visibility"]
KEPT = 16  # clouds that a sequence keeps in memory


@dataclass(frozen=True, eq=False)
class LidarFrame:
    """One frame of one LiDAR, in the levelled LiDAR frame, metres and radians.

    Attributes
    ----------
    number : frame number in the scene or folder
    points : (n, 4) float32, x y z intensity
    objects : type, box, id, points and visibility of each known object, with or without points
    fields : (n,) records of the points: time_s since the start of the frame, ring, class and
        object_id (-1 for background); None if the folder has no fields
    """

    number: int
    points: Float32Array
    objects: pd.DataFrame
    fields: Records | None = None

    @property
    def labels(self) -> pd.DataFrame:
        """The objects with at least one point, with their boxes at the label time."""
        return self.objects[self.objects.points > 0].reset_index(drop=True)


class FrameSequence(Sequence[LidarFrame], ABC):
    """Frames of one LiDAR, in ascending order."""

    numbers: tuple[int, ...]

    @property
    @abstractmethod
    def name(self) -> str:
        """Name of the LiDAR."""

    @property
    @abstractmethod
    def lidar(self) -> kitti.Lidar | None:
        """The LiDAR's pose, field of view and price; None for a folder without lidar.yaml."""

    @property
    @abstractmethod
    def ground(self) -> Ground | None:
        """Height of the road; None if it is unknown."""

    @property
    @abstractmethod
    def region(self) -> Region | None:
        """The evaluation region; None if it is unknown."""

    @property
    @abstractmethod
    def known(self) -> Sequence[int]:
        """Numbers of all frames in the scene or folder, including frames outside this sequence."""

    @property
    @abstractmethod
    def frames_version(self) -> str:
        """The number of the frames; empty for a recording."""

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
    def frame(self, number: int) -> LidarFrame:
        """Returns the frame with a given number."""

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


def table_of(vehicles: Vehicles) -> pd.DataFrame:
    """Converts objects to a table with the columns LABEL_COLUMNS."""
    table = pd.DataFrame({"type": vehicles.names.astype(object)})
    table[BOX] = vehicles.boxes
    return table.assign(id=vehicles.ids, points=vehicles.points, visibility=vehicles.visibility)


@dataclass(eq=False)
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

    @property
    def name(self) -> str:
        return self.unit.name

    @cached_property
    def keys(self) -> dict[str, Any]:
        """The resolved keys of the scene."""
        return dict(yaml.safe_load(self.world.dump()))

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

    def frame(self, number: int) -> LidarFrame:
        if number in self.clouds and number in self.rows:
            return self._frame(number, *self.clouds[number])
        (frame,) = (self._frame(number, *cloud) for number, cloud in self._cast([number]))
        return frame

    def __iter__(self) -> Iterator[LidarFrame]:
        return (self._frame(number, *cloud) for number, cloud in self._cast(self.numbers))

    def vehicles(self) -> Vehicles:
        missing = [k for k in self.numbers if k not in self.rows]
        for _ in self._cast(missing):
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

        stream = simulation.simulate(self.world, [self.unit], numbers, threads=self.threads)
        for number, (frame,) in stream:
            self.rows[number] = frame.objects
            self.clouds[number] = cloud = simulation.points(frame), simulation.fields(frame)
            while len(self.clouds) > self.kept:
                self.clouds.popitem(last=False)
            yield number, cloud

    def _frame(self, number: int, points: Float32Array, fields: Records) -> LidarFrame:
        objects = table_of(vehicles_of(self.rows[number], 0, self.label_time))
        return LidarFrame(number, points, objects, fields)


@dataclass(eq=False)
class RecordedFrames(FrameSequence):
    """Frames of a LiDAR's folder in the KITTI layout."""

    folder: Path
    numbers: tuple[int, ...]

    @property
    def name(self) -> str:
        return self.lidar.name if self.lidar else self.folder.name

    @cached_property
    def lidar(self) -> kitti.Lidar | None:
        has_lidar = (self.folder / "lidar.yaml").is_file()
        return kitti.read_lidar(self.folder) if has_lidar else None

    @cached_property
    def ground(self) -> Ground | None:
        return ground_of(self.folder) if self.lidar else None

    @cached_property
    def region(self) -> Region | None:
        return region_of(self.folder, self.lidar.T_world_levelled) if self.lidar else None

    @property
    def frames_version(self) -> str:
        return number_at(self.folder)

    @property
    def known(self) -> Sequence[int]:
        return frame_numbers(self.folder, "all")

    def of(self, numbers: Sequence[int]) -> RecordedFrames:
        return RecordedFrames(self.folder, tuple(numbers))

    def frame(self, number: int) -> LidarFrame:
        points = kitti.read_points(kitti.frame_file(self.folder, "velodyne", number))
        file = kitti.frame_file(self.folder, "fields", number)
        fields = kitti.read_fields(file) if file.is_file() else None
        return LidarFrame(number, points, table_of(read_vehicles(self.folder, [number])), fields)

    def vehicles(self) -> Vehicles:
        return read_vehicles(self.folder, self.numbers)


def vehicles_of(rows: AnyArray, frame: int, label_time: LabelTime) -> Vehicles:
    """Converts the structured object rows of one simulated frame; `frame` is the frame's index."""
    at = "scan_" if label_time == "scan" else ""
    labelled = [f"{at}x", f"{at}y", f"{at}z", "dx", "dy", "dz", f"{at}heading"]
    return Vehicles(
        frame=np.full(len(rows), frame, dtype=np.int64),
        ids=rows["id"].astype(np.int64),
        names=type_names(rows),
        boxes=np.stack([rows[name] for name in labelled], axis=1).reshape(-1, 7),
        mid_frame=np.stack([rows[name] for name in BOX], axis=1).reshape(-1, 7),
        points=rows["points"].astype(np.int64),
        visibility=rows["visibility"].astype(np.float64),
    )


def scene_objects(rows: AnyArray, frame: int) -> Vehicles:
    """Converts the result of `World.objects` for one frame. `frame` is the index of the frame."""
    boxes = np.stack([rows[name] for name in BOX], axis=1).reshape(-1, 7)
    index = np.full(len(rows), frame, dtype=np.int64)
    return without_points(index, rows["id"].astype(np.int64), type_names(rows), boxes)


def type_names(rows: AnyArray) -> AnyArray:
    """Returns the types (k,) of structured object rows."""
    return np.array([OBJECT_NAMES[int(c)] for c in rows["class_id"]], dtype="<U12")


def roads_of_world(world: simulation.World, name: str) -> list[Road]:
    """Returns the roads of a scene. Messages show `name` as the file."""
    return roads_of(world.roads_csv().splitlines(), Path(name))
