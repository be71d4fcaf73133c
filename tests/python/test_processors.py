"""Frames have the same bytes on every x86-64 processor.

QEMU runs the simulator as three processors: without AVX, with AVX2, and of another vendor. Each
differs from this machine in the instructions that Embree and the C library would select, and in
how it approximates reciprocals.
"""

import shutil
import subprocess
from pathlib import Path

import pytest
from conftest import ROOT

from pyinfra.dataset import launch

# The first differs most from this machine; `make nightly` tries the others.
PROCESSORS = (
    "Nehalem",
    pytest.param("Haswell", marks=pytest.mark.nightly),
    pytest.param("EPYC-Milan", marks=pytest.mark.nightly),
)
LIDARS = ("livox_avia", "pandar_64")  # prisms with a wide beam, and columns
SCENE = ("highway", "--set", "duration_s=1", "traffic.warm_up_s=10", "fields=true")
FRAMES = 2


def files_of(folder: Path) -> dict[str, bytes]:
    """Returns the bytes of the files of all frames, by path."""
    return {
        str(file.relative_to(folder)): file.read_bytes()
        for file in sorted(folder.glob("*/training/*/*"))
    }


@pytest.fixture(scope="module")
def here(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    return simulated(tmp_path_factory.mktemp("here") / "data")


def simulated(out: Path, *emulator: str) -> dict[str, bytes]:
    command = [*emulator, str(launch.binary()), "run", *SCENE, "--preset", "datasheet"]
    command += ["--lidar", *LIDARS, "--frames", f"0:{FRAMES}", "--threads", "1", "--out", str(out)]
    subprocess.run(command, check=True, capture_output=True, cwd=ROOT)
    return files_of(out)


@pytest.mark.parametrize("processor", PROCESSORS)
def test_frames_have_the_same_bytes_on_processor(
    processor: str, here: dict[str, bytes], tmp_path: Path
) -> None:
    qemu = shutil.which("qemu-x86_64")
    assert qemu, "the package qemu-user is missing: run `make setup`"
    there = simulated(tmp_path / "data", qemu, "-cpu", processor)
    assert len(there) == FRAMES * len(LIDARS) * 5  # points, labels, calibration, objects, fields
    assert [name for name in there if there[name] != here.get(name)] == []
