"""The paired difference of two evaluations, with its interval."""

from __future__ import annotations

from collections.abc import Sequence

from pyinfra.core.errors import Error
from pyinfra.core.public import public
from pyinfra.metrics.comparison import Bootstrapped, Interval, over_seeds
from pyinfra.metrics.evaluation_result import Evaluation
from pyinfra.metrics.matching import threshold_of
from pyinfra.metrics.replicates import difference
from pyinfra.metrics.settings import Settings


@public
def compare(
    a: Evaluation | Sequence[Evaluation],
    b: Evaluation | Sequence[Evaluation],
    *,
    ground_truth: str | None = None,
) -> Interval:
    """Returns the paired difference in AP (R1000): AP of `a` less AP of `b`.

    Parameters
    ----------
    a, b : two evaluations of the same frames and objects, for instance of two detectors, or of two
        LiDARs in one scene. Two lists of evaluations are also accepted, with one evaluation per
        seed. The seeds must have the same order in both lists
    ground_truth : name of a ground-truth subset, such as `captured`; by default the first subset
        that both evaluations have

    Returns
    -------
    value, low, high : the difference and its 95 % interval. For two single evaluations the interval
        comes from a bootstrap over blocks of time. For two lists it is Student's t interval of the
        seeds' differences. The difference is significant if the interval excludes 0.

    Raises
    ------
    Error : for evaluations of different frames, label times, objects, thresholds or metrics, or
        lists of unequal length

    Examples
    --------
    >>> import pyinfra as pi
    >>> frames = pi.simulate(pi.load_scene("highway"), "helios_16", range(0, 500, 100))
    >>> all_boxes = pi.evaluate(frames, frames.labels.assign(score=1.0))
    >>> half_of_boxes = pi.evaluate(frames, frames.labels[::2].assign(score=1.0))
    >>> pi.compare(all_boxes, half_of_boxes).value > 0
    True
    """
    for name, value in (("a", a), ("b", b)):
        evaluations = value if isinstance(value, (list, tuple)) else [value]
        for evaluation in evaluations:
            if not isinstance(evaluation, Evaluation):
                raise Error(
                    f"{name}: expected results of evaluate, got {type(evaluation).__name__}"
                )
    if isinstance(a, Evaluation) and isinstance(b, Evaluation):
        return over_seeds([_difference(a, b, ground_truth)])
    if isinstance(a, Evaluation) or isinstance(b, Evaluation):
        raise Error("compare: expected two evaluations or two lists, got one of each")
    if len(a) != len(b) or len(a) < 2:
        raise Error(
            f"compare: expected two lists of equal length, 2 or more, got {len(a)} and {len(b)}"
        )
    pairs = list(zip(a, b, strict=True))
    if len({(id(x), id(y)) for x, y in pairs}) < len(pairs):
        raise Error("compare: expected another seed in each pair, got the same two results twice")
    return over_seeds([_difference(x, y, ground_truth) for x, y in pairs])


def _difference(a: Evaluation, b: Evaluation, ground_truth: str | None) -> Bootstrapped:
    names = [set(evaluation.ap.ground_truth) for evaluation in (a, b)]
    common = [name for name in a.ap.ground_truth if name in names[1]]
    subset = ground_truth or (common[0] if common else "")
    if subset not in common:
        raise Error(f"ground_truth: expected one of {', '.join(common)}, got '{subset}'")
    second = _measured(b, subset)
    for name, value in _measured(a, subset).items():
        if value != second[name]:
            raise Error(
                f"compare: {name}: expected the same in both, got {value} and {second[name]}"
            )
    rows = []
    for evaluation in (a, b):
        table = evaluation.replicates[
            (evaluation.replicates.ground_truth == subset)
            & (evaluation.replicates.measure == "ap_r1000")
        ]
        rows.append(table.iloc[0])
    try:
        return difference(*rows)
    except ValueError as error:
        raise Error(f"compare: {error}") from None


def _measured(evaluation: Evaluation, subset: str) -> dict[str, object]:
    """Returns the settings that define the AP of an evaluation."""
    settings = evaluation.settings or Settings()
    metric = settings.metrics[0]
    return {
        "classes": sorted(next(iter(settings.classes.values()))),
        "metrics": metric,
        "ious": threshold_of(metric, settings.ious[0]),
        "min_points": settings.min_points if subset == "captured" else None,
    }
