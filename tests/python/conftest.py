"""Fixtures for the tests of the `infrasim` binary of this Python environment."""

import gc
import hashlib
import html
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browser import Browser, start_browser
from hypothesis import settings

from pyinfra.core.arrays import FloatArray

# These variables must be set before torch and OpenBLAS are loaded, here and in child processes.
# Threads of small operations mostly wait for each other, and detectors use one thread
# (network.one_thread).
os.environ["OMP_NUM_THREADS"] = "1"

# With Python's own threshold, looking for cycles takes a twentieth of the tests' time.
gc.set_threshold(50_000)

# Without a limit of the time of an example: other processes may delay it.
settings.register_profile("tests", deadline=None)
settings.load_profile("tests")

ROOT = Path(__file__).resolve().parents[2]
BINARY = Path(sys.executable).with_name("infrasim")

# The slowest test files. They start first, so that no worker still runs one of them at the end.
LONG = (
    "api benchmark benchmark_inputs cli_errors detectors docs faults onnx own_recording planner "
    "processes recommend report report_browser stress training viewer_browser"
).split()

Result = subprocess.CompletedProcess[str]
Infrasim = Callable[..., Result]


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    items.sort(key=lambda item: item.path.stem.removeprefix("test_") not in LONG)


@pytest.fixture(scope="session")
def infrasim() -> Infrasim:
    """Returns a function that runs the binary in the root of the repository. Its arguments are
    command words and options of `subprocess.run`."""

    def call(*words: object, **options: Any) -> Result:
        return subprocess.run(
            [str(BINARY), *map(str, words)],
            **{"capture_output": True, "text": True, "cwd": ROOT, "timeout": 120} | options,
        )

    return call


@pytest.fixture(scope="session")
def run_command() -> Callable[..., list[str]]:
    """Returns a function that makes the words of a short `run` command on the motorway. Its traffic
    needs no warm-up."""

    def words(*lidars: str, frames: str = "0:4", preset: str = "paper", **options: object):
        files = [f"configs/lidars/{name}.yaml" for name in lidars or ("helios_16",)]
        extra = [w for key, value in options.items() for w in (f"--{key}", str(value))]
        return [
            *("run", "configs/scenes/highway.yaml", "--preset", preset, "--frames", frames),
            *("--set", "duration_s=20", "--set", "traffic.warm_up_s=5"),
            *("--lidar", *files, *extra),
        ]

    return words


@pytest.fixture(scope="session")
def motorway(
    infrasim: Infrasim, run_command: Callable[..., list[str]], tmp_path_factory: Any
) -> Path:
    """Simulates three frames of four LiDARs on the motorway, with fields. Tests must not change the
    folder."""
    out = tmp_path_factory.mktemp("motorway") / "data"
    lidars = ("ruby_plus", "livox_avia", "pandar_64", "helios_16")
    result = infrasim(*run_command(*lidars, frames="0:3"), "--set", "fields=true", "--out", out)
    assert result.returncode == 0, result.stderr
    return out


@pytest.fixture(scope="session")
def digests() -> Callable[[Path], dict[str, str]]:
    """Returns a function that computes the SHA-256 of each file of a data set, by path. It leaves
    out summary.csv, which contains computing times."""

    def of(folder: Path) -> dict[str, str]:
        return {
            str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
            for path in sorted(folder.rglob("*"))
            if path.is_file() and path.name != "summary.csv"
        }

    return of


@pytest.fixture
def pattern(infrasim: Infrasim, tmp_path: Path) -> Callable[..., FloatArray]:
    """Returns a function that computes the azimuth, elevation (rad) and time (s) of a LiDAR's rays:
    (n, 3)."""

    def rays(lidar: Path | str, *options: object) -> FloatArray:
        file = lidar if isinstance(lidar, Path) else ROOT / f"configs/lidars/{lidar}.yaml"
        out = tmp_path / "pattern.npy"
        result = infrasim("pattern", file, "--out", out, *options)
        assert result.returncode == 0, result.stderr
        array = np.load(out)
        assert result.stdout == f"{len(array)} rays\n"
        return array

    return rays


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    """A headless Chromium, for the tests of one file."""
    with start_browser() as started:
        yield started


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Makes the figures of reports empty, for tests that read only text. Drawing takes most of the
    time of a page."""

    def empty(_: object, name: str, label: str, dpi: int = 0) -> str:
        return f'<svg role="img" aria-label="{html.escape(label)}"></svg>'

    monkeypatch.setattr("pyinfra.viz.report.svg.inline", empty)


@pytest.fixture(scope="session")
def planned(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """A small plan at the crossroad; to be read only."""
    from plan_page_data import small_plan

    return small_plan(tmp_path_factory.mktemp("planned"))
