"""The frames_version of a model's training frames, and a warning if other frames differ from it."""

from pathlib import Path

import numpy as np

from pyinfra.dataset.frames_version import FIRST, other_frames
from pyinfra.dataset.prediction_origin import MODEL_FRAMES, model_name, origin_of
from pyinfra.models.training.provenance import read_provenance


def learnt_from(model: Path) -> str:
    """Returns the frames_version of the frames that a model was learnt from.

    The text is empty if they were recorded. Several values are separated by blanks. The value is 3
    if the file does not state it. Raises the errors of checkpoint.load.
    """
    if model.suffix != ".npz":
        return read_provenance(model).frames_version
    with model.open("rb") as stream, np.load(stream, allow_pickle=False) as data:
        return str(data["frames_version"]) if "frames_version" in data.files else FIRST


def frames_warning(model: Path, used: str) -> str:
    """Returns a warning if a model was not learnt from frames of the frames_version `used`.

    The text is empty if it was, or if a frames_version is empty, as for recorded frames.
    """
    return other_frames(model_name(model), learnt_from(model), used)


def model_origin(lidar_folder: Path, model: Path) -> dict[str, str]:
    """Returns the origin of a model's predictions, with the frames_version of its training."""
    return origin_of(lidar_folder, model) | {MODEL_FRAMES: learnt_from(model)}
