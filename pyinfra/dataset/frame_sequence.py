"""Frames of one LiDAR in memory: simulated when they are asked for, or read from a folder.

A sequence knows what an evaluation needs beside the points: the LiDAR and its pose, the objects,
the roads that make the evaluation region. It keeps no clouds but the last few, so that it may be
longer than memory.
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

from pyinfra.core.arrays import AnyArray, Float32Array, FloatArray
from pyinfra.core.version import __version__
from pyinfra.core.vocabulary import OBJECT_NAMES, LabelTime
from pyinfra.dataset.frame_tables import (
    Vehicles,
    concatenated,
    read_vehicles,
    without_points,
)
from pyinfra.dataset.frames import PERIOD_S, frame_numbers
from pyinfra.dataset.ground import Ground, ground_of, ground_of_roads
from pyinfra.dataset.outlines import outlines_of
from pyinfra.dataset.regions import Region, Road, region_of, roads_of, roads_region
from pyinfra.formats import kitti

if TYPE_CHECKING:
    from pyinfra.dataset import simulation

BOX = ["x", "y", "z", "dx", "dy", "dz", "heading"]
LABEL_COLUMNS = ["type", *BOX, "id", "points", "visibility"]
KEPT = 16  # clouds in memory


@dataclass(frozen=True, eq=False)
class LidarFrame:
    """One frame of one LiDAR; levelled LiDAR frame, metres and radians.

    Attributes
    ----------
    number : of the frame in its scene or folder
    points : (n, 4) float32, x y z intensity
    objects : a row for each object that is known, seen or not: type, box, id, points, visibility
    """

    number: int
    points: Float32Array
    objects: pd.DataFrame

    @property
    def labels(self) -> pd.DataFrame:
        """The objects with a point, each with its box at the label time."""
        return self.objects[self.objects.points > 0].reset_index(drop=True)


class FrameSequence(Sequence[LidarFrame], ABC):
    """Frames of one LiDAR, in ascending order."""

    numbers: tuple[int, ...]

    @property
    @abstractmethod
    def name(self) -> str:
        """Of the LiDAR."""

    @property
    @abstractmethod
    def lidar(self) -> kitti.Lidar | None:
        """Pose, field of view and price; None for a folder without lidar.yaml."""

    @property
    @abstractmethod
    def ground(self) -> Ground | None:
        """Height of the road; None where it is not known."""

    @property
    @abstractmethod
    def region(self) -> Region | None:
        """Where vehicles can be; None where it is not known."""

    @property
    @abstractmethod
    def known(self) -> Sequence[int]:
        """Numbers of all frames that there are, in this sequence or not."""

    @property
    def period_s(self) -> float:
        """Seconds of a frame."""
        return self.lidar.period_s if self.lidar else PERIOD_S

    @abstractmethod
    def vehicles(self) -> Vehicles:
        """The objects of all frames in one table of arrays; `frame` counts along `numbers`."""

    @abstractmethod
    def of(self, numbers: Sequence[int]) -> FrameSequence:
        """The same sequence with other frames."""

    @abstractmethod
    def frame(self, number: int) -> LidarFrame:
        """The frame of a number."""

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
        """Every object of all frames: frame, type, box, id, points, visibility."""
        vehicles = self.vehicles()
        table = table_of(vehicles)
        table.insert(0, "frame", np.array(self.numbers, dtype=np.int64)[vehicles.frame])
        return table

    @property
    def labels(self) -> pd.DataFrame:
        """The objects with a point of this LiDAR, with the box that its labels have."""
        table = self.objects
        return table[table.points > 0].reset_index(drop=True)


def table_of(vehicles: Vehicles) -> pd.DataFrame:
    """Columns LABEL_COLUMNS of objects."""
    table = pd.DataFrame({"type": vehicles.names.astype(object)})
    table[BOX] = vehicles.boxes
    return table.assign(id=vehicles.ids, points=vehicles.points, visibility=vehicles.visibility)


@dataclass(eq=False)
class SimulatedFrames(FrameSequence):
    """Frames that are simulated when they are asked for; nothing is on disk.

    beside: the sequences of the other LiDARs that see the same scene.
    """

    world: simulation.World
    unit: simulation.Lidar
    numbers: tuple[int, ...]
    threads: int | None = None
    beside: Mapping[str, SimulatedFrames] = field(default_factory=dict)
    rows: dict[int, AnyArray] = field(default_factory=dict)  # objects of frames that were cast
    clouds: OrderedDict[int, Float32Array] = field(default_factory=OrderedDict)

    @property
    def name(self) -> str:
        return self.unit.name

    @cached_property
    def keys(self) -> dict[str, Any]:
        """The scene, key by key."""
        return dict(yaml.safe_load(self.world.dump()))

    @cached_property
    def described(self) -> tuple[kitti.Lidar, kitti.Tilt]:
        """What a run would write in lidar.yaml."""
        return kitti.parse_lidar(self.world.lidar_yaml(self.unit), f"{self.name}/lidar.yaml")

    @property
    def lidar(self) -> kitti.Lidar:
        return self.described[0]

    @property
    def tilt(self) -> kitti.Tilt:
        """How the sensor leans."""
        return self.described[1]

    @cached_property
    def roads(self) -> tuple[Road, ...]:
        return tuple(roads_of_world(self.world, "roads.csv"))

    @cached_property
    def outlines(self) -> tuple[FloatArray, ...]:
        return outlines_of(self.keys)

    @property
    def of_lanes(self) -> bool:
        """Whether the scene's roads are lanes of a file."""
        return bool(self.keys.get("lanes"))

    @cached_property
    def ground(self) -> Ground:
        return ground_of_roads(self.roads, self.lidar.T_world_levelled)

    @cached_property
    def region(self) -> Region:
        return roads_region(list(self.roads), self.lidar.T_world_levelled, self.outlines)

    @property
    def versions(self) -> tuple[str, str]:
        """The number of the frames, and the version of the package."""
        from pyinfra.dataset import simulation

        return str(simulation.frames_version()), __version__

    @property
    def known(self) -> Sequence[int]:
        return range(self.world.frames)

    def of(self, numbers: Sequence[int]) -> SimulatedFrames:
        beside = {
            name: replace(one, numbers=tuple(numbers), beside={})
            for name, one in self.beside.items()
        }
        return replace(self, numbers=tuple(numbers), beside=beside)

    def frame(self, number: int) -> LidarFrame:
        if number in self.clouds and number in self.rows:
            return self._frame(number, self.clouds[number])
        (frame,) = (self._frame(*cast) for cast in self._cast([number]))
        return frame

    def __iter__(self) -> Iterator[LidarFrame]:
        return (self._frame(*cast) for cast in self._cast(self.numbers))

    def vehicles(self) -> Vehicles:
        missing = [k for k in self.numbers if k not in self.rows]
        for _ in self._cast(missing):
            pass
        label_time = self.label_time
        return concatenated(
            [vehicles_of(self.rows[k], i, label_time) for i, k in enumerate(self.numbers)]
        )

    def everybody(self) -> Vehicles:
        """Every object of the scene at mid-frame, near or far; without points."""
        return concatenated(
            [scene_objects(self.world.objects(k), i) for i, k in enumerate(self.numbers)]
        )

    @property
    def label_time(self) -> LabelTime:
        from pyinfra.dataset import simulation

        return simulation.label_time(self.world, self.unit)

    def _cast(self, numbers: Sequence[int]) -> Iterator[tuple[int, Float32Array]]:
        """Number and points of each frame; its objects are kept."""
        from pyinfra.dataset import simulation

        stream = simulation.simulate(self.world, [self.unit], numbers, threads=self.threads)
        for number, (frame,) in stream:
            self.rows[number] = frame.objects
            points = simulation.points(frame)
            self.clouds[number] = points
            while len(self.clouds) > KEPT:
                self.clouds.popitem(last=False)
            yield number, points

    def _frame(self, number: int, points: Float32Array) -> LidarFrame:
        return LidarFrame(
            number, points, table_of(vehicles_of(self.rows[number], 0, self.label_time))
        )


@dataclass(eq=False)
class RecordedFrames(FrameSequence):
    """Frames of a LiDAR's folder in the KITTI layout: simulated, imported, or of any tool."""

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
    def known(self) -> Sequence[int]:
        return frame_numbers(self.folder, "all")

    def of(self, numbers: Sequence[int]) -> RecordedFrames:
        return RecordedFrames(self.folder, tuple(numbers))

    def frame(self, number: int) -> LidarFrame:
        points = kitti.read_points(kitti.frame_file(self.folder, "velodyne", number))
        return LidarFrame(number, points, table_of(read_vehicles(self.folder, [number])))

    def vehicles(self) -> Vehicles:
        return read_vehicles(self.folder, self.numbers)


def vehicles_of(rows: AnyArray, frame: int, label_time: LabelTime) -> Vehicles:
    """The structured rows of one simulated frame; frame: its index."""
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
    """What `World.objects` gives of one frame."""
    boxes = np.stack([rows[name] for name in BOX], axis=1).reshape(-1, 7)
    index = np.full(len(rows), frame, dtype=np.int64)
    return without_points(index, rows["id"].astype(np.int64), type_names(rows), boxes)


def type_names(rows: AnyArray) -> AnyArray:
    """(k,) the types of structured rows."""
    return np.array([OBJECT_NAMES[int(c)] for c in rows["class_id"]], dtype="<U12")


def roads_of_world(world: simulation.World, name: str) -> list[Road]:
    """The roads of a scene; name: for messages."""
    return roads_of(world.roads_csv().splitlines(), Path(name))
