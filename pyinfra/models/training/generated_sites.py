"""Samples of generated sites, cast when they are asked for; nothing is on disk.

A visit is one site with some LiDARs and some frames of each: its world is built once, all its
samples are cast, and it is thrown away. Some visits are mixed: a group of them is held in memory,
and its samples are given in a drawn order. Sample n is a function of the plan and n alone, so a run
goes on from any n at the price of one group.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np

from pyinfra.core.config import read_config, ruled
from pyinfra.core.errors import ConfigError, Error
from pyinfra.core.vocabulary import VEHICLES, LabelTime, ObjectClass
from pyinfra.dataset import regions, simulation
from pyinfra.dataset.frame_sequence import roads_of_world
from pyinfra.dataset.ground import ground_of_roads
from pyinfra.models.detectors.batch import Area
from pyinfra.models.detectors.detection_area import Site
from pyinfra.models.training.samples import SiteSample
from pyinfra.models.training.sources import Stream, labels_of_frame, pose_of
from pyinfra.scenes.generator import lidar_catalogue
from pyinfra.scenes.generator.generate import make_site
from pyinfra.scenes.generator.layout import Keys
from pyinfra.scenes.generator.lidar_catalogue import PresetShares
from pyinfra.scenes.generator.random_stream import KEY, VERSION
from pyinfra.scenes.generator.ranges import RANGES

# What is looked at around a sensor, metres: x and y to the end of the regions and of parked crowds,
# z from below the local road to over a truck.
AREA = Area((-110.0, -110.0, -1.0), (110.0, 110.0, 4.5))
# Sites of narrow visits: the sensor looks along a road.
ALONG = replace(RANGES, mount=replace(RANGES.mount, aims={"along": 1.0}, off_aim_deg=(-8, 8)))
REDRAWN, TRIES = 1_000_000_000, 5


@dataclass(frozen=True)
class StreamPlan:
    """Which sites, and how they are visited."""

    seed: int = ruled(1, 0, 2**62)  # of LiDARs, frames and order
    sites: int = ruled(1000, 1, REDRAWN)
    first_site: int = ruled(0, 0, REDRAWN - 1)
    lidars: int = ruled(4, 1, 100)  # of a visit
    frames: int = ruled(2, 1, 100)  # of each of its LiDARs
    mixed: int = ruled(6, 1, 1000)  # visits in memory
    label_time: LabelTime | None = None  # None: as each site has it
    # Share of the visits whose LiDARs are all narrow ones (`StreamFile.narrow`); their sensor looks
    # along a road, where vehicles are. The other visits have none of them.
    narrow: float = ruled(0.0, 0, 1)

    @property
    def of_visit(self) -> int:
        return self.lidars * self.frames

    @property
    def of_group(self) -> int:
        return self.mixed * self.of_visit


@dataclass
class SiteSamples:
    """Samples (`pyinfra.models.training.samples.Samples`) of a plan."""

    plan: StreamPlan
    sensors: lidar_catalogue.Sensors
    classes: tuple[ObjectClass, ...] = VEHICLES  # that their boxes are of
    make_keys: Callable[[int], Keys] = make_site
    narrow: lidar_catalogue.Sensors | None = None  # that the plan's narrow visits draw from
    _group: tuple[int, list[SiteSample]] = (-1, [])

    def __post_init__(self) -> None:
        for chosen in (self.sensors, *([self.narrow] if self.narrow else [])):
            if self.plan.lidars > len(chosen.files):
                raise Error(f"lidars: found {self.plan.lidars}, allowed up to {len(chosen.files)}")
        if (self.plan.narrow > 0) != (self.narrow is not None):
            raise Error(
                "narrow: expected LiDARs with a share above 0, and none with 0, got "
                f"a share of {self.plan.narrow:g}"
            )

    def __len__(self) -> int:
        """Of one round over the sites; the next one has other LiDARs and frames."""
        return self.plan.sites * self.plan.of_visit

    def nth(self, _seed: int, n: int) -> int:
        """In the stream's own order, so that a world is built once."""
        return n

    def sample(self, i: int) -> SiteSample:
        group, position = divmod(i, self.plan.of_group)
        return self._samples(group)[self._order(group)[position]]

    def another(self, i: int, draw: np.random.Generator) -> SiteSample:
        """Of the same visit and LiDAR."""
        group, position = divmod(i, self.plan.of_group)
        first = self._order(group)[position] // self.plan.frames * self.plan.frames
        return self._samples(group)[first + int(draw.integers(self.plan.frames))]

    def _order(self, group: int) -> list[int]:
        random = np.random.default_rng([KEY, self.plan.seed, 1, group])
        return [int(k) for k in random.permutation(self.plan.of_group)]

    def _samples(self, group: int) -> list[SiteSample]:
        if self._group[0] != group:
            self._group = (-1, [])  # never two in memory
            visits = range(group * self.plan.mixed, (group + 1) * self.plan.mixed)
            self._group = (group, [s for visit in visits for s in self._visit(visit)])
        return self._group[1]

    def _visit(self, visit: int) -> list[SiteSample]:
        random = np.random.default_rng([KEY, self.plan.seed, 0, visit])
        seed = self.plan.first_site + visit % self.plan.sites
        make_keys, sensors = self.make_keys, self.sensors
        if self.narrow is not None and random.random() < self.plan.narrow:
            make_keys, sensors = partial(make_site, ranges=ALONG), self.narrow
        keys, world = world_of(seed, self.plan.label_time, make_keys)
        samples = []
        for lidar in sensors.draw(random, self.plan.lidars):
            # Drawn, not evenly spaced: a pattern that nearly repeats would show few phases.
            frames = sorted(random.choice(world.frames, self.plan.frames, replace=False).tolist())
            samples += samples_of(world, keys, lidar, frames, self.classes)
        return samples


def world_of(
    seed: int, label_time: LabelTime | None = None, make_keys: Callable[[int], Keys] = make_site
) -> tuple[Keys, simulation.World]:
    """A seed's site, or that of the next of its stand-ins, and its world.

    One bad draw must not end a long run. Raises ConfigError if the simulator refuses all of them.
    """
    for times in range(TRIES):
        keys = make_keys(redrawn(seed, times))
        if label_time is not None:
            keys["label_time"] = label_time
        try:
            return keys, simulation.make_world(keys)
        except simulation.ConfigError as error:
            refused = error
    raise refused


def redrawn(seed: int, times: int) -> int:
    """The seed of the site that stands in for one that the simulator refuses."""
    return seed + times * REDRAWN


def samples_of(
    world: simulation.World,
    keys: Keys,
    lidar: simulation.Lidar,
    frames: list[int],
    classes: tuple[ObjectClass, ...] = VEHICLES,
) -> list[SiteSample]:
    """Frames of a site's LiDAR, above its road. Raises what the simulator does."""
    pose = pose_of(keys)
    roads = roads_of_world(world, keys["name"])
    region, ground = regions.roads_region(roads, pose), ground_of_roads(roads, pose)
    label_time, height_m = simulation.label_time(world, lidar), ground.sensor_m
    samples = []
    for frame in cast(world, lidar, frames):
        points, (boxes, numbers) = (
            simulation.points(frame),
            labels_of_frame(frame, label_time, classes),
        )
        above = ground.above(points), ground.above(boxes)
        samples.append(SiteSample(*above, numbers, region=region, height_m=height_m))
    return samples


def cast(
    world: simulation.World, lidar: simulation.Lidar, frames: list[int]
) -> list[simulation.Frame]:
    """Without a word on weather, which sites have and not every preset.

    Warnings are not turned off: that is for the process, and samples are made in a second thread.
    """
    return [frame for _, (frame,) in simulation.FrameStream(world, [lidar], frames, 1)]


@dataclass(frozen=True)
class StreamFile:
    """`configs/streams/*.yaml`: sites to learn from."""

    plan: StreamPlan = field(default_factory=StreamPlan)
    without: tuple[str, ...] = ()  # LiDARs of the catalogue that are not learnt from
    narrow: tuple[str, ...] = ()  # LiDARs of `plan.narrow`
    presets: PresetShares = field(default_factory=PresetShares)


def read_stream(file: Path, classes: tuple[ObjectClass, ...] = VEHICLES) -> Stream:
    """What a file says, with boxes of these classes.

    Raises ConfigError with file, line and key, and FileNotFoundError."""
    settings = read_config(file, StreamFile)
    try:
        presets = asdict(settings.presets)
        chosen = lidar_catalogue.sensors(
            without=(*settings.without, *settings.narrow), presets=presets
        )
        narrow = lidar_catalogue.only(settings.narrow, presets) if settings.narrow else None
        return site_stream(settings.plan, chosen, classes, narrow)
    except ValueError as error:
        raise ConfigError(f"{file}: {error}") from None


def site_stream(
    plan: StreamPlan,
    sensors: lidar_catalogue.Sensors | None = None,
    classes: tuple[ObjectClass, ...] = VEHICLES,
    narrow: lidar_catalogue.Sensors | None = None,
) -> Stream:
    """What `pyinfra.models.training.train.train` learns from in place of sources.

    narrow: the LiDARs of the plan's narrow visits.

    Raises Error for more LiDARs a visit than there are.
    """
    chosen = sensors or lidar_catalogue.sensors()
    samples = SiteSamples(plan, chosen, classes, narrow=narrow)
    files = (*chosen.files, *(narrow.files if narrow else ()))
    drawn = asdict(plan)
    if plan.narrow == 0:
        del drawn["narrow"]  # a run that began before there were narrow visits goes on
    of_narrow = {"of_narrow": lidar_catalogue.names_of(narrow.files)} if narrow else {}
    last = plan.first_site + plan.sites - 1
    return Stream(
        lidar=lidar_catalogue.names_of(files),
        preset=" ".join(sorted(chosen.presets)),
        scene=f"sites_v{VERSION}_{plan.first_site}_to_{last}_seed_{plan.seed}",
        label_time=plan.label_time or "frame scan",
        samples=samples,
        site=Site(AREA),
        anywhere=True,
        classes=classes,
        drawn=str(drawn | {**chosen.presets} | of_narrow),
    )
