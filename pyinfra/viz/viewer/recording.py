"""Writes frames as a recording for Rerun (https://rerun.io), an optional viewer.

The viewer is installed with the extra `rerun`.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pyinfra.core.arrays import FloatArray
from pyinfra.core.errors import Error, missing
from pyinfra.core.files import replacing
from pyinfra.viz.viewer.frames import ViewFrame

try:
    import rerun
except ModuleNotFoundError as error:
    raise missing("rerun-sdk", "rerun") from error

VEHICLE_COLOUR = (0, 114, 178)
PREDICTION_COLOUR = (213, 94, 0)
POINT_RADIUS = rerun.Radius.ui_points(1.2)


def write(views: Mapping[str, Sequence[ViewFrame]], out: Path) -> int:
    """Writes a recording (.rrd) of frames by the LiDAR's name; returns its size in bytes.

    Each LiDAR is an entity below `world` with points, vehicles, predictions and trails of tracks.
    The timelines are `frame` and `time`, the start of the frame in seconds.
    """
    out.parent.mkdir(parents=True, exist_ok=True)
    with replacing(out) as beside:
        recording = rerun.RecordingStream("pyinfra")
        recording.save(beside)
        recording.log("world", rerun.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        for name, frames in views.items():
            for view in frames:
                recording.set_time("frame", sequence=view.frame)
                recording.set_time("time", duration=view.frame * view.period_s)
                _log(recording, ["world", name], view)
        recording.flush()
        recording.disconnect()
    return out.stat().st_size


def open_viewer(recording: Path) -> None:
    """Opens a recording in Rerun's window and waits until the window is closed.

    The viewer listens on this machine only. Raises Error if it fails, for example without a screen.
    """
    words = [sys.executable, "-m", "rerun", "--bind", "127.0.0.1", "--port", "auto", str(recording)]
    code = subprocess.run(words, check=False).returncode
    if code != 0:
        raise Error(f"{recording} was written, but Rerun's viewer ended with exit code {code}")


def _log(recording: Any, path: list[str], view: ViewFrame) -> None:
    """Logs points, vehicles, predictions and trails of a frame, even if they are empty.

    For a part that is not logged, Rerun would show the part of the previous frame.
    """
    grey = np.rint(255 * np.clip(view.intensity, 0, 1)).astype(np.uint8)
    colours = np.stack([grey // 2 + 64, grey // 2 + 96, 255 - grey // 2], axis=1)
    points = rerun.Points3D(view.points, colors=colours, radii=POINT_RADIUS)
    recording.log([*path, "points"], points)
    recording.log([*path, "vehicles"], _boxes(view.boxes, view.names.tolist(), VEHICLE_COLOUR))
    predictions = view.predictions
    boxes = np.empty((0, 7)) if predictions is None else predictions.boxes
    labels = [] if predictions is None else predictions.names.tolist()
    recording.log([*path, "predictions"], _boxes(boxes, labels, PREDICTION_COLOUR))
    trails = rerun.LineStrips3D(list(view.trails), colors=[PREDICTION_COLOUR] * len(view.trails))
    recording.log([*path, "trails"], trails)


def _boxes(boxes: FloatArray, labels: list[str], colour: tuple[int, int, int]) -> Any:
    half = boxes[:, 6] / 2  # half the heading, for the quaternion (x, y, z, w) of the rotation
    turns = np.stack([0 * half, 0 * half, np.sin(half), np.cos(half)], axis=1)
    return rerun.Boxes3D(
        centers=boxes[:, :3],
        sizes=boxes[:, 3:6],
        quaternions=turns,
        colors=[colour] * len(boxes),
        labels=labels,
        show_labels=False,
    )
