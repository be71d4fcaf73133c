"""Reads clouds outside any data set, and detects properties that the files do not state."""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import numpy as np

from pyinfra.core.arrays import Points
from pyinfra.exchange import pcd
from pyinfra.exchange.bin_columns import USUAL, columns_of
from pyinfra.exchange.data_set import has_return
from pyinfra.exchange.label_files import LabelFiles
from pyinfra.exchange.pose_estimation import WIDE
from pyinfra.exchange.record_clouds import readable
from pyinfra.exchange.recording import Options, read_bin
from pyinfra.exchange.units import usual_intensity_max
from pyinfra.formats import kitti, pcd_file

NONE = np.empty(0, dtype=np.float32)
CHECKED = 5  # number of .pcd clouds in which the highest intensity is searched


def cloud_reader(clouds: Sequence[Path]) -> tuple[Callable[[Path], Points], list[str]]:
    """Returns a function that reads .bin and .pcd files, and notes about assumptions.

    The returned function maps a file to points (n, 4), x y z intensity. It rotates .pcd points by
    the file's VIEWPOINT, scales intensities as an import does, and drops points that are not finite
    or 0 0 0. Raises OSError, and FormatError for an invalid file.
    """
    pcds = [cloud for cloud in clouds if cloud.suffix.lower() == ".pcd"]
    bins = [cloud for cloud in clouds if cloud not in pcds]
    columns, assumed = columns_of(bins, Options())
    notes = [assumed] if columns != USUAL else []
    notes += pcd.Clouds(LabelFiles(pcds), Options()).notes(shifted=False, timed=False)
    chosen = pcds
    if len(pcds) > CHECKED:  # selects files that are evenly distributed
        chosen = [pcds[i * len(pcds) // CHECKED] for i in range(CHECKED)]
    brightest = max(map(_brightest, chosen), default=0.0)
    highest = usual_intensity_max(brightest)
    if highest != 1:
        notes.append(
            f"the highest intensity is {brightest:.6g}: intensities are divided by {highest:g}"
        )

    def read(cloud: Path) -> Points:
        if cloud in pcds:
            points = _points(cloud, Options(intensity_max=highest))
        elif columns == USUAL:
            return kitti.read_points(cloud)
        else:
            points = read_bin(cloud, columns, Options())
        return points[has_return(points)]

    return read, notes


def _points(file: Path, options: Options) -> Points:
    return pcd.points_of(file, pcd_file.read_pcd(file), options, shifted=False)


def _brightest(file: Path) -> float:
    """Returns the highest finite intensity of a .pcd file, or 0; also 0 if it cannot be read."""
    read = partial(_points, options=Options(intensity_max=WIDE.intensity_max))
    shares = np.concatenate([points[:, 3] for points in readable(read, [file])] or [NONE])
    return float(shares[np.isfinite(shares)].max(initial=0)) * (WIDE.intensity_max or 1)
