"""Paired differences of bootstrapped figures, and intervals over seeds."""

import numpy as np
import pytest
from benchmark_data import experiments, replicates_of

from pyinfra.metrics.comparison import Bootstrapped, over_replicates
from pyinfra.metrics.replicates import difference, slope


def test_the_replicates_of_a_difference_go_in_pairs() -> None:
    common = np.sin(np.arange(200))
    a, b = Bootstrapped(90, 90 + common, 1e6), Bootstrapped(88, 88 + common, 1e6)
    interval = a.less(b).measured()
    assert (interval.value, interval.low, interval.high) == pytest.approx((2, 2, 2))
    assert interval.is_significant
    assert a.less(Bootstrapped(90, 90 - common, 1e6)).measured().low < -2


def test_figures_without_replicates_do_not_differ() -> None:
    interval = Bootstrapped(90, np.empty(0), 2).less(Bootstrapped(10, np.empty(0), 2)).measured()
    assert not interval.is_known
    assert not interval.is_significant


@pytest.mark.parametrize(
    "column", ["vehicles_digest", "version", "label_time", "block_s", "replicates_seed"]
)
def test_replicates_of_other_blocks_are_not_compared(column: str) -> None:
    rows = replicates_of(experiments(), "ap", 1)
    other = rows.iloc[1].copy()
    other[column] = "another"
    with pytest.raises(ValueError, match=f"{column}: expected the same .*, got .* and another"):
        difference(rows.iloc[0], other)


def test_a_figure_over_seeds_has_students_interval() -> None:
    interval = over_replicates([1.0, 2.0, 3.0])
    assert interval.value == 2
    assert interval.high - interval.value == pytest.approx(4.3027 / 3**0.5, rel=1e-3)
    assert not over_replicates([1.0]).is_known


def test_a_straight_line_has_its_slope_in_every_replicate() -> None:
    s = np.arange(0.0, 60, 10)
    aps = 90 + np.outer(np.arange(6), [-2.0, -1.0, -3.0])
    aps[1, 1] = np.nan
    assert slope(s, aps) == pytest.approx([-2, -1, -3])
    aps[2, 1] = np.nan
    assert np.isnan(slope(s, aps)).tolist() == [False, True, False]
