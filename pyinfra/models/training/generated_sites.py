"""Training samples from generated sites, simulated on demand without files.

A visit is one site with some LiDARs and some frames of each LiDAR. The scene of a visit is built
once, all samples of the visit are simulated, and the scene is discarded. A group of visits is held
in memory, and its samples are returned in random order. Sample n depends only on n and on the plan.
Therefore a training can resume at any sample by simulating one group.
"""

from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np

from pyinfra.core.arrays import Points
from pyinfra.core.config import read_config, ruled
from pyinfra.core.errors import ConfigError, Error
from pyinfra.core.vocabulary import VEHICLES, LabelTime, ObjectClass
from pyinfra.dataset import regions, simulation
from pyinfra.dataset.ground import ground_of_roads
from pyinfra.dataset.simulated_frames import roads_of_world
from pyinfra.models.detectors.detection_area import Area, Site
from pyinfra.models.training.samples import SiteSample
from pyinfra.models.training.sources import Stream, labels_of_frame, pose_of
from pyinfra.scenes.generator import lidar_catalogue
from pyinfra.scenes.generator.generate import make_site
from pyinfra.scenes.generator.layout import Keys
from pyinfra.scenes.generator.lidar_catalogue import PresetShares
from pyinfra.scenes.generator.random_stream import KEY, VERSION
from pyinfra.scenes.generator.ranges import RANGES

# The area around a sensor that networks use, in metres. x and y include the regions and parking
# lots. z extends from below the local road to above a truck.
AREA = Area((-110.0, -110.0, -1.0), (110.0, 110.0, 4.5))
# Parameter ranges of sites for narrow LiDARs, which are aimed along a road.
ALONG = replace(RANGES, mount=replace(RANGES.mount, aims={"along": 1.0}, off_aim_deg=(-8, 8)))
RESAMPLED, TRIES = 1_000_000_000, 5


@dataclass(frozen=True)
class StreamPlan:
    """The sites of a stream of training samples, and the LiDARs and frames of each site."""

    seed: int = ruled(1, 0, 2**62)  # seed of the choice and order of LiDARs and frames
    sites: int = ruled(1000, 1, RESAMPLED)
    first_site: int = ruled(0, 0, RESAMPLED - 1)  # seed of the first site
    lidars: int = ruled(4, 1, 100)  # number of LiDARs in a visit, that is, one simulation of a site
    frames: int = ruled(2, 1, 100)  # number of frames of each LiDAR in a visit
    mixed: int = ruled(6, 1, 1000)  # number of visits whose samples are mixed in memory
    label_time: LabelTime | None = None  # label time; None for that of each site's scene
    # Share of the visits that use only narrow LiDARs (`StreamFile.narrow`). Narrow LiDARs are aimed
    # along a road, where vehicles are. The other visits use no narrow LiDAR.
    narrow: float = ruled(0.0, 0, 1)

    @property
    def of_visit(self) -> int:
        return self.lidars * self.frames

    @property
    def of_group(self) -> int:
        return self.mixed * self.of_visit


@dataclass
class SiteSamples:
    """The samples of a plan, as `pyinfra.models.training.samples.Samples`."""

    plan: StreamPlan
    sensors: lidar_catalogue.Sensors
    classes: tuple[ObjectClass, ...] = VEHICLES
    make_keys: Callable[[int], Keys] = make_site
    narrow: lidar_catalogue.Sensors | None = None  # LiDARs with a narrow field of view
    _group: tuple[int, list[SiteSample]] = (-1, [])

    def __post_init__(self) -> None:
        for chosen in (self.sensors, *([self.narrow] if self.narrow else [])):
            if self.plan.lidars > len(chosen.files):
                most = len(chosen.files)
                raise Error(
                    f"lidars: expected up to {most} LiDARs per visit, got {self.plan.lidars}"
                )
        if (self.plan.narrow > 0) != (self.narrow is not None):
            given = "no list" if self.narrow is None else "a list"
            raise Error(
                "narrow: expected a list of LiDARs if plan.narrow is above 0, and only then, got "
                f"{given} and plan.narrow {self.plan.narrow:g}"
            )

    def __len__(self) -> int:
        """Returns the number of samples in one round over the sites.

        Each further round uses other LiDARs and frames.
        """
        return self.plan.sites * self.plan.of_visit

    @property
    def together(self) -> int:
        """Number of samples of a group, which are simulated together."""
        return self.plan.of_group

    def nth(self, _seed: int, n: int) -> int:
        """Returns n, because samples are used in the stream's order. Each scene is built once."""
        return n

    def sample(self, i: int) -> SiteSample:
        group, position = divmod(i, self.plan.of_group)
        return self._samples(group)[self._order(group)[position]]

    def another(self, i: int, draw: np.random.Generator) -> SiteSample:
        """Returns a random sample of the same visit and LiDAR."""
        group, position = divmod(i, self.plan.of_group)
        first = self._order(group)[position] // self.plan.frames * self.plan.frames
        return self._samples(group)[first + int(draw.integers(self.plan.frames))]

    def _order(self, group: int) -> list[int]:
        random = np.random.default_rng([KEY, self.plan.seed, 1, group])
        return [int(k) for k in random.permutation(self.plan.of_group)]

    def _samples(self, group: int) -> list[SiteSample]:
        if self._group[0] != group:
            self._group = (-1, [])  # frees memory, so that there are never two groups in memory
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
            # Frames are random instead of evenly spaced. If the scan pattern of a LiDAR almost
            # repeats, evenly spaced frames would have only few phases of the pattern.
            count = world.frames_of(lidar.period_s)
            frames = sorted(random.choice(count, self.plan.frames, replace=False).tolist())
            samples += samples_of(world, keys, lidar, frames, self.classes)
        return samples


def world_of(
    seed: int, label_time: LabelTime | None = None, make_keys: Callable[[int], Keys] = make_site
) -> tuple[Keys, simulation.World]:
    """Returns the site of a seed and its simulated scene.

    If the simulator rejects the site, the sites of up to TRIES - 1 replacement seeds are tried.
    Therefore one invalid site does not end a long training. Raises ConfigError if all sites are
    rejected.
    """
    for times in range(TRIES):
        keys = make_keys(seed + times * RESAMPLED)
        if label_time is not None:
            keys["label_time"] = label_time
        try:
            world = simulation.make_world(keys)
            world.drive()  # simulates the traffic, so that an invalid site is rejected here
            return keys, world
        except simulation.ConfigError as error:
            refused = error
    raise refused


def samples_of(
    world: simulation.World,
    keys: Keys,
    lidar: simulation.Lidar,
    frames: list[int],
    classes: tuple[ObjectClass, ...] = VEHICLES,
) -> list[SiteSample]:
    """Returns the training frames of a LiDAR at a site. z is the height above the road.

    Raises the errors of the simulator.
    """
    sample = maker(world, keys, lidar, classes)
    return [sample(frame, simulation.points(frame)) for frame in cast(world, lidar, frames)]


def maker(
    world: simulation.World,
    keys: Keys,
    lidar: simulation.Lidar,
    classes: tuple[ObjectClass, ...],
) -> Callable[[simulation.Frame, Points], SiteSample]:
    """Returns a function that makes a sample of a frame and its points."""
    pose = pose_of(keys)
    roads = roads_of_world(world, keys["name"])
    region, ground = regions.roads_region(roads, pose), ground_of_roads(roads, pose)
    label_time, height_m = simulation.label_time(world, lidar), ground.sensor_m

    def sample(frame: simulation.Frame, points: Points) -> SiteSample:
        boxes, numbers = labels_of_frame(frame, label_time, classes)
        above = ground.above(points), ground.above(boxes)
        return SiteSample(*above, numbers, region=region, height_m=height_m)

    return sample


def cast(
    world: simulation.World, lidar: simulation.Lidar, frames: list[int]
) -> list[simulation.Frame]:
    """Simulates frames without the warning that a preset ignores the site's weather.

    Python's warning filters are not used, because they apply to the whole process. Samples are made
    in a second thread of the training.
    """
    return [frame for _, (frame,) in simulation.FrameStream(world, [lidar], frames, 1)]


@dataclass(frozen=True)
class StreamFile:
    """`configs/streams/*.yaml`: generated sites to train on."""

    plan: StreamPlan = field(default_factory=StreamPlan)
    without: tuple[str, ...] = ()  # LiDARs of the catalogue that are not used
    narrow: tuple[str, ...] = ()  # narrow LiDARs, for the share `plan.narrow` of the visits
    presets: PresetShares = field(default_factory=PresetShares)


def read_stream(file: Path, classes: tuple[ObjectClass, ...] = VEHICLES) -> Stream:
    """Reads a stream file; `classes` are the classes of the boxes.

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
    """Returns a stream of samples, which `training.train.train` accepts instead of sources.

    narrow: LiDARs of the plan's narrow visits. Raises Error if a visit needs more LiDARs than
    `sensors` or `narrow` has.
    """
    chosen = sensors or lidar_catalogue.sensors()
    samples = SiteSamples(plan, chosen, classes, narrow=narrow)
    files = (*chosen.files, *(narrow.files if narrow else ()))
    drawn = asdict(plan)
    if plan.narrow == 0:
        del drawn["narrow"]  # so that trainings of versions without narrow visits can be resumed
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
        frames_version=str(simulation.frames_version()),
    )
