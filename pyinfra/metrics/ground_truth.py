"""The vehicles to be found in the frames of one LiDAR, and which of them count."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from pyinfra.core.arrays import BoolArray, FloatArray
from pyinfra.core.errors import Error
from pyinfra.core.vocabulary import Subset
from pyinfra.dataset import regions
from pyinfra.dataset.data_set import MIN_VISIBILITY, field_of_view_mask, is_of_lanes, read_lidars
from pyinfra.dataset.frame_sequence import FrameSequence, RecordedFrames, SimulatedFrames
from pyinfra.dataset.frame_tables import Vehicles, read_vehicles
from pyinfra.dataset.frames import PERIOD_S, data_set_of, frame_numbers
from pyinfra.dataset.outlines import read_outlines
from pyinfra.dataset.regions import GridCell, Places, Road, Window
from pyinfra.dataset.trajectories import read_objects_at
from pyinfra.formats import kitti


@dataclass(frozen=True, eq=False)
class GroundTruth:
    """What is known of the frames of one LiDAR."""

    folder: Path
    name: str
    period_s: float
    frames: tuple[int, ...]  # ascending; `vehicles.frame` counts along them
    vehicles: Vehicles  # every one in reach, counted or not
    has_objects: bool  # False: the vehicles are the labels, and only `captured` can be told
    lidar: kitti.Lidar | None  # None without lidar.yaml
    neighbours: tuple[tuple[kitti.Lidar, kitti.Tilt], ...]  # every LiDAR of the data set
    roads: tuple[Road, ...]  # empty without roads.csv: then there is no region
    outlines: tuple[FloatArray, ...]  # that narrow the region, world
    drawn: FloatArray | None  # (m, 2) levelled: the region where no roads are known
    of_lanes: bool  # the roads are lanes of a file, each a road of its own
    versions: tuple[str, str] | None = None  # of frames in memory: their number, the package's

    @property
    def has_region(self) -> bool:
        return bool(self.roads) or self.drawn is not None

    def places(self, boxes: FloatArray, beside_m: float = 0.0) -> Places:
        """Where boxes (n, 7) of the levelled LiDAR frame lie; beside_m makes the roads wider."""
        if not self.roads or self.lidar is None:
            return regions.by_distance(boxes, self.drawn, margin_m=beside_m)
        roads = [replace(road, half_width=road.half_width + beside_m) for road in self.roads]
        world = regions.to_world(boxes, self.lidar.T_world_levelled)
        return regions.locate(world, roads, self.outlines)

    def windows(self) -> list[Window]:
        """The windows of distance: along the roads, or away from the sensor without roads."""
        if self.of_lanes:
            return regions.lane_windows(self.roads)
        if self.roads:
            return regions.road_windows(list(self.roads))
        distance = np.hypot(self.vehicles.mid_frame[:, 0], self.vehicles.mid_frame[:, 1])
        return regions.distance_windows(float(distance.max(initial=0)))

    def cells(self) -> list[GridCell]:
        """The areas where no road has an axis, as of lanes; none where windows are the areas."""
        return regions.region_cells(self.roads, self.outlines) if self.of_lanes else []

    def counted(
        self, which: Subset, vehicles: Vehicles, places: Places, min_points: int
    ) -> BoolArray:
        """Which of some vehicles (n,), with their places, are to be found.

        Raises Error for a set that this folder cannot tell.
        """
        if which == "captured":
            return places.inside & (vehicles.points >= min_points)
        if not self.has_objects:
            raise Error(f"{self.folder}: found no objects, allowed ground truth: captured")
        if which == "present":
            return places.inside
        visible = places.inside & (vehicles.visibility >= MIN_VISIBILITY)
        return visible & self.in_common_view(vehicles.mid_frame) if which == "common" else visible

    def in_common_view(self, boxes: FloatArray) -> BoolArray:
        """Centres (n,) inside the field of view and range of every LiDAR of the data set."""
        seen = np.ones(len(boxes), dtype=np.bool_)
        for lidar, tilt in self.neighbours:
            seen &= field_of_view_mask(lidar, tilt, boxes[:, :3])[1]
        return seen


def read_ground_truth(
    folder: Path, frames: Sequence[int] | None = None, *, beyond_range: bool = False
) -> GroundTruth:
    """Reads the frames of a folder in the KITTI layout: of a run of `infrasim`, or any other.

    frames: those to read, `frame_numbers(folder)` if left out. beyond_range: with the vehicles that
    this LiDAR does not reach: what another one of the data set knows of them, else where they are.
    Raises FileNotFoundError, FormatError with file and line, and Error without any frame.
    """
    frames = sorted(frame_numbers(folder) if frames is None else frames)
    if not frames:
        raise Error(f"{folder}: found no frame to evaluate, allowed one or more")
    has_lidar = (folder / "lidar.yaml").is_file()
    lidar = kitti.read_lidar(folder) if has_lidar else None
    data_set = data_set_of(folder)
    neighbours = read_lidars(data_set) if has_lidar else ()
    vehicles = read_vehicles(folder, frames)
    has_objects = (folder / "training/objects").is_dir()
    if beyond_range and has_objects and lidar is not None:
        farthest = max((_reach(other), other.name) for other, _ in neighbours)
        if farthest[0] > _reach(lidar):
            others = read_vehicles(data_set / farthest[1], frames)
            vehicles = with_unreached(vehicles, others)
        vehicles = with_absent(vehicles, data_set / "trajectories.csv", frames, lidar)
    file = data_set / "roads.csv"
    roads = tuple(regions.read_roads(file)) if lidar and file.is_file() else ()
    return GroundTruth(
        folder=folder,
        name=lidar.name if lidar else folder.name,
        period_s=lidar.period_s if lidar else PERIOD_S,
        frames=tuple(frames),
        vehicles=vehicles,
        has_objects=has_objects,
        lidar=lidar,
        neighbours=neighbours,
        roads=roads,
        outlines=read_outlines(data_set),
        drawn=None if roads else regions.drawn_outline(folder),
        of_lanes=bool(roads) and is_of_lanes(data_set),
    )


def ground_truth_of(frames: FrameSequence) -> GroundTruth:
    """That of frames in memory, or of those of a folder; raises as read_ground_truth."""
    if isinstance(frames, RecordedFrames):
        return read_ground_truth(frames.folder, frames.numbers, beyond_range=True)
    if not isinstance(frames, SimulatedFrames):
        raise Error(f"frames: expected a sequence of frames, got {type(frames).__name__}")
    vehicles = frames.vehicles()
    every = [frames, *frames.beside.values()]
    farthest = max(every, key=lambda one: (_reach(one.lidar), one.name))
    if _reach(farthest.lidar) > _reach(frames.lidar):
        vehicles = with_unreached(vehicles, farthest.of(frames.numbers).vehicles())
    everybody = frames.everybody()
    return GroundTruth(
        folder=Path(frames.name),
        name=frames.name,
        period_s=frames.lidar.period_s,
        frames=frames.numbers,
        vehicles=_with(vehicles, everybody.select(_unknown(vehicles, everybody))),
        has_objects=True,
        lidar=frames.lidar,
        neighbours=tuple((one.lidar, one.tilt) for one in sorted(every, key=lambda one: one.name)),
        roads=frames.roads,
        outlines=frames.outlines,
        drawn=None,
        of_lanes=frames.of_lanes,
        versions=frames.versions,
    )


def _reach(lidar: kitti.Lidar) -> float:
    return max(unit.range_m[1] for unit in lidar.field_of_view)


def with_unreached(vehicles: Vehicles, others: Vehicles) -> Vehicles:
    """Own vehicles, and those of the region that only the others have.

    These have 0 points, so that they are labelled at mid-frame.
    """
    return _with(vehicles, others.select(_unknown(vehicles, others) & (others.visibility >= 0)))


def with_absent(
    vehicles: Vehicles, file: Path, frames: Sequence[int], lidar: kitti.Lidar
) -> Vehicles:
    """Own vehicles, and those that trajectories.csv has beside them."""
    if not file.is_file():
        return vehicles
    others = read_objects_at(file, frames, lidar.T_world_levelled)
    return _with(vehicles, others.select(_unknown(vehicles, others)))


def _unknown(vehicles: Vehicles, others: Vehicles) -> BoolArray:
    """Which of the others (n,) are not among the own ones."""
    base = 1 + max(vehicles.ids.max(initial=0), others.ids.max(initial=0))
    return ~np.isin(others.frame * base + others.ids, vehicles.frame * base + vehicles.ids)


def _with(vehicles: Vehicles, extra: Vehicles) -> Vehicles:
    """Both, by frame; the extra ones without points and with their boxes at mid-frame."""
    columns = {
        name: np.concatenate([vars(vehicles)[name], vars(extra)[name]]) for name in vars(vehicles)
    }
    columns["points"][len(vehicles) :] = 0
    columns["boxes"][len(vehicles) :] = extra.mid_frame
    joined = Vehicles(**columns)
    order = np.argsort(joined.frame, kind="stable")
    return Vehicles(**{name: column[order] for name, column in vars(joined).items()})
