"""The paired difference of two evaluations, with its interval."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import pandas as pd

from pyinfra.core.errors import Error
from pyinfra.core.public import public
from pyinfra.core.vocabulary import Subset
from pyinfra.metrics.comparison import Interval
from pyinfra.metrics.evaluation_result import Evaluation
from pyinfra.metrics.matching import threshold_of
from pyinfra.metrics.replicates import difference, over_seeds
from pyinfra.metrics.settings import Settings


@public()
def compare(
    a: Evaluation | Sequence[Evaluation],
    b: Evaluation | Sequence[Evaluation],
    *,
    ground_truth: Subset | None = None,
    by: Literal["distance"] | None = None,
) -> Interval | pd.DataFrame:
    """Returns the paired difference in AP (R1000): AP of `a` minus AP of `b`.

    Parameters
    ----------
    a, b : two evaluations of the same frames and objects, for instance of two detectors, or of two
        LiDARs in one scene. Two lists of evaluations are also accepted, with one evaluation per
        seed of the traffic or of the training. The seeds must have the same order in both lists
    ground_truth : name of a ground-truth subset, such as `captured`; by default the first subset
        that both evaluations have
    by : `distance` for the difference in each ring of 20 m around the sensor

    Returns
    -------
    With `by`, a table with the columns distance_m (middle of the ring), value, low, high and
    significant; rings that one of the evaluations lacks are left out. Otherwise an `Interval`:

    value, low, high : the difference and its 95 % interval. For two single evaluations the interval
        comes from a bootstrap over blocks of time, and so does that of two lists in which all seeds
        have the same vehicles and frames. Otherwise, for two lists it is Student's t interval over
        the different traffic. The difference is significant if the interval excludes 0.

    Raises
    ------
    Error : for evaluations of different frames, label times, objects or settings, or lists of
        unequal length

    Examples
    --------
    >>> import pyinfra as pi
    >>> frames = pi.simulate(pi.load_scene("highway"), "helios_16", range(0, 500, 100))
    >>> all_boxes = pi.evaluate(frames, frames.labels.assign(score=1.0))
    >>> half_of_boxes = pi.evaluate(frames, frames.labels[::2].assign(score=1.0))
    >>> pi.compare(all_boxes, half_of_boxes).value > 0
    True
    >>> pi.compare(all_boxes, half_of_boxes, by="distance").distance_m.tolist()[:2]
    [10.0, 30.0]
    """
    pairs = _pairs(a, b)
    chosen = [_rows(x, y, ground_truth) for x, y in pairs]
    if len({repr([row.tolist() for row in rows]) for rows in chosen}) < len(chosen):
        raise Error(
            "compare: expected a different seed in each pair, got the same two results twice"
        )
    firsts = [first for first, _ in chosen]
    try:
        overall = over_seeds([difference(*rows) for rows in chosen], firsts)
    except ValueError as error:
        raise Error(f"compare: {error}") from None
    return overall if by is None else _by_distance(pairs, firsts)


def _pairs(
    a: Evaluation | Sequence[Evaluation], b: Evaluation | Sequence[Evaluation]
) -> list[tuple[Evaluation, Evaluation]]:
    if isinstance(a, Evaluation) and isinstance(b, Evaluation):
        return [(a, b)]
    if isinstance(a, Evaluation) or isinstance(b, Evaluation):
        raise Error("compare: expected two evaluations or two lists, got an evaluation and a list")
    if len(a) != len(b) or len(a) < 2:
        raise Error(
            f"compare: expected two lists of equal length, 2 or more, got {len(a)} and {len(b)}"
        )
    return list(zip(a, b, strict=True))


def _by_distance(
    pairs: Sequence[tuple[Evaluation, Evaluation]], firsts: Sequence[pd.Series]
) -> pd.DataFrame:
    """Returns the difference in AP (R1000) for each ring. firsts: each pair's first AP row."""
    subset = str(firsts[0].ground_truth)
    rings = [(x.rings(subset), y.rings(subset)) for x, y in pairs]
    common = [ring for ring in rings[0][0] if all(ring in one for pair in rings for one in pair)]
    rows = []
    for ring in common:
        figure = over_seeds([x[ring].less(y[ring]) for x, y in rings], firsts)
        rows.append({"distance_m": ring, **vars(figure), "significant": figure.is_significant})
    return pd.DataFrame(rows, columns=["distance_m", "value", "low", "high", "significant"])


def _rows(a: Evaluation, b: Evaluation, ground_truth: str | None) -> tuple[pd.Series, pd.Series]:
    """Returns the AP rows of both evaluations for a subset. Raises Error if the settings differ."""
    common = [name for name in a.ap.ground_truth if name in set(b.ap.ground_truth)]
    subset = ground_truth or (common[0] if common else "")
    if subset not in common:
        raise Error(
            f"ground_truth: expected one of {', '.join(common)}, got '{subset}'; evaluate with it "
            "in `Settings.ground_truths`"
        )
    second = _measured(b, subset)
    for name, value in _measured(a, subset).items():
        if value != second[name]:
            raise Error(
                f"compare: {name}: expected the same value in both, got {value} and {second[name]}"
            )
    first, other = (
        table[(table.ground_truth == subset) & (table.measure == "ap_r1000")].iloc[0]
        for table in (a.replicates, b.replicates)
    )
    return first, other


def _measured(evaluation: Evaluation, subset: str) -> dict[str, object]:
    """Returns the settings that define the AP of an evaluation."""
    settings = evaluation.settings or Settings()
    metric = settings.metrics[0]
    return {
        "classes": sorted(next(iter(settings.classes.values()))),
        "metrics": metric,
        "ious": threshold_of(metric, settings.ious[0]),
        "min_points": settings.min_points if subset == "captured" else None,
        "min_score": settings.min_score,
    }
