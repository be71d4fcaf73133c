"""The public function `plan`: where LiDARs stand, which, how high and how many."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, partial
from pathlib import Path

import numpy as np
import pandas as pd

from pyinfra.core.files import replacing
from pyinfra.core.names import path_of
from pyinfra.core.public import public
from pyinfra.experiments.planner.answer import (
    Answer,
    candidate_table,
    option_table,
)
from pyinfra.experiments.planner.areas import crossings_of, read_areas
from pyinfra.experiments.planner.candidates import (
    PoseGrid,
    checked_grid,
    feasible,
    make_candidates,
    read_candidates,
    with_faults,
)
from pyinfra.experiments.planner.check import check, check_yaw, checked_lines
from pyinfra.experiments.planner.costs import Costs, read_costs
from pyinfra.experiments.planner.decide import decide, few_positions, units_of
from pyinfra.experiments.planner.detectability import Detectability, read_detectability
from pyinfra.experiments.planner.front import (
    Front,
    front_of,
    front_options,
    goals_of,
    masks_of,
    with_columns_of,
    with_objects,
)
from pyinfra.experiments.planner.kept import described, keep_request
from pyinfra.experiments.planner.lidars import PlanLidar, common_period_s, open_lidars
from pyinfra.experiments.planner.predict import Prediction, predict
from pyinfra.experiments.planner.race import Race, race
from pyinfra.experiments.planner.rain import WITH_WEATHER, in_rain, rain_lines
from pyinfra.experiments.planner.refusals import (
    affordable,
    check_settings,
    check_site,
    lowest_prices,
    possible,
)
from pyinfra.experiments.planner.request import Request, checked
from pyinfra.experiments.planner.sensitivity import (
    loss_lines,
    price_lines,
    table_of,
    with_rain,
    with_yaw_errors,
    yaw_lines,
)
from pyinfra.experiments.planner.site import PlanSite, open_site, other_traffic, scene_path
from pyinfra.experiments.planner.unseen import UNSEEN_FRAMES, observed_again


@dataclass(frozen=True, eq=False)
class Plan:
    """The result of a plan.

    Attributes
    ----------
    options : a row for each LiDAR of each option; the chosen option is number 1
    candidates : a row for each pose and LiDAR that was considered
    sensitivity : what is chosen and found with other prices, a lost LiDAR, rain and a yaw error
    front : the options that are best for some budget, wanted share, number of poles and LiDARs
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
    above_budget: dict[str, float] = field(default_factory=dict)  # lowest price of other LiDARs

    @property
    def text(self) -> str:
        return "\n".join(self.answer.lines)


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
    people : weight of a pedestrian relative to a vehicle in the choice
    areas : CSV file of areas with other weights, such as crossings (name, x_m, y_m, radius_m;
        weight, class); the answer has the share found in each
    centre_m : x y from which `within_m` is measured; by default the middle of the first junction
    costs : CSV file of costs (item, per, low, high, source); by default that of the package
    years : years of use that the price includes
    preset, seed : preset of the LiDARs, and seed of the traffic
    frames : most frames of a pose
    check_frames : frames in which the best options are simulated in full, with other traffic; 0
        for none
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
    check_settings(law, request, centre_m, seed, check_frames, jobs)
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
    tell = progress or (lambda _: None)
    run = race(site, free, units, pairs, request, law, jobs=jobs, folder=parts, progress=tell)
    result = decided(site, request, law, table_of_costs, table, units, run, jobs, parts)
    prices = lowest_prices(asked, free, table_of_costs)
    above = {name: usd for name, usd in prices.items() if usd > request.budget_usd}
    result = replace(result, above_budget=above)
    if check_frames:
        result = simulated(result, units, check_frames, tell)
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
    errors = check_yaw(
        result.site, options, lidars, request.detector, request.within_m, frames=frames
    )
    lines = (
        *result.answer.lines,
        *checked_lines(
            options,
            request,
            len(result.site.other_frames(frames)),
            recorded=result.site.recorded,
        ),
        *yaw_lines(errors),
    )
    return replace(
        result,
        options=options,
        sensitivity=with_yaw_errors(result.sensitivity, options, errors),
        answer=replace(result.answer, lines=lines),
    )


def candidates(site: PlanSite, file: Path | None, request: Request, grid: PoseGrid) -> pd.DataFrame:
    """Returns the poses of a file, or made ones, with their faults."""
    if file is not None:
        return with_faults(read_candidates(file, site, grid), site)
    return with_faults(make_candidates(site, request.within_m, grid), site)


def decided(
    site: PlanSite,
    request: Request,
    law: Detectability,
    costs: Costs,
    table: pd.DataFrame,
    lidars: Sequence[PlanLidar],
    run: Race,
    jobs: int = 1,
    folder: Path | None = None,
) -> Plan:
    """Chooses among the pairs that stayed, and returns the plan."""
    poses = feasible(table, site)
    units = units_of(run, poses, lidars, costs, law, request)
    goals = goals_of(site, run.objects, law, request)
    best = front_options(units, goals, request)
    decision = decide(run, units, best, law, request, masks_of(goals))
    options, listed = decision.options, decision.options[: decision.listed]
    changed = [move.choice for move in decision.moves if move.choice is not None]
    frames = min(request.frames, UNSEEN_FRAMES)
    again = partial(
        observed_again,
        stayed=run.stayed,
        poses=poses,
        lidars=lidars,
        request=request,
        jobs=jobs,
        folder=folder,
    )
    unseen = again(other_traffic(site, frames), options=[*options, *changed])

    is_unseen = bool(unseen.objects.near_vehicles.any())
    unseen = unseen if is_unseen else run
    goals = with_objects(goals, site, unseen.objects, law, request)
    masks = masks_of(goals)

    @cache
    def predicted(some: tuple[int, ...]) -> Prediction:
        return predict(unseen, some, law, request, masks)

    shown = [(one, predicted(one.units)) for one in options]
    rows_of_all = option_table(shown, run.stayed, poses, lidars, units, decision.in_choice)
    rows = rows_of_all[rows_of_all.option <= len(listed)].copy()
    every = candidate_table(table, run.pairs, poses, lidars)
    sensitivity = table_of(options, decision.moves, units, predicted)
    moved = [*price_lines(decision.moves, options, units, predicted), *loss_lines(sensitivity)]
    moved += few_positions(poses, request)
    if site.preset == WITH_WEATHER:
        rainy = again(in_rain(site, frames), options=listed)
        wet = [predict(rainy, one.units, law, request) for one in listed]
        if rainy.objects.near_vehicles.any():
            moved += rain_lines([one.recall for one in wet])
            sensitivity = with_rain(sensitivity, listed, wet, units, request.find)
        rows["recall_in_rain"] = 100 * np.array([one.recall.value for one in wet])[rows.option - 1]
    answer = Answer.of(
        site,
        request,
        law,
        costs,
        shown[: len(listed)],
        rows,
        every,
        units,
        moved,
        is_unseen=is_unseen,
    )
    front = front_of(
        shown, decision.in_choice, rows_of_all, goals, units, unseen.objects, law, request
    )
    return Plan(site, request, rows, every, sensitivity, answer, front, tuple(lidars))


def write(result: Plan, folder: Path) -> None:
    """Writes options.csv, front.csv, candidates.csv, sensitivity.csv and answer.txt.

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
    with replacing(folder / "sensitivity.csv") as beside:
        result.sensitivity.to_csv(beside, index=False, float_format="%.6g")
    with replacing(folder / "answer.txt") as beside:
        beside.write_text(result.text + "\n", encoding="utf-8")
