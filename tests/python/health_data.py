"""Clean recordings of simulated roads, and the same recordings with faults."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from scipy.spatial.transform import Rotation

from pyinfra.formats import kitti

LINES = 32
FROM = 30  # first faulty frame
Frame = tuple[np.ndarray, np.ndarray]


def clean(seed: int, frames: int = 60) -> Iterator[Frame]:
    """Yields points (n, 4) and fields (n,) of a spinning LiDAR on a pole at a road with cars."""
    g = np.random.default_rng(seed)
    height = g.uniform(4, 8)
    walls = g.uniform(12, 40, 36)  # distance of houses by azimuth
    elevation = np.radians(np.linspace(-35, 5, LINES))
    azimuth = np.radians(np.arange(0, 360, 1.0))
    a, e = (v.ravel() for v in np.meshgrid(azimuth, elevation, indexing="ij"))
    ring = np.tile(np.arange(LINES), len(azimuth))
    speeds, lanes = g.uniform(0.5, 1.5, 6), g.uniform(3, 10, 6)
    for k in range(frames):
        ground = np.where(e < 0, height / np.maximum(-np.tan(e), 1e-6), np.inf)
        far = np.minimum(ground, walls[(np.degrees(a) // 10).astype(int) % 36])
        for speed, lane, at in zip(speeds, lanes, range(6), strict=True):
            centre = (-60 + 20 * at + speed * k + 60) % 120 - 60
            side = np.arctan2(lane, centre)
            off = np.abs((a - side + np.pi) % (2 * np.pi) - np.pi)
            is_car = (off < 2.2 / np.hypot(lane, centre)) & (e < -0.05)
            far = np.where(is_car, np.minimum(far, np.hypot(lane, centre)), far)
        r = far / np.cos(e) + g.normal(0, 0.02, len(far))
        keep = (r < 80) & (g.uniform(size=len(r)) > 0.05)
        xyz = r[:, None] * np.column_stack(
            [np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)]
        )
        points = np.column_stack([xyz, np.full(len(r), 0.3)])[keep].astype(np.float32)
        fields = np.zeros(len(points), dtype=kitti.FIELDS)
        fields["ring"], fields["time_s"] = ring[keep], (a / (2 * np.pi) * 0.1)[keep]
        yield points, fields


def tilted(degrees: float) -> Callable[[Frame], Frame]:
    turn = Rotation.from_euler("y", degrees, degrees=True).as_matrix()
    return lambda frame: (moved(frame[0], turn), frame[1])


def turned(degrees: float) -> Callable[[Frame], Frame]:
    turn = Rotation.from_euler("z", degrees, degrees=True).as_matrix()
    return lambda frame: (moved(frame[0], turn), frame[1])


def moved(points: np.ndarray, turn: np.ndarray) -> np.ndarray:
    out = points.copy()
    out[:, :3] = points[:, :3] @ turn.T
    return out


def subset(keep: Callable[[Frame], np.ndarray]) -> Callable[[Frame], Frame]:
    def changed(frame: Frame) -> Frame:
        rows = keep(frame)
        return frame[0][rows], frame[1][rows]

    return changed


def in_sector(frame: Frame, low: float, high: float) -> np.ndarray:
    azimuth = np.degrees(np.arctan2(frame[0][:, 1], frame[0][:, 0])) % 360
    return (azimuth >= low) & (azimuth < high)


def dirt(frame: Frame) -> Frame:
    points = frame[0].copy()
    rows = in_sector(frame, 80, 120)
    points[rows, :3] *= 0.3 / np.linalg.norm(points[rows, :3], axis=1, keepdims=True)
    return points, frame[1]


def late(frame: Frame) -> Frame:
    fields = frame[1].copy()
    fields["time_s"] += 0.2
    return frame[0], fields


def raised(metres: float) -> Callable[[Frame], Frame]:
    return lambda frame: (frame[0] - np.array([0, 0, metres, 0], dtype=np.float32), frame[1])


# Name of each fault, the word that names it, and the change of a frame.
FAULTS: dict[str, tuple[str, Callable[[Frame], Frame]]] = {
    "tilt 5": ("tilted", tilted(5)),
    "tilt 2": ("tilted", tilted(2)),
    "tilt 1": ("tilted", tilted(1.2)),
    "turn 10": ("turned", turned(10)),
    "turn 20": ("turned", turned(-20)),
    "raised": ("lifted", raised(0.6)),
    "half the lines": ("lost-lines", subset(lambda f: f[1]["ring"] % 2 == 0)),
    "one line": ("lost-lines", subset(lambda f: f[1]["ring"] != 3)),
    "four lines": ("lost-lines", subset(lambda f: f[1]["ring"] > 3)),
    "sector of 20": ("lost-sectors", subset(lambda f: ~in_sector(f, 80, 100))),
    "sector of 90": ("lost-sectors", subset(lambda f: ~in_sector(f, 90, 180))),
    "half the points": ("few-points", subset(lambda f: np.arange(len(f[0])) % 2 == 0)),
    "a tenth": ("few-points", subset(lambda f: np.arange(len(f[0])) % 10 == 0)),
    "ten-fold": ("many-points", lambda f: (np.repeat(f[0], 10, 0), np.repeat(f[1], 10))),
    "twice": ("many-points", lambda f: (np.repeat(f[0], 2, 0), np.repeat(f[1], 2))),
    "empty": ("empty", lambda f: (f[0][:0], f[1][:0])),
    "almost empty": ("empty", lambda f: (f[0][:20], f[1][:20])),
    "dirt": ("dirt", dirt),
    "late": ("times", late),
}
