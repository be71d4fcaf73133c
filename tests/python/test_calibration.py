"""Calibrated scores equal the share of correct boxes."""

import numpy as np
import pytest

from pyinfra.models.detectors.calibration import calibrated, fit, logit


@pytest.mark.parametrize("line", [(1.0, 0.0), (2.0, -1.5), (0.5, 1.0)])
def test_the_line_of_the_random_boxes_is_fitted(line: tuple[float, float]) -> None:
    draw = np.random.default_rng(3)
    scores = draw.uniform(0.02, 0.98, 40_000)
    right = draw.random(len(scores)) < calibrated(scores, line)
    assert fit(scores, right) == pytest.approx(line, abs=0.06)


def test_scores_are_then_shares_of_right_boxes() -> None:
    draw = np.random.default_rng(4)
    scores = draw.beta(0.7, 0.9, 30_000)
    # the calibration line of logits can't describe this relation exactly
    right = draw.random(len(scores)) < scores**2
    shares = calibrated(scores, fit(scores, right))
    for low in (0.1, 0.3, 0.5, 0.7):
        here = (shares >= low) & (shares < low + 0.2)
        assert shares[here].mean() == pytest.approx(right[here].mean(), abs=0.06)


def test_sure_scores_stay_finite() -> None:
    assert np.isfinite(logit(np.array([0.0, 1.0]))).all()
    with pytest.raises(
        ValueError, match="expected true and false positives, got 2 true positives in 2"
    ):
        fit(np.array([0.2, 0.9]), np.array([True, True]))


def test_a_line_far_from_the_scores_as_they_are_is_fitted() -> None:
    draw = np.random.default_rng(3)
    true = draw.normal(-4, 2, 4000)
    right = draw.random(4000) < 1 / (1 + np.exp(-true))
    a, b = fit(1 / (1 + np.exp(-(true + 9))), right)
    assert a == pytest.approx(1, abs=0.15)
    assert b == pytest.approx(-9, abs=1.2)
