"""Scores that are shares of right boxes: the line of logits that makes them so.

Platt, "Probabilistic outputs for support vector machines", 1999.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import minimize
from scipy.special import expit

from pyinfra.core.arrays import BoolArray, FloatArray
from pyinfra.core.errors import Error

STEADY = 1e-3  # pulls the line to scores as they are, where there are next to no boxes
LEAST = 1e-7  # of a score and of what it lacks to 1


def logit(scores: FloatArray) -> FloatArray:
    """(n,) of scores (n,) in [0, 1]."""
    inside = np.clip(scores, LEAST, 1 - LEAST)
    return np.asarray(np.log(inside / (1 - inside)))


def fit(scores: FloatArray, right: BoolArray) -> tuple[float, float]:
    """a and b of logit -> a logit + b, most likely for boxes with these scores (n,).

    right: (n,) whether each overlaps a vehicle enough. Raises Error without a right and a
    wrong one.
    """
    if right.all() or not right.any():
        raise Error(f"found {right.sum()} right boxes of {len(right)}, allowed some and not all")
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
    """(n,) scores whose logits are the line of what they were."""
    a, b = line
    return np.asarray(expit(a * logit(scores) + b))
