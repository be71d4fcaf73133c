"""Calibration of scores, so that a score is the probability of a true positive.

Logits are transformed linearly (Platt, "Probabilistic outputs for support vector machines", 1999).
"""

import numpy as np
from scipy.optimize import minimize
from scipy.special import expit

from pyinfra.core.arrays import BoolArray, FloatArray
from pyinfra.core.errors import Error

STEADY = 1e-3  # weight of the prior that scores are calibrated already; only matters for few boxes
LEAST = 1e-7  # scores are clipped to the range from LEAST to 1 - LEAST


def logit(scores: FloatArray) -> FloatArray:
    """Returns the logits of scores (n,) in [0, 1]: (n,)."""
    inside = np.clip(scores, LEAST, 1 - LEAST)
    return np.asarray(np.log(inside / (1 - inside)))


def fit(scores: FloatArray, right: BoolArray) -> tuple[float, float]:
    """Returns the maximum-likelihood a and b of logit -> a logit + b.

    scores: (n,) scores of boxes. right: (n,) whether each box is a true positive. Raises Error if
    all values of `right` are equal.
    """
    if right.all() or not right.any():
        raise Error(
            f"expected true and false positives, got {right.sum()} true positives in "
            f"{len(right)} boxes"
        )
    logits = logit(scores)

    def unlikely(line: FloatArray) -> tuple[float, FloatArray]:
        adjusted = line[0] * logits + line[1]
        off = expit(adjusted) - right
        pull = STEADY * (line - [1, 0])
        value = np.logaddexp(0, adjusted).sum() - adjusted[right].sum() + pull @ pull / (2 * STEADY)
        return float(value), np.array([off @ logits, off.sum()]) + pull

    a, b = minimize(unlikely, np.array([1.0, 0.0]), jac=True, method="BFGS").x
    return float(a), float(b)


def calibrated(scores: FloatArray, line: tuple[float, float]) -> FloatArray:
    """Returns calibrated scores (n,); line: a and b of `fit`."""
    a, b = line
    return np.asarray(expit(a * logit(scores) + b))
