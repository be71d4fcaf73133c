"""The public function `plan`: where LiDARs stand, which, how high and how many."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, partial
from pathlib import Path

import numpy as np
import pandas as pd

from pyinfra.core.files import replacing
from pyinfra.core.names import path_of
from pyinfra.core.present import Presented
from pyinfra.core.progress import show_line
from pyinfra.core.public import public
from pyinfra.dataset import simulation
from pyinfra.experiments.planner.answer import LISTED, Answer, answer_of, few_positions
from pyinfra.experiments.planner.areas import crossings_of, read_areas
from pyinfra.experiments.planner.candidates import (
    POSE,
    PoseGrid,
    checked_grid,
    feasible,
    make_candidates,
    read_candidates,
    with_faults,
)
from pyinfra.experiments.planner.check import Counted, Found, simulate_option, standing
from pyinfra.experiments.planner.choice import Choice, Units
from pyinfra.experiments.planner.costs import Costs, read_costs
from pyinfra.experiments.planner.counting import Counting, count_line, count_option
from pyinfra.experiments.planner.decide import (
    considered,
    first_at_each_place,
    kind_of,
    listed,
    moves_of,
    options_of,
    units_of,
)
from pyinfra.experiments.planner.detectability import Detectability, read_detectability
from pyinfra.experiments.planner.front import (
    Front,
    Goal,
    counted_of,
    front_of,
    front_options,
    goals_of,
    masks_of,
    with_objects,
)
from pyinfra.experiments.planner.kept import described, keep_request
from pyinfra.experiments.planner.lidars import PlanLidar, common_period_s, open_lidars
from pyinfra.experiments.planner.predict import Prediction, predict
from pyinfra.experiments.planner.race import Race, race
from pyinfra.experiments.planner.refusals import (
    affordable,
    check_settings,
    check_site,
    lowest_prices,
    possible,
)
from pyinfra.experiments.planner.request import Request, checked
from pyinfra.experiments.planner.sensitivity import (
    RAIN_MM_PER_H,
    WITH_WEATHER,
    cases_of,
    change_line,
    changed_rows,
    price_line,
    rain_rows,
    table_of,
    with_rows,
)
from pyinfra.experiments.planner.site import PlanSite, open_site, other_traffic, scene_path
from pyinfra.experiments.planner.tables import candidate_table, option_table
from pyinfra.experiments.planner.unseen import UNSEEN_FRAMES, observed_again
from pyinfra.experiments.planner.verdict import Standing, in_order
from pyinfra.metrics.comparison import Interval

MOST_SIMULATED = 6  # options that are simulated in full, beside one of another kind
RAIN_FRAMES = 24
Tell = Callable[[str], None]


@dataclass(frozen=True, eq=False, repr=False)
class Plan(Presented):
    """The result of a plan.

    Attributes
    ----------
    options : a row for each LiDAR of each option; the chosen option is number 1. `share` with its
        interval decides, and `verdict` says whether it meets the request
    candidates : a row for each pose and LiDAR that was considered
    sensitivity : what is chosen and found with other prices, a lost LiDAR, and what `what_if` adds
    front : the options that are best for some budget, wanted share, number of poles and LiDARs
    counting : passages that tracks of option 1 counted, and its speeds; None if not asked for
    text : the answer in sentences
    """

    site: PlanSite
    request: Request
    options: pd.DataFrame
    candidates: pd.DataFrame
    sensitivity: pd.DataFrame
    answer: Answer
    front: Front
    lidars: tuple[PlanLidar, ...]  # within the budget
    counting: Counting | None = None
    above_budget: dict[str, float] = field(default_factory=dict)  # lowest price of other LiDARs

    def facts(self) -> dict[str, object]:
        first = self.options[self.options.option == 1]
        return {
            "scene": self.site.name,
            "verdict": self.verdict,
            "lidars": " + ".join(first.lidar),
            "price_usd": f"{first.price_usd.iloc[0]:.0f}",
            "found_percent": f"{first.share.iloc[0]:.0f}",
            "options": self.options.option.nunique(),
        }

    @property
    def text(self) -> str:
        return "\n".join(self.answer.lines)

    @property
    def verdict(self) -> str:
        """Whether option 1 meets the request: `met`, `not met`, or `not known`."""
        return self.answer.verdict


@public()
def plan(
    scene: str | os.PathLike[str],
    budget_usd: float,
    *,
    find: float = 0.9,
    within_m: float = 60.0,
    false_per_minute: float = math.inf,
    poles: int = 1,
    lidars_per_pole: int = 1,
    lidars: Sequence[str | os.PathLike[str]] = (),
    detector: str = "generalist",
    poses: str | os.PathLike[str] | None = None,
    grid: PoseGrid | None = None,
    people: float = 0.0,
    areas: str | os.PathLike[str] | None = None,
    centre_m: tuple[float, float] | None = None,
    costs: str | os.PathLike[str] | None = None,
    years: float = 5.0,
    preset: str = "datasheet",
    seed: int | None = None,
    frames: int = 96,
    check_frames: int = 30,
    what_if: bool = False,
    count: float | None = None,
    out: str | os.PathLike[str] | None = None,
    jobs: int = 1,
    progress: Callable[[str], None] | None = None,
) -> Plan:
    """Chooses poles, heights and LiDARs for a site within a budget.

    Many poses and LiDARs are observed in a few frames, and those that may be the best in more. A
    detector's detectability turns what they see into the share of objects that it finds. The best
    options are simulated in full, and the measured share then decides.

    Parameters
    ----------
    scene : name or file of a scene, or a folder of `pyinfra site import`
    budget_usd : highest price over the years, in US dollars
    find : wanted share of the vehicles that are found in a frame, 0 to 1
    within_m : distance from the centre of the site within which objects count
    false_per_minute : most false boxes a minute; by default boxes of score 0.5 or more count
    poles, lidars_per_pole : most poles, and most LiDARs on one pole
    lidars : names or files of LiDARs; by default all of the catalogue
    detector : `generalist` for the pretrained detector, or `background`
    poses : CSV file of poses (x_m, y_m; z_m, yaw_deg, pitch_deg, existing, arm_m, bearing_deg), of
        which each position has an option; by default they are made along kerbs, medians and walls
    grid : spacing, heights and directions of the poses that are made
    people : weight of a pedestrian relative to a vehicle in the choice
    areas : CSV file of areas with other weights, such as crossings (name, x_m, y_m, radius_m;
        weight, class); the answer has the share found in each
    centre_m : x y from which `within_m` is measured; by default the middle of the first junction,
        or of the largest one near the mount of an imported map
    costs : CSV file of costs (item, per, low, high, source); by default that of the package
    years : years of use that the price includes
    preset, seed : preset of the LiDARs, and seed of the traffic
    frames : most frames of a pose
    check_frames : frames in which the best options are simulated in full, with three further
        traffic seeds; 0 for none
    what_if : also simulate option 1 with a changed mast, traffic, weather and a lost LiDAR
    count : also simulate 30 s of option 1 without gaps, track its vehicles and count their
        passages; the answer says whether this share of the passages is counted, 0 to 1
    out : folder for the tables and answer.txt; an interrupted plan resumes there
    jobs : number of threads
    progress : called with a line for each stage

    Returns
    -------
    Plan : tables `options` and `candidates`, and the answer as `text`

    Raises
    ------
    Error : if no pose is free, no LiDAR is within the budget, or the region has no traffic

    Examples
    --------
    >>> import pyinfra as pi
    >>> result = pi.plan("crossroad", 9000, lidars=["helios_16"], frames=6, check_frames=0,
    ...                  grid=pi.PoseGrid(every_m=60, heights_m=(5,), pitches_deg=(0,)))
    >>> result.options.lidar.iloc[0]
    'helios_16'
    >>> result.sensitivity.case.iloc[0]
    'as asked'
    """
    request = checked(
        Request(
            budget_usd=budget_usd,
            find=find,
            within_m=within_m,
            false_per_minute=false_per_minute,
            poles=poles,
            lidars_per_pole=lidars_per_pole,
            people=people,
            areas=crossings_of(scene_path(scene).parent, people)
            if areas is None
            else read_areas(path_of(areas, "areas")),
            years=years,
            detector=detector,
            preset=preset,
            frames=frames,
        )
    )
    folder = None if out is None else path_of(out, "out")
    law = read_detectability(detector)
    check_settings(law, request, centre_m, seed, check_frames, count, jobs)
    grid = checked_grid(grid or PoseGrid())
    table_of_costs = read_costs(None if costs is None else path_of(costs, "costs"), years, law)
    period_s = common_period_s(lidars, preset)
    request = replace(request, period_s=period_s)
    table_of_costs = replace(table_of_costs, frame_ms=1000 * period_s)
    site = open_site(scene, frames, preset=preset, seed=seed, centre_m=centre_m, period_s=period_s)
    check_site(site, request, check_frames, drawn=areas is not None)
    asked = open_lidars(lidars, site)
    units = affordable(asked, table_of_costs, request)
    table = candidates(site, None if poses is None else path_of(poses, "poses"), request, grid)
    free = feasible(table, site)
    pairs = possible(free, units, table_of_costs, request)
    if folder is not None:
        keep_request(folder, described(site, request, units, table, table_of_costs, check_frames))
    parts = None if folder is None else folder / "observations"
    tell = progress or show_line
    run = race(site, free, units, pairs, request, law, jobs=jobs, folder=parts, progress=tell)
    steps = Steps(site, request, law, table_of_costs, free, units, run, check_frames, tell)
    result = chosen(steps, table, what_if=what_if, count=count, jobs=jobs, folder=parts)
    prices = lowest_prices(asked, free, table_of_costs)
    above = {name: usd for name, usd in prices.items() if usd > request.budget_usd}
    result = replace(result, above_budget=above)
    if folder is not None:
        write(result, folder)
    return result


@dataclass(frozen=True, eq=False)
class Steps:
    """What the choice needs of the steps before it."""

    site: PlanSite
    request: Request
    law: Detectability
    costs: Costs
    poses: pd.DataFrame  # that are possible
    lidars: Sequence[PlanLidar]
    run: Race
    check_frames: int
    tell: Tell


def candidates(site: PlanSite, file: Path | None, request: Request, grid: PoseGrid) -> pd.DataFrame:
    """Returns the poses of a file, or made ones, with their faults."""
    if file is not None:
        return with_faults(read_candidates(file, site, grid), site)
    return with_faults(make_candidates(site, request.within_m, grid), site)


@dataclass(frozen=True, eq=False)
class Compared:
    """The options of a plan, the chosen one first, and what decides about them."""

    options: list[Choice]
    listed: int  # options in the table; the others are those of the front
    units: Units
    goals: tuple[Goal, ...]
    standings: dict[tuple[int, ...], Standing]
    found: dict[tuple[int, ...], Found]  # of the options that were simulated
    predicted: Callable[[tuple[int, ...]], Prediction]
    unseen: Race  # what is seen in other traffic than that of the choice
    again: Callable[..., Race]  # observes options in the frames of a site

    @property
    def first(self) -> Choice:
        return self.options[0]


def chosen(
    steps: Steps,
    table: pd.DataFrame,
    *,
    what_if: bool,
    count: float | None,
    jobs: int,
    folder: Path | None,
) -> Plan:
    """Compares the options of the pairs that stayed, and makes the tables and the answer.

    table: all poses, with their faults. count: share of the passages to be counted, or None.
    """
    site, request, law = steps.site, steps.request, steps.law
    one = compare(steps, jobs=jobs, folder=folder)
    moves = moves_of(one.options, one.units, one.standings, request)
    sensitivity = table_of(one.options, one.standings, moves, one.units, one.predicted)
    in_rain = recall_in_rain(steps, one)
    sensitivity = with_rows(sensitivity, rain_rows(in_rain[:1]))
    if what_if and steps.check_frames:
        sensitivity = with_rows(sensitivity, what_if_rows(steps, one))

    predictions = {choice.units: one.predicted(choice.units) for choice in one.options}
    rows_of_all = option_table(
        one.options, predictions, one.standings, steps.run.stayed, steps.poses, steps.lidars,
        one.units, request,
    )  # fmt: skip
    by_option = {k: 100 * share.value for k, share in enumerate(in_rain, start=1)}
    if site.preset == WITH_WEATHER:
        rows_of_all["recall_in_rain"] = rows_of_all.option.map(by_option)
    rows = rows_of_all[rows_of_all.option <= one.listed].copy()
    every = candidate_table(table, steps.run.pairs, steps.poses, steps.lidars)
    stands = [(choice, one.standings[choice.units]) for choice in one.options]
    prices = price_line(moves, one.options, one.units, one.standings)
    changes = [
        " ".join(filter(None, [prices, few_positions(steps.poses, request)])),
        change_line(sensitivity),
    ]
    counting = None
    if count is not None:
        counting = count_option(site, parts_of(one.first, steps), request.detector)
        changes.append(count_line(counting, count))
    answer = answer_of(
        site, request, law, steps.costs, stands[: one.listed], rows, every, one.units, changes,
        len(site.other_frames(steps.check_frames)),
    )  # fmt: skip
    probability = [predictions[choice.units].probability for choice in one.options]
    front = front_of(
        stands, rows_of_all, one.goals, probability, one.units, one.unseen.objects, law, request
    )
    lidars = tuple(steps.lidars)
    return Plan(site, request, rows, every, sensitivity, answer, front, lidars, counting)


def compare(steps: Steps, *, jobs: int, folder: Path | None) -> Compared:
    """Predicts the options of the pairs that stayed in other traffic, and simulates the best."""
    site, request, law, run = steps.site, steps.request, steps.law, steps.run
    units = units_of(run, steps.poses, steps.lidars, steps.costs, law, request)
    goals = goals_of(site, run.objects, law, request)
    best = considered(units, request)
    options = options_of(best, front_options(units, goals, request), units, request)
    again = partial(
        observed_again,
        stayed=run.stayed,
        poses=steps.poses,
        lidars=steps.lidars,
        request=request,
        jobs=jobs,
        folder=folder,
    )
    unseen = again(other_traffic(site, unseen_frames(request)), options=options)
    unseen = unseen if unseen.objects.near_vehicles.any() else run
    goals = with_objects(goals, site, unseen.objects, law, request)
    masks = masks_of(goals)

    @cache
    def predicted(some: tuple[int, ...]) -> Prediction:
        return predict(unseen, some, law, request, masks)

    standings = {one.units: Standing.predicted(predicted(one.units)) for one in options}
    found = {}
    if steps.check_frames:
        counted = counted_of(goals, site, law, request)
        found = simulate_best(steps, options, standings, units, counted, predicted)
    ordered, count = listed(in_order(options, standings, request), best, units)
    return Compared(ordered, count, units, goals, standings, found, predicted, unseen, again)


def unseen_frames(request: Request) -> int:
    return min(request.frames, UNSEEN_FRAMES)


def recall_in_rain(steps: Steps, one: Compared) -> list[Interval]:
    """Returns the predicted share of vehicles of each listed option in rain.

    The list is empty if the preset has no weather or no vehicle is near.
    """
    if steps.site.preset != WITH_WEATHER:
        return []
    frames = min(unseen_frames(steps.request), RAIN_FRAMES)
    wet_site = other_traffic(steps.site, frames, {"weather.rain_mm_per_h": RAIN_MM_PER_H})
    options = one.options[: one.listed]
    rainy = one.again(wet_site, options=options)
    if not rainy.objects.near_vehicles.any():
        return []
    return [predict(rainy, choice.units, steps.law, steps.request).recall for choice in options]


def what_if_rows(steps: Steps, one: Compared) -> list[dict[str, object]]:
    """Returns a row for each change of the first option, simulated in the same frames."""
    parts = parts_of(one.first, steps)
    before = one.found.get(one.first.units) or simulate(steps, one.first, one.predicted)
    rows = changed_rows(
        steps.site,
        parts,
        steps.request.detector,
        steps.request.within_m,
        one.predicted(one.first.units).cut,
        before,
        steps.check_frames,
        cases_of(steps.site, parts),
        steps.tell,
    )
    return list(rows)


def simulate_best(
    steps: Steps,
    options: Sequence[Choice],
    standings: dict[tuple[int, ...], Standing],
    units: Units,
    counted: Mapping[str, Counted],
    predicted: Callable[[tuple[int, ...]], Prediction],
) -> dict[tuple[int, ...], Found]:
    """Simulates options until the first ones are measured, and one of another kind.

    Their standings are replaced by the measured ones.
    """
    found: dict[tuple[int, ...], Found] = {}

    def measure(one: Choice) -> None:
        found[one.units] = simulate(steps, one, predicted)
        now = standing(found[one.units], counted, steps.site, steps.request)
        standings[one.units] = now
        names = " and ".join(units.lidars[u].name for u in one.units)
        steps.tell(f"simulated {names}: finds {100 * now.recall.value:.0f} of 100")

    while len(found) < MOST_SIMULATED:
        order = in_order(options, standings, steps.request)
        first = first_at_each_place(order, units)[:LISTED]
        left = [one for one in first if one.units not in found]
        if not left:
            break
        measure(left[0])
    order = in_order(options, standings, steps.request)
    kinds = {kind_of(one, units) for one in options if one.units in found}
    other = next((one for one in order if kind_of(one, units) not in kinds), None)
    if other is not None:
        measure(other)
    return found


def simulate(
    steps: Steps, one: Choice, predicted: Callable[[tuple[int, ...]], Prediction]
) -> Found:
    """Simulates an option in full."""
    cut = predicted(one.units).cut
    detector, frames = steps.request.detector, steps.check_frames
    return simulate_option(steps.site, parts_of(one, steps), detector, cut, frames)


def parts_of(one: Choice, steps: Steps) -> list[tuple[list[float], simulation.Lidar]]:
    """Returns pose and LiDAR of each unit of an option."""
    stayed = steps.run.stayed.iloc[list(one.units)]
    poses = steps.poses[POSE].to_numpy(float)[stayed.pose]
    return [
        (pose.tolist(), steps.lidars[lidar].unit)
        for pose, lidar in zip(poses, stayed.lidar, strict=True)
    ]


def write(result: Plan, folder: Path) -> None:
    """Writes options.csv, front.csv, candidates.csv, sensitivity.csv, answer.txt and notes.txt.

    `existing` is yes or no there, so that rows can be a file of poses.
    """
    folder.mkdir(parents=True, exist_ok=True)
    tables = {
        "options": result.options,
        "front": result.front.table,
        "candidates": result.candidates,
    }
    for name, table in tables.items():
        with replacing(folder / f"{name}.csv") as beside:
            words = np.where(table.existing.to_numpy(bool), "yes", "no")
            table.assign(existing=words).to_csv(beside, index=False, float_format="%.6g")
    with replacing(folder / "sensitivity.csv") as beside:
        result.sensitivity.to_csv(beside, index=False, float_format="%.6g")
    texts = {"answer.txt": result.answer.lines, "notes.txt": result.answer.notes}
    for name, lines in texts.items():
        with replacing(folder / name) as beside:
            beside.write_text("\n".join(lines) + "\n", encoding="utf-8")
