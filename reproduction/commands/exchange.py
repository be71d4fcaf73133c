"""Measures the speed of every export and import on one core, with 100 frames of four LiDARs.

The command writes out/exchange.csv:

    python -m reproduction exchange

The column of seconds is the sum of user and system CPU time. It equals the wall time on an idle
machine whose disk is fast enough. All files are in the page cache. The column of megabytes is the
size of the written files.
"""

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

os.environ["OMP_NUM_THREADS"] = "1"  # must be set before numpy is imported

import pandas as pd

from pyinfra.dataset.frames import frame_numbers
from pyinfra.exchange.data_set import LidarFacts
from pyinfra.exchange.exports import export
from pyinfra.exchange.formats import EXPORTS, IMPORTS
from pyinfra.exchange.imports import import_recording
from pyinfra.exchange.rates import size_of
from pyinfra.exchange.recording import Options
from reproduction import ROOT, provenance
from reproduction.arguments import Out, command

LIDARS = ("ruby_plus", "livox_avia", "pandar_64", "helios_16")
READ = [name for name in IMPORTS if name in ("kitti", *EXPORTS)]  # formats both written and read
Row = dict[str, object]


def simulate(folder: Path, frames: int) -> None:
    """Simulates frames with all fields; raises CalledProcessError."""
    lidars = [f"configs/lidars/{name}.yaml" for name in LIDARS]
    command = [Path(sys.executable).with_name("infrasim"), "run", "configs/scenes/highway.yaml"]
    command += ["--lidar", *lidars, "--preset", "paper", "--frames", f"0:{frames}"]
    command += ["--set", "fields=true", "--out", folder]
    subprocess.run([str(word) for word in command], cwd=ROOT, check=True, capture_output=True)


def rows(data: Path, folder: Path) -> Iterator[Row]:
    """Yields a row for each LiDAR, format and direction (export or import)."""
    for lidar in LIDARS:
        source = data / lidar
        frames = frame_numbers(source, "all")
        for name in EXPORTS:
            out = folder / f"{lidar}-{name}"
            seconds = timed(partial(export, source, frames, name, out))
            yield row("export", name, lidar, len(frames), out, seconds)
        for name in READ:
            recording = source if name == "kitti" else folder / f"{lidar}-{name}"
            out = folder / f"{lidar}-from-{name}" / lidar
            facts = LidarFacts(lidar, "highway")
            seconds = timed(partial(import_recording, recording, name, out, facts, Options()))
            yield row("import", name, lidar, len(frames), out, seconds)


def warm_up(folder: Path) -> None:
    """Runs each conversion once on two frames, so that no timing includes imports of modules."""
    simulate(folder / "few", 2)
    list(rows(folder / "few", folder / "warm"))


def timed(work: Callable[[], object]) -> float:
    start = time.process_time()
    work()
    return time.process_time() - start


def row(way: str, name: str, lidar: str, frames: int, out: Path, seconds: float) -> Row:
    megabytes = size_of(out) / 1e6
    return {
        "way": way,
        "format": name,
        "lidar": lidar,
        "frames": frames,
        "megabytes": megabytes,
        "frames_per_s": frames / seconds,
        "megabytes_per_s": megabytes / seconds,
    }


@command
def main(*, out: Out = Path("exchange.csv"), frames: int = 100) -> None:
    """
    Parameters
    ----------
    frames : number of frames per LiDAR (default: %(default)s)
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        simulate(folder / "data", frames)
        warm_up(folder)
        table = pd.DataFrame(list(rows(folder / "data", folder / "out")))
    described = table.assign(seed=1, **provenance("exchange"))
    described.to_csv(out, index=False, float_format="%.4g")
    print(table.to_string(index=False, float_format="%.4g"))
