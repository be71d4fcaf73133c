"""Predicted boxes of several frames as a table that can be saved and read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from pyinfra.core.arrays import FloatArray, IntArray, NameArray
from pyinfra.core.errors import Error, check_exists
from pyinfra.core.names import StrPath, path_of
from pyinfra.core.public import public
from pyinfra.dataset.frame_readers import Cameras, read_cameras, read_predictions
from pyinfra.dataset.frames import frame_numbers
from pyinfra.dataset.object_rows import BOX
from pyinfra.formats import kitti
from pyinfra.metrics.prediction_checks import find_files
from pyinfra.metrics.prediction_table import COLUMNS


class Detections(pd.DataFrame):  # type: ignore[misc]  # pandas has no types
    """Boxes of a detector: a pandas table with methods to save and read it.

    Columns: frame, type, x y z dx dy dz heading (levelled LiDAR frame, metres, radians), score.
    """

    @property
    def _constructor(self) -> type[Detections]:
        return Detections

    def save(
        self,
        folder: StrPath,
        frames: Sequence[int] | None = None,
        lidar_folder: StrPath | None = None,
    ) -> Path:
        """Writes a KITTI result file for each frame to a folder, and returns its path.

        frames: frame numbers, also of frames without boxes, which get an empty file; by default the
        frames of the table. lidar_folder: LiDAR's folder with the calibrations of the frames; by
        default the camera is that of a simulated LiDAR. Raises Error for a missing column, and
        FormatError for an invalid calibration.
        """
        if missing := [name for name in COLUMNS if name not in self.columns]:
            names = ", ".join(COLUMNS)
            raise Error(f"detections: expected the columns {names}; {missing[0]} is missing")
        out = path_of(folder, "folder")
        numbers = sorted(set(self.frame.tolist()) | set(() if frames is None else frames))
        cameras = Cameras((kitti.simulated(),), np.zeros(len(numbers), np.int64))
        if lidar_folder is not None:
            cameras = read_cameras(path_of(lidar_folder, "lidar_folder"), numbers)
        out.mkdir(parents=True, exist_ok=True)
        for number, camera in zip(numbers, cameras.of_frame, strict=True):
            rows = self[self.frame == number]
            names, boxes = rows["type"].to_numpy(np.str_), rows[BOX].to_numpy(np.float64)
            labels = kitti.Labels(names, boxes, rows["score"].to_numpy(np.float64))
            kitti.write_labels(out / f"{int(number):06d}.txt", labels, cameras.different[camera])
        return out

    @classmethod
    @public()
    def from_nuscenes(
        cls, file: StrPath, source: StrPath, frames: Sequence[int] | None = None
    ) -> Detections:
        """Reads a result file of nuScenes (.json) for key frames of one LiDAR.

        source: folder of the tables of nuScenes, such as an export of `frames.save`. frames:
        numbers of the key frames, in the order of time; by default 0, 1, ... Raises FormatError.
        """
        from pyinfra.conversion import nuscenes_results

        boxes = nuscenes_results(path_of(file, "file"), path_of(source, "source"))
        numbers = list(boxes) if frames is None else list(frames)
        if len(numbers) != len(boxes):
            raise Error(f"frames: expected {len(boxes)} numbers of key frames, got {len(numbers)}")
        parts = [
            pd.DataFrame(dict(zip(BOX, one.boxes.T, strict=True))).assign(
                frame=number, type=one.names.astype(object), score=one.visibility
            )
            for number, one in zip(numbers, boxes.values(), strict=True)
        ]
        return cls(pd.concat(parts, ignore_index=True)[COLUMNS])

    @classmethod
    @public()
    def from_csv(
        cls, file: StrPath, lidar_folder: StrPath, columns: Mapping[str, str] | None = None
    ) -> Detections:
        """Reads boxes of a .csv file with a row for each box and columns of any names.

        lidar_folder: LiDAR's folder of the frames. The column `frame` has their numbers, or the
        names of the clouds from which they were imported. columns: maps keys (frame, class, x, y,
        z or z_bottom, length, width, height, yaw or yaw_deg, score) to columns; plain names are
        recognised. Boxes are in the levelled LiDAR frame. Without a column `score`, the score is 1.
        Raises FormatError with file, line and column.
        """
        from pyinfra.conversion import csv_detections

        folder = path_of(lidar_folder, "lidar_folder")
        return cls(csv_detections(path_of(file, "file"), folder, columns or {})[COLUMNS])

    @classmethod
    @public()
    def from_kitti(cls, folder: StrPath, lidar_folder: StrPath | None = None) -> Detections:
        """Reads a folder of KITTI results (.txt) or of CSV files in the LiDAR frame.

        lidar_folder: LiDAR's folder with the calibrations of the frames; by default the camera is
        that of a simulated LiDAR. Raises FormatError with file and line.
        """
        source = path_of(folder, "folder")
        check_exists(source)
        if not source.is_dir():
            raise Error(f"folder: expected a folder, got '{source}'")
        truth = None if lidar_folder is None else path_of(lidar_folder, "lidar_folder")
        files = (f for f in source.iterdir() if f.suffix in (".txt", ".csv"))
        numbers = sorted(int(f.stem) for f in files if f.stem.isdecimal())
        known = frame_numbers(truth, "all") if truth else numbers
        paths = find_files(source, numbers, known, lidar_folder=truth).files
        simulated = Cameras((kitti.simulated(),), np.zeros(len(numbers), np.int64))
        table = read_predictions(paths, read_cameras(truth, numbers) if truth else simulated)
        frame = np.array(numbers, np.int64)[table.frame]
        return table_of(frame, table.names, table.boxes, table.scores)


def table_of(
    frame: IntArray, names: NameArray, boxes: FloatArray, scores: FloatArray
) -> Detections:
    """Returns a table of boxes (n, 7). frame: (n,) frame numbers."""
    columns: dict[str, Any] = {"frame": frame, "type": pd.Series(names.tolist(), dtype=object)}
    columns |= dict(zip(BOX, boxes.T, strict=True)) | {"score": scores}
    return Detections(columns)
