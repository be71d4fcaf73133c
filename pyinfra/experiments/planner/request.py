"""The request of a plan: requirements, areas, goals, and how much is computed."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pandas as pd

from pyinfra.core.arrays import BoolArray, FloatArray
from pyinfra.core.errors import Error, FormatError
from pyinfra.core.progress import show_line
from pyinfra.core.vocabulary import Preset
from pyinfra.dataset.frames import PERIOD_S
from pyinfra.dataset.roads import Road
from pyinfra.experiments.planner.detectability import Detectability
from pyinfra.experiments.planner.site import PlanSite
from pyinfra.formats.csv_table import check_columns, expect, read_csv
from pyinfra.scenes.maps import site_folder

DISTANCES = (1.0, 0.5, 1.5)  # factors of the request's distance; each has its own best options
RANGES = {  # allowed ranges of arguments of `plan`
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
CLASSES = ("vehicle", "person", "any")
CROSSINGS = "the crossings"
BESIDE_M = 10.0  # width beside a carriageway in which people walk
CROSSING_M = 6.0  # radius around the middle of a crossing of a map
ENDS = ("low", "high", "in_choice", "in_rain", "simulated")  # suffixes of columns in the tables
AREA_COLUMNS = ("name", "x_m", "y_m", "radius_m")


@dataclass(frozen=True)
class Area:
    """A disc in the world frame, the objects that it includes, and their weight."""

    name: str
    x_m: float
    y_m: float
    radius_m: float
    weight: float = 1.0
    object_class: str = "any"

    def holds(self, objects: pd.DataFrame) -> BoolArray:
        """Returns which objects (columns x, y, person) count in the area: (n,)."""
        inside = np.hypot(objects.x - self.x_m, objects.y - self.y_m) <= self.radius_m
        if self.object_class == "any":
            return np.asarray(inside)
        return np.asarray(inside & (objects.person == (self.object_class == "person")))


@dataclass(frozen=True)
class Request:
    """The requirements of a plan, and how many poses and frames its search observes."""

    budget_usd: float
    find: float = 0.9  # share of the objects to be found in a frame, 0 to 1
    within_m: float = 60.0  # distance from the centre of the site within which objects are included
    # maximum rate of false boxes; if infinite, the minimum score of a box is 0.5
    false_per_minute: float = math.inf
    poles: int = 1  # maximum number of poles
    lidars_per_pole: int = 1  # maximum number of LiDARs on a pole
    people: float = 0.0  # weight of a person relative to a vehicle in the choice
    areas: tuple[Area, ...] = ()  # areas whose objects have other weights
    years: float = 5.0
    detector: str = "generalist"
    preset: Preset = "datasheet"
    frames: int = 96  # maximum number of frames per pose
    most: int = 1200  # maximum number of pairs of pose and LiDAR after the first frames
    keep: float = 0.99  # confidence level of the test that leaves out worse poses
    period_s: float = PERIOD_S  # frame period of the LiDARs

    @property
    def units(self) -> int:
        """The maximum number of LiDARs of an option."""
        return self.poles * self.lidars_per_pole

    @property
    def frames_per_minute(self) -> float:
        return 60 / self.period_s

    @property
    def most_false(self) -> float:
        """The maximum number of false boxes per frame."""
        return self.false_per_minute / self.frames_per_minute


@dataclass(frozen=True)
class Effort:
    """What a plan computes after its search, and with which resources."""

    check_frames: int = 30  # frames in which the best options are simulated in full; 0 for none
    count: float | None = None  # share of passages that option 1 must count; None for no count
    jobs: int = 1  # number of threads
    observations: Path | None = None  # folder of observations, from which a plan can resume
    tell: Callable[[str], None] = show_line  # function that gets a line for each stage


def check_request(request: Request, effort: Effort, law: Detectability) -> None:
    """Raises Error for values that RANGES does not check."""
    find, count, people = request.find, effort.count, request.people
    share = f"; it is a share, not percent: {find / 100:g}" if 1 < find <= 100 else ""
    if not 0 <= find <= 1:
        raise Error(f"find: expected 0 to 1, got {find:g}{share}")
    if not request.false_per_minute > 0:
        raise Error(f"false_per_minute: expected more than 0, got {request.false_per_minute}")
    if effort.jobs == 0:
        raise Error("jobs: expected 1 or more, or -1 for all cores, got 0")
    if count is not None and not 0 < count <= 1:
        raise Error(f"count: expected more than 0, at most 1, got {count:g}")
    if people > 0 and law.people is None:
        raise Error(
            f"people: expected 0 for the detector {law.detector}, which detects no pedestrians, "
            f"got {people:g}; the detector generalist detects them"
        )


@dataclass(frozen=True, eq=False)
class Goal:
    """The objects to be found: those of a class within a distance, or those of an area."""

    column: str  # column with the share of the goal
    what: str  # kind of objects: vehicles, pedestrians or the name of an area
    within_m: float | None  # maximum distance of the objects; None for an area
    # whether each object counts for the goal, shape (objects,)
    counted: BoolArray = field(default_factory=lambda: np.zeros(0, bool))


def goals_of(
    site: PlanSite, objects: pd.DataFrame, law: Detectability, request: Request
) -> tuple[Goal, ...]:
    """Returns the goals of a plan; the first one is that of the request.

    A distance is left out if no vehicle is within it, or the same vehicles as within another one.
    """
    goals: list[Goal] = []
    numbers = {0}
    for factor in DISTANCES:
        within = factor * request.within_m
        distance = "" if factor == 1 else f"_within_{within:g}_m"
        both = [
            Goal(f"{prefix}recall{distance}", name, within)
            for name, prefix in (("vehicles", ""), ("pedestrians", "people_"))
        ]
        some = with_objects(both, site, objects, law, request)
        vehicles = int(some[0].counted.sum())
        if vehicles not in numbers:
            numbers.add(vehicles)
            goals += some
    names = dict.fromkeys(area.name for area in request.areas)
    areas = [Goal(f"recall_{name}", name, None) for name in names]
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
    person, known = objects.person.to_numpy(bool), can_be_found(objects, law)

    def counted(one: Goal) -> BoolArray:
        if one.within_m is None:
            return np.asarray(known & of_name(request.areas, one.what, objects))
        of_class = person if one.what == "pedestrians" else ~person
        return np.asarray(known & of_class & site.is_near(objects, one.within_m))

    return tuple(replace(one, counted=counted(one)) for one in goals)


def masks_of(goals: Sequence[Goal]) -> dict[str, BoolArray]:
    """Returns which objects each goal includes, by the column of the goal."""
    return {one.column: one.counted for one in goals}


def distances(goals: Sequence[Goal]) -> list[float]:
    return list(dict.fromkeys(one.within_m for one in goals if one.within_m is not None))


def read_areas(file: Path) -> tuple[Area, ...]:
    """Reads areas from a CSV file.

    Columns: name, x_m, y_m, radius_m; optional weight (default 1) and class (vehicle, person or
    any, the default). Areas with the same name form one area. Raises FormatError with file, line
    and column.
    """
    table = read_csv(file, {"name", "class"}, AREA_COLUMNS)
    check_columns(file, table, [*AREA_COLUMNS, "class", "weight"])
    if table.empty:
        raise FormatError(f"{file}: expected one or more areas, got none")
    usual = {"weight": 1.0, "class": "any"}
    table = table.assign(**{key: usual[key] for key in usual if key not in table})
    table = table.astype(dict.fromkeys((*AREA_COLUMNS[1:], "weight"), float))
    name = table["name"]
    expect(file, name, name.notna(), "a name")
    taken = {f"{stem}{end}" for stem in ("", *(name + "_")) for end in ENDS}
    free = ~name.isin(taken) & ~name.str.startswith("within_")
    expect(file, name, free, "a name that does not collide with another column of options.csv")
    for axis in ("x_m", "y_m"):
        expect(file, table[axis], np.isfinite(table[axis]), "a number")
    expect(file, table.radius_m, table.radius_m.between(0.1, 1e4), "0.1 to 10000")
    expect(file, table.weight, table.weight.between(0, 1e4), "0 to 10000")
    expect(file, table["class"], table["class"].isin(CLASSES), ", ".join(CLASSES))
    table = table[[*AREA_COLUMNS, "weight", "class"]]
    return tuple(Area(*row) for row in table.itertuples(index=False, name=None))


def check_on_roads(areas: tuple[Area, ...], roads: Sequence[Road]) -> None:
    """Raises Error for an area that overlaps no road or roadside of the evaluation region."""
    for area in areas:
        at = area.x_m, area.y_m
        away = min(float((np.hypot(*(road.xy - at).T) - road.half_width).min()) for road in roads)
        if away > area.radius_m + BESIDE_M:
            raise Error(
                f"areas: expected areas in the evaluation region, got '{area.name}' at "
                f"({area.x_m:g}, {area.y_m:g}), {away:.0f} m from its nearest road"
            )


def crossings_of(folder: Path, weight: float) -> tuple[Area, ...]:
    """Returns the pedestrian crossings of an imported map as one area, for people.

    The result is empty if the folder has no map.yaml. Raises FormatError.
    """
    crossings = site_folder.features(folder).get("crossing", ())
    return tuple(
        Area(CROSSINGS, float(x), float(y), CROSSING_M, weight, "person") for x, y in crossings
    )


def of_name(areas: tuple[Area, ...], name: str, objects: pd.DataFrame) -> BoolArray:
    """Returns which objects the areas with this name include: (n,)."""
    return np.asarray(np.any([one.holds(objects) for one in areas if one.name == name], axis=0))


def can_be_found(objects: pd.DataFrame, law: Detectability) -> BoolArray:
    """Returns which objects are of a class that the detector detects: (n,)."""
    return np.asarray(~objects.person.to_numpy(bool) | (law.people is not None))


def weighted(
    objects: pd.DataFrame, near: BoolArray, people: float, areas: tuple[Area, ...]
) -> FloatArray:
    """Returns the weights of objects (n,): 1 for a vehicle that is near, `people` for a pedestrian.

    The weight of an object in areas is the largest weight of these areas.
    """
    out = np.asarray(np.where(objects.person, people, 1.0) * near)
    inside = np.zeros(len(out), bool)
    for area in areas:
        here = area.holds(objects)
        out[here] = np.where(inside[here], np.maximum(out[here], area.weight), area.weight)
        inside |= here
    return out
