"""Writes the test sites of pretrained detectors as files: tests/data/sites.

    python -m reproduction frozen_sites

The command was run once. It wrote 60 sites of generator version 4 (`plain`) and 20 streets of
version 5 with much street furniture (`cluttered`). Each site has four LiDARs of the catalogue and
the frame numbers of each LiDAR. The files stay unchanged when the generator changes. All versions
of a detector are therefore tested on the same frames. Training never uses the seeds of these sites.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import yaml

from pyinfra.core.vocabulary import ObjectClass
from pyinfra.dataset import simulation
from pyinfra.dataset.catalogue import lidar_file
from pyinfra.models.training.generated_sites import samples_of
from pyinfra.models.training.samples import SiteSample
from pyinfra.scenes.generator import lidar_catalogue
from pyinfra.scenes.generator.generate import make_site
from pyinfra.scenes.generator.layout import Keys
from pyinfra.scenes.generator.ranges import CLUTTERED, RANGES, Ranges
from reproduction import ROOT

FOLDER = ROOT / "tests/data/sites"
FIRST_SITE = 1_000_000  # training uses smaller seeds only
PRESET = "datasheet"
LIDARS, FRAMES = 4, 5  # LiDARs per site, frames per LiDAR
# The first seed, the number of sites and the parameter ranges of each set of sites.
SETS: dict[str, tuple[int, int, Ranges]] = {
    "plain": (FIRST_SITE, 60, replace(RANGES, furniture=replace(RANGES.furniture, sites=0.0))),
    "cluttered": (FIRST_SITE + 100, 20, CLUTTERED),
}


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


def looked_at(
    name: str, classes: tuple[ObjectClass, ...], sites: int | None = None, frames: int = FRAMES
) -> Iterator[tuple[str, str, list[SiteSample]]]:
    """Simulates the visits of a set; yields the site, the LiDAR and the samples of each visit.

    Parameters
    ----------
    sites : maximum number of sites; None for all sites
    frames : maximum number of frames per LiDAR
    """
    for number, (keys, visits) in enumerate(read_visits(name)):
        if number == sites:
            return
        world = simulation.make_world(keys)
        for visit in visits:
            lidar = simulation.load_lidar(lidar_file(visit.lidar), PRESET).with_free_motors()
            chosen = list(visit.frames[:frames])
            yield visit.site, visit.lidar, samples_of(world, keys, lidar, chosen, classes)


def write_set(name: str) -> None:
    first, count, ranges = SETS[name]
    (FOLDER / name).mkdir(parents=True, exist_ok=True)
    everyone = lidar_catalogue.sensors(presets={PRESET: 1.0})
    visits = [("site", "lidar", "frames")]
    for seed in range(first, first + count):
        random = np.random.default_rng(seed)
        keys = make_site(seed, ranges) | {"label_time": "scan"}
        world = simulation.make_world(keys)
        # The JSON round trip copies shared objects, because YAML would write them as anchors.
        plain = json.loads(json.dumps(keys))
        text = yaml.safe_dump(plain, sort_keys=False, width=110, default_flow_style=None)
        (FOLDER / name / f"{keys['name']}.yaml").write_text(text)
        for lidar in everyone.draw(random, LIDARS):
            chosen = sorted(random.choice(world.frames, FRAMES, replace=False).tolist())
            visits.append((keys["name"], lidar.name, " ".join(map(str, chosen))))
    with (FOLDER / name / "visits.csv").open("w", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows(visits)


def main() -> None:
    for name in SETS:
        write_set(name)
