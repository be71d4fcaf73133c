"""Makes the three findings of README, each with its measurement conditions."""

from __future__ import annotations

import pandas as pd

from pyinfra.core.vocabulary import PRESETS
from reproduction.tables.common import markdown, number, results
from reproduction.tables.findings import rows_of

YAW_DEG = 0.25
WORDS = {2: "two", 3: "three"}


def findings() -> str:
    return markdown(["finding", "measured on"], [far_points(), wrong_yaw(), several_poles()])


def far_points() -> list[str]:
    """Returns the row about points on far vehicles.

    The row has the ratio of the Avia to the best other LiDAR under each of three presets.
    """
    table = results("scanning_claims")
    paper, equal, datasheet = (
        number(rows_of(table, "far-range", " common,", preset=preset).value.item())
        for preset in PRESETS
    )
    finding = (
        f"On far vehicles the Livox Avia has {paper} times the points of the best other LiDAR "
        f"under [the study's settings](docs/first_steps.md#presets), {equal} times at equal range, "
        f"{datasheet} times by data sheets."
    )
    where = (
        "[highway](docs/results/points.md), beyond 90 m, within range of all LiDARs; "
        "one traffic seed"
    )
    return [finding, where]


def wrong_yaw() -> list[str]:
    """Returns the row about a small yaw error.

    The row has the smallest and the largest loss of AP over detectors and LiDARs.
    """
    table = results("stress_generalist")
    turned = table[(table.stressor == "yaw_error") & (table.severity == f"{YAW_DEG:g}")]
    before = table[table.stressor == "none"].set_index("run").ap_r1000
    costs = before - turned.set_index("run").ap_r1000
    detectors = turned.run.str.rsplit("_", n=1).str[-1].nunique()
    finding = (
        f"An unknown yaw error of {YAW_DEG:g} degrees costs a detector {costs.min():.0f} to "
        f"{costs.max():.0f} AP (average precision, in percent)."
    )
    where = (
        f"[highway](docs/results/failures.md), {WORDS[detectors]} detectors, "
        f"{WORDS[turned.lidar.nunique()]} LiDARs; one seed and training, no intervals"
    )
    return [finding, where]


def several_poles() -> list[str]:
    """Returns the row about the AP of 16-line LiDARs on one pole and on four poles."""
    table = results("poles")
    keep = (table.lidar == "helios_16") & (table.arm == "centerpoint-pillar")
    keep &= (table.error == "none") & (table.ground_truth == "all")
    ap: pd.Series[float] = table[keep].set_index("poles").ap_r1000
    one, four = (f"{ap[count]:.0f}" for count in (1, 4))
    finding = f"With 16-line LiDARs on four poles a detector has AP {four}; on one pole, {one}."
    where = "[crossroad](docs/several_poles.md), exact clocks and poses; one seed and training"
    return [finding, where]
