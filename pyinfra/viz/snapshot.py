"""The drawn content of one frame, read from the folder of a LiDAR."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pyinfra.core.arrays import BoolArray, FloatArray, Points
from pyinfra.core.vocabulary import PERSON_TYPES
from pyinfra.dataset import regions
from pyinfra.dataset.outlines import Drawn
from pyinfra.dataset.roads import read_roads
from pyinfra.dataset.world_frame import to_levelled
from pyinfra.formats import kitti


@dataclass(frozen=True, eq=False)
class Snapshot:
    """The drawn content of one frame of one LiDAR, in its levelled frame."""

    scene: str  # name of the data set's folder
    lidar: kitti.Lidar
    points: Points  # (n, 4) x, y, z, intensity
    objects: kitti.Objects
    region: tuple[FloatArray, ...]  # outlines (n, 2) of the evaluation region; empty if unknown
    holes: tuple[FloatArray, ...]  # outlines (n, 2) of holes in the region
    road_z: float  # z of the road in the levelled LiDAR frame

    def counts(self) -> str:
        if self.lidar.preset == kitti.RECORDED and len(self.objects.names) == 0:
            return f"{len(self.points):,} points"
        on_vehicles = self.objects.points[~self.are_people].sum()
        return f"{len(self.points):,} points, {on_vehicles:,} on vehicles"

    @property
    def are_people(self) -> BoolArray:
        """Returns a (k,) mask of the objects that are pedestrians or cyclists."""
        return np.isin(self.objects.names, PERSON_TYPES)


def read_snapshot(lidar_folder: Path, frame: int) -> Snapshot:
    """Reads a frame. Raises OSError, and the exceptions of the readers in pyinfra.formats.kitti."""
    lidar = kitti.read_lidar(lidar_folder)
    region, road_z = _region(lidar_folder, lidar)
    return Snapshot(
        scene=lidar_folder.parent.name,
        lidar=lidar,
        points=kitti.read_points(kitti.frame_file(lidar_folder, "velodyne", frame)),
        objects=kitti.read_objects(kitti.frame_file(lidar_folder, "objects", frame)),
        region=region.outlines,
        holes=region.holes,
        road_z=road_z,
    )


def _region(lidar_folder: Path, lidar: kitti.Lidar) -> tuple[Drawn, float]:
    """Returns the area of the roads, or of a recording's region file, and the z of the road."""
    outline = lidar_folder / regions.REGION_FILE
    if lidar.preset != kitti.RECORDED or (lidar_folder.parent / "roads.csv").is_file():
        pose = lidar.T_world_levelled
        roads = read_roads(lidar_folder.parent / "roads.csv")
        outlines = [to_levelled(road.outline, pose) for road in roads]
        road_z = float(np.concatenate([road.z for road in roads]).mean() - pose.z)
        return Drawn(tuple(outlines)), road_z
    drawn = regions.read_outline(outline) if outline.is_file() else Drawn(())
    return drawn, -lidar.T_world_levelled.z
