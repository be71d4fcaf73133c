"""Penalised logistic and Poisson regression by Newton's method."""

from __future__ import annotations

import numpy as np

from pyinfra.core.arrays import FloatArray

STEPS = 60


def fit_logistic(
    x: FloatArray, y: FloatArray, weights: FloatArray | None = None, ridge: float = 1.0
) -> FloatArray:
    """Returns the coefficients (k,) of P(y = 1) = 1 / (1 + exp(-x b)), x (n, k), y (n,) 0 or 1.

    weights: (n,) weight of each row. ridge: penalty of half the squared coefficients, except the
    first, which is the constant.
    """
    weights = np.ones(len(x)) if weights is None else weights
    penalty = ridge * np.eye(x.shape[1])
    penalty[0, 0] = 1e-6
    b = np.zeros(x.shape[1])
    for _ in range(STEPS):
        p = probability(x @ b)
        slope = x.T @ (weights * (y - p)) - penalty @ b
        curvature = (x * (weights * np.maximum(p * (1 - p), 1e-9))[:, None]).T @ x + penalty
        step = np.linalg.solve(curvature, slope)
        largest = float(np.abs(step).max())
        b = b + step * min(1.0, 4 / max(largest, 1e-12))
        if largest < 1e-8:
            break
    return b


def fit_poisson(
    x: FloatArray, counts: FloatArray, weights: FloatArray | None = None, ridge: float = 0.1
) -> FloatArray:
    """Returns the coefficients (k,) of E(count) = exp(x b), x (n, k), counts (n,)."""
    weights = np.ones(len(x)) if weights is None else weights
    penalty = ridge * np.eye(x.shape[1])
    penalty[0, 0] = 1e-6
    b = np.zeros(x.shape[1])
    b[0] = np.log(max(float((weights * counts).sum() / weights.sum()), 1e-6))
    for _ in range(STEPS):
        mean = np.exp(np.clip(x @ b, -30, 30))
        slope = x.T @ (weights * (counts - mean)) - penalty @ b
        curvature = (x * (weights * np.maximum(mean, 1e-9))[:, None]).T @ x + penalty
        step = np.linalg.solve(curvature, slope)
        largest = float(np.abs(step).max())
        b = b + step * min(1.0, 2 / max(largest, 1e-12))
        if largest < 1e-8:
            break
    return b


def probability(score: FloatArray) -> FloatArray:
    """Returns 1 / (1 + exp(-score))."""
    return np.asarray(1 / (1 + np.exp(-np.clip(score, -30, 30))))
