"""A Kalman filter of positions on the ground plane, for many tracks at a time.

The state is x y vx vy ax ay, in metres and seconds. Acceleration is a random process that decays
(R. A. Singer, Estimating Optimal Tracking Filter Performance for Manned Maneuvering Targets, 1970).
x and y move independently with the same model.
"""

from functools import lru_cache

import numpy as np

from pyinfra.core.arrays import FloatArray

STATES = 6
DECAY_S = 1.5  # time constant of the acceleration
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(5)


@lru_cache(maxsize=64)
def transition(dt_s: float) -> FloatArray:
    """Returns the matrix (6, 6) that moves a state by dt_s."""
    share = np.exp(-dt_s / DECAY_S)
    axis = np.array(
        [
            [1, dt_s, DECAY_S * (dt_s - DECAY_S * (1 - share))],
            [0, 1, DECAY_S * (1 - share)],
            [0, 0, share],
        ]
    )
    return np.asarray(np.kron(axis, np.eye(2)))


@lru_cache(maxsize=64)
def _unit_noise(dt_s: float) -> FloatArray:
    """Returns the covariance (3, 3) of one axis after dt_s for an acceleration noise of 1 m/s2."""
    times, weights = dt_s * (_NODES + 1) / 2, dt_s * _WEIGHTS / 2
    columns = [transition(float(time))[::2, 4:5] for time in times]
    parts = [w * column @ column.T for w, column in zip(weights, columns, strict=True)]
    return np.asarray(2 / DECAY_S * np.sum(parts, axis=0))


def process_noise(dt_s: float, noise: FloatArray) -> FloatArray:
    """Returns covariances (n, 6, 6) after dt_s, for covariances (n, 2, 2) of the acceleration."""
    both = _unit_noise(dt_s)[:, None, :, None] * noise[:, None, :, None, :]
    return np.asarray(both.reshape(len(noise), STATES, STATES))


def predict(
    state: FloatArray, covariance: FloatArray, dt_s: float, noise: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Moves states (n, 6) and covariances (n, 6, 6) by dt_s.

    noise: (n, 2, 2) covariances of the acceleration.
    """
    step = transition(dt_s)
    return state @ step.T, step @ covariance @ step.T + process_noise(dt_s, noise)


def update(
    state: FloatArray, covariance: FloatArray, position: FloatArray, noise: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Corrects states (n, 6) by measured positions (n, 2) with covariances `noise` (n, 2, 2)."""
    gain = covariance[:, :, :2] @ np.linalg.inv(covariance[:, :2, :2] + noise)
    error = position - state[:, :2]
    new = covariance - gain @ covariance[:, :2]
    return state + np.einsum("nij,nj->ni", gain, error), (new + new.transpose(0, 2, 1)) / 2


def smoothed(
    states: FloatArray, covariances: FloatArray, times_s: FloatArray, noise: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Returns one track's states (k, 6) and covariances (k, 6, 6) given all its boxes.

    This is the smoother of Rauch, Tung and Striebel. The inputs are the filter's values at times_s.
    noise: (k, 2, 2) covariances of the acceleration that the filter used up to each time.
    """
    out, spread = states.copy(), covariances.copy()
    for i in range(len(states) - 2, -1, -1):
        dt_s = round(float(times_s[i + 1] - times_s[i]), 6)
        step = transition(dt_s)
        ahead = step @ covariances[i] @ step.T + process_noise(dt_s, noise[i + 1 : i + 2])[0]
        gain = np.linalg.solve(ahead, step @ covariances[i]).T
        out[i] += gain @ (out[i + 1] - step @ states[i])
        spread[i] += gain @ (spread[i + 1] - ahead) @ gain.T
    return out, spread


def axes(heading: FloatArray, along: FloatArray | float, across: FloatArray | float) -> FloatArray:
    """Returns covariances (n, 2, 2) with standard deviations along and across a heading (n,)."""
    ahead = np.stack([np.cos(heading), np.sin(heading)], axis=1)
    left = np.stack([-ahead[:, 1], ahead[:, 0]], axis=1)
    first = np.reshape(np.square(along), (-1, 1, 1)) * ahead[:, :, None] * ahead[:, None]
    return np.asarray(
        first + np.reshape(np.square(across), (-1, 1, 1)) * left[:, :, None] * left[:, None]
    )
