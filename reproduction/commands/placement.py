"""Measures how the pose of a LiDAR changes its AP, at generated sites that no fit has used.

The questions are

- place: by how much does the AP of the pose with the highest predicted AP exceed that of other
  poses of the same LiDAR? The answer is computed from the table of `reproduction detectability`.
- order: does the order of LiDARs depend on the pose? Each of LIDARS is measured at the same poses.
- units: do several LiDARs with 16 lines find more vehicles than one with 128 lines, at an equal
  price that includes the poles? Both are planned within the price of the LiDAR with 128 lines on
  one pole, and then simulated in full with other traffic.

Measurements use traffic that no prediction has used. Runs are stored in --work, and `units` adds
its rows as they are made. Run the command again to resume. It writes NAME.csv for `units`,
NAME_order.csv, and NAME_summary.csv with 95 % intervals over sites.

    python -m reproduction placement results/detectability.csv --work out/detectability \\
        --out results/placement.csv
"""

import warnings
from collections.abc import Sequence
from itertools import combinations, product
from pathlib import Path

import numpy as np
import pandas as pd

from pyinfra.core.errors import Error
from pyinfra.experiments import store as rows_store
from pyinfra.experiments.planner.candidates import POSE, PoseGrid
from pyinfra.experiments.planner.check import standing
from pyinfra.experiments.planner.costs import open_lidars, read_costs
from pyinfra.experiments.planner.detectability import CUT, read_detectability
from pyinfra.experiments.planner.plan import plan
from pyinfra.experiments.planner.simulate import simulate_option
from pyinfra.metrics.comparison import over_replicates
from reproduction import provenance
from reproduction.arguments import Out, Work, command
from reproduction.detectability.runs import (
    CHECK_POSES,
    FIRST_CHECK_SITE,
    Run,
    read,
    scene_file_of,
    site_of,
    store,
)
from reproduction.frames_number import common_number, number_of

DETECTOR = "generalist"
LIDARS = ("ruby_plus", "pandar_64", "livox_avia")
ORDER_SEEDS = (1, 2)
ONE_DIRECTION = ("livox_avia", "livox_horizon")  # LiDARs with a field of view below 360 degrees
WIDE, NARROW = "ruby_plus", "helios_16"
MOST_POLES = 8
YEARS, PLAN_FRAMES = 5.0, 24
GRID = PoseGrid(every_m=20.0, heights_m=(4.0, 6.0, 8.0), pitches_deg=(0.0,))
WITHIN_M = 60.0
KEY = ["site", "lidar", "seed"]


def place_rows(check: pd.DataFrame) -> list[dict[str, object]]:
    """Returns by how much the AP of the chosen pose exceeds that of other poses.

    The difference to the mean over all poses is repeated for each traffic seed and kind of LiDAR.
    """
    table = check[check.detector == DETECTOR]
    name = "chosen pose less mean pose, AP"
    narrow = table.lidar.isin(ONE_DIRECTION)
    parts = {f"{name}: traffic seed {seed}": part for seed, part in table.groupby("seed")}
    parts[f"{name}: LiDARs that see all around"] = table[~narrow]
    parts[f"{name}: LiDARs that look in one direction"] = table[narrow]
    gains = chosen_gains(table)
    return [
        summary_row("place", name, gains.mean_pose),
        summary_row("place", "chosen pose less the scene's own pose, AP", gains.own_pose),
        summary_row("place", "chosen pose less the pose predicted worst, AP", gains.worst_pose),
        *(summary_row("place", key, chosen_gains(part).mean_pose) for key, part in parts.items()),
    ]


def chosen_gains(table: pd.DataFrame) -> pd.DataFrame:
    """Returns the AP of the chosen pose minus that of other poses: a row per site and LiDAR."""
    rows = []
    for _, group in table.groupby(["site", "lidar"]):
        means = group.groupby("pose")[["ap_predicted", "ap_measured"]].mean()
        measured, chosen = means.ap_measured, means.ap_measured[means.ap_predicted.idxmax()]
        rows.append(
            {
                "mean_pose": chosen - measured.mean(),
                "own_pose": chosen - measured[0],
                "worst_pose": chosen - measured[means.ap_predicted.idxmin()],
            }
        )
    return pd.DataFrame(rows, columns=["mean_pose", "own_pose", "worst_pose"])


def order_table(sites: int, frames: int, work: Path) -> pd.DataFrame:
    """Measures each of LIDARS at the same poses; returns a row per site, pose, LiDAR and seed."""
    rows: list[dict[str, object]] = []
    for i in range(sites):
        runs = [
            Run(FIRST_CHECK_SITE + i, pose, lidar, seed)
            for pose, lidar, seed in product(range(CHECK_POSES), LIDARS, ORDER_SEEDS)
        ]
        try:
            for run in runs:
                store(run, frames, work)
        except Error as error:
            print(f"site {FIRST_CHECK_SITE + i}: left out: {error}", flush=True)
            continue
        rows += [
            {
                "site": run.site,
                "pose": run.pose,
                "lidar": run.lidar,
                "seed": run.seed,
                "ap": read(run, work).ap[DETECTOR],
            }
            for run in runs
        ]
    return pd.DataFrame(rows)


def order_rows(table: pd.DataFrame) -> list[dict[str, object]]:
    """Returns how much the difference of two LiDARs varies over the poses of a site."""
    wide = table.pivot(index=["site", "pose", "seed"], columns="lidar", values="ap")
    out = []
    for a, b in combinations(LIDARS, 2):
        less = (wide[a] - wide[b]).unstack("seed")
        noise = less.var(axis=1, ddof=1).groupby("site").mean() / less.shape[1]
        spread = less.mean(axis=1).groupby("site").var(ddof=1)
        variance = (spread - noise).to_numpy()
        mean = less.mean(axis=1).groupby("site").mean()
        name = f"{a} less {b}, AP"
        out += [
            summary_row("order", name, mean),
            summary_row("order", f"{name}: variance over the poses of a site", variance),
            summary_row(
                "order",
                f"{name}: share of poses at which the sign is not that of all poses, percent",
                100 * (np.sign(less.mean(axis=1)) != np.sign(mean.mean())).groupby("site").mean(),
            ),
        ]
    best = wide.groupby(["site", "pose"]).mean().idxmax(axis=1)
    for lidar in LIDARS:
        share = 100 * (best == lidar).groupby("site").mean()
        out.append(
            summary_row("order", f"{lidar}: share of poses at which it is best, percent", share)
        )
    return out


def units_rows(
    site_number: int, frames: int, work: Path, out: Path, made_by: dict[str, object]
) -> None:
    """Plans and measures one WIDE, and several NARROW LiDARs, at a site without rows in `out`."""
    seed = FIRST_CHECK_SITE + site_number
    keys = [{"site": seed, "lidar": lidar, "seed": 1} for lidar in (WIDE, NARROW)]
    if all(rows_store.has_each(rows_store.read(out), keys)):
        return
    file = scene_file_of(seed, work)
    site = site_of(seed, frames, work)
    costs = read_costs(None, YEARS, read_detectability(DETECTOR))
    units = {one.name: one for one in open_lidars([WIDE, NARROW], site)}
    budget = costs.price([units[WIDE]], 1, 1).middle
    rows = []
    for lidar, poles in ((WIDE, 1), (NARROW, MOST_POLES)):
        result = plan(
            file,
            budget,
            within_m=WITHIN_M,
            poles=poles,
            lidars=[lidar],
            grid=GRID,
            years=YEARS,
            frames=PLAN_FRAMES,
            check_frames=0,
        )
        options = result.options.sort_values(["recall", "price_usd"], ascending=[False, True])
        best = options[options.option == options.option.iloc[0]]
        parts = [(row.to_list(), units[lidar].unit) for _, row in best[POSE].iterrows()]
        found = simulate_option(site, parts, DETECTOR, CUT, frames)
        measured = standing(found, {}, site, result.request)
        first = best.iloc[0]
        rows.append(
            {
                "site": seed,
                "lidar": lidar,
                "seed": 1,
                "units": len(best),
                "poles": int(first.poles),
                "price_usd": first.price_usd,
                "budget_usd": budget,
                "recall_predicted": first.recall,
                "recall_measured": 100 * measured.recall.value,
                "ap_predicted": first.ap_predicted,
                "ap_measured": measured.ap.value,
                "false_per_frame": measured.false_per_frame.value,
            }
        )
    table = pd.DataFrame(rows).assign(**made_by)
    rows_store.put(out, table, KEY)
    print(table.iloc[:, :-3].round(1).to_string(index=False, header=site_number == 0), flush=True)


def units_summary(table: pd.DataFrame) -> list[dict[str, object]]:
    """Returns the differences of several LiDARs of 16 lines to one of 128 lines, by quantity."""
    wide = table.pivot(index="site", columns="lidar")
    return [
        summary_row(
            "units", f"{NARROW} less {WIDE}, {name}", wide[column][NARROW] - wide[column][WIDE]
        )
        for column, name in (
            ("recall_measured", "vehicles found within 60 m, percent"),
            ("ap_measured", "AP"),
            ("recall_predicted", "predicted vehicles found within 60 m, percent"),
            ("ap_predicted", "predicted AP"),
            ("units", "number of LiDARs"),
            ("price_usd", "price, USD"),
        )
    ]


def summary_row(
    question: str, quantity: str, values: Sequence[float] | pd.Series
) -> dict[str, object]:
    """Returns the mean over sites with Student's 95 % interval."""
    interval = over_replicates([float(value) for value in values])
    return {
        "question": question,
        "quantity": quantity,
        "sites": len(values),
        "value": interval.value,
        "low": interval.low,
        "high": interval.high,
    }


@command
def main(
    check: Path,
    *,
    work: Work,
    sites: int = 6,
    unit_sites: int = 12,
    frames: int = 30,
    out: Out = Path("placement.csv"),
) -> None:
    """
    Parameters
    ----------
    work : folder of the runs
    check : table of `reproduction detectability`: results/detectability.csv
    sites : number of sites of `order`; default: 6
    unit_sites : number of sites of `units`; default: 12
    frames : number of frames of a run; default: 30
    """
    warnings.simplefilter("ignore")
    words = f"placement {check} --sites {sites} --unit-sites {unit_sites} --frames {frames}"
    made_by = provenance(words)
    checked = pd.read_csv(check)
    numbers = {str(check): number_of(checked, str(check))}
    common_number({**numbers, "the simulator's frames": int(str(made_by["frames_version"]))})
    for number in range(unit_sites):
        try:
            units_rows(number, frames, work, out, made_by)
        except Error as error:
            print(f"site {FIRST_CHECK_SITE + number}: left out: {error}", flush=True)
    order = order_table(sites, frames, work)
    summary = [
        *place_rows(checked),
        *order_rows(order),
        *units_summary(rows_store.read(out)),
    ]
    for suffix, table in (("_order", order), ("_summary", pd.DataFrame(summary))):
        file = out.with_name(f"{out.stem}{suffix}.csv")
        table.assign(**made_by).to_csv(file, index=False, float_format="%.4g")
