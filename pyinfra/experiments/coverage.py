"""How much road, or how many squares, each experiment of a benchmark covers."""

import math

import numpy as np
import pandas as pd

from pyinfra.dataset.windows import REGION_M, WINDOW_M
from pyinfra.experiments.requirements import Requirements
from pyinfra.experiments.value import KEY, covered
from pyinfra.metrics.evaluation_tables import LANES
from pyinfra.metrics.intervals import FEW_BLOCKS

ROAD, SQUARES = "m of road", f"squares of {WINDOW_M:g} m"


def coverage(
    distance: pd.DataFrame, squares: pd.DataFrame, requirements: Requirements, truth: str
) -> pd.DataFrame:
    """Returns for each experiment how much road, or how many squares, it covers.

    Columns: covered_m with its interval (low_m, high_m); road_m, the length of road or number of
    squares that was evaluated; covered_in, the unit of these columns; no_interval, the reason if
    the interval is missing.
    """
    rows_covered = road(distance, requirements, truth).assign(covered_in=ROAD)
    near = distance[(distance.ground_truth == truth) & (distance.s.abs() <= requirements.range_m)]
    parts = near[near.road != LANES]
    if len(squares) and (distance.road == LANES).any():
        usable = squares[(squares.ground_truth == truth) & squares.ap_r1000.notna()]
        parts = (
            usable
            if requirements.range_m >= REGION_M
            else usable[usable.distance_m <= requirements.range_m]
        )
        counted = parts.assign(
            covered_m=parts.ap_r1000 > requirements.min_ap,
            low_m=parts.ap_r1000_low > requirements.min_ap,
            high_m=parts.ap_r1000_high.fillna(math.inf) > requirements.min_ap,
            road_m=1,
        )
        ends = ["covered_m", "low_m", "high_m", "road_m"]
        sums = counted.groupby(KEY)[ends].sum().astype(np.float64).reset_index()
        rows_covered = (
            rows_covered[KEY]
            .merge(sums, on=KEY, how="left")
            .fillna(dict.fromkeys(ends, 0.0))
            .assign(covered_in=SQUARES)
        )
    known = parts[parts.ap_r1000.notna()]
    counts = known.assign(parts=1, unsure=known.ap_r1000_low.isna())
    counts = counts.groupby(KEY)[["parts", "unsure"]].sum().reset_index()
    rows_covered = rows_covered.merge(counts, on=KEY, how="left").fillna({"parts": 0, "unsure": 0})
    reasons = [no_interval(row, requirements) for _, row in rows_covered.iterrows()]
    rows_covered = rows_covered.assign(no_interval=reasons)
    ends = ["low_m", "high_m"]
    return rows_covered.assign(
        **{end: rows_covered[end].where(rows_covered.no_interval == "") for end in ends}
    )


def no_interval(row: pd.Series, requirements: Requirements) -> str:
    """Returns the reason why the coverage has no valid interval; empty if it has one."""
    part = "window" if row.covered_in == ROAD else "square"
    if row.parts == 0:
        return "no vehicle is within the range"
    if row.low_m > 0 or row.high_m < row.road_m:
        return "" if row.unsure < row.parts else f"no {part} has an interval: {FEW_BLOCKS}"
    if row.unsure == 0:
        return f"no {part} differs significantly from AP {requirements.min_ap:g}"
    return f"{row.unsure:.0f} of {row.parts:.0f} {part}s have no interval: {FEW_BLOCKS}"


def road(distance: pd.DataFrame, requirements: Requirements, truth: str) -> pd.DataFrame:
    """Returns covered_m, the ends of its interval low_m and high_m, and road_m by experiment.

    distance: windows of the experiments of one scene.
    """
    values = {
        "covered_m": distance.ap_r1000,
        "low_m": distance.ap_r1000_low,
        "high_m": distance.ap_r1000_high.fillna(math.inf),
        "road_m": math.inf,
    }
    metres = [
        covered(distance.assign(ap_r1000=ap), requirements.min_ap, requirements.range_m, truth)
        .set_index(KEY)
        .covered_m.rename(name)
        for name, ap in values.items()
    ]
    return pd.concat(metres, axis=1).reset_index()
