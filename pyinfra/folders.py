"""Public API functions that check, divide, describe and draw folders of frames and results."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

import pandas as pd

from pyinfra.core.errors import Error
from pyinfra.core.names import StrPath, path_of
from pyinfra.core.public import CALLER, public
from pyinfra.dataset.frame_sequence import FrameSequence
from pyinfra.dataset.sequence_folder import on_disk
from pyinfra.dataset.split import TRAIN_UNTIL_S, VAL_FROM_S, By

if TYPE_CHECKING:
    from pyinfra.models.inference.region_proposal import Proposal

AnyData: TypeAlias = "FrameSequence | StrPath | Sequence[StrPath]"


@contextmanager
def folders_of(data: AnyData, *, of_lidar: bool = False) -> Iterator[list[Path]]:
    """Context manager that gives the folders of data; frames in memory get a temporary folder.

    of_lidar: whether frames of a sequence give the LiDAR's folder; otherwise the data set.
    """
    if isinstance(data, FrameSequence):
        with on_disk(data) as folder:
            yield [folder if of_lidar else folder.parent]
        return
    given = list(data) if isinstance(data, (list, tuple)) else [data]
    yield [path_of(one, "data") for one in given]


@public(train_until_s=(0, math.inf), val_from_s=(0, math.inf))
def split(
    data: StrPath,
    by: By = "time",
    *,
    val_data: StrPath | None = None,
    seed: int = 1,
    train_until_s: float = TRAIN_UNTIL_S,
    val_from_s: float = VAL_FROM_S,
    force: bool = False,
) -> pd.DataFrame:
    """Divides the frames of a data set into training and validation frames.

    The numbers are written to `ImageSets/train.txt` and `val.txt` of every LiDAR.

    Parameters
    ----------
    data : folder of a data set
    by : `time`: frames before `train_until_s` are train, and frames from `val_from_s` on are val;
        `seed`: all frames of `val_data` are val; `random`: a fifth of the frames is val
    val_data : data set with another seed, only with `seed`
    seed : random seed, with `random`
    train_until_s, val_from_s : times in seconds, with `time`
    force : whether to replace another split

    Returns
    -------
    DataFrame : a row for each data set: its folder, and the numbers of frames `train` and `val`

    Raises
    ------
    Error : for parts without frames, or if there is another split and `force` is False

    Examples
    --------
    >>> import tempfile
    >>> import pyinfra as pi
    >>> frames = pi.simulate(pi.load_scene("highway"), "helios_16", range(0, 30, 10))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     data = frames.save(f"{folder}/highway")
    ...     table = pi.split(data, train_until_s=2, val_from_s=2)
    >>> table[["train", "val"]].values.tolist()
    [[2, 1]]
    """
    from pyinfra.dataset.data_set import read_data_set
    from pyinfra.dataset.split import by_random, by_seed, by_time, write

    if (by == "seed") != (val_data is not None):
        wanted = "a data set" if by == "seed" else "no data set"
        raise Error(f"val_data: expected {wanted} if `by` is '{by}', got {val_data or 'none'}")
    whole = read_data_set(path_of(data, "data"))
    if val_data is not None:
        validation = read_data_set(path_of(val_data, "val_data"))
        pairs = list(zip((whole, validation), by_seed(whole, validation), strict=True))
    elif by == "random":
        pairs = [(whole, by_random(whole.frames, seed, where=whole.folder))]
    else:
        ends = (train_until_s, val_from_s)
        pairs = [(whole, by_time(whole.frames, whole.period_s, *ends, where=whole.folder))]
    for one, parts in pairs:
        write(one, parts, force=force)
    rows = [(str(one.folder), len(parts.train), len(parts.val)) for one, parts in pairs]
    return pd.DataFrame(rows, columns=["folder", "train", "val"])


@public()
def validate(
    data: FrameSequence | StrPath,
    predictions: StrPath | None = None,
    *,
    split: str | None = None,
    allow_missing: bool = False,
) -> pd.DataFrame:
    """Checks frames and predictions for them, and finds common causes of an AP of 0.

    Parameters
    ----------
    data : frames, a LiDAR's folder, or without `predictions` a data set
    predictions : folder of predictions, NNNNNN.txt or NNNNNN.csv
    split : the name of a list in ImageSets, such as `val`, whose frames must have predictions, or
        `all`; by default `val` if it exists, else all
    allow_missing : whether frames may have no prediction file

    Returns
    -------
    DataFrame : a row for each finding: level (`error`, `warning` or `note`), name and text

    Raises
    ------
    Error : for a folder without frames, and several LiDARs with predictions

    Examples
    --------
    >>> import pyinfra as pi
    >>> frames = pi.simulate(pi.load_scene("highway"), "helios_16", range(0, 30, 10))
    >>> "error" in set(pi.validate(frames).level)
    False
    """
    from pyinfra.metrics.frame_checks import folders_with_frames
    from pyinfra.metrics.frame_checks import validate as findings_of

    found = None if predictions is None else path_of(predictions, "predictions")
    with folders_of(data, of_lidar=True) as (folder,):
        lidars = folders_with_frames(folder)
        if found is not None and len(lidars) > 1:
            names = ", ".join(lidar.name for lidar in lidars)
            raise Error(
                f"{folder}: expected the folder of one LiDAR with predictions, got the LiDARs "
                f"{names}"
            )
        findings = [
            finding
            for lidar in lidars
            for finding in findings_of(lidar, found, split, allow_missing=allow_missing)
        ]
    rows = [(finding.level, finding.name, finding.text) for finding in findings]
    return pd.DataFrame(rows, columns=["level", "name", "text"])


@public()
def trust(
    data: FrameSequence | StrPath,
    predictions: StrPath,
    *,
    split: str | None = None,
    allow_missing: bool = False,
) -> pd.DataFrame:
    """Estimates without labels how reliable predictions of a fixed LiDAR are.

    Parameters
    ----------
    data : frames or a LiDAR's folder; labels are not used
    predictions : folder of predictions, NNNNNN.txt or NNNNNN.csv
    split : the name of a list in ImageSets; by default all frames
    allow_missing : whether frames may have no prediction file

    Returns
    -------
    DataFrame : a row for each minimum score: shares of boxes that move, last, and agree with the
        moving points, as `trust.csv` of `docs/formats.md`

    Raises
    ------
    Error : for missing or invalid predictions, less than 10 s, frames that are not consecutive, no
        outline of the road, or a fault in more than half of the frames

    Examples
    --------
    >>> import tempfile
    >>> import pyinfra as pi
    >>> frames = pi.simulate(pi.load_scene("highway"), "helios_16", range(0, 105))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     labels = pi.Detections(frames.labels.assign(score=1.0))
    ...     table = pi.trust(frames, labels.save(f"{folder}/found"), allow_missing=True)
    >>> int(table.frames[0])
    105
    """
    from pyinfra.models.inference.label_free_checks import trust_of

    found = path_of(predictions, "predictions")
    with folders_of(data, of_lidar=True) as (folder,):
        rows = trust_of(folder, found, split, allow_missing=allow_missing)
    return pd.DataFrame([asdict(row) for row in rows])


@public(accumulate=(1, 100))
def statistics(
    data: AnyData,
    out: StrPath | None = None,
    *,
    above_road: bool = False,
    accumulate: int = 1,
) -> dict[str, pd.DataFrame]:
    """Computes scanning statistics of data sets, such as points per vehicle.

    Parameters
    ----------
    data : frames, or the folder of a data set, or several folders
    out : folder for the tables and figures; by default no file is written
    above_road : whether to leave out points below road level; needs frames with fields
    accumulate : number of consecutive frames whose points are merged into one frame

    Returns
    -------
    Tables by name: `points_per_vehicle`, `quality`, `speeds`, `lit_share`, `angular_density` and
    others; the last two need the compiled extension

    Raises
    ------
    Error : for a folder that is no data set, and vehicles without ids with `accumulate`

    Examples
    --------
    >>> import pyinfra as pi
    >>> frames = pi.simulate(pi.load_scene("highway"), "helios_16", range(0, 30, 10))
    >>> "points_per_vehicle" in pi.statistics(frames)
    True
    """
    from pyinfra.formats.csv_table import write_tables
    from pyinfra.metrics.scanning_statistics import statistics as tables_of
    from pyinfra.models.ops.kernels import kernels

    with folders_of(data) as folders:
        tables = tables_of(
            folders,
            above_road=above_road,
            patterns=kernels is not None,
            accumulate=accumulate,
        )
    if out is not None:
        from pyinfra.viz import scanning_plots

        folder = path_of(out, "out")
        write_tables(folder, tables)
        for name, table in tables.items():
            scanning_plots.save(scanning_plots.draw(name, table), folder / name)
    return tables


@public()
def propose_region(data: FrameSequence | StrPath, out: StrPath | None = None) -> Proposal:
    """Proposes an outline of the road from the moving vehicles of a recording of 10 s or more.

    Parameters
    ----------
    data : frames or a LiDAR's folder; no labels are used
    out : .yaml file for the outline; by default no file is written

    Returns
    -------
    Proposal : an argument `region` of `detect`, and a polygon for `shapely.geometry.shape`, in the
        levelled LiDAR frame, metres. Its attributes are `corners` (m, 2) of the largest outline,
        `area_m2`, `vehicles`, `inside_share` and `moving_share`

    Raises
    ------
    Error : for a recording that is too short, or has too few vehicles

    Examples
    --------
    >>> import pyinfra as pi
    >>> frames = pi.simulate(pi.load_scene("highway"), "helios_16", range(0, 20, 2))
    >>> try:
    ...     pi.propose_region(frames)
    ... except pi.Error as error:
    ...     print(str(error).partition(": ")[2])
    expected a recording of 10 s or more, got 2 s
    """
    from pyinfra.models.inference.region_proposal import (
        SHORT_S,
        propose_of_folder,
        write_outline,
    )

    file = None if out is None else path_of(out, "out")
    if file is not None and file.suffix not in (".yaml", ".yml"):
        raise Error(f"out: expected a file name that ends in .yaml, got {file}")
    with folders_of(data, of_lidar=True) as (folder,):
        proposal = propose_of_folder(folder)
    if proposal.seconds < SHORT_S:
        warnings.warn(
            f"the recording has {proposal.seconds:g} s; lanes without a vehicle in this time are "
            f"missing in the outline; use a recording of {SHORT_S:g} s or more",
            stacklevel=CALLER,
        )
    if file is not None:
        write_outline(file, proposal.drawn)
    return proposal
