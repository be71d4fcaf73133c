"""Rebuilds the paper's table of hit points, and simulates and draws frames of each scene."""

import sys
import time
from pathlib import Path

from pyinfra.dataset import simulation
from pyinfra.dataset.catalogue import LIDARS, SCENES, lidar_file, scene_file
from pyinfra.dataset.runs import SimulatorError
from pyinfra.formats import kitti
from pyinfra.viz import clouds
from pyinfra.viz.pattern_picture import pattern_picture
from pyinfra.viz.picture_style import save
from reproduction.arguments import command
from reproduction.hit_points import PRESET, hit_table, table_text, write_table
from reproduction.simulate import simulate

# part of the simulator's error message for a folder that was written with another configuration
ANOTHER_RUN = "holds another run"
PATTERN_FRAMES = range(20)


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
    table = hit_table(scenes, lidars, progress=progress)
    write_table(table, out / "hit_points.csv")
    print(table_text(table), flush=True)

    progress("pictures")
    data_sets = [[folder / lidar for lidar in LIDARS] for folder in data]
    first = int(frames.split(":")[0])
    pictures = clouds.draw_frames(data_sets, first, out / "pictures")
    sheets = {name: kitti.read_lidar(data[0] / name) for name in LIDARS}
    patterns = {
        sheet.model: simulation.scan_pattern(lidar_file(name), PATTERN_FRAMES, preset=PRESET)
        for name, sheet in sheets.items()
    }
    periods_s = {sheet.model: sheet.period_s for sheet in sheets.values()}
    pictures.append(out / "pictures/patterns.png")
    save(pattern_picture(patterns, periods_s), pictures[-1])
    progress("done")
    print(f"\nhit points   {out / 'hit_points.csv'}\nframes       {out / 'data'}")
    for file in pictures:
        print(f"picture      {file}")
