"""Detections of frames in memory as a table, by any detector."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import numpy as np
import pandas as pd

from pyinfra.core.arrays import Points
from pyinfra.core.errors import Error
from pyinfra.core.names import suggestion
from pyinfra.dataset.frame_sequence import BOX, FrameSequence
from pyinfra.dataset.loading import one_lidar
from pyinfra.models.detectors import Detections, Detector
from pyinfra.models.inference import detect as inference

COLUMNS = ["frame", "type", *BOX, "score"]
DetectorFunction: TypeAlias = Callable[[Points], pd.DataFrame]


@dataclass(frozen=True)
class TrainedDetector:
    """A trained detector's file; `detect` places it where the frames were taken."""

    file: Path
    device: str = "cpu"

    def at(self, frames: FrameSequence) -> Detector:
        """The detector with the road and region of some frames."""
        return inference.load_detector(
            self.file, ground=frames.ground, region=frames.region, device=self.device
        )


def load_detector(
    model: str | os.PathLike[str] = "generalist", *, device: str = "cpu"
) -> TrainedDetector:
    """A detector that comes with the package, or one that was trained.

    Parameters
    ----------
    model : `generalist`, the pretrained detector; the folder of a training; or a file in it
    device : of torch, such as `cpu` or `cuda`

    Raises
    ------
    Error : for a name, folder or file without a model

    Examples
    --------
    >>> import pyinfra as pi
    >>> pi.load_detector("generalist").file.name
    'generalist.safetensors'
    """
    try:
        return TrainedDetector(inference.model_file(Path(model)), device)
    except FileNotFoundError:
        near = suggestion(os.fspath(model), inference.shipped())
        raise Error(f"model: expected a model or a name, got '{model}'{near}") from None


def detect(
    model: TrainedDetector | Detector | DetectorFunction | str | os.PathLike[str],
    frames: FrameSequence | str | os.PathLike[str],
) -> pd.DataFrame:
    """Boxes of a detector in each frame.

    Parameters
    ----------
    model : of `load_detector`, or what it takes; or any callable that takes points (n, 4) float32,
        x y z intensity, and returns a table with the columns type (default `vehicle`), x y z dx dy
        dz heading, score (default 1); metres and radians, levelled LiDAR frame
    frames : of `simulate` or `load_dataset`, or a LiDAR's folder

    Returns
    -------
    DataFrame : frame, type, x y z dx dy dz heading, score; by frame, best first

    Raises
    ------
    Error : if the model is none, or a callable fails or returns something else

    Examples
    --------
    >>> import pandas as pd
    >>> import pyinfra as pi
    >>> frames = pi.simulate(pi.load_scene("highway"), "helios_16", range(0, 20, 10))
    >>> def nothing(points):
    ...     return pd.DataFrame(columns=["x", "y", "z", "dx", "dy", "dz", "heading", "score"])
    >>> pi.detect(nothing, frames).shape
    (0, 10)
    """
    frames = one_lidar(frames, "frames")
    if isinstance(model, (str, os.PathLike)):
        model = load_detector(model)
    if isinstance(model, TrainedDetector):
        model = model.at(frames)
    if hasattr(model, "predict"):
        tables = (_of_detections(f.number, model.predict(f.points)) for f in frames)
    elif callable(model):
        tables = (_of_function(f.number, model, f.points) for f in frames)
    else:
        raise Error(f"model: expected a detector or a callable, got {type(model).__name__}")
    return _joined(tables)


def _joined(tables: Iterable[pd.DataFrame]) -> pd.DataFrame:
    kept = [table for table in tables if len(table) > 0]
    if not kept:
        empty = {name: pd.Series(dtype=object if name == "type" else float) for name in COLUMNS}
        return pd.DataFrame(empty).astype({"frame": int})
    return pd.concat(kept, ignore_index=True)


def _of_detections(number: int, detections: Detections) -> pd.DataFrame:
    table = pd.DataFrame({"frame": number, "type": detections.names.astype(object)})
    table[BOX] = detections.boxes
    return table.assign(score=detections.scores)


def _of_function(number: int, model: DetectorFunction, points: Points) -> pd.DataFrame:
    try:
        table = model(points)
    except Exception as error:
        raise Error(f"model: frame {number}: {type(error).__name__}: {error}") from error
    if not isinstance(table, pd.DataFrame):
        raise Error(f"model: frame {number}: expected a table of boxes, got {type(table).__name__}")
    for name in BOX:
        if name not in table.columns:
            near = suggestion(name, map(str, table.columns))
            raise Error(f"model: frame {number}: expected the column '{name}', got none{near}")
    table = table.assign(
        frame=number,
        type=table["type"] if "type" in table.columns else "vehicle",
        score=table["score"] if "score" in table.columns else 1.0,
    )
    try:
        numbers = table[[*BOX, "score"]].to_numpy(dtype=np.float64)
    except (TypeError, ValueError):
        raise Error(f"model: frame {number}: expected numbers in the columns of boxes") from None
    if not np.isfinite(numbers).all():
        raise Error(f"model: frame {number}: expected finite numbers, got NaN or inf")
    return table[COLUMNS].sort_values("score", ascending=False, ignore_index=True)
