"""Scores that are shares of right boxes: the line of logits that makes them so.

Platt, "Probabilistic outputs for support vector machines", 1999.
"""

from __future__ import annotations

import numpy as np

from pyinfra.arrays import BoolArray, FloatArray

STEPS = 50  # of Newton; ten are enough
STEADY = 1e-3  # pulls the line to scores as they are, where there are next to no boxes
LEAST = 1e-7  # of a score and of what it lacks to 1


def logit(scores: FloatArray) -> FloatArray:
    """(n,) of scores (n,) in [0, 1]."""
    inside = np.clip(scores, LEAST, 1 - LEAST)
    return np.asarray(np.log(inside / (1 - inside)))


def fit(scores: FloatArray, right: BoolArray) -> tuple[float, float]:
    """a and b of logit -> a logit + b, most likely for boxes with these scores (n,).

    right: (n,) whether each overlaps a vehicle enough. Raises ValueError without a right and a
    wrong one.
    """
    if right.all() or not right.any():
        raise ValueError(
            f"found {right.sum()} right boxes of {len(right)}, allowed some and not all"
        )
    columns = np.stack([logit(scores), np.ones(len(scores))], axis=1)
    line = np.array([1.0, 0.0])
    for _ in range(STEPS):
        share = 1 / (1 + np.exp(-columns @ line))
        slope = columns.T @ (share - right) + STEADY * (line - [1, 0])
        curve = (columns * (share * (1 - share))[:, None]).T @ columns + STEADY * np.eye(2)
        line = line - np.linalg.solve(curve, slope)
    return float(line[0]), float(line[1])


def calibrated(scores: FloatArray, line: tuple[float, float]) -> FloatArray:
    """(n,) as `pyinfra.detectors.network.calibrated` has them."""
    a, b = line
    return np.asarray(1 / (1 + np.exp(-(a * logit(scores) + b))))
