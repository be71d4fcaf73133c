"""Decides the claims of docs/verdict_rules.md from a table of experiments.

A claim's value in a replicate is the mean over the replicate's test seeds. The interval is
Student's t interval over replicates. Its confidence level is 1 - 0.05 / 3, because a claim can be
tested three times: after 3, 5 and 10 replicates. Replicates that lack a LiDAR, or a detector if
detectors are compared, are left out, and so are replicates after the tenth. A claim that is
undecided after ten replicates is `not known`.

Two detectors are trained for each LiDAR (column `primary`). The rows with training `both` have the
combined verdict of both detectors. The command writes results/claims.csv, and prints for which
claims further replicates may lead to a verdict:

    python -m reproduction verdicts results/experiments.csv --out results/claims.csv
"""

import math
import sys
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from pyinfra.core.arrays import FloatArray
from pyinfra.core.errors import Error
from pyinfra.experiments import store
from pyinfra.metrics.comparison import over_replicates
from reproduction import provenance
from reproduction.arguments import Out, command
from reproduction.claims.two_detectors import (
    CHEAPER,
    FAILS_ABOVE,
    FAILS_BELOW,
    HOLDS,
    NOT_KNOWN,
    PRIMARY,
    TOO_FEW,
    UNDECIDED,
    of_both,
    undecided,
)
from reproduction.commands.experiments import TEXT, at_own_cut_angle
from reproduction.frames_number import number_of
from reproduction.tables.common import results

TESTS_AFTER = (3, 5, 10)  # numbers of replicates after which a claim is tested
LEVEL = 1 - 0.05 / len(TESTS_AFTER)  # confidence level of each test
LEAST_REPLICATES = TESTS_AFTER[0]
LEVEL_AP = 80.0  # the AP that the claim `value` requires
WIDE, MIDDLE = "ruby_plus", "pandar_64"
SPINNING = [WIDE, MIDDLE, "helios_16"]
PAIR = ("avia", WIDE)
MEASURES = ["ap_r1000", "ap_r1000_near", "ap_r1000_far", "p_hqda"]
GROUP = ["scene", "preset", "training", "detector", "label_time", "law_exponent", "subset"]
OF_DETECTORS = [name if name != "detector" else "lidar" for name in GROUP]  # grouping by LiDAR
NETWORKS = ("pointpillars", "pv-rcnn", "dsvt")  # networks of the study without PointRCNN

Values = Callable[[pd.DataFrame], pd.Series]


@dataclass(frozen=True)
class Claim:
    """A claim: its value in each replicate, and the range in which it holds."""

    name: str
    values: Values  # maps measures by replicate and name to the value of each replicate
    subsets: tuple[str, ...]
    low: float  # the claim holds if its interval lies between low and high
    high: float
    precision: float
    names: tuple[str, ...] = ("avia", *SPINNING)  # LiDARs or detectors that `values` needs


def less(column: str, a: str, b: str) -> Values:
    """Returns a function that computes the measure of LiDAR a minus that of LiDAR b."""
    return lambda rows: rows[column][a] - rows[column][b]


def gentle(rows: pd.DataFrame) -> pd.Series:
    """Returns, by replicate, how much less AP the Avia loses with distance than another LiDAR.

    The loss is the AP within 60 m minus the AP beyond 60 m. The other LiDAR is the spinning LiDAR
    with the highest AP in the replicate.
    """
    loss = rows.ap_r1000_far - rows.ap_r1000_near
    best = rows.ap_r1000[SPINNING].idxmax(axis=1)
    return loss["avia"] - pd.Series({r: loss[name][r] for r, name in best.items()})


def above_level(rows: pd.DataFrame, lidar: str = "avia") -> pd.Series:
    return rows.ap_r1000[lidar] - LEVEL_AP


def cheaper(lidars: Collection[str]) -> list[str]:
    """Returns the spinning LiDARs that cost less than the Avia, or the bundle, among `lidars`."""
    table = results("lidars").drop_duplicates("lidar").set_index("lidar")
    prices = table.price_high_usd[list(lidars)]
    (avia,) = (price for lidar, price in prices.items() if "avia" in str(lidar))
    return [lidar for lidar in SPINNING if prices[lidar] < avia]


CLAIMS = (
    Claim("comparable", less("ap_r1000", *PAIR), ("captured", "common"), -3, 3, 1.5, PAIR),
    Claim("64-below", less("ap_r1000", MIDDLE, "avia"), ("captured",), -math.inf, 0, 1.5),
    Claim("gentle", gentle, ("captured",), 0, math.inf, 3),
    Claim("areas", less("p_hqda", *PAIR), ("captured",), 0, math.inf, 5, PAIR),
    Claim("value", above_level, ("present",), 0, math.inf, 1.5),
)


def spread(rows: pd.DataFrame) -> pd.Series:
    """Returns the highest AP of NETWORKS minus the lowest, by replicate."""
    aps = rows.ap_r1000[list(NETWORKS)]
    return aps.max(axis=1) - aps.min(axis=1)


def above_dsvt(rows: pd.DataFrame) -> pd.Series:
    """Returns the lower AP of PointPillars and PV-RCNN minus that of DSVT, by replicate."""
    return rows.ap_r1000[["pointpillars", "pv-rcnn"]].min(axis=1) - rows.ap_r1000["dsvt"]


def above_pointrcnn(rows: pd.DataFrame) -> pd.Series:
    """Returns the highest AP of NETWORKS minus that of PointRCNN, by replicate."""
    return rows.ap_r1000[list(NETWORKS)].max(axis=1) - rows.ap_r1000["pointrcnn"]


def _of_detectors(name: str, values: Values, low: float, high: float, *more: str) -> Claim:
    return Claim(name, values, ("captured",), low, high, 1.5, (*NETWORKS, *more))


CLAIMS_OF_DETECTORS = (
    _of_detectors("similar", spread, -math.inf, 5),
    _of_detectors("algorithms, dsvt", above_dsvt, 0, math.inf),
    _of_detectors("algorithms, pointrcnn", above_pointrcnn, 20, math.inf, "pointrcnn"),
)


def interval(values: FloatArray) -> tuple[float, float]:
    """Returns the ends of Student's t interval of the mean.

    The ends are NaN for fewer than LEAST_REPLICATES values.
    """
    if len(values) < LEAST_REPLICATES:
        return math.nan, math.nan
    mean = over_replicates(values.tolist(), LEVEL)
    return mean.low, mean.high


def verdict(claim: Claim, low: float, high: float, replicates: int = LEAST_REPLICATES) -> str:
    if math.isnan(low):
        return TOO_FEW
    if claim.low <= low and high <= claim.high:
        return HOLDS
    if low > claim.high:
        return FAILS_ABOVE
    return FAILS_BELOW if high < claim.low else not_decided(replicates)


def not_decided(replicates: int) -> str:
    return NOT_KNOWN if replicates >= TESTS_AFTER[-1] else UNDECIDED


def of_value(avia: str, cheaper_ends: Collection[tuple[float, float]], replicates: int) -> str:
    """Returns the verdict of the claim `value` unless the Avia is below the level.

    The claim fails if a cheaper LiDAR reaches the level, whether the Avia does or not. It holds
    only if the whole interval of each cheaper LiDAR is below the level.

    Parameters
    ----------
    avia : verdict on the Avia alone: whether it reaches the level
    cheaper_ends : intervals of the cheaper LiDARs' AP minus the level
    """
    if any(low > 0 for low, _ in cheaper_ends):
        return CHEAPER
    if avia != HOLDS:
        return avia
    return HOLDS if all(high < 0 for _, high in cheaper_ends) else not_decided(replicates)


def check_pairs(table: pd.DataFrame) -> None:
    """Raises Error if the LiDARs of one replicate differ in software version, frames or seeds.

    Each LiDAR must have one row for each test seed of the replicate.
    """
    for key, rows in table.groupby([*GROUP, "replicate"], sort=False):
        case = " ".join(map(str, key))
        for column in {"version", "frames", "frames_version"} & set(rows):
            if rows[column].nunique() > 1:
                pairs = zip(rows.lidar, rows[column], strict=True)
                values = ", ".join(dict.fromkeys(f"{lidar} {value}" for lidar, value in pairs))
                raise Error(f"{case}: {column}: expected one value for all LiDARs, got {values}")
        counts = rows.groupby(["lidar", "seed"]).size().unstack(fill_value=0).stack()
        for (lidar, seed), count in counts[counts != 1].items():
            raise Error(f"{case}: {lidar}: expected one row with seed {seed}, got {count} rows")


def missing(table: pd.DataFrame) -> Iterator[str]:
    """Yields a text for each LiDAR that lacks replicates which other LiDARs have."""
    for key, rows in table.groupby([name for name in GROUP if name != "subset"], sort=False):
        wanted = set(rows.replicate)
        for lidar, part in rows.groupby("lidar", sort=False):
            if lacking := sorted(wanted - set(part.replicate)):
                numbers = ", ".join(map(str, lacking))
                yield f"{' '.join(map(str, key))}: {lidar} has no replicate {numbers}"


def planned(count: int) -> int:
    """Returns how many of `count` replicates are used: a number in TESTS_AFTER, or all if fewer."""
    return max((n for n in TESTS_AFTER if n <= count), default=count)


def means_of(rows: pd.DataFrame, compared: str) -> pd.DataFrame:
    """Returns means over test seeds: a row for each replicate that has all LiDARs or detectors.

    The columns are pairs of a measure and a LiDAR or detector, whose column in `rows` is
    `compared`. A mean is NaN if the value of a seed is NaN.
    """
    by_name = rows.groupby(["replicate", compared])[MEASURES]
    means = by_name.agg(lambda seeds: seeds.mean(skipna=False)).unstack()
    return means[means.ap_r1000.notna().all(axis=1)]


def claims(table: pd.DataFrame) -> Iterator[dict[str, object]]:
    """Yields a row for each claim, scene, preset, training, label time and subset.

    A claim about LiDARs has a row for each detector, and one about detectors has a row for each
    LiDAR. Tests at turned cut angles are left out.
    """
    original = at_own_cut_angle(table)
    table = original.assign(
        lidar=original.lidar.where(~original.lidar.str.contains("avia"), "avia")
    )
    for key, rows in table.groupby(GROUP, sort=False):
        means = means_of(rows, "lidar")
        for claim in CLAIMS:
            if key[-1] not in claim.subsets or not set(claim.names) <= set(rows.lidar):
                continue
            row, values = decided(claim, means)
            avia = str(row["verdict"])
            if claim.name == "value" and avia in (HOLDS, UNDECIDED, NOT_KNOWN):
                rivals = cheaper(set(original.lidar[rows.index]))
                same = means.loc[values.index]
                ends = [interval(above_level(same, name).to_numpy()) for name in rivals]
                row["verdict"] = of_value(avia, ends, len(values))
            group = dict(zip(GROUP, key, strict=True))
            decides = (group["training"], group["detector"]) in PRIMARY
            yield {**row, "primary": decides and group["label_time"] == "scan", **group}
    networks = table[table["training"] == "from scratch"]
    for key, rows in networks.groupby(OF_DETECTORS, sort=False):
        for claim in CLAIMS_OF_DETECTORS:
            if key[-1] in claim.subsets and set(claim.names) <= set(rows.detector):
                row, _ = decided(claim, means_of(rows[rows.detector.isin(claim.names)], "detector"))
                yield {**row, "primary": False, **dict(zip(OF_DETECTORS, key, strict=True))}


def decided(claim: Claim, means: pd.DataFrame) -> tuple[dict[str, object], pd.Series]:
    """Returns a claim's value, interval and verdict, and its value in each replicate used.

    means: measures by replicate.
    """
    values = claim.values(means).dropna()
    values = values[: planned(len(values))]
    low, high = interval(values.to_numpy(np.float64))
    row = {
        "claim": claim.name,
        "replicates": len(values),
        "value": float(values.mean()) if len(values) else math.nan,
        "low": low,
        "high": high,
        "precision": claim.precision,
        "known": high - low <= 2 * claim.precision,
        "verdict": verdict(claim, low, high, len(values)),
    }
    return row, values


@command
def main(experiments: Path, *, out: Out = Path("claims.csv")) -> None:
    """
    Parameters
    ----------
    experiments : table of `reproduction experiments`
    """
    table = store.read(experiments, TEXT)
    check_pairs(at_own_cut_angle(table))
    for line in missing(table):
        print(f"warning: {line}", file=sys.stderr)
    number = number_of(table, str(experiments))
    single = pd.DataFrame(claims(table))
    rows = pd.concat([single, pd.DataFrame(of_both(single))], ignore_index=True)
    rows = rows.assign(**provenance(f"verdicts {experiments}", number))
    first = ["claim", "primary", *GROUP, "lidar"]
    rows = rows.reindex(columns=[*first, *(name for name in rows if name not in first)])
    rows.to_csv(out, index=False, float_format="%.5g")
    print(rows.drop(columns=["version", "machine", "command"]).to_string(index=False))
    for line in undecided(single):
        print(f"further replicates may decide: {line}")
