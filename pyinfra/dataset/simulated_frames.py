"""Frames that are simulated on demand and not written to disk."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

from pyinfra.core.arrays import AnyArray, Float32Array, FloatArray, Records, concatenated
from pyinfra.core.progress import track
from pyinfra.core.version import __version__
from pyinfra.core.vocabulary import LabelTime
from pyinfra.dataset.frame_sequence import KEPT, FrameSequence, LidarFrame
from pyinfra.dataset.frame_tables import Vehicles, no_vehicles
from pyinfra.dataset.ground import Ground, ground_of_roads
from pyinfra.dataset.object_rows import scene_objects, vehicles_of
from pyinfra.dataset.outlines import outlines_of
from pyinfra.dataset.regions import Region, roads_region
from pyinfra.dataset.returns import counted, returned
from pyinfra.dataset.roads import Road, roads_of
from pyinfra.formats import kitti

if TYPE_CHECKING:
    from pyinfra.dataset import simulation


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
    rows: dict[int, AnyArray] = field(default_factory=dict)  # objects of each simulated frame
    # The points and fields of the last `kept` simulated frames.
    clouds: OrderedDict[int, tuple[Float32Array, Records]] = field(default_factory=OrderedDict)
    returns: Callable[..., Any] | None = None  # the user's function for hits (dataset/returns.py)

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


def roads_of_world(world: simulation.World, name: str) -> list[Road]:
    """Returns the roads of a scene. Messages show `name` as the file."""
    return roads_of(world.roads_csv().splitlines(), Path(name))
