"""Draws the health of a recording (points, tilt, lost sectors) by frame."""

from collections.abc import Sequence
from pathlib import Path

import matplotlib.pyplot as plt

from pyinfra.dataset.health import FrameHealth

BAD = "tab:red"


def draw_health(health: Sequence[FrameHealth], file: Path) -> None:
    """Draws number of points, tilt and lost sectors by frame; faulty frames have red marks."""
    frames = [row.frame for row in health]
    columns: dict[str, list[float]] = {
        "points, share of usual": [row.points_share for row in health],
        "tilt, degrees": [row.tilt_deg for row in health],
        "lost sectors, degrees": [float(row.lost_sectors_deg) for row in health],
    }
    figure, axes = plt.subplots(len(columns), 1, sharex=True, figsize=(8, 5), layout="constrained")
    for axis, (label, values) in zip(axes, columns.items(), strict=True):
        axis.plot(frames, values, linewidth=1)
        bad = [i for i, row in enumerate(health) if row.problems]
        axis.plot([frames[i] for i in bad], [values[i] for i in bad], ".", color=BAD, markersize=4)
        axis.set_ylabel(label)
    axes[-1].set_xlabel("frame")
    figure.savefig(file, dpi=100)
    plt.close(figure)
