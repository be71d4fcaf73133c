"""Reads a folder of predictions into a table."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd

from pyinfra.core.errors import Error
from pyinfra.dataset.frame_readers import read_cameras, read_predictions
from pyinfra.dataset.frame_sequence import RecordedFrames
from pyinfra.dataset.object_rows import BOX
from pyinfra.dataset.prediction_origin import check_origin


def prediction_table(
    frames: RecordedFrames, folder: Path, warn: Callable[[str], None]
) -> pd.DataFrame:
    """Returns the boxes of a folder, NNNNNN.txt or NNNNNN.csv, as a table like that of `detect`.

    Raises Error for predictions of other frames and for a folder without predictions of the frames,
    and FormatError. `warn` gets a text if the origin is unknown or files are missing.
    """
    if not check_origin(folder, frames.folder):
        warn(f"{folder} has no origin.yaml, so its predictions may belong to other frames")
    files = [_file(folder, number) for number in frames.numbers]
    missing = [number for number, file in zip(frames.numbers, files, strict=True) if file is None]
    if len(missing) == len(files):
        raise Error(
            f"{folder}: expected a file for each frame, such as {missing[0]:06d}.txt, got none"
        )
    if missing:
        warn(f"{folder} has no file for {len(missing)} frames, such as frame {missing[0]}")
    read = read_predictions(files, read_cameras(frames.folder, frames.numbers))
    table = pd.DataFrame({"frame": np.array(frames.numbers, dtype=np.int64)[read.frame]})
    table["type"] = read.names.astype(object)
    table[BOX] = read.boxes
    return table.assign(score=read.scores)


def _file(folder: Path, number: int) -> Path | None:
    files = (folder / f"{number:06d}{suffix}" for suffix in (".txt", ".csv"))
    return next((file for file in files if file.is_file()), None)
