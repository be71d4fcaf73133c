"""The public function `plan`: number, models, positions and heights of LiDARs for a site.

Its steps in order: candidates, observe, race, choose, check, answer.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field

import pandas as pd

from pyinfra.core.files import alone, write
from pyinfra.core.names import path_of
from pyinfra.core.present import Presented
from pyinfra.core.progress import show_line
from pyinfra.core.public import public
from pyinfra.core.vocabulary import Preset
from pyinfra.experiments.planner.answer import Answer, answer_of
from pyinfra.experiments.planner.candidates import (
    PoseGrid,
    check_grid,
    feasible,
    make_candidates,
    read_candidates,
    read_poses,
    with_faults,
)
from pyinfra.experiments.planner.check import cheaper_line, check, parts_of
from pyinfra.experiments.planner.costs import (
    PlanLidar,
    affordable,
    common_period_s,
    lowest_prices,
    open_lidars,
    possible,
    read_costs,
)
from pyinfra.experiments.planner.detectability import read_detectability
from pyinfra.experiments.planner.front import Front, choose, front_of
from pyinfra.experiments.planner.observe import Setting, check_site
from pyinfra.experiments.planner.race import race
from pyinfra.experiments.planner.request import (
    RANGES,
    Effort,
    Request,
    check_request,
    crossings_of,
    read_areas,
)
from pyinfra.experiments.planner.sensitivity import (
    computed_rows,
    moves_of,
    recall_in_rain,
    sensitivity_table,
    simulated_rows,
)
from pyinfra.experiments.planner.simulate import SEEDS, Counting, count_option
from pyinfra.experiments.planner.site import PlanSite, open_site, scene_path
from pyinfra.experiments.planner.tables import (
    candidate_table,
    keep_request,
    option_table,
    write_tables,
)


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
    lidars: tuple[PlanLidar, ...]  # LiDARs within the budget
    counting: Counting | None = None
    # prices of the LiDARs whose price is above the budget
    above_budget: dict[str, float] = field(default_factory=dict)

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


@public(**RANGES)
def plan(
    scene: str | os.PathLike[str],
    budget_usd: float,
    *,
    find: float = Request.find,
    within_m: float = Request.within_m,
    false_per_minute: float = Request.false_per_minute,
    poles: int = Request.poles,
    lidars_per_pole: int = Request.lidars_per_pole,
    lidars: Sequence[str | os.PathLike[str]] = (),
    detector: str = Request.detector,
    poses: str | os.PathLike[str] | None = None,
    grid: PoseGrid | None = None,
    people: float = Request.people,
    areas: str | os.PathLike[str] | None = None,
    centre_m: tuple[float, float] | None = None,
    costs: str | os.PathLike[str] | None = None,
    years: float = Request.years,
    preset: Preset = Request.preset,
    seed: int | None = None,
    frames: int = Request.frames,
    check_frames: int = Effort.check_frames,
    what_if: bool = False,
    count: float | None = Effort.count,
    out: str | os.PathLike[str] | None = None,
    jobs: int = Effort.jobs,
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
    within_m : distance from the centre of the site within which objects are included
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
    Error : if no pose is free, no LiDAR is within the budget, the region has no traffic, or another
        plan writes to the same folder

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
    law = read_detectability(detector)
    period_s = common_period_s(lidars, preset)
    drawn = (
        crossings_of(scene_path(scene).parent, people)
        if areas is None
        else read_areas(path_of(areas, "areas"))
    )
    request = Request(
        budget_usd, find, within_m, false_per_minute, poles, lidars_per_pole, people, drawn, years,
        detector, preset, frames, period_s=period_s,
    )  # fmt: skip
    folder = None if out is None else path_of(out, "out")
    effort = Effort(
        check_frames, count, jobs, folder and folder / "observations", progress or show_line
    )
    check_request(request, effort, law)
    grid = grid or PoseGrid()
    check_grid(grid)
    priced = read_costs(None if costs is None else path_of(costs, "costs"), years, law, period_s)
    if poses is not None:
        read_poses(path_of(poses, "poses"), scene_path(scene).parent)
    # The seed of the predictions, and the seeds of the simulations.
    further = 1 + min(max(check_frames, count is not None), SEEDS)
    site = open_site(
        scene, frames, preset=preset, seed=seed, centre_m=centre_m, period_s=period_s,
        further_seeds=further,
    )  # fmt: skip
    check_site(site, request, law, check_frames, drawn=areas is not None)

    # Make the candidates: poses and LiDARs.
    asked = open_lidars(lidars, site)
    units = affordable(asked, priced, budget_usd)
    made = (
        make_candidates(site, within_m, grid)
        if poses is None
        else read_candidates(path_of(poses, "poses"), site, grid)
    )
    table = with_faults(made, site)
    setting = Setting(site, request, effort, law, priced, feasible(table, site), units)
    allowed = possible(setting.poses, units, priced, budget_usd)
    with nullcontext() if folder is None else alone(folder):
        if folder is not None:
            keep_request(folder, setting, table)

        # Observe each pair of pose and LiDAR in a few frames, and drop the worse pairs in stages.
        raced = race(setting, allowed)

        # Choose options, and simulate the best ones in full.
        compared, found = check(setting, choose(setting, raced))

        # Vary prices and conditions, and count the passages of the first option.
        parts = parts_of(compared.first, compared, setting)
        moves, in_rain = moves_of(compared, request), recall_in_rain(compared, setting)
        rows = list(computed_rows(compared, moves, in_rain[:1]))
        if what_if and check_frames:
            rows += simulated_rows(compared, setting, parts, found)
        sensitivity = sensitivity_table(rows)
        counting = None if count is None else count_option(site, parts, detector)

        # Make the tables and the answer.
        of_front = option_table(compared, setting, in_rain)
        options = of_front[of_front.option <= compared.listed].copy()
        every = candidate_table(table, raced.pairs, setting.poses, units)
        cheaper = cheaper_line(compared, found, setting)
        answer = answer_of(compared, setting, options, every, moves, sensitivity, counting, cheaper)
        prices = lowest_prices(asked, setting.poses, priced)
        if folder is not None:
            write_tables(folder, options=options, front=of_front, candidates=every)
            write_tables(folder, sensitivity=sensitivity)
            write(folder / "answer.txt", "\n".join(answer.lines) + "\n")
            write(folder / "notes.txt", "\n".join(answer.notes) + "\n")
        return Plan(
            site,
            request,
            options,
            every,
            sensitivity,
            answer,
            front_of(compared, of_front, setting),
            tuple(units),
            counting,
            {name: usd for name, usd in prices.items() if usd > budget_usd},
        )
