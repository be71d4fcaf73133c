"""Vehicles with known motion, as tables of true boxes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt
import pandas as pd

PERIOD_S = 0.1
Motion = Callable[[npt.NDArray[np.float64]], tuple[object, object, object]]


def straight(x: float, y: float, speed: float, heading: float = 0.0) -> Motion:
    def motion(t: npt.NDArray[np.float64]) -> tuple[object, object, object]:
        ahead = speed * t
        return x + np.cos(heading) * ahead, y + np.sin(heading) * ahead, heading + 0 * t

    return motion


def circle(radius: float, speed: float) -> Motion:
    """A left turn around (30, 0)."""

    def motion(t: npt.NDArray[np.float64]) -> tuple[object, object, object]:
        angle = speed / radius * t
        return 30 + radius * np.cos(angle), radius * np.sin(angle), angle + np.pi / 2

    return motion


def boxes(motions: list[Motion], frames: int, kind: str = "Car") -> pd.DataFrame:
    """Returns frame, id, type, box (z = -5 m) and score of vehicles, ordered by frame."""
    t = (np.arange(frames) + 0.5) * PERIOD_S
    parts = []
    for number, motion in enumerate(motions):
        x, y, heading = motion(t)
        part = pd.DataFrame({"frame": np.arange(frames), "id": number, "type": kind})
        part["x"], part["y"], part["z"] = x, y, -5.0
        part[["dx", "dy", "dz"]] = 4.5, 1.8, 1.5
        part["heading"], part["score"] = heading, 0.9
        parts.append(part)
    return pd.concat(parts).sort_values(["frame", "id"], ignore_index=True)


def noisy(table: pd.DataFrame, seed: int, sigma_m: float = 0.2) -> pd.DataFrame:
    rng = np.random.default_rng(seed)
    moved = table[["x", "y"]] + rng.normal(0, sigma_m, (len(table), 2))
    return table.assign(x=moved.x, y=moved.y)
