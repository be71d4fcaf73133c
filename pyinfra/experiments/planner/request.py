"""What an engineer asks of a plan: requirements, goals, and how much is computed."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd

from pyinfra.core.arrays import BoolArray
from pyinfra.core.errors import Error
from pyinfra.core.progress import show_line
from pyinfra.core.vocabulary import Preset
from pyinfra.dataset.frames import PERIOD_S
from pyinfra.experiments.planner.areas import Area, of_name
from pyinfra.experiments.planner.detectability import Detectability
from pyinfra.experiments.planner.site import PlanSite

DISTANCES = (1.0, 0.5, 1.5)  # of the request's distance, for which there is a front
RANGES = {  # of the arguments of `plan` that have one
    "budget_usd": (1, 1e9),
    "within_m": (5, 500),
    "poles": (1, 20),
    "lidars_per_pole": (1, 8),
    "people": (0, 1000),
    "years": (0, 100),
    "frames": (2, 5000),
    "seed": (0, 2**31 - 2),
    "check_frames": (0, 5000),
    "jobs": (-1, 1000),
}


@dataclass(frozen=True)
class Request:
    """The requirements of a plan, and the effort of its race."""

    budget_usd: float
    find: float = 0.9  # share of the objects to be found in a frame, 0 to 1
    within_m: float = 60.0  # distance from the centre of the site within which objects count
    false_per_minute: float = math.inf  # most false boxes a minute; infinite: score 0.5
    poles: int = 1  # most poles
    lidars_per_pole: int = 1  # most LiDARs on a pole
    people: float = 0.0  # weight of a person relative to a vehicle in the choice
    areas: tuple[Area, ...] = ()  # areas of other weights, such as crossings
    years: float = 5.0
    detector: str = "generalist"
    preset: Preset = "datasheet"
    frames: int = 96  # most frames of a pose
    most: int = 1200  # most pairs of pose and LiDAR after the first frames
    keep: float = 0.99  # confidence with which a pose must be worse to be left out
    period_s: float = PERIOD_S  # frame period of the LiDARs

    @property
    def units(self) -> int:
        """The most LiDARs of an option."""
        return self.poles * self.lidars_per_pole

    @property
    def frames_per_minute(self) -> float:
        return 60 / self.period_s

    @property
    def most_false(self) -> float:
        """The most false boxes of a frame."""
        return self.false_per_minute / self.frames_per_minute


@dataclass(frozen=True)
class Effort:
    """What a plan computes beyond its race, and how."""

    check_frames: int = 30  # frames in which the best options are simulated in full; 0 for none
    what_if: bool = False  # whether option 1 is also simulated with changes
    count: float | None = None  # share of the passages that option 1 must count; None: no count
    jobs: int = 1  # threads
    folder: Path | None = None  # of the results; an interrupted plan resumes there
    tell: Callable[[str], None] = show_line  # called with a line for each stage

    @property
    def observations(self) -> Path | None:
        """The folder of the observations."""
        return None if self.folder is None else self.folder / "observations"


def check_request(request: Request, effort: Effort, law: Detectability) -> None:
    """Checks what ranges alone do not. Raises Error."""
    if not 0 <= request.find <= 1:
        share = f"; it is a share, not percent: {request.find / 100:g}"
        note = share if 1 < request.find <= 100 else ""
        raise Error(f"find: expected 0 to 1, got {request.find:g}{note}")
    if not request.false_per_minute > 0:
        raise Error(f"false_per_minute: expected more than 0, got {request.false_per_minute}")
    if effort.jobs == 0:
        raise Error("jobs: expected 1 or more, or -1 for all cores, got 0")
    if effort.count is not None and not 0 < effort.count <= 1:
        raise Error(f"count: expected above 0 to 1, got {effort.count:g}")
    if request.people > 0 and law.people is None:
        raise Error(
            f"people: expected 0 for the detector {law.detector}, which detects no pedestrians, "
            f"got {request.people:g}; generalist detects them"
        )


@dataclass(frozen=True, eq=False)
class Goal:
    """What is to be found: objects of a class within a distance, or the objects of an area."""

    column: str  # the column of its share
    what: str  # vehicles, pedestrians or the name of an area
    within_m: float | None  # None for an area
    counted: BoolArray  # (objects,)


def goals_of(
    site: PlanSite, objects: pd.DataFrame, law: Detectability, request: Request
) -> tuple[Goal, ...]:
    """Returns the goals of a plan; the first one is that of the request.

    A distance without a vehicle, or with the vehicles of another one, is left out.
    """
    goals: list[Goal] = []
    numbers = {0}
    for factor in DISTANCES:
        within = factor * request.within_m
        distance = "" if factor == 1 else f"_within_{within:g}_m"
        both = [
            Goal(f"{prefix}recall{distance}", name, within, np.ones(0, bool))
            for name, prefix in (("vehicles", ""), ("pedestrians", "people_"))
        ]
        some = with_objects(both, site, objects, law, request)
        vehicles = int(some[0].counted.sum())
        if vehicles not in numbers:
            numbers.add(vehicles)
            goals += some
    names = dict.fromkeys(area.name for area in request.areas)
    areas = [Goal(f"recall_{name}", name, None, np.ones(0, bool)) for name in names]
    goals += with_objects(areas, site, objects, law, request)
    return tuple(one for one in goals if one.counted.any())


def with_objects(
    goals: Sequence[Goal],
    site: PlanSite,
    objects: pd.DataFrame,
    law: Detectability,
    request: Request,
) -> tuple[Goal, ...]:
    """Returns the same goals for the objects of other frames; a goal may have none there."""
    person = objects.person.to_numpy(bool)
    known = ~person | (law.people is not None)

    def counted(one: Goal) -> BoolArray:
        if one.within_m is None:
            return np.asarray(known & of_name(request.areas, one.what, objects))
        of_class = person if one.what == "pedestrians" else ~person
        return np.asarray(known & of_class & site.is_near(objects, one.within_m))

    return tuple(replace(one, counted=counted(one)) for one in goals)


def distances(goals: Sequence[Goal]) -> list[float]:
    return list(dict.fromkeys(one.within_m for one in goals if one.within_m is not None))
