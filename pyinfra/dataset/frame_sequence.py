"""Frames of one LiDAR in memory: simulated when they are asked for, or read from a folder.

A sequence knows what an evaluation needs beside the points: the LiDAR and its pose, the objects,
the roads that make the evaluation region. It keeps no clouds but the last few, so that it may be
longer than memory.
"""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections import OrderedDict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias, overload

import numpy as np
import pandas as pd
import yaml

from pyinfra.core.arrays import AnyArray, Float32Array, FloatArray
from pyinfra.core.errors import Error
from pyinfra.core.names import OBJECT_NAMES, file_or_name
from pyinfra.core.version import __version__
from pyinfra.dataset.catalogue import configs
from pyinfra.dataset.frame_tables import Vehicles, read_vehicles
from pyinfra.dataset.frames import frame_numbers, lidars_in
from pyinfra.dataset.ground import Ground, ground_of, ground_of_roads
from pyinfra.dataset.outlines import outlines_of
from pyinfra.dataset.regions import Region, Road, region_of, roads_of, roads_region
from pyinfra.formats import kitti

if TYPE_CHECKING:
    from pyinfra.dataset import simulation

AnyLidar: TypeAlias = "simulation.Lidar | str | os.PathLike[str]"
AnyLidars: TypeAlias = "list[AnyLidar] | tuple[AnyLidar, ...]"
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
    def lidar(self) -> kitti.Lidar:
        return kitti.parse_lidar(self.world.lidar_yaml(self.unit), f"{self.name}/lidar.yaml")[0]

    @cached_property
    def tilt(self) -> kitti.Tilt:
        return kitti.parse_lidar(self.world.lidar_yaml(self.unit), f"{self.name}/lidar.yaml")[1]

    @cached_property
    def roads(self) -> tuple[Road, ...]:
        return tuple(roads_of(self.world.roads_csv().splitlines(), Path("roads.csv")))

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

    def of(self, numbers: Sequence[int]) -> SimulatedFrames:
        other = SimulatedFrames(self.world, self.unit, tuple(numbers), self.threads)
        other.rows, other.clouds = self.rows, self.clouds
        other.beside = {
            name: SimulatedFrames(
                one.world, one.unit, tuple(numbers), one.threads, {}, one.rows, one.clouds
            )
            for name, one in self.beside.items()
        }
        return other

    def frame(self, number: int) -> LidarFrame:
        if number in self.clouds and number in self.rows:
            return self._frame(number, self.clouds[number])
        return next(self._cast([number]))

    def __iter__(self) -> Iterator[LidarFrame]:
        return self._cast(self.numbers)

    def vehicles(self) -> Vehicles:
        missing = [k for k in self.numbers if k not in self.rows]
        for _ in self._cast(missing):
            pass
        parts = [vehicles_of(self.rows[k], i, self.label_time) for i, k in enumerate(self.numbers)]
        return joined(parts)

    def everybody(self) -> Vehicles:
        """Every object of the scene at mid-frame, near or far; without points."""
        parts = [scene_objects(self.world.objects(k), i) for i, k in enumerate(self.numbers)]
        return joined(parts)

    @property
    def label_time(self) -> kitti.LabelTime:
        return "scan" if self.world.label_time(self.unit.preset) == "scan" else "frame"

    def _cast(self, numbers: Sequence[int]) -> Iterator[LidarFrame]:
        from pyinfra.dataset import simulation

        stream = simulation.simulate(self.world, [self.unit], numbers, threads=self.threads)
        for number, (frame,) in stream:
            self.rows[number] = frame.objects
            points = simulation.points(frame)
            self.clouds[number] = points
            while len(self.clouds) > KEPT:
                self.clouds.popitem(last=False)
            yield self._frame(number, points)

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

    def of(self, numbers: Sequence[int]) -> RecordedFrames:
        return RecordedFrames(self.folder, tuple(numbers))

    def frame(self, number: int) -> LidarFrame:
        points = kitti.read_points(kitti.frame_file(self.folder, "velodyne", number))
        return LidarFrame(number, points, table_of(read_vehicles(self.folder, [number])))

    def vehicles(self) -> Vehicles:
        return read_vehicles(self.folder, self.numbers)


def vehicles_of(rows: AnyArray, frame: int, label_time: kitti.LabelTime) -> Vehicles:
    """The structured rows of one simulated frame; frame: its index."""
    at = "scan_" if label_time == "scan" else ""
    labelled = [f"{at}x", f"{at}y", f"{at}z", "dx", "dy", "dz", f"{at}heading"]
    return Vehicles(
        frame=np.full(len(rows), frame, dtype=np.int64),
        ids=rows["id"].astype(np.int64),
        names=_names(rows),
        boxes=np.stack([rows[name] for name in labelled], axis=1).reshape(-1, 7),
        mid_frame=np.stack([rows[name] for name in BOX], axis=1).reshape(-1, 7),
        points=rows["points"].astype(np.int64),
        visibility=rows["visibility"].astype(np.float64),
    )


def scene_objects(rows: AnyArray, frame: int) -> Vehicles:
    """What `World.objects` gives of one frame."""
    boxes = np.stack([rows[name] for name in BOX], axis=1).reshape(-1, 7)
    return Vehicles(
        frame=np.full(len(rows), frame, dtype=np.int64),
        ids=rows["id"].astype(np.int64),
        names=_names(rows),
        boxes=boxes,
        mid_frame=boxes,
        points=np.zeros(len(rows), dtype=np.int64),
        visibility=np.full(len(rows), -1.0),
    )


def _names(rows: AnyArray) -> AnyArray:
    return np.array([OBJECT_NAMES[int(c)] for c in rows["class_id"]], dtype="<U12")


def joined(parts: Sequence[Vehicles]) -> Vehicles:
    """Tables of frames after one another."""
    if not parts:
        raise Error("frames: expected one or more, got none")
    columns = {name: [vars(part)[name] for part in parts] for name in vars(parts[0])}
    return Vehicles(**{name: np.concatenate(column) for name, column in columns.items()})


def load_scene(
    scene: str | os.PathLike[str],
    *,
    preset: str = "datasheet",
    seed: int | None = None,
    set: Mapping[str, object] | None = None,
    mount: str = "",
) -> simulation.World:
    """A scene made ready: its traffic is simulated, its meshes are built.

    Parameters
    ----------
    scene : a name that comes with the package (`highway`, `crossroad`, ...), or a file
    preset : `paper`, `equal` or `datasheet`; a scene may have keys of its own for one
    seed : of traffic and noise; by default the scene's own
    set : values by dotted key, such as `{"traffic.vehicles_per_km_lane": 20}`
    mount : which of several; a scene with one mount needs none

    Raises
    ------
    Error : for an unknown name, a wrong key or value (file, line and key are in the message)

    Examples
    --------
    >>> import pyinfra as pi
    >>> pi.load_scene("highway", seed=1, set={"duration_s": 2}).frames
    20
    """
    from pyinfra.dataset import simulation

    file = file_or_name(scene, _shipped("scenes"), "scene")
    return simulation.load_scene(file, preset=preset, seed=seed, set=set, mount=mount)


def load_lidar(lidar: str | os.PathLike[str], *, preset: str = "datasheet") -> simulation.Lidar:
    """One preset of a LiDAR.

    Parameters
    ----------
    lidar : a name of the catalogue (`pyinfra lidars` lists them), or a file
    preset : `paper`, `equal` or `datasheet`

    Raises
    ------
    Error : for an unknown name or preset, a wrong key or value

    Examples
    --------
    >>> import pyinfra as pi
    >>> pi.load_lidar("ruby_plus").name
    'ruby_plus'
    """
    from pyinfra.dataset import simulation

    file = file_or_name(lidar, _shipped("lidars"), "lidar")
    return simulation.load_lidar(file, preset)


@overload
def simulate(
    scene: simulation.World | str | os.PathLike[str],
    lidar: AnyLidar,
    frames: Sequence[int],
    *,
    threads: int | None = ...,
) -> SimulatedFrames: ...
@overload
def simulate(
    scene: simulation.World | str | os.PathLike[str],
    lidar: AnyLidars,
    frames: Sequence[int],
    *,
    threads: int | None = ...,
) -> dict[str, SimulatedFrames]: ...
def simulate(
    scene: simulation.World | str | os.PathLike[str],
    lidar: AnyLidar | AnyLidars,
    frames: Sequence[int],
    *,
    threads: int | None = None,
) -> SimulatedFrames | dict[str, SimulatedFrames]:
    """Frames of one LiDAR in a scene, or of several, simulated when they are asked for.

    Parameters
    ----------
    scene : of `load_scene`, or what `load_scene` takes
    lidar : of `load_lidar`, or what it takes; a list of several LiDARs gives a dict by name
    frames : numbers of frames of 0.1 s, such as `range(0, 1000, 10)`
    threads : that cast rays; by default as many as there are processors

    Returns
    -------
    A sequence: `frames[3].points` is (n, 4) float32 x y z intensity in the levelled LiDAR frame,
    `frames.labels` a table of all labels. No file is written.

    Raises
    ------
    Error : for frames that the scene does not have, or a LiDAR that it cannot take

    Examples
    --------
    >>> import pyinfra as pi
    >>> scene = pi.load_scene("highway", set={"duration_s": 2})
    >>> frames = pi.simulate(scene, pi.load_lidar("helios_16"), range(0, 20, 10))
    >>> len(frames), frames[1].number, frames[1].points.shape[1]
    (2, 10, 4)
    """
    from pyinfra.dataset import simulation

    several = isinstance(lidar, (list, tuple))
    asked: list[AnyLidar] = list(lidar) if isinstance(lidar, (list, tuple)) else [lidar]
    if not asked:
        raise Error("lidar: expected one or more LiDARs, got an empty list")
    world = scene if isinstance(scene, simulation.World) else load_scene(scene)
    units = [x if isinstance(x, simulation.Lidar) else load_lidar(x) for x in asked]
    numbers = tuple(int(k) for k in frames)
    if not numbers:
        raise Error("frames: expected one or more numbers, got none")
    if list(numbers) != sorted(set(numbers)):
        raise Error("frames: expected ascending numbers, each once")
    if numbers[0] < 0 or numbers[-1] >= world.frames:
        raise Error(f"frames: expected 0 to {world.frames - 1}, got {numbers[0]} to {numbers[-1]}")
    simulation.simulate(world, units, [])  # raises for presets that do not fit the scene
    every = {unit.name: SimulatedFrames(world, unit, numbers, threads) for unit in units}
    if len(every) < len(units):
        raise Error("lidar: expected different LiDARs, got one twice")
    for own in every.values():
        own.beside = {name: other for name, other in every.items() if other is not own}
    return every if several else next(iter(every.values()))


def load_dataset(folder: str | os.PathLike[str]) -> RecordedFrames | dict[str, RecordedFrames]:
    """Frames on disk: of a LiDAR's folder, or of each LiDAR of a data set.

    Parameters
    ----------
    folder : what `infrasim run` or `pyinfra import` wrote, or a folder in KITTI's layout

    Returns
    -------
    A sequence of frames for a LiDAR's folder; for a data set a dict of sequences by LiDAR.

    Raises
    ------
    Error : if there is no frame in it
    """
    path = Path(folder)
    if not path.is_dir():
        raise Error(f"folder: expected a folder, got '{path}'")
    if lidars := lidars_in(path):
        return {one.name: _recorded(one) for one in lidars}
    return _recorded(path)


def _recorded(folder: Path) -> RecordedFrames:
    try:
        numbers = frame_numbers(folder, "all")
    except FileNotFoundError:
        raise Error(
            f"folder: expected training/velodyne or a LiDAR's folder in it, got '{folder}'"
        ) from None
    if not numbers:
        raise Error(f"folder: expected one or more frames, got none in '{folder}'")
    return RecordedFrames(folder, tuple(numbers))


def _shipped(kind: str) -> dict[str, Path]:
    return {file.stem: file for file in (configs() / kind).glob("*.yaml")}
