"""Reads clouds outside any data set, and detects properties that the files do not state."""

from collections.abc import Callable, Sequence
from dataclasses import replace
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
from pyinfra.exchange.units import brightest_of, usual_intensity_max
from pyinfra.formats import pcd_file

CHECKED = 5  # number of clouds of each file type whose intensities decide the scale


def cloud_reader(clouds: Sequence[Path]) -> tuple[Callable[[Path], Points], list[str]]:
    """Returns a function that reads .bin and .pcd files, and a list of notes on assumptions.

    The returned function maps a file to points (n, 4), x y z intensity. It rotates .pcd points by
    the file's VIEWPOINT, scales intensities as an import does, and drops points that are not finite
    or 0 0 0. Raises OSError, and FormatError for an invalid file.
    """
    pcds = [cloud for cloud in clouds if _is_pcd(cloud)]
    bins = [cloud for cloud in clouds if not _is_pcd(cloud)]
    columns, assumed = columns_of(bins, Options())
    notes = [assumed] if columns != USUAL else []
    notes += pcd.Clouds(LabelFiles(pcds), Options()).notes(shifted=False, timed=False)

    def raw(cloud: Path, options: Options) -> Points:
        if _is_pcd(cloud):
            return pcd.points_of(cloud, pcd_file.read_pcd(cloud), options, shifted=False)
        return read_bin(cloud, columns, options)

    scales = []
    for files in (bins, pcds):
        brightest = _brightest(partial(raw, options=replace(WIDE, unit_m=1.0)), files)
        scales.append(usual_intensity_max(brightest))
        if scales[-1] != 1:
            notes.append(
                f"the highest intensity is {brightest:.6g}: intensities are divided by "
                f"{scales[-1]:g}"
            )

    def read(cloud: Path) -> Points:
        points = raw(cloud, Options(intensity_max=scales[_is_pcd(cloud)]))
        points[~np.isfinite(points[:, 3]), 3] = 0
        return points[has_return(points)]

    return read, notes


def following_reader() -> Callable[[Path], Points]:
    """Returns a function like that of `cloud_reader`, for clouds that arrive one by one.

    The first CHECKED clouds with points decide the columns and the scale of all later ones.
    """
    first: list[Path] = []
    read: Callable[[Path], Points] | None = None

    def following(cloud: Path) -> Points:
        nonlocal read
        if read is None or len(first) < CHECKED:
            read, _ = cloud_reader([*filter(Path.exists, first), cloud])
        points = read(cloud)
        if len(points) > 0 and len(first) < CHECKED:
            first.append(cloud)
        return points

    return following


def _is_pcd(cloud: Path) -> bool:
    return cloud.suffix.lower() == ".pcd"


def _brightest(read: Callable[[Path], Points], files: Sequence[Path]) -> float:
    """Returns the intensity that only a few points of some of the files exceed, or 0."""
    step = max(len(files) / CHECKED, 1)
    chosen = [files[int(i * step)] for i in range(min(len(files), CHECKED))]  # evenly spaced files
    clouds = [points[has_return(points)].astype(np.float64) for points in readable(read, chosen)]
    return brightest_of([cloud * [1, 1, 1, WIDE.intensity_max or 1] for cloud in clouds])
