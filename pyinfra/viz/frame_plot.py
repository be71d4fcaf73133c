"""Draws one frame from above: points, labels and detections."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from pyinfra.core.arrays import FloatArray
from pyinfra.core.boxes import footprints
from pyinfra.core.errors import Error
from pyinfra.core.public import public
from pyinfra.dataset.box_tables import check_columns
from pyinfra.dataset.frame_sequence import LidarFrame
from pyinfra.dataset.object_rows import BOX

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LABEL, DETECTION = "#1b7837", "#d6604d"  # colour-blind readers can distinguish these colours


@public(min_score=(0, 1))
def plot_frame(
    frame: LidarFrame,
    detections: pd.DataFrame | None = None,
    *,
    min_score: float = 0.5,
    ax: Axes | None = None,
) -> Axes:
    """Draws a frame from above.

    Parameters
    ----------
    frame : one element of a sequence of frames
    detections : result of `detect`; rows of other frames are ignored
    min_score : 0 to 1, the minimum score of a drawn detection
    ax : axes to draw into; by default those of a new figure

    Returns
    -------
    Matplotlib axes, metres in the levelled LiDAR frame: x to the right, y up

    Raises
    ------
    Error : if frame is not a frame, detections has no boxes, or min_score is out of range

    Examples
    --------
    >>> import pyinfra as pi
    >>> frames = pi.simulate(pi.load_scene("highway"), "helios_16", [100])
    >>> pi.plot_frame(frames[0]).get_title()
    'frame 100'
    """
    import matplotlib.pyplot as plt
    from matplotlib.collections import PolyCollection

    if detections is not None:
        _check(detections)
    if ax is None:
        ax = plt.subplots(figsize=(10, 6), layout="constrained")[1]
    x, y, z = frame.points[:, :3].T
    ax.scatter(x, y, s=0.3, c=z, cmap="Greys", vmin=-15, vmax=5, linewidths=0, rasterized=True)
    parts = [("labels", frame.labels, LABEL, "-")]
    if detections is not None:
        shown = detections[(detections.frame == frame.number) & (detections.score >= min_score)]
        parts.append((f"detections, score {min_score:g} or more", shown, DETECTION, "--"))
    for name, table, colour, style in parts:
        boxes: FloatArray = table[BOX].to_numpy(dtype=np.float64).reshape(-1, 7)
        ax.add_collection(
            PolyCollection(
                list(footprints(boxes)),
                facecolors="none",
                edgecolors=colour,
                linestyles=style,
                label=f"{name}: {len(table)}",
            )
        )
    ax.set(xlabel="x, m", ylabel="y, m", title=f"frame {frame.number}", aspect="equal")
    ax.legend(loc="upper right")
    return ax


def _check(detections: pd.DataFrame) -> None:
    """Raises Error if `detections` is not a table of detections."""
    if not isinstance(detections, pd.DataFrame):
        got = type(detections).__name__
        raise Error(f"detections: expected a table, got {got}")
    for name in ("frame", *BOX, "score"):
        check_columns(detections, [name], "detections")
        values = pd.to_numeric(detections[name], errors="coerce")
        if not (good := np.isfinite(values.to_numpy(dtype=np.float64))).all():
            wrong = detections[name].iloc[int(good.argmin())]
            raise Error(f"detections: {name}: expected finite numbers, got {wrong!r:.40}")
