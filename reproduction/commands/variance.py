"""Estimates how much each choice of an experiment changes AP: its variance components.

The quantities are the AP (R1000) of `captured` of each LiDAR, and the AP of the Avia minus that of
the LiDAR with 128 lines. The components are standard deviations:

- frames: over bootstrap replicates of the frames of one test seed. A difference
  has no such component, because the table has no paired bootstrap replicates.
- seed: between the two test seeds of a replicate, without `frames`
- training: between replicates, without `seed` and `frames`. A replicate has its own training seed
  and training traffic.
- detector, scene, preset, label_time: between the means over replicates, while everything else is
  equal. The options of `detector` are the values of the column `training`. Only replicates that
  all options have are used. The components include the remaining variation of the replicates.

Groups with fewer than three replicates are left out. Of the networks
that are trained from scratch, only PointPillars is used.

Components are averaged as variances over all groups that have them. The estimate of a group can be
negative; a mean below 0 counts as 0. The command writes results/variance.csv:

    python -m reproduction variance results/experiments.csv --out results/variance.csv
"""

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd

from pyinfra.experiments import store
from reproduction import provenance
from reproduction.arguments import Out, command
from reproduction.commands.experiments import TEXT, at_catalogue_law, at_own_cut_angle
from reproduction.commands.verdicts import LEAST_REPLICATES, WIDE
from reproduction.frames_number import number_of

CHOICES = ["training", "scene", "preset", "label_time"]
COLUMNS = ["quantity", "training", "component", "sd", "groups"]
DIFFERENCE = "avia less ruby_plus"


def quantities(table: pd.DataFrame) -> pd.DataFrame:
    """Returns the values of all quantities, one row per test seed.

    The columns are those of CHOICES, replicate, seed, quantity, value and frames_sd.
    """
    rows = at_catalogue_law(at_own_cut_angle(table[table.subset == "captured"]))
    replicates = rows.groupby(CHOICES).replicate.transform("nunique")
    rows = rows[replicates >= LEAST_REPLICATES]
    rows = rows[(rows["training"] != "from scratch") | (rows.detector == "pointpillars")]
    rows = rows.assign(quantity=rows.lidar.where(~rows.lidar.str.contains("avia"), "avia"))
    rows = rows.rename(columns={"ap_r1000": "value", "ap_r1000_frames_sd": "frames_sd"})
    rows = rows[[*CHOICES, "replicate", "seed", "quantity", "value", "frames_sd"]]
    wide = rows.pivot(index=[*CHOICES, "replicate", "seed"], columns="quantity", values="value")
    less = (wide["avia"] - wide[WIDE]).dropna().rename("value").reset_index()
    return pd.concat([rows, less.assign(quantity=DIFFERENCE, frames_sd=math.nan)])


def nested(rows: pd.DataFrame) -> dict[str, float]:
    """Returns the variances within one quantity, training, scene, preset and label time.

    They are estimates without bias, and can therefore be negative.
    """
    by_replicate = rows.groupby("replicate").value
    within = float(by_replicate.var(ddof=1).mean())
    frames = float((rows.frames_sd**2).mean())
    of_replicates = float(by_replicate.mean().var(ddof=1))
    return {
        "frames": frames,
        "seed": within - (0.0 if math.isnan(frames) else frames),
        "training": of_replicates - within / 2,
    }


def components(table: pd.DataFrame) -> Iterator[dict[str, object]]:
    """Yields one row per quantity, training and component; training is `all` for a choice."""
    values = quantities(table)
    for (quantity, setup), rows in values.groupby(["quantity", "training"], sort=False):
        groups = [nested(group) for _, group in rows.groupby(CHOICES)]
        for component in groups[0]:
            yield _row(quantity, setup, component, [group[component] for group in groups])
    for choice in CHOICES:
        others = [name for name in CHOICES if name != choice]
        for quantity, rows in values.groupby("quantity", sort=False):
            variances = [between(group, choice) for _, group in rows.groupby(others)]
            component = "detector" if choice == "training" else choice
            yield _row(quantity, "all", component, variances)


def between(rows: pd.DataFrame, choice: str) -> float:
    """Returns the variance between the means of a choice's options; NaN if there is one option.

    The means are over the replicates that all options have.
    """
    options = rows.pivot(index=["replicate", "seed"], columns=choice, values="value").dropna()
    return float(options.mean().var(ddof=1))


def _row(
    quantity: object, setup: object, component: str, variances: list[float]
) -> dict[str, object]:
    known = [variance for variance in variances if not math.isnan(variance)]
    sd = math.sqrt(max(0.0, float(np.mean(known)))) if known else math.nan
    names = {"quantity": quantity, "training": setup, "component": component}
    return {**names, "sd": sd, "groups": len(known)}


@command
def main(experiments: Path, *, out: Out = Path("variance.csv")) -> None:
    """
    Parameters
    ----------
    experiments : table of `reproduction experiments`
    """
    table = store.read(experiments, TEXT)
    rows = pd.DataFrame(components(table), columns=COLUMNS).dropna(subset="sd")
    number = number_of(table, str(experiments))
    rows.assign(**provenance(f"variance {experiments}", number)).to_csv(
        out, index=False, float_format="%.4g"
    )
    print(rows.to_string(index=False, float_format=lambda sd: f"{sd:.2f}"))
