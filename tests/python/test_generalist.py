"""The network that comes with the package is small and calibrated, and finds vehicles without
training."""

from pathlib import Path

import pytest
from safetensors import safe_open

import pyinfra
from pyinfra.cli import main
from pyinfra.models.inference.detect import model_file, shipped

MODEL = model_file(Path("generalist"))
LEAST_AP = 70  # for the few frames of this test; the network has 98, and an untrained network has 0


@pytest.fixture(scope="module")
def frames(infrasim, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("highway")
    words = ["--lidar", "configs/lidars/ruby_plus.yaml", "--preset", "datasheet", "--out", out]
    run = infrasim("run", "configs/scenes/highway.yaml", *words, "--frames", "0:400:40")
    assert run.returncode == 0, run.stderr
    return out / "ruby_plus"


def test_it_is_small_and_says_what_it_is() -> None:
    assert shipped() == ["generalist", "generalist-3"]
    assert MODEL.stat().st_size < 1_500_000
    with safe_open(MODEL, "pt") as file:
        metadata = file.metadata()
        kinds = {str(file.get_tensor(name).dtype) for name in file.keys()}  # noqa: SIM118
    assert "torch.float16" in kinds
    text = " ".join(metadata.values())
    for word in ("calibration", "figures", "precision", "recall", "steps: 16000"):
        assert word in text


def test_it_finds_vehicles_of_a_site_that_it_never_saw(frames: Path, tmp_path: Path) -> None:
    words = ["detect", str(frames), "--model", "generalist", "--split", "all"]
    assert main.main([*words, "--out", str(tmp_path)]) == 0
    ap = pyinfra.evaluate(frames, tmp_path, split="all").ap.set_index("ground_truth")
    assert ap.ap_r1000["captured"] > LEAST_AP


def test_a_lone_cloud_needs_the_height_of_the_sensor(
    frames: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cloud = str(next((frames / "training/velodyne").glob("*.bin")))
    assert main.main(["detect", "--model", "generalist", cloud]) == 2
    assert (
        "expected the height of the sensor above the road, got none; set --height-m"
        in capsys.readouterr().err
    )
    assert main.main(["detect", "--model", "generalist", cloud, "--height-m", "6"]) == 0
    # there are about 70 boxes for 45 vehicles
    assert len(capsys.readouterr().out.splitlines()) > 30
