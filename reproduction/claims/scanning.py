"""Tests the paper's claims about scanning with statistics of points on vehicles.

docs/verdict_rules.md, "Claims about scanning", defines the rules. The rules were written
before the first run.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from pyinfra.core.arrays import FloatArray
from pyinfra.core.errors import Error
from pyinfra.dataset.data_set import DataSet, read_data_set
from pyinfra.dataset.frames_version import number_at
from pyinfra.metrics.intervals import Blocks, Estimate, ratio
from pyinfra.metrics.observations import Observations, blocks_of, read_observations
from pyinfra.metrics.scanning_tables import (
    EDGES_M,
    FAR_M,
    aggregation_change,
    alone_and_another,
    decay,
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
COLUMNS = "claim preset statement value low high verdict command seed version frames_version".split(
    " "
)


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


def claims(exact: Observations, blocks: Blocks, instant: Observations | None = None) -> list[Row]:
    """Returns all tested claims for the vehicles of one data set.

    Raises Error if the data set does not have exactly the four LiDARs of the paper.

    Parameters
    ----------
    instant : the same frames with aggregation `instant`; without them `deskew` is not tested
    """
    if sorted(exact.lidars) != sorted((AVIA, *SPINNING)):
        names = ", ".join((AVIA, *SPINNING))
        raise Error(f"expected the LiDARs {names}, got {', '.join(exact.lidars)}")
    common, view = exact.select(exact.common()), exact.select(exact.view())
    rows = [
        far_range(common, blocks, "common"),
        far_range(view, blocks, "view"),
        near_range(common, blocks),
        lines_ratio(common, blocks, LINES_128, LINES_64, (1.6, 2.4)),
        lines_ratio(common, blocks, LINES_64, LINES_16, (3.2, 4.8)),
        gentle(common, blocks),
        only_one(common, blocks, "common"),
        only_one(view, blocks, "view"),
    ]
    if instant is not None:
        rows[6:6] = deskew(instant.select(instant.common()), common, blocks)
    return rows


def far_range(vehicles: Observations, blocks: Blocks, name: str) -> Row:
    """Compares points per far vehicle between the Avia and the best other LiDAR."""
    avia, others = vehicles.column(AVIA), [vehicles.column(x) for x in SPINNING]

    def statistic(sums: FloatArray) -> FloatArray:
        best = sums[..., 0, others, 0].max(axis=-1)
        return ratio(sums[..., 0, avia, 0], best)

    rows, estimate = _span(vehicles, blocks, FAR_SPAN_M, statistic)
    points = rows.points[:, others].sum(axis=0)
    best = SPINNING[int(points.argmax())]
    where = _where(rows, FAR_SPAN_M, name)
    text = f"APV of {AVIA} over the best of the others (here {best}) is 1.5 to 2.5; {where}"
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
    """Compares the smallest decay exponent of the spinning LiDARs with the Avia's exponent."""
    avia, others = vehicles.column(AVIA), [vehicles.column(x) for x in SPINNING]

    def statistic(sums: FloatArray) -> FloatArray:
        exponent, _ = decay_lines(sums)
        return np.asarray(exponent[..., others].min(axis=-1) - exponent[..., avia])

    estimate = blocks.estimate(vehicle_sums(vehicles, blocks, EDGES_M), statistic)
    fits = decay(vehicles, blocks).set_index("lidar").exponent
    exponents = ", ".join(f"{name} {fits[name]:.2f}" for name in (AVIA, *SPINNING))
    where = _where(_within(vehicles, WHOLE_M), WHOLE_M, "common")
    text = f"smallest decay exponent of the others minus that of {AVIA} is above 0 ({exponents})"
    return _row("gentle", f"{text}; {where}", estimate, ABOVE_0)


def deskew(instant: Observations, exact: Observations, blocks: Blocks) -> list[Row]:
    """Tests by how much `instant` changes the points inside boxes of moving vehicles, by LiDAR."""
    if not np.array_equal(np.unique(instant.frame), np.unique(exact.frame)):
        raise Error(
            "instant and exact: expected the same frames in both data sets, got "
            f"{len(np.unique(instant.frame))} and {len(np.unique(exact.frame))} frames that differ"
        )
    change = aggregation_change(_within(instant, WHOLE_M), _within(exact, WHOLE_M), blocks)
    rows = []
    for row in change[change.counted == "points_in_box"].itertuples():
        text = (
            f"points in the box of {row.lidar} change by 5 % or more from instant to exact; "
            f"common, {WHOLE_M[0]:g} to {WHOLE_M[1]:g} m, {row.vehicles} moving vehicles"
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
        f"vehicles hit by {AVIA} alone ({alone.sum()}) minus those hit by another and not by it "
        f"({another.sum()}), per 100, are above 0; {_where(far, FAR_SPAN_M, name)}"
    )
    row = _row("only-one", text, estimate, ABOVE_0)
    if len(far) > 0 and alone.sum() == 0:
        return replace(row, rule=never)
    return row


def claims_table(folders: Sequence[Path]) -> pd.DataFrame:
    """Returns the tested claims of all data sets as a table.

    The columns are COLUMNS. The claim `deskew` compares a data set of aggregation `instant` with
    the `exact` data set of the same scene, preset and seed. Raises Error if that `exact` data set
    is missing, or if a data set has another aggregation.
    """
    data_sets = [read_data_set(folder) for folder in folders]
    command = "python -m reproduction claims " + " ".join(str(folder) for folder in folders)
    instants = {_key(d): d for d in data_sets if d.aggregation == "instant"}
    rows = []
    for data in data_sets:
        if data.aggregation == "instant":
            continue
        if data.aggregation != "exact":
            raise Error(
                f"{data.folder}: aggregation: expected exact or instant, got {data.aggregation}"
            )
        for row in claims_of(data, instants.pop(_key(data), None)):
            origin = {"command": command, "seed": data.seed, "version": data.version}
            origin["frames_version"] = number_at(data.lidar_folder(data.names[0]))
            rows.append({**columns_of(row), "preset": data.preset, **origin})
    for data in instants.values():
        raise Error(
            f"{data.folder}: expected an exact data set of the same scene and preset, got none"
        )
    return pd.DataFrame(rows, columns=COLUMNS)


def columns_of(row: Row) -> dict[str, object]:
    """Returns the columns of a row, with its verdict."""
    names = ("claim", "statement", "value", "low", "high", "verdict")
    return {name: getattr(row, name) for name in names}


def claims_of(data: DataSet, instant: DataSet | None) -> list[Row]:
    twin = read_observations(instant) if instant is not None else None
    vehicles = read_observations(data)
    return claims(vehicles, blocks_of(data, vehicles), twin)


def _key(data: DataSet) -> tuple[str, str, int]:
    return data.scene, data.preset, data.seed


def _apv_ratio(
    claim: str,
    text: str,
    vehicles: Observations,
    blocks: Blocks,
    pair: tuple[str, str],
    span: tuple[float, float],
    inside: tuple[float, float],
) -> Row:
    """Tests the ratio of the mean points per vehicle of two LiDARs; `vehicles` is `common`."""
    above, below = (vehicles.column(name) for name in pair)
    rows, estimate = _span(
        vehicles, blocks, span, lambda s: ratio(s[..., 0, above, 0], s[..., 0, below, 0])
    )
    return _row(claim, f"{text}; {_where(rows, span, 'common')}", estimate, inside)


def _span(
    vehicles: Observations,
    blocks: Blocks,
    span: tuple[float, float],
    statistic: Callable[[FloatArray], FloatArray],
) -> tuple[Observations, Estimate]:
    """Returns the vehicles in a distance span, and the estimate of a statistic of their sums.

    The statistic receives sums of shape (..., 1, number of LiDARs, 4).
    """
    rows = _within(vehicles, span)
    return rows, blocks.estimate(vehicle_sums(rows, blocks, np.array(span)), statistic)


def _within(vehicles: Observations, span: tuple[float, float]) -> Observations:
    return vehicles.select((vehicles.distance >= span[0]) & (vehicles.distance < span[1]))


def _where(rows: Observations, span: tuple[float, float], name: str) -> str:
    """Describes the subset, the distance span, and the number and distances of the vehicles."""
    if len(rows) == 0:
        return f"{name}, {span[0]:g} to {span[1]:g} m, no vehicles"
    return (
        f"{name}, {span[0]:g} to {span[1]:g} m, {len(rows)} vehicles "
        f"at {rows.distance.min():.1f} to {rows.distance.max():.1f} m"
    )


def _row(claim: str, text: str, estimate: Estimate, inside: tuple[float, float]) -> Row:
    value, low, high = float(estimate.value), float(estimate.low), float(estimate.high)
    return Row(claim, text, value, low, high, partial(verdict, inside=inside))
