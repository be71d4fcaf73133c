"""The paired difference of two evaluations, with its interval."""

from __future__ import annotations

from collections.abc import Sequence

from pyinfra.core.errors import Error
from pyinfra.core.public import public
from pyinfra.metrics.comparison import Bootstrapped, Interval, over_seeds
from pyinfra.metrics.evaluation_result import Evaluation
from pyinfra.metrics.replicates import difference


@public
def compare(
    a: Evaluation | Sequence[Evaluation],
    b: Evaluation | Sequence[Evaluation],
    *,
    ground_truth: str | None = None,
) -> Interval:
    """Returns the paired difference in AP (R1000), the first evaluation less the second.

    Parameters
    ----------
    a, b : two evaluations of the same frames and objects, for instance of two detectors, or of two
        LiDARs in one scene. Two lists of evaluations are also accepted, with one evaluation per
        seed, in the same order
    ground_truth : `captured`, `all`, ...; by default the first that both evaluations have

    Returns
    -------
    value, low, high : the difference and its 95 % interval. For single evaluations the interval is
        a bootstrap over blocks of time. For lists it is Student's t over the seeds' differences.
        The difference is significant if the interval excludes 0.

    Raises
    ------
    Error : for evaluations of different frames, label times or objects, or lists of unequal length

    Examples
    --------
    >>> import pyinfra as pi
    >>> frames = pi.simulate(pi.load_scene("highway"), "helios_16", range(0, 500, 100))
    >>> every = pi.evaluate(frames, frames.labels.assign(score=1.0))
    >>> some = pi.evaluate(frames, frames.labels[::2].assign(score=1.0))
    >>> pi.compare(every, some).value > 0
    True
    """
    for name, value in (("a", a), ("b", b)):
        several = value if isinstance(value, (list, tuple)) else [value]
        for one in several:
            if not isinstance(one, Evaluation):
                raise Error(f"{name}: expected results of evaluate, got {type(one).__name__}")
    if isinstance(a, Evaluation) and isinstance(b, Evaluation):
        return over_seeds([_difference(a, b, ground_truth)])
    if isinstance(a, Evaluation) or isinstance(b, Evaluation):
        raise Error("compare: expected two evaluations or two lists, got one of each")
    if len(a) != len(b) or len(a) < 2:
        raise Error(
            f"compare: expected two lists of equal length, 2 or more, got {len(a)} and {len(b)}"
        )
    pairs = zip(a, b, strict=True)
    return over_seeds([_difference(x, y, ground_truth) for x, y in pairs])


def _difference(a: Evaluation, b: Evaluation, ground_truth: str | None) -> Bootstrapped:
    names = [set(one.ap.ground_truth) for one in (a, b)]
    common = [name for name in a.ap.ground_truth if name in names[1]]
    which = ground_truth or (common[0] if common else "")
    if which not in common:
        raise Error(f"ground_truth: expected one of {', '.join(common)}, got '{which}'")
    rows = []
    for one in (a, b):
        table = one.replicates[
            (one.replicates.ground_truth == which) & (one.replicates.measure == "ap_r1000")
        ]
        rows.append(table.iloc[0])
    try:
        return difference(*rows)
    except ValueError as error:
        raise Error(f"compare: {error}") from None
