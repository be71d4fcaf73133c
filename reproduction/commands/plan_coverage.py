"""Compares the intervals of plans with measurements of the options in other traffic.

At generated sites that no fit has used, `pyinfra plan` predicts and simulates options of two
LiDARs. Each simulated option is then simulated in further traffic seeds, which stand for an hour
of traffic. For 95 % of the options, the interval should contain the mean over these seeds. The
command adds a row for each option and figure as soon as it is computed. NAME_summary.csv has the
share of intervals that contain the mean, and their half-widths. Run the command again to resume.

The errors at the first ten sites, whose `use` is `calibration`, set the width of the predicted
intervals (`detectability --only-errors`). The summary has the later sites, which test them:

    python -m reproduction plan_coverage --work data/coverage --sites 20 --seeds 10 --frames 30
"""

import math
import warnings
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd

from pyinfra.core.errors import Error
from pyinfra.experiments import store
from pyinfra.experiments.planner.candidates import PoseGrid
from pyinfra.experiments.planner.check import standing
from pyinfra.experiments.planner.costs import open_lidars
from pyinfra.experiments.planner.plan import plan
from pyinfra.experiments.planner.simulate import simulate_option
from pyinfra.experiments.planner.site import frame_order
from pyinfra.experiments.planner.tables import units_at
from pyinfra.metrics.comparison import over_replicates
from reproduction import provenance
from reproduction.arguments import Out, Work, command
from reproduction.detectability.runs import FIRST_CHECK_SITE, scene_file_of

FIRST_SITE = FIRST_CHECK_SITE + 100  # first seed; the check of detectability uses smaller seeds
CALIBRATION_SITES = 10
LIDARS = ("helios_16", "pandar_64", "livox_avia", "ruby_plus", "hesai_xt32", "livox_horizon")
GRID = PoseGrid(every_m=30.0, heights_m=(5.0,), pitches_deg=(0.0, 10.0))
BUDGET_USD, WITHIN_M, PEOPLE = 60_000.0, 60.0, 1.0
FIRST_SEED = 100  # first seed of the further traffic, larger than the seeds of the plan
KEY = ["site", "option", "figure", "source"]


def rows_of(
    number: int, frames: int, check_frames: int, seeds: int, work: Path
) -> Iterator[dict[str, object]]:
    """Yields the rows of a site."""
    site_number = FIRST_SITE + number
    names = [LIDARS[(2 * number + k) % len(LIDARS)] for k in (0, 1)]
    file = scene_file_of(site_number, work)
    result = plan(
        file, BUDGET_USD, within_m=WITHIN_M, people=PEOPLE, lidars=names, grid=GRID, frames=24,
        check_frames=check_frames,
    )  # fmt: skip
    site, request = result.site, result.request
    lidars = open_lidars(names, site)
    traffic = [(FIRST_SEED + k, frame_order(site.every_frame, frames)) for k in range(seeds)]
    for option, rows in result.options[result.options.source == "simulated"].groupby("option"):
        first = rows.iloc[0]
        parts = units_at(result.options, int(option), lidars)
        each = [
            simulate_option(site, parts, request.detector, float(first.score), traffic=[one])
            for one in traffic
        ]
        found = [standing(one, {}, site, request) for one in each]
        figures = {
            "recall": ("recall", "recall_simulated", [100 * one.recall.value for one in found]),
            "people_recall": (
                "people_recall", "people_recall_simulated",
                [100 * one.people.value for one in found],
            ),
            "false_per_frame": (
                "false_per_frame", "false_per_frame_simulated",
                [one.false_per_frame.value for one in found],
            ),
            "ap": ("ap_predicted", "ap_simulated", [one.ap.value for one in found]),
        }  # fmt: skip
        for figure, (before, after, values) in figures.items():
            mean = over_replicates([one for one in values if math.isfinite(one)])
            for source, column in (("predicted", before), ("simulated", after)):
                yield {
                    "site": site_number,
                    "use": "calibration" if number < CALIBRATION_SITES else "test",
                    "option": int(option),
                    "figure": figure,
                    "source": source,
                    "lidar": " + ".join(rows.lidar),
                    "value": first[column],
                    "low": first[f"{column}_low"],
                    "high": first[f"{column}_high"],
                    "mean": mean.value,
                    "mean_low": mean.low,
                    "mean_high": mean.high,
                    "seeds": len(values),
                }


def summary(table: pd.DataFrame) -> pd.DataFrame:
    """Returns how many intervals of plans contain the mean of other traffic, and their widths.

    `agree_percent` allows for the uncertainty of the mean: the share of differences that are at
    most the root of the sum of the squared half-widths of both intervals.
    """
    known = table[table.use == "test"].dropna(subset=["low", "high", "mean"])
    groups = {("all",): known} | {(name,): part for name, part in known.groupby("lidar")}
    rows = []
    for (lidar,), part in groups.items():
        for (figure, source), some in part.groupby(["figure", "source"]):
            inside = (some.low <= some["mean"]) & (some["mean"] <= some.high)
            halves = (some.high - some.low) / 2, (some.mean_high - some.mean_low) / 2
            agree = (some.value - some["mean"]).abs() <= np.hypot(*halves)
            rows.append(
                {
                    "lidar": lidar,
                    "figure": figure,
                    "source": source,
                    "options": len(some),
                    "inside_percent": 100 * inside.mean(),
                    "agree_percent": 100 * agree.mean(),
                    "mean_half_width": halves[1].mean(),
                    "half_width": (some.high - some.low).mean() / 2,
                    "bias": (some.value - some["mean"]).mean(),
                }
            )
    return pd.DataFrame(rows)


@command
def main(
    *,
    work: Work,
    sites: int = 20,
    seeds: int = 10,
    frames: int = 30,
    check_frames: int = 30,
    out: Out = Path("plan_coverage.csv"),
) -> None:
    """
    Parameters
    ----------
    work : folder for sites
    sites : number of sites; default: 20
    seeds : number of further traffic seeds; default: 10
    frames : number of frames of a seed; default: 30
    check_frames : number of frames of the plan's simulation; default: 30
    """
    warnings.simplefilter("ignore")
    sizes = f"--sites {sites} --seeds {seeds} --frames {frames}"
    made_by = provenance(f"plan_coverage {sizes} --check-frames {check_frames}")
    text = ["use", "figure", "source", "lidar"]
    for number in range(sites):
        known = store.read(out, text)
        if not known.empty and (known.site == FIRST_SITE + number).any():
            continue
        try:
            rows = list(rows_of(number, frames, check_frames, seeds, work))
        except Error as error:  # the site has no traffic in the region, or no free pose
            print(f"site {FIRST_SITE + number}: left out: {error}", flush=True)
            continue
        store.put(out, pd.DataFrame(rows).assign(**made_by), KEY)
        print(f"site {FIRST_SITE + number}: {len(rows)} rows", flush=True)
    table = summary(store.read(out, text))
    table.assign(**made_by).to_csv(
        out.with_name(f"{out.stem}_summary.csv"), index=False, float_format="%.4g"
    )
    print(table.round(1).to_string(index=False))
