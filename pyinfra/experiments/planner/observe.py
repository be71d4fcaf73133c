"""What each pose and LiDAR sees of the objects of a site, without writing a cloud.

An observation is one object in one frame with at least one point: its points and their extents,
its distance from the LiDAR and its visible share. Only rays that may meet an object are cast.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path

import joblib
import numpy as np
import pandas as pd

from pyinfra.core.arrays import AnyArray
from pyinfra.core.files import replacing
from pyinfra.dataset import simulation
from pyinfra.experiments.benchmark.inputs import named_files
from pyinfra.experiments.planner.candidates import POSE
from pyinfra.experiments.planner.lidars import PlanLidar
from pyinfra.experiments.planner.site import PlanSite

POSES_AT_ONCE = 8


def observe(
    site: PlanSite,
    poses: pd.DataFrame,
    lidars: Sequence[PlanLidar],
    wanted: AnyArray,
    frames: Sequence[int],
    *,
    jobs: int = 1,
    folder: Path | None = None,
) -> pd.DataFrame:
    """Returns a row for each object, frame, pose and LiDAR with at least one point.

    wanted: (poses, lidars) bool, which pairs to observe. folder: finished parts are kept in it, so
    that an interrupted call resumes. Columns: pose, lidar (numbers of rows), frame, id, points,
    along, across, up (extents in metres), distance (m), visibility (0 to 1).
    """
    tasks = [k for k in range(len(poses)) if wanted[k].any()]
    where = poses[POSE].to_numpy(float)
    inputs = _inputs(site, lidars, frames)
    chunks = [tasks[i : i + POSES_AT_ONCE] for i in range(0, len(tasks), POSES_AT_ONCE)]

    def call(chunk: list[int]) -> AnyArray:
        file = None
        if folder is not None:
            file = folder / f"{_digest(inputs, where[chunk], wanted[chunk])}.npy"
            if (kept := _kept(file)) is not None:
                return kept
        rows = _observed(site.observer, where[chunk], lidars, wanted[chunk], frames)
        if file is not None:
            with replacing(file) as beside, beside.open("wb") as stream:
                np.save(stream, rows)
        return rows

    if folder is not None:
        folder.mkdir(parents=True, exist_ok=True)
    # The extension releases the interpreter's lock, so that threads share one site.
    parallel = joblib.Parallel(n_jobs=jobs, backend="threading")
    parts = parallel(joblib.delayed(call)(chunk) for chunk in chunks)
    numbered = []
    for chunk, rows in zip(chunks, parts, strict=True):
        table = pd.DataFrame(rows)
        table.insert(0, "pose", np.array(chunk, dtype=np.int64)[table.pop("at").to_numpy()])
        numbered.append(table)
    return pd.concat(numbered, ignore_index=True)


def _kept(file: Path) -> AnyArray | None:
    """Returns the rows of a finished part, or None for a missing or damaged file."""
    try:
        rows: AnyArray = np.load(file)
    except (OSError, ValueError, EOFError, SyntaxError):  # the header is a Python literal
        return None
    return rows if {"at", "lidar", "frame"} <= {*(rows.dtype.names or ())} else None


def _observed(
    observer: simulation.Observer,
    poses: AnyArray,
    lidars: Sequence[PlanLidar],
    wanted: AnyArray,
    frames: Sequence[int],
) -> AnyArray:
    """Returns the rows of some poses; `at` and `lidar` are numbers of the arguments."""
    parts = []
    for at, pose in enumerate(poses):
        some = np.flatnonzero(wanted[at])
        rows = observer.observe([*pose], [lidars[int(i)].unit for i in some], list(frames))
        kept = np.empty(len(rows), dtype=[("at", np.int32), *rows.dtype.descr])
        for name in rows.dtype.names or ():
            kept[name] = rows[name]
        kept["at"], kept["lidar"] = at, some[rows["lidar"]]
        parts.append(kept)
    return np.concatenate(parts)


def _inputs(
    site: PlanSite, lidars: Sequence[PlanLidar], frames: Sequence[int]
) -> dict[str, object]:
    """Returns all inputs of observations except the poses, with the contents of files."""
    files = [(site.file.parent / name).read_bytes() for name in named_files(site.keys)]
    return {
        "scene": (site.keys, site.preset, site.seed),
        "files": [hashlib.sha256(content).hexdigest() for content in files],
        "lidars": [lidar.unit.dump() for lidar in lidars],
        "frames": [*frames],
        "version": simulation.frames_version(),
    }


def _digest(inputs: dict[str, object], poses: AnyArray, wanted: AnyArray) -> str:
    """Returns a name that changes with anything on which observations depend."""
    text = repr((inputs, poses.tolist(), wanted.tolist()))
    return hashlib.sha256(text.encode()).hexdigest()[:20]
