"""Tests the paper's claims about scanning with statistics of points on vehicles.

docs/verdict_rules.md, "Claims about scanning", defines the rules. The rules were written
before the first run.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from pyinfra.core.arrays import FloatArray
from pyinfra.dataset.data_set import DataSet
from pyinfra.metrics.intervals import Blocks, Estimate, ratio
from pyinfra.metrics.observations import Observations, blocks_of, read_observations
from pyinfra.metrics.scanning_tables import (
    EDGES_M,
    FAR_M,
    aggregation_change,
    alone_and_another,
    decay_lines,
    vehicle_sums,
)

AVIA, LINES_16, LINES_64, LINES_128 = "livox_avia", "helios_16", "pandar_64", "ruby_plus"
SPINNING = (LINES_16, LINES_64, LINES_128)
NEAR_M = (30.0, 50.0)
FAR_SPAN_M = (FAR_M, 120.0)
WHOLE_M = (30.0, 120.0)
ABOVE_0 = (float(np.nextafter(0, 1)), np.inf)  # range of all values above 0, without 0 itself
ABOVE_1 = (float(np.nextafter(1, 2)), np.inf)


@dataclass(frozen=True)
class Row:
    """The result of a tested claim: measured value and interval."""

    claim: str
    statement: str
    value: float
    low: float
    high: float
    rule: Callable[[float, float], str]  # maps the ends of an interval to a verdict

    @property
    def verdict(self) -> str:
        return self.rule(self.low, self.high)


def verdict(low: float, high: float, inside: tuple[float, float]) -> str:
    """Returns `holds`, `fails` or `undecided` for an interval and the range that a claim states.

    The verdict is `undecided` if an end of the interval is NaN.
    """
    if low >= inside[0] and high <= inside[1]:
        return "holds"
    if high < inside[0] or low > inside[1]:
        return "fails"
    return "undecided"


def verdict_of_change(low: float, high: float, least: float) -> str:
    """Returns the verdict on the claim that a value changes by at least `least`, up or down."""
    if low >= least or high <= -least:
        return "holds"
    if low > -least and high < least:
        return "fails"
    return "undecided"


def never(_low: float, _high: float) -> str:
    """Returns the verdict on a claim whose case does not occur in a data set."""
    return "fails"


def claims(exact: Observations, instant: Observations, blocks: Blocks) -> list[Row]:
    """Returns all tested claims for the vehicles of one data set, which has the paper's LiDARs.

    exact, instant: observations of the same frames with aggregation `exact` and `instant`
    """
    common, view = exact.select(exact.common()), exact.select(exact.view())
    return [
        far_range(common, blocks, "common"),
        far_range(view, blocks, "view"),
        near_range(common, blocks),
        lines_ratio(common, blocks, LINES_128, LINES_64, (1.6, 2.4)),
        lines_ratio(common, blocks, LINES_64, LINES_16, (3.2, 4.8)),
        gentle(common, blocks),
        *deskew(instant.select(instant.common()), common, blocks),
        only_one(common, blocks, "common"),
        only_one(view, blocks, "view"),
    ]


def far_range(vehicles: Observations, blocks: Blocks, name: str) -> Row:
    """Compares points per far vehicle of the Avia with the most that a spinning LiDAR has."""
    avia, others = vehicles.column(AVIA), [vehicles.column(x) for x in SPINNING]

    def statistic(sums: FloatArray) -> FloatArray:
        best = sums[..., 0, others, 0].max(axis=-1)
        return ratio(sums[..., 0, avia, 0], best)

    estimate = _span(vehicles, blocks, FAR_SPAN_M, statistic)
    where = _where(FAR_SPAN_M, name)
    text = f"APV of {AVIA} over the best of the others is 1.5 to 2.5; {where}"
    return _row("far-range", text, estimate, (1.5, 2.5))


def near_range(vehicles: Observations, blocks: Blocks) -> Row:
    """Compares points per near vehicle between the 128-line LiDAR and the Avia."""
    text = f"APV of {LINES_128} over {AVIA} is above 1"
    return _apv_ratio("near-range", text, vehicles, blocks, (LINES_128, AVIA), NEAR_M, ABOVE_1)


def lines_ratio(
    vehicles: Observations, blocks: Blocks, more: str, less: str, inside: tuple[float, float]
) -> Row:
    """Compares points per vehicle of two LiDARs with different numbers of lines."""
    text = f"APV of {more} over {less} is {inside[0]:g} to {inside[1]:g}"
    return _apv_ratio("ratio", text, vehicles, blocks, (more, less), WHOLE_M, inside)


def gentle(vehicles: Observations, blocks: Blocks) -> Row:
    """Compares how fast points per vehicle fall with distance (decay exponent), by LiDAR.

    The smallest exponent of the spinning LiDARs is compared with the Avia's exponent.
    """
    avia, others = vehicles.column(AVIA), [vehicles.column(x) for x in SPINNING]

    def statistic(sums: FloatArray) -> FloatArray:
        exponent, _ = decay_lines(sums)
        return np.asarray(exponent[..., others].min(axis=-1) - exponent[..., avia])

    estimate = blocks.estimate(vehicle_sums(vehicles, blocks, EDGES_M), statistic)
    text = f"smallest decay exponent of the others minus that of {AVIA} is above 0"
    return _row("gentle", f"{text}; {_where(WHOLE_M, 'common')}", estimate, ABOVE_0)


def deskew(instant: Observations, exact: Observations, blocks: Blocks) -> list[Row]:
    """Tests by how much `instant` changes the points inside boxes of moving vehicles, by LiDAR."""
    change = aggregation_change(_within(instant, WHOLE_M), _within(exact, WHOLE_M), blocks)
    rows = []
    for row in change[change.counted == "points_in_box"].itertuples():
        text = (
            f"points in the box of {row.lidar} change by 5 % or more from instant to exact; "
            f"{_where(WHOLE_M, 'common')}"
        )
        low, high = float(row.ci_low), float(row.ci_high)
        rule = partial(verdict_of_change, least=5)
        rows.append(Row("deskew", text, float(row.change_percent), low, high, rule))
    return rows


def only_one(vehicles: Observations, blocks: Blocks, name: str) -> Row:
    """Compares how many far vehicles per 100 only the Avia hits, and only other LiDARs hit."""
    far = _within(vehicles, FAR_SPAN_M)
    avia = far.column(AVIA)
    alone, another = (flags[:, avia] for flags in alone_and_another(far))
    sums = blocks.sums(far.frame, np.stack([alone - another, np.ones_like(alone)], axis=1))
    estimate = blocks.estimate(sums, lambda s: 100 * ratio(s[..., 0], s[..., 1]))
    text = (
        f"vehicles hit by {AVIA} alone minus those hit by another and not by it, per 100, "
        f"are above 0; {_where(FAR_SPAN_M, name)}"
    )
    row = _row("only-one", text, estimate, ABOVE_0)
    if len(far) > 0 and alone.sum() == 0:
        return replace(row, rule=never)
    return row


def columns_of(row: Row) -> dict[str, object]:
    """Returns the columns of a row, with its verdict."""
    names = ("claim", "statement", "value", "low", "high", "verdict")
    return {name: getattr(row, name) for name in names}


def claims_of(exact: DataSet, instant: DataSet) -> list[Row]:
    vehicles = read_observations(exact)
    return claims(vehicles, read_observations(instant), blocks_of(exact, vehicles))


def _apv_ratio(
    claim: str,
    text: str,
    vehicles: Observations,
    blocks: Blocks,
    pair: tuple[str, str],
    span: tuple[float, float],
    inside: tuple[float, float],
) -> Row:
    """Tests the ratio of the mean points per vehicle of two LiDARs, for the subset `common`."""
    above, below = (vehicles.column(name) for name in pair)
    estimate = _span(
        vehicles, blocks, span, lambda s: ratio(s[..., 0, above, 0], s[..., 0, below, 0])
    )
    return _row(claim, f"{text}; {_where(span, 'common')}", estimate, inside)


def _span(
    vehicles: Observations,
    blocks: Blocks,
    span: tuple[float, float],
    statistic: Callable[[FloatArray], FloatArray],
) -> Estimate:
    """Returns the estimate of a statistic of the sums of the vehicles in a distance span.

    The statistic receives sums of shape (..., 1, number of LiDARs, 4).
    """
    rows = _within(vehicles, span)
    return blocks.estimate(vehicle_sums(rows, blocks, np.array(span)), statistic)


def _within(vehicles: Observations, span: tuple[float, float]) -> Observations:
    return vehicles.select((vehicles.distance >= span[0]) & (vehicles.distance < span[1]))


def _where(span: tuple[float, float], name: str) -> str:
    """Describes the subset and the distance span."""
    return f"{name}, {span[0]:g} to {span[1]:g} m"


def _row(claim: str, text: str, estimate: Estimate, inside: tuple[float, float]) -> Row:
    value, low, high = float(estimate.value), float(estimate.low), float(estimate.high)
    return Row(claim, text, value, low, high, partial(verdict, inside=inside))
