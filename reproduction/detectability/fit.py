"""Fits the laws of detectability, by Newton's method with a penalty of the coefficients."""

from collections.abc import Callable

import numpy as np

from pyinfra.core.arrays import BoolArray, FloatArray
from pyinfra.experiments.planner.detectability import (
    CUTS,
    ap_of_counts,
    detection_probability,
    false_per_frame,
    false_terms,
    with_score,
)

STEPS = 60


def fit_detection(
    terms: FloatArray, best_score: FloatArray, weights: FloatArray | None = None
) -> FloatArray:
    """Fits the law of the probability that an object is found; returns its coefficients.

    best_score: (n,) score of the match, 0 for a missed object
    """
    cuts = CUTS[1::2]
    x = np.concatenate([with_score(terms, cut) for cut in cuts])
    y = np.concatenate([(best_score >= cut).astype(float) for cut in cuts])
    every = np.ones(len(terms)) if weights is None else weights

    def logistic(score: FloatArray) -> tuple[FloatArray, FloatArray]:
        p = 1 / (1 + np.exp(-np.clip(score, -30, 30)))
        return p, p * (1 - p)

    start = np.zeros(x.shape[1])
    return newton(x, y, np.tile(every, len(cuts)) / len(cuts), logistic, start, 1.0, 4)


def fit_false(
    counts: FloatArray, seen: FloatArray, spinning: BoolArray, weights: FloatArray | None = None
) -> FloatArray:
    """Fits the law of the number of false boxes; returns its coefficients.

    counts: (n, CUTS) false boxes of each experiment per frame. seen: (n,) objects with points per
    frame. spinning: (n,) whether the LiDAR spins. weights: (n,) frames of each experiment.
    """
    x = np.concatenate(
        [false_terms(np.array(CUTS), *one) for one in zip(seen, spinning, strict=True)]
    )
    every = np.ones(len(seen)) if weights is None else weights
    of_row = np.repeat(every, len(CUTS)) / len(CUTS)

    def poisson(score: FloatArray) -> tuple[FloatArray, FloatArray]:
        mean = np.exp(np.clip(score, -30, 30))
        return mean, mean

    start = np.zeros(x.shape[1])
    start[0] = np.log(max(float((of_row * counts.ravel()).sum() / of_row.sum()), 1e-6))
    return newton(x, counts.ravel(), of_row, poisson, start, 0.1, 2)


def newton(
    x: FloatArray,
    y: FloatArray,
    weights: FloatArray,
    law: Callable[[FloatArray], tuple[FloatArray, FloatArray]],
    b: FloatArray,
    ridge: float,
    largest_step: float,
) -> FloatArray:
    """Returns the coefficients b (k,) of the model: mean of y = law(x @ b), x (n, k), y (n,).

    law: maps x @ b to the mean of y and its slope. b: initial coefficients. ridge: penalty of half
    the squared coefficients, except the first, which is the constant.
    """
    penalty = ridge * np.eye(x.shape[1])
    penalty[0, 0] = 1e-6
    for _ in range(STEPS):
        mean, curved = law(x @ b)
        slope = x.T @ (weights * (y - mean)) - penalty @ b
        curvature = (x * (weights * np.maximum(curved, 1e-9))[:, None]).T @ x + penalty
        step = np.linalg.solve(curvature, slope)
        largest = float(np.abs(step).max())
        b = b + step * min(1.0, largest_step / max(largest, 1e-12))
        if largest < 1e-8:
            break
    return b


def average_precision(
    coefficients: FloatArray,
    false: FloatArray,
    terms: FloatArray,
    objects: int,
    frames: int,
    *,
    spinning: bool,
) -> float:
    """Returns the expected AP, 0 to 100, over all objects, seen or not.

    terms: terms of the seen objects. objects: number of all objects in the frames. spinning:
    whether the LiDAR spins.
    """
    true_positives = np.array(
        [detection_probability(coefficients, terms, cut).sum() for cut in CUTS]
    )
    rates = false_per_frame(false, np.array(CUTS), len(terms) / max(frames, 1), spinning)
    return ap_of_counts(true_positives, frames * rates, objects)
