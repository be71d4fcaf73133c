"""Reads and simulates the test sites of pretrained detectors: tests/data/sites.

There are 60 sites of generator version 4 (`plain`), and 20 streets of version 5 with much street
furniture (`cluttered`). Commit aebf9cc3 wrote their files. Each site has four LiDARs of the
catalogue and the frame numbers of each LiDAR. The files stay unchanged when the generator changes.
All versions of a detector are therefore tested on the same frames. Training never uses the seeds of
these sites.
"""

import csv
import itertools
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
import yaml

from pyinfra.core.arrays import BoolArray, FloatArray, IntArray
from pyinfra.core.errors import Error
from pyinfra.core.vocabulary import ObjectClass
from pyinfra.dataset import simulation
from pyinfra.dataset.catalogue import lidar_file
from pyinfra.dataset.object_rows import scene_objects
from pyinfra.models.training import sources
from pyinfra.models.training.generated_sites import cast, maker
from pyinfra.models.training.samples import SiteSample
from pyinfra.scenes.generator import lidar_catalogue
from pyinfra.scenes.generator.generate import make_site
from pyinfra.scenes.generator.layout import Keys
from pyinfra.scenes.generator.ranges import CLUTTERED, RANGES
from reproduction import ROOT

FOLDER = ROOT / "tests/data/sites"
SETS = ("plain", "cluttered")
CALIBRATION_SITE = 1_500_000  # first seed of the sites that calibrate scores
HELD_OUT = ("hesai_ot128", "hesai_xt32", "livox_horizon")  # LiDARs that no training uses
PRESET = "datasheet"
LIDARS, FRAMES = 4, 5  # number of LiDARs per site, and of frames per LiDAR
QUEUE_S, STANDS_M = 30.0, 0.5  # a vehicle in a queue moves less than STANDS_M in QUEUE_S


@dataclass(frozen=True)
class Visit:
    """One LiDAR at one test site, with its frame numbers."""

    site: str
    lidar: str
    frames: tuple[int, ...]


def read_visits(name: str) -> Iterator[tuple[Keys, list[Visit]]]:
    """Yields the scene keys and the visits of each site of a set."""
    with (FOLDER / name / "visits.csv").open() as file:
        rows = [
            Visit(row["site"], row["lidar"], tuple(map(int, row["frames"].split())))
            for row in csv.DictReader(file)
        ]
    for site in dict.fromkeys(row.site for row in rows):
        keys = yaml.safe_load((FOLDER / name / f"{site}.yaml").read_text())
        yield keys, [row for row in rows if row.site == site]


def calibration_visits(sites: int) -> Iterator[tuple[Keys, list[Visit]]]:
    """Yields the scene keys and the visits of sites that neither training nor tests use.

    A fourth of the sites are streets with much street furniture. Their LiDARs are those of the
    training. Sites that the simulator refuses are left out.
    """
    trained = lidar_catalogue.sensors(without=HELD_OUT, presets={PRESET: 1.0})
    made = 0
    for seed in itertools.count(CALIBRATION_SITE):
        if made == sites:
            return
        random = np.random.default_rng(seed)
        keys = make_site(seed, CLUTTERED if seed % 4 == 3 else RANGES) | {"label_time": "scan"}
        try:
            world = simulation.make_world(keys)
        except Error as error:
            print(f"site {seed}: left out: {error}", flush=True)
            continue
        made += 1
        visits = []
        for lidar in trained.draw(random, LIDARS):
            count = world.frames_of(lidar.period_s)
            frames = sorted(random.choice(count, FRAMES, replace=False).tolist())
            visits.append(Visit(keys["name"], lidar.name, tuple(frames)))
        yield keys, visits


@dataclass(frozen=True, eq=False)
class TestSample(SiteSample):
    """A sample of a test site."""

    queues: BoolArray = field(kw_only=True)  # (k,) whether each box has stood for QUEUE_S

    __test__ = False  # pytest does not collect this class


def tested_at(
    keys: Keys, visits: list[Visit], classes: tuple[ObjectClass, ...], frames: int
) -> Iterator[tuple[str, list[TestSample]]]:
    """Simulates the visits of a site; yields the LiDAR and the samples of each visit.

    frames: maximum number of frames per LiDAR.
    """
    world = simulation.make_world(keys)
    for visit in visits:
        lidar = simulation.load_lidar(lidar_file(visit.lidar), PRESET).with_free_motors()
        count = world.frames_of(lidar.period_s)
        make = maker(world, keys, lidar, classes)
        label_time, samples = simulation.label_time(world, lidar), list[TestSample]()
        numbers = list(visit.frames[:frames])
        for number, frame in zip(numbers, cast(world, lidar, numbers), strict=True):
            sample = make(frame, simulation.points(frame))
            hit = sources.hit_vehicles(frame, label_time, classes)
            queues = stands(world, number, lidar.period_s, count, hit.ids)
            samples.append(TestSample(**vars(sample), queues=queues))
        yield visit.lidar, samples


def stands(
    world: simulation.World, frame: int, period_s: float, count: int, ids: IntArray
) -> BoolArray:
    """Returns which objects have stood for QUEUE_S, and drive at another time of the run: (n,).

    Parked vehicles never drive, so their result is False.
    """
    before = [frame - round(share * QUEUE_S / period_s) for share in (1.0, 0.5)]
    if before[0] < 0:
        return np.zeros(len(ids), np.bool_)
    now, *earlier = (positions(world, k, period_s) for k in (frame, *before))
    ends = [positions(world, k, period_s) for k in (0, count - 1)]

    def moved(i: int, there: dict[int, FloatArray]) -> bool:
        return i not in there or bool(np.linalg.norm(now[i] - there[i]) > STANDS_M)

    return np.array(
        [
            not any(moved(i, there) for there in earlier) and any(moved(i, there) for there in ends)
            for i in ids.tolist()
        ],
        np.bool_,
    )


def positions(world: simulation.World, frame: int, period_s: float) -> dict[int, FloatArray]:
    """Returns x, y of each object in a frame, by its id."""
    objects = scene_objects(world.objects(frame, period_s), 0)
    return dict(zip(objects.ids.tolist(), objects.boxes[:, :2], strict=True))
