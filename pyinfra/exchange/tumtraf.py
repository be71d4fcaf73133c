"""Reads TUMTraf: a folder of .pcd clouds of one LiDAR, and OpenLABEL files of the same names.

The reader follows TUMTraf's public development kit. A label file contains one frame. The ten
numbers of a cuboid are x y z, quaternion x y z w, and length width height, in the frame of the
cloud. The cloud is tilted like the LiDAR, so the import estimates the road from the points.
"""

from pathlib import Path

from pyinfra.exchange.cuboids import read_cuboids
from pyinfra.exchange.label_files import paired_labels
from pyinfra.exchange.pcd import Clouds
from pyinfra.exchange.recording import Options, Recording, selected, sorted_files

CLOUDS = ("point_clouds", "_point_clouds", "_points_clouds", "_points")
LABELS = ("labels_point_clouds", "_labels_point_clouds", "_labels")


def read(source: Path, options: Options) -> Recording:
    """Opens a folder of clouds, or the folder that contains both clouds and labels.

    A folder of clouds is, for example, point_clouds/s110_lidar_ouster_south.
    `options.channel` selects one of several LiDARs. Raises FileNotFoundError, and Error for labels
    that do not pair with clouds or if no LiDAR is selected. Reading a frame raises FormatError.
    """
    folder = _cloud_folder(source, options.channel)
    clouds = sorted_files(folder, [".pcd"])
    ids: dict[str, int] = {}
    labels = paired_labels(
        clouds, options.labels or _label_folder(folder), lambda file: read_cuboids(file, ids)
    )
    return Clouds(labels, options).recording()


def _cloud_folder(source: Path, channel: str | None) -> Path:
    inside = next((source / name for name in CLOUDS if (source / name).is_dir()), None)
    if inside is None:
        return source
    lidars = sorted(folder for folder in inside.iterdir() if folder.is_dir())
    if not lidars:
        return inside
    return lidars[selected(inside, [folder.name for folder in lidars], channel)]


def _label_folder(clouds: Path) -> Path | None:
    """Returns the folder of the labels beside the folder of the clouds; None if there is none."""
    places = ((clouds.parent.parent, clouds.name), (clouds.parent, ""))
    folders = (top / name / inside for top, inside in places for name in LABELS)
    return next((folder for folder in folders if folder.is_dir()), None)
