"""The ground-truth objects in the frames of one LiDAR, and which of them count."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from pyinfra.core.arrays import BoolArray, FloatArray, concatenated
from pyinfra.core.errors import Error
from pyinfra.core.vocabulary import Subset
from pyinfra.dataset import regions
from pyinfra.dataset.data_set import MIN_VISIBILITY, field_of_view_mask, is_of_lanes, read_lidars
from pyinfra.dataset.frame_readers import read_vehicles
from pyinfra.dataset.frame_sequence import FrameSequence, RecordedFrames
from pyinfra.dataset.frame_tables import Vehicles
from pyinfra.dataset.frames import PERIOD_S, data_set_of, frame_numbers
from pyinfra.dataset.outlines import Drawn, read_outlines
from pyinfra.dataset.roads import Places, Road, by_distance, locate, read_roads
from pyinfra.dataset.simulated_frames import SimulatedFrames
from pyinfra.dataset.trajectories import read_objects_at
from pyinfra.dataset.windows import (
    GridCell,
    Window,
    distance_windows,
    lane_windows,
    region_cells,
    road_windows,
)
from pyinfra.dataset.world_frame import to_world
from pyinfra.formats import kitti


@dataclass(frozen=True, eq=False)
class GroundTruth:
    """The objects in the frames of one LiDAR, and data that decide which ones are evaluated."""

    folder: Path
    name: str
    period_s: float
    frames: tuple[int, ...]  # frame numbers, ascending; `vehicles.frame` has indices into `frames`
    vehicles: Vehicles  # all vehicles, whether they are evaluated or not
    has_objects: bool  # if False, vehicles are the labels, and only `captured` can be evaluated
    lidar: kitti.Lidar | None  # None if the folder has no lidar.yaml
    neighbours: tuple[tuple[kitti.Lidar, kitti.Tilt], ...]  # LiDARs of the data set and their tilts
    roads: tuple[Road, ...]  # empty if the data set has no roads.csv
    outlines: tuple[FloatArray, ...]  # outlines that narrow the region, world frame
    drawn: Drawn | None  # area drawn by the user, if there are no roads; levelled LiDAR frame
    of_lanes: bool  # whether each road is one lane, read from a file of lanes
    versions: tuple[str, str] | None = None  # frames_version and version, for frames in memory

    @property
    def has_region(self) -> bool:
        return bool(self.roads) or self.drawn is not None

    def places(self, boxes: FloatArray, beside_m: float = 0.0) -> Places:
        """Returns where boxes (n, 7) of the levelled LiDAR frame lie on the roads.

        beside_m: width in metres that is added to each side of the roads.
        """
        if not self.roads or self.lidar is None:
            return by_distance(boxes, self.drawn, margin_m=beside_m)
        roads = [replace(road, half_width=road.half_width + beside_m) for road in self.roads]
        return locate(to_world(boxes, self.lidar.T_world_levelled), roads, self.outlines)

    def windows(self) -> list[Window]:
        """Returns the windows along the roads, or rings around the sensor if there are no roads."""
        if self.of_lanes:
            return lane_windows(self.roads)
        if self.roads:
            return road_windows(self.roads)
        distance = np.hypot(self.vehicles.mid_frame[:, 0], self.vehicles.mid_frame[:, 1])
        return distance_windows(float(distance.max(initial=0)))

    def cells(self) -> list[GridCell]:
        """Returns the grid cells that are the areas of a site of lanes; empty for other sites.

        At other sites, the areas are the windows along the roads.
        """
        return region_cells(self.roads, self.outlines) if self.of_lanes else []

    def counted(
        self, which: Subset, vehicles: Vehicles, places: Places, min_points: int
    ) -> BoolArray:
        """Returns which vehicles are in a ground-truth subset: (n,) bool.

        places: positions of the vehicles. Raises Error for a subset that needs objects if the
        folder has none.
        """
        if which == "captured":
            return places.inside & (vehicles.points >= min_points)
        if not self.has_objects:
            raise Error(
                f"{self.folder}: expected a folder `objects`, got none; without it, only the "
                "ground-truth subset `captured` can be evaluated"
            )
        if which == "present":
            return places.inside
        visible = places.inside & (vehicles.visibility >= MIN_VISIBILITY)
        return visible & self.in_common_view(vehicles.mid_frame) if which == "common" else visible

    def in_common_view(self, boxes: FloatArray) -> BoolArray:
        """Returns which centres are in the field of view and range of all LiDARs: (n,) bool."""
        in_view = np.ones(len(boxes), dtype=np.bool_)
        for lidar, tilt in self.neighbours:
            in_view &= field_of_view_mask(lidar, tilt, boxes[:, :3])[1]
        return in_view


def read_ground_truth(
    folder: Path, frames: Sequence[int] | None = None, *, beyond_range: bool = False
) -> GroundTruth:
    """Reads the ground truth of a folder in the KITTI layout, from `infrasim` or any other tool.

    frames: frame numbers to read; by default `frame_numbers(folder)`. beyond_range: whether to add
    the vehicles beyond the range of this LiDAR. These vehicles are read from the folder of the
    LiDAR with the longest range, then from trajectories.csv. Raises FileNotFoundError, FormatError
    with file and line, and Error if there is no frame.
    """
    frames = sorted(frame_numbers(folder) if frames is None else frames)
    if not frames:
        raise Error(f"{folder}: expected one or more frames to evaluate, got none")
    has_lidar = (folder / "lidar.yaml").is_file()
    lidar = kitti.read_lidar(folder) if has_lidar else None
    data_set = data_set_of(folder)
    neighbours = read_lidars(data_set) if has_lidar else ()
    vehicles = read_vehicles(folder, frames)
    has_objects = (folder / "training/objects").is_dir()
    if beyond_range and has_objects and lidar is not None:
        farthest = max((_reach(other), other.name) for other, _ in neighbours)
        if farthest[0] > _reach(lidar):
            vehicles = with_unreached(vehicles, read_vehicles(data_set / farthest[1], frames))
        if (trajectories := data_set / "trajectories.csv").is_file():
            pose = lidar.T_world_levelled
            absent = read_objects_at(trajectories, frames, pose, lidar.period_s)
            vehicles = _with(vehicles, absent)
    file = data_set / "roads.csv"
    roads = tuple(read_roads(file)) if lidar and file.is_file() else ()
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
    """Returns the ground truth of frames in memory or in a folder.

    Raises the same exceptions as read_ground_truth.
    """
    if isinstance(frames, RecordedFrames):
        return read_ground_truth(frames.folder, frames.numbers, beyond_range=True)
    if not isinstance(frames, SimulatedFrames):
        raise Error(f"frames: expected a sequence of frames, got {type(frames).__name__}")
    if not frames.numbers:
        raise Error("frames: expected one or more frames to evaluate, got none")
    vehicles = frames.vehicles()
    sequences = [frames, *frames.beside.values()]
    farthest = max(sequences, key=lambda sequence: (_reach(sequence.lidar), sequence.name))
    if _reach(farthest.lidar) > _reach(frames.lidar):
        vehicles = with_unreached(vehicles, farthest.of(frames.numbers).vehicles())
    return GroundTruth(
        folder=Path(frames.name),
        name=frames.name,
        period_s=frames.lidar.period_s,
        frames=frames.numbers,
        vehicles=_with(vehicles, frames.everybody()),
        has_objects=True,
        lidar=frames.lidar,
        neighbours=tuple(
            (sequence.lidar, sequence.tilt)
            for sequence in sorted(sequences, key=lambda sequence: sequence.name)
        ),
        roads=frames.roads,
        outlines=frames.outlines,
        drawn=None,
        of_lanes=frames.of_lanes,
        versions=frames.versions,
    )


def _reach(lidar: kitti.Lidar) -> float:
    return max(unit.range_m[1] for unit in lidar.field_of_view)


def with_unreached(vehicles: Vehicles, others: Vehicles) -> Vehicles:
    """Returns `vehicles`, plus the rows of `others` in the region that are not in `vehicles`.

    For the added vehicles, `points` is 0 and `boxes` holds the boxes at mid-frame.
    """
    return _with(vehicles, others.select(others.visibility >= 0))


def _unknown(vehicles: Vehicles, others: Vehicles) -> BoolArray:
    """Returns which rows of `others` have no row of the same frame and id in `vehicles`: (n,).

    A row of `others` without an id (-1) is always returned.
    """
    base = 2 + max(vehicles.ids.max(initial=0), others.ids.max(initial=0))
    keys, known = (v.frame * base + v.ids + 1 for v in (others, vehicles))
    return ~np.isin(keys, known) | (others.ids < 0)


def _with(vehicles: Vehicles, others: Vehicles) -> Vehicles:
    """Returns `vehicles`, plus the rows of `others` that are not in `vehicles`, ordered by frame.

    For the added vehicles, `points` is 0 and `boxes` holds the boxes at mid-frame.
    """
    extra = others.select(_unknown(vehicles, others))
    added = replace(extra, points=np.zeros_like(extra.points), boxes=extra.mid_frame)
    joined = concatenated([vehicles, added])
    return joined.select(np.argsort(joined.frame, kind="stable"))
