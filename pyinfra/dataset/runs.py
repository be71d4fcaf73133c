"""Runs of the `infrasim` binary."""

import hashlib
import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from pyinfra.core.arrays import FloatArray
from pyinfra.dataset import launch
from pyinfra.formats.csv_table import read_csv

PRESET = "paper"
FRAMES = "0:5000:25"
SUMMARY_COLUMNS = ("lidar", "frames", "hits_per_frame")


class SimulatorError(RuntimeError):
    """The binary is missing or failed; `exit_code` is 2 for a wrong configuration, else 1."""

    def __init__(self, message: str, exit_code: int) -> None:
        super().__init__(message)
        self.exit_code = exit_code


def infrasim(*words: str | Path) -> str:
    """Runs the binary and returns what it printed.

    Raises SimulatorError with the binary's own message, or if there is no binary.
    """
    binary = launch.binary()
    if binary is None:
        raise SimulatorError("infrasim: no binary; run `make build` or install the wheel", 1)
    done = subprocess.run([binary, *words], capture_output=True, text=True, check=False)
    if done.returncode != 0:
        last = (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1]
        raise SimulatorError(f"infrasim {words[0]}: {last}", 2 if done.returncode == 2 else 1)
    return done.stdout


def simulate(scene: Path, lidars: Sequence[Path], frames: str, out: Path) -> None:
    """Writes frames with `fields` in the `paper` preset; frames that are there stay as they are.

    frames: A:B[:STEP], B excluded. out: data set folder, see pyinfra.formats.kitti.
    Raises SimulatorError, also if the folder holds another run.
    """
    infrasim(*_run(scene, lidars, frames), "--out", out, "--fields")


def hits_per_frame(
    scene: Path, lidars: Sequence[Path], frames: str = FRAMES, cache: Path | None = None
) -> pd.Series:
    """Mean hit points per frame in the `paper` preset, by LiDAR name; no frames are written.

    frames: A:B[:STEP], B excluded. cache: a folder for the answers, so that the same binary is
    asked once for the same configuration.
    Raises SimulatorError.
    """
    if cache is None:
        with tempfile.TemporaryDirectory() as folder:
            return hits_per_frame(scene, lidars, frames, Path(folder))
    summary = cache / f"{scene.stem}-{_key(scene, lidars, frames)}.csv"
    if not summary.is_file():
        cache.mkdir(parents=True, exist_ok=True)
        infrasim(*_run(scene, lidars, frames), "--summary", summary)
    return read_hits(summary)


def scan_pattern(lidar: Path, frames: str = "0:1", preset: str = PRESET) -> FloatArray:
    """Azimuth, elevation (rad) and time (s) of every ray: (n, 3), sensor frame, phase 0.

    Raises SimulatorError.
    """
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "pattern.npy"
        infrasim("pattern", lidar, "--preset", preset, "--frames", frames, "--out", file)
        rays: FloatArray = np.load(file)
    return rays


def read_hits(summary: Path) -> pd.Series:
    """Hits per frame by LiDAR name, from the summary of a run.

    Raises ValueError if it has other columns, no LiDAR or no frames.
    """
    table = read_csv(summary)
    missing = [column for column in SUMMARY_COLUMNS if column not in table.columns]
    if missing:
        raise ValueError(f"{summary}:1: found no column {missing[0]}, needed {SUMMARY_COLUMNS}")
    if len(table) == 0 or (table["frames"] < 1).any():
        raise ValueError(f"{summary}: found a summary without frames")
    hits = table.set_index("lidar")["hits_per_frame"].astype(float)
    return hits.rename("hits")


def _run(scene: Path, lidars: Sequence[Path], frames: str) -> list[str | Path]:
    return ["run", scene, "--lidar", *lidars, "--preset", PRESET, "--frames", frames]


def _key(scene: Path, lidars: Sequence[Path], frames: str) -> str:
    """Names all that a summary depends on: the binary, the resolved configuration, the frames."""
    key = hashlib.sha256(frames.encode())
    key.update(infrasim("check", scene, "--preset", PRESET).encode())
    for lidar in lidars:
        key.update(infrasim("check", lidar, "--preset", PRESET).encode())
    binary = launch.binary()
    assert binary is not None
    key.update(binary.read_bytes())
    return key.hexdigest()[:12]
