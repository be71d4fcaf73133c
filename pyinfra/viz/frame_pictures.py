"""Draws pictures of data sets for `pyinfra pictures DATA...`."""

from collections.abc import Sequence
from pathlib import Path

from pyinfra.core.errors import Error
from pyinfra.dataset.frames import lidar_folders
from pyinfra.formats import kitti
from pyinfra.viz import clouds
from pyinfra.viz import cutouts as cutout_figures
from pyinfra.viz import scene_pictures as scene_figures
from pyinfra.viz.picture_style import save


def draw_pictures(data: Sequence[Path], frame: int | None, out: Path) -> list[Path]:
    """Writes all pictures of one frame of data sets, and returns the files.

    frame: by default the first frame of the first data set. Raises Error for a frame that a data
    set does not have.
    """
    data_sets = [lidar_folders(folder) for folder in data]
    for folders in data_sets:
        existing = kitti.frames(folders[0])
        if frame is None:
            frame = next(iter(existing), 0)
        if frame not in existing:
            raise Error(f"frame: expected {kitti.extent(existing)}, got {frame}: see {folders[0]}")
    files = clouds.draw_frames(data_sets, frame or 0, out)
    return files + draw_scenes(data_sets, frame or 0, out)


def draw_scenes(data_sets: Sequence[Sequence[Path]], frame: int, out: Path) -> list[Path]:
    """Writes the plan and the cut-outs of each data set, and returns the files.

    data_sets: the LiDAR folders of each data set. Recordings are skipped, because their scene is
    unknown. Raises OSError and FormatError.
    """
    out.mkdir(parents=True, exist_ok=True)
    files = []
    for folders in data_sets:
        if kitti.read_lidar(folders[0]).preset == kitti.RECORDED:
            continue
        scene = scene_figures.read_scene(folders)
        name = folders[0].parent.name
        files += [out / f"plan_{name}.png", out / f"cutouts_{name}.png"]
        save(scene_figures.plan(scene), files[-2])
        save(cutout_figures.cutouts(scene, frame), files[-1])
    return files
