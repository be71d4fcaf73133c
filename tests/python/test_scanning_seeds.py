"""The claims about scanning over several traffic seeds."""

import math
from functools import partial

import pytest
from scipy import stats

from reproduction.claims.scanning import ABOVE_0, Row, never, verdict
from reproduction.commands import scanning


def row(value: float) -> Row:
    text = "APV of a over b is 1.5 to 2.5; common, 90 to 120 m"
    return Row("far-range", text, value, value, value, partial(verdict, inside=(1.5, 2.5)))


def test_a_claim_over_seeds_has_students_interval_and_its_own_rule() -> None:
    values = (1.8, 2.0, 2.2)
    (over,) = scanning.over_seeds([[row(v)] for v in values])
    half = stats.t.ppf(0.975, 2) * 0.2 / math.sqrt(3)
    assert (over.value, over.low, over.high) == pytest.approx((2.0, 2.0 - half, 2.0 + half))
    assert over.verdict == "holds"
    assert over.statement == "APV of a over b is 1.5 to 2.5; common, 90 to 120 m"


@pytest.mark.parametrize(("found", "expected"), [((), "fails"), ((3,), "undecided")])
def test_a_claim_fails_if_its_case_occurs_with_no_seed(
    found: tuple[int, ...], expected: str
) -> None:
    rule = partial(verdict, inside=ABOVE_0)
    per_seed = [
        Row("only-one", "hit by a alone; view, 90 to 120 m", v, v, v, rule if n in found else never)
        for n, v in enumerate((0.0, -0.1, 0.0, 0.1))
    ]
    (over,) = scanning.over_seeds([[one] for one in per_seed])
    assert over.verdict == expected


def test_one_seed_decides_nothing() -> None:
    (over,) = scanning.over_seeds([[row(2.0)]])
    assert (math.isnan(over.low), over.verdict) == (True, "undecided")


def test_the_step_shares_no_factor_with_the_pattern_of_200_frames() -> None:
    assert math.gcd(int(scanning.FRAMES.split(":")[2]), 200) == 1
