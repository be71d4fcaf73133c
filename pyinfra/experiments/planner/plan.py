"""The public function `plan`: where LiDARs stand, which, how high and how many."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd

from pyinfra.core.arrays import BoolArray
from pyinfra.core.errors import Error
from pyinfra.core.files import replacing
from pyinfra.core.names import path_of
from pyinfra.core.public import public
from pyinfra.experiments.planner.answer import (
    Answer,
    candidate_table,
    checked_lines,
    option_table,
)
from pyinfra.experiments.planner.areas import crossings_of, read_areas
from pyinfra.experiments.planner.candidates import (
    PoseGrid,
    feasible,
    make_candidates,
    read_candidates,
    with_faults,
)
from pyinfra.experiments.planner.check import check
from pyinfra.experiments.planner.choice import Choice, Units, greedy, most_units, pairs, singles
from pyinfra.experiments.planner.costs import Costs, read_costs
from pyinfra.experiments.planner.detectability import Detectability, read_detectability
from pyinfra.experiments.planner.front import (
    Front,
    front_of,
    front_options,
    goals_of,
    with_columns_of,
)
from pyinfra.experiments.planner.lidars import PlanLidar, open_lidars
from pyinfra.experiments.planner.predict import predict
from pyinfra.experiments.planner.race import Race, detection_probabilities, race
from pyinfra.experiments.planner.rain import WITH_WEATHER, rain_lines, recall_in_rain
from pyinfra.experiments.planner.ranking import ranked
from pyinfra.experiments.planner.request import Request, checked
from pyinfra.experiments.planner.site import PlanSite, open_site, scene_path

SHOWN = 12  # options in the table, besides the best of each LiDAR


@dataclass(frozen=True, eq=False)
class Plan:
    """The result of a plan.

    Attributes
    ----------
    options : a row for each LiDAR of each option; the chosen option is number 1
    candidates : a row for each pose and LiDAR that was considered
    front : the options that are best for some budget, wanted share, number of poles and LiDARs
    text : the answer in sentences
    """

    site: PlanSite
    request: Request
    options: pd.DataFrame
    candidates: pd.DataFrame
    answer: Answer
    front: Front

    @property
    def text(self) -> str:
        return "\n".join(self.answer.lines)


@public
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
    out: str | os.PathLike[str] | None = None,
    jobs: int = 1,
    progress: Callable[[str], None] | None = None,
) -> Plan:
    """Chooses poles, heights and LiDARs for a site within a budget.

    Many poses and LiDARs are observed in a few frames, and those that may be the best in more. A
    detector's detectability turns what they see into the share of objects that it finds.

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
    poses : CSV file of poses (x_m, y_m; z_m, yaw_deg, pitch_deg, existing); by default they are
        made along kerbs, medians and walls
    grid : spacing, heights and directions of the poses that are made
    people : weight of a person relative to a vehicle in the choice
    areas : CSV file of areas with other weights, such as crossings (name, x_m, y_m, radius_m;
        weight, class); the answer has the share found in each
    centre_m : x y from which `within_m` is measured; by default the middle of the first junction
    costs : CSV file of costs (item, per, low, high, source); by default that of the package
    years : years of use that the price includes
    preset, seed : preset of the LiDARs, and seed of the traffic
    frames : most frames of a pose
    check_frames : frames in which the best options are simulated in full, with other traffic; 0
        for none
    out : folder for options.csv, front.csv, candidates.csv and answer.txt; an interrupted plan
        resumes there
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
    table_of_costs = read_costs(None if costs is None else path_of(costs, "costs"), years, law)
    site = open_site(scene, frames, preset=preset, seed=seed, centre_m=centre_m)
    units = affordable(open_lidars(lidars, site), table_of_costs, request)
    table = candidates(site, None if poses is None else path_of(poses, "poses"), request, grid)
    free = feasible(table, site)
    run = race(
        site,
        free,
        units,
        possible(free, units),
        request,
        law,
        jobs=jobs,
        folder=None if folder is None else folder / "observations",
        progress=progress or (lambda _: None),
    )
    result = decided(site, request, law, table_of_costs, table, units, run)
    if check_frames:
        result = simulated(result, units, check_frames, progress or (lambda _: None))
    if folder is not None:
        write(result, folder)
    return result


def simulated(
    result: Plan, lidars: Sequence[PlanLidar], frames: int, progress: Callable[[str], None]
) -> Plan:
    """Returns the plan with the measured figures of its best options."""
    request = result.request
    options = check(
        result.site,
        result.options,
        lidars,
        request.detector,
        request.within_m,
        frames=frames,
        progress=progress,
    )
    lines = (*result.answer.lines, *checked_lines(options, request, frames))
    return replace(result, options=options, answer=replace(result.answer, lines=lines))


def affordable(lidars: list[PlanLidar], costs: Costs, request: Request) -> list[PlanLidar]:
    """Returns the LiDARs that the budget can pay for. Raises Error if there is none."""
    prices = [costs.price([lidar], 0, 1).middle for lidar in lidars]
    good = [one for one, price in zip(lidars, prices, strict=True) if price <= request.budget_usd]
    if not good:
        cheapest = int(np.argmin(prices))
        raise Error(
            f"budget_usd: expected {math.ceil(prices[cheapest]):,} or more, the price of "
            f"{lidars[cheapest].name} on an existing mast, got {request.budget_usd:,.0f}"
        )
    return good


def candidates(
    site: PlanSite, file: Path | None, request: Request, grid: PoseGrid | None
) -> pd.DataFrame:
    """Returns the poses of a file, or made ones, with their faults."""
    grid = grid or PoseGrid()
    if file is not None:
        return with_faults(read_candidates(file, site, grid), site)
    return with_faults(make_candidates(site, request.within_m, grid), site)


def possible(poses: pd.DataFrame, lidars: Sequence[PlanLidar]) -> BoolArray:
    """Returns which pairs of pose and LiDAR are observed: (poses, lidars).

    A LiDAR that sees all around needs no second yaw at the same place.
    """
    first = (poses.turn == 0).to_numpy()
    return np.stack([first if lidar.all_around else np.ones_like(first) for lidar in lidars], 1)


def decided(
    site: PlanSite,
    request: Request,
    law: Detectability,
    costs: Costs,
    table: pd.DataFrame,
    lidars: Sequence[PlanLidar],
    run: Race,
) -> Plan:
    """Chooses among the pairs that stayed, and returns the plan."""
    poses = feasible(table, site)
    units = units_of(run, poses, lidars, costs, law, request)
    alone = singles(units, request.budget_usd)
    if not alone:
        best = min(
            (units.price([u]).middle for u in range(len(units.probability))), default=math.nan
        )
        raise Error(
            f"budget_usd: expected {math.ceil(best):,} or more for a pole with a LiDAR, got "
            f"{request.budget_usd:,.0f}; an existing mast costs less"
        )
    options = alone[:SHOWN] + best_of_each_lidar(alone, units)
    if request.units >= 2:
        options += pairs(units, request.budget_usd, request.poles, request.lidars_per_pole)[:SHOWN]
    if min(request.units, most_units(units, request.budget_usd)) > 2:
        more = greedy(units, request.budget_usd, request.poles, request.lidars_per_pole)
        options += [more] if more else []
    goals = goals_of(site, run.objects, law, request)
    masks = {goal.column: goal.counted for goal in goals}
    ordered, others = ranked(
        options,
        front_options(units, goals, request),
        units,
        request,
        lambda one: predict(run, one.units, law, request, masks),
    )
    rows_of_all = option_table([*ordered, *others], run.stayed, poses, lidars, units)
    rows = rows_of_all[rows_of_all.option <= len(ordered)].copy()
    every = candidate_table(table, run.pairs, poses, lidars)
    answer = Answer.of(site, request, law, costs, ordered, rows, every, units)
    if site.preset == WITH_WEATHER:
        choices = [choice for choice, _ in ordered]
        wet = recall_in_rain(site, run.stayed, poses, lidars, choices, law, request)
        answer = replace(answer, lines=(*answer.lines, *rain_lines(wet)))
        shares = pd.Series([100 * one.value for one in wet], index=range(1, len(wet) + 1))
        rows["recall_in_rain"] = shares[rows.option].to_numpy()
    front = front_of([*ordered, *others], rows_of_all, goals, units, run.objects, law, request)
    return Plan(site, request, rows, every, answer, front)


def units_of(
    run: Race,
    poses: pd.DataFrame,
    lidars: Sequence[PlanLidar],
    costs: Costs,
    law: Detectability,
    request: Request,
) -> Units:
    """Returns the pairs that stayed as the units of a choice."""
    stayed = run.stayed
    probability = detection_probabilities(run.seen, len(stayed), run.objects, law, request)
    of_pose = poses.iloc[stayed.pose.to_numpy()]
    place = of_pose.groupby(["x_m", "y_m"], sort=False).ngroup().to_numpy()
    existing = of_pose.existing.to_numpy(bool)
    return Units(
        probability, run.objects.weight, place, existing, [lidars[i] for i in stayed.lidar], costs
    )


def best_of_each_lidar(alone: Sequence[Choice], units: Units) -> list[Choice]:
    """Returns the best option of each LiDAR alone."""
    first: dict[str, Choice] = {}
    for one in alone:
        first.setdefault(units.lidars[one.units[0]].name, one)
    return list(first.values())


def write(result: Plan, folder: Path) -> None:
    """Writes options.csv, front.csv, candidates.csv and answer.txt.

    `existing` is yes or no there, so that rows can be a file of poses.
    """
    folder.mkdir(parents=True, exist_ok=True)
    tables = {
        "options": result.options,
        "front": with_columns_of(result.front.table, result.options),
        "candidates": result.candidates,
    }
    for name, table in tables.items():
        with replacing(folder / f"{name}.csv") as beside:
            words = np.where(table.existing.to_numpy(bool), "yes", "no")
            table.assign(existing=words).to_csv(beside, index=False, float_format="%.6g")
    with replacing(folder / "answer.txt") as beside:
        beside.write_text(result.text + "\n", encoding="utf-8")
