"""Observations of the objects of a site by each pose and LiDAR, without writing point clouds.

An observation is one object in one frame with at least one point: its points and their extents,
its distance from the LiDAR and its visible share. Only rays that may hit an object are cast.
"""

import hashlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import joblib
import numpy as np
import pandas as pd

from pyinfra.core.arrays import AnyArray, BoolArray, FloatArray, IntArray
from pyinfra.core.errors import Error
from pyinfra.core.files import replacing
from pyinfra.dataset import simulation
from pyinfra.experiments.benchmark.inputs import named_files
from pyinfra.experiments.planner.candidates import POSE
from pyinfra.experiments.planner.costs import Costs, PlanLidar
from pyinfra.experiments.planner.detectability import Detectability
from pyinfra.experiments.planner.request import (
    Effort,
    Request,
    can_be_found,
    check_on_roads,
    weighted,
)
from pyinfra.experiments.planner.site import PlanSite

POSES_AT_ONCE = 8


@dataclass(frozen=True, eq=False)
class Setting:
    """The input of the steps of a plan: site, request, and possible poses and LiDARs of options."""

    site: PlanSite
    request: Request
    effort: Effort
    law: Detectability
    costs: Costs
    poses: pd.DataFrame
    lidars: Sequence[PlanLidar]  # LiDARs within the budget


@dataclass(frozen=True, eq=False)
class Objects:
    """The objects of some frames, in the order of `PlanSite.present`, and their weights."""

    table: pd.DataFrame
    weight: FloatArray  # (n,) weight of each object; 0 if the choice ignores the object
    near: BoolArray  # (n,) whether the object lies within the distance of the request
    frame: IntArray  # (n,) index of each object's frame
    frames: int  # number of frames, including frames without an object

    @property
    def near_vehicles(self) -> BoolArray:
        """Which objects are vehicles within the distance of the request: (n,)."""
        return np.asarray(self.near & ~self.table.person.to_numpy(bool))

    @property
    def total(self) -> float:
        """The sum of the weights, above 0."""
        return max(float(self.weight.sum()), 1e-12)


@dataclass(frozen=True, eq=False)
class Observed:
    """Pairs of pose and LiDAR, and the observations of the pairs that were not left out."""

    pairs: pd.DataFrame  # columns pose, lidar, frames, spinning, recall, left_out
    seen: pd.DataFrame  # observations of the pairs that were not left out; has columns pair, object
    objects: Objects

    @property
    def stayed(self) -> pd.DataFrame:
        """The pairs that were not left out, numbered as `pair` in `seen`."""
        return self.pairs[self.pairs.left_out == ""].reset_index(drop=True)


def weighted_objects(
    site: PlanSite, request: Request, law: Detectability, frames: Sequence[int]
) -> Objects:
    """Returns the objects of some frames.

    Objects beyond the distance of the request have weight 0. So do people if the detector does not
    detect people.
    """
    table = site.present[site.present.frame.isin(frames)].reset_index(drop=True)
    near = site.is_near(table, request.within_m)
    weight = weighted(table, near, request.people, request.areas) * can_be_found(table, law)
    order = pd.Series(range(len(frames)), index=list(frames))
    return Objects(table, weight, near, order[table.frame].to_numpy(), len(frames))


def check_site(
    site: PlanSite, request: Request, law: Detectability, check_frames: int, *, drawn: bool
) -> None:
    """Raises Error if no object has a weight above 0, or if an area of the user is off all roads.

    Also raises Error if the check leaves no frames from which `background` can learn. drawn:
    whether the user gave the areas.
    """
    if drawn:
        check_on_roads(request.areas, site.roads)
    objects = weighted_objects(site, request, law, site.frames)
    if objects.weight.sum() == 0 or not objects.near_vehicles.any():
        vehicles, (x, y) = objects.table[~objects.table.person], site.centre
        away = np.hypot(vehicles.x - x, vehicles.y - y)
        nearest = f"; the nearest is {away.min():.0f} m away" if len(away) else ""
        raise Error(
            f"within_m: expected vehicles within {request.within_m:g} m of ({x:.0f}, {y:.0f}), "
            f"got none in {len(site.frames)} frames{nearest}"
        )
    all_used = len(site.other_frames(check_frames)) >= site.every_frame
    if request.detector == "background" and check_frames and all_used:
        raise Error(
            f"check_frames: expected fewer than the {site.every_frame} frames of the scene, got "
            f"{check_frames}; the detector background learns from the other frames"
        )


def joined(rows: pd.DataFrame, pairs: pd.DataFrame, objects: Objects) -> pd.DataFrame:
    """Adds the columns pair, object, type, speed and spinning to the observations `rows`."""
    index = pd.Series(pairs.index, index=pd.MultiIndex.from_frame(pairs[["pose", "lidar"]]))
    pair = index.reindex(pd.MultiIndex.from_frame(rows[["pose", "lidar"]])).to_numpy()
    table = objects.table[["frame", "id", "type", "speed"]].assign(object=objects.table.index)
    rows = rows.drop(columns=["pose", "lidar"])
    rows = rows.assign(pair=pair, spinning=pairs.spinning.to_numpy()[pair])
    return rows.merge(table, on=["frame", "id"], how="inner")


def observed_again(
    setting: Setting, site: PlanSite, stayed: pd.DataFrame, units: Iterable[int]
) -> Observed:
    """Observes units in the frames of `site`. The choice must not have used these frames.

    The share that an option finds in the frames of the choice is too high on average, because the
    options were selected for it. stayed: pose and lidar of each unit. Units have the same numbers
    in the result as in `stayed`.
    """
    some = stayed.iloc[sorted(set(units))]
    wanted = np.zeros((len(setting.poses), len(setting.lidars)), bool)
    wanted[some.pose, some.lidar] = True
    rows = observe(
        site, setting.poses, setting.lidars, wanted, site.frames,
        jobs=setting.effort.jobs, folder=setting.effort.observations,
    )  # fmt: skip
    objects = weighted_objects(site, setting.request, setting.law, site.frames)
    return Observed(stayed, joined(rows, stayed, objects), objects)


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
    that an interrupted call resumes. Columns: pose, lidar (indices in the arguments), frame, id,
    points, along, across, up (extents in metres), distance (m), visibility (0 to 1).
    """
    tasks = np.flatnonzero(wanted.any(axis=1))
    where = poses[POSE].to_numpy(float)
    inputs = _inputs(site, lidars, frames)
    chunks = [tasks[i : i + POSES_AT_ONCE] for i in range(0, len(tasks), POSES_AT_ONCE)]

    def call(chunk: IntArray) -> AnyArray:
        some = where[chunk], wanted[chunk]
        if folder is None:
            return _observed(site.observer, some[0], lidars, some[1], frames)
        # The file name is a hash of all inputs, so that different inputs have different files.
        text = repr((inputs, *(one.tolist() for one in some)))
        file = folder / f"{hashlib.sha256(text.encode()).hexdigest()[:20]}.npy"
        rows = _kept(file)
        if rows is None:
            rows = _observed(site.observer, some[0], lidars, some[1], frames)
            with replacing(file) as beside, beside.open("wb") as stream:
                np.save(stream, rows)
        return rows

    if folder is not None:
        folder.mkdir(parents=True, exist_ok=True)
    # The extension releases the interpreter's lock, so that threads share one site.
    parallel = joblib.Parallel(n_jobs=jobs, backend="threading")
    parts = list(parallel(joblib.delayed(call)(chunk) for chunk in chunks))
    poses_of_rows = [chunk[rows["at"]] for chunk, rows in zip(chunks, parts, strict=True)]
    table = pd.concat(map(pd.DataFrame, parts), ignore_index=True).drop(columns="at")
    table.insert(0, "pose", np.concatenate(poses_of_rows))
    return table


def _kept(file: Path) -> AnyArray | None:
    """Returns the rows of a finished part, or None for a missing or damaged file."""
    try:
        rows: AnyArray = np.load(file)
    except (OSError, ValueError, EOFError, SyntaxError):  # NumPy parses a header as Python code
        return None
    return rows if {"at", "lidar", "frame"} <= {*(rows.dtype.names or ())} else None


def _observed(
    observer: simulation.Observer,
    poses: AnyArray,
    lidars: Sequence[PlanLidar],
    wanted: AnyArray,
    frames: Sequence[int],
) -> AnyArray:
    """Returns the observations of some poses; `at`, `lidar`: indices in `poses` and `lidars`."""
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
    files = [site.file.parent / name for name in named_files(site.keys)]
    return {
        "scene": (site.keys, site.preset, site.seed),
        "files": [hashlib.sha256(file.read_bytes()).hexdigest() for file in files],
        "lidars": [lidar.unit.dump() for lidar in lidars],
        "frames": [*frames],
        "version": simulation.frames_version(),
    }
