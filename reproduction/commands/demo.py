"""Rebuilds the paper's table of hit points, and simulates and draws frames of each scene."""

import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from pyinfra.core.arrays import FloatArray
from pyinfra.dataset.catalogue import LIDARS, SCENES, lidar_file, scene_file
from pyinfra.dataset.runs import SimulatorError, infrasim
from pyinfra.formats import kitti
from pyinfra.viz import clouds
from pyinfra.viz.pattern_picture import pattern_picture
from pyinfra.viz.picture_style import save
from reproduction.arguments import command
from reproduction.hit_points import PRESET, hit_table, table_text, write_table
from reproduction.simulate import simulate

# part of the simulator's error message for a folder that was written with another configuration
ANOTHER_RUN = "holds another run"
PATTERN_FRAMES = "0:20"


@command
def main(*, out: Path = Path("out/demo"), frames: str = "0:3") -> None:
    """Rebuilds the paper's table of hit points, simulates a few frames of each scene and makes
    pictures of them.

    example: python -m reproduction demo --out out/demo --frames 0:3

    Parameters
    ----------
    out : output folder (default: %(default)s)
    frames : frames to write, from A to B without B, A:B[:STEP]; the pictures show the first
        frame (default: %(default)s)
    """
    start = time.perf_counter()

    def progress(step: str) -> None:
        print(f"[{time.perf_counter() - start:5.1f} s] {step}", file=sys.stderr, flush=True)

    lidars = [lidar_file(name) for name in LIDARS]
    scenes = [scene_file(name) for name in SCENES]
    data = [out / "data" / name for name in SCENES]
    for scene, folder in zip(scenes, data, strict=True):
        progress(f"frames {frames} of {scene.stem}")
        try:
            simulate(scene, lidars, folder, preset=PRESET, frames=frames, fields=True)
        except SimulatorError as error:
            if ANOTHER_RUN not in str(error):
                raise
            advice = f"remove {folder} or choose another --out"
            raise SimulatorError(f"{error}; {advice}", error.exit_code) from None
    table = hit_table(scenes, lidars, cache=out / "summaries", progress=progress)
    write_table(table, out / "hit_points.csv")
    print(table_text(table), flush=True)

    progress("pictures")
    data_sets = [[folder / lidar for lidar in LIDARS] for folder in data]
    first = int(frames.split(":")[0])
    pictures = clouds.draw_frames(data_sets, first, out / "pictures")
    patterns = {
        kitti.read_lidar(folder).model: scan_pattern(lidar_file(folder.name))
        for folder in data_sets[0]
    }
    read = [kitti.read_lidar(folder) for folder in data_sets[0]]
    periods_s = {lidar.model: lidar.period_s for lidar in read}
    pictures.append(out / "pictures/patterns.png")
    save(pattern_picture(patterns, periods_s), pictures[-1])
    progress("done")
    print(f"\nhit points   {out / 'hit_points.csv'}\nframes       {out / 'data'}")
    for file in pictures:
        print(f"picture      {file}")


def scan_pattern(lidar: Path) -> FloatArray:
    """Returns azimuth, elevation (rad) and time (s) of every ray of PATTERN_FRAMES.

    The result is (n, 3) in the sensor frame. Raises SimulatorError.
    """
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "pattern.npy"
        infrasim("pattern", lidar, "--preset", PRESET, "--frames", PATTERN_FRAMES, "--out", file)
        rays: FloatArray = np.load(file)
    return rays
