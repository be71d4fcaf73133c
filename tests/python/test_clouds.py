"""Pictures of clouds and of scan patterns."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from pyinfra.cli import main
from pyinfra.dataset import catalogue, runs
from pyinfra.viz.pattern_picture import CAR, pattern_picture


def test_pictures_of_a_short_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    data = tmp_path / "highway"
    lidars = [catalogue.lidar_file(name) for name in ("livox_avia", "helios_16")]
    words = ["--preset", "paper", "--frames", "2:3", "--out", data, "--fields"]
    runs.infrasim("run", catalogue.scene_file("highway"), "--lidar", *lidars, *words)
    assert main.main(["pictures", str(data), "--out", str(tmp_path / "out")]) == 0
    names = [Path(line).name for line in capsys.readouterr().out.splitlines()]
    views = ["sheet.png", "highway_helios_16.png", "highway_livox_avia.png"]
    assert names == [*views, "plan_highway.png", "cutouts_highway.png"]
    for name in views:
        with Image.open(tmp_path / "out" / name) as image:
            colours = image.convert("RGB").getcolors() or []
            assert min(image.size) > 200
        seen = {colour for _, colour in colours}
        assert (0, 32, 91) in seen, "no box of a vehicle with many points"  # 00205B
        assert (213, 94, 0) in seen, "no crossed-out box of a missed vehicle"  # D55E00
    assert main.main(["pictures", str(data), "--frame", "1", "--out", str(tmp_path / "out")]) == 2
    assert "--frame: expected 2 to 2, got 1" in capsys.readouterr().err
    (data / "helios_16/training/velodyne/000002.bin").unlink()
    assert main.main(["pictures", str(data), "--frame", "2", "--out", str(tmp_path / "out")]) == 2
    assert "expected none, as the folder has no frame, got 2" in capsys.readouterr().err


def test_rays_on_a_car_are_counted_per_frame() -> None:
    middle = CAR.mean(axis=0)
    rays = np.array([[*middle, 0.01], [*middle, 0.11], [*middle, 0.19], [0.5, 0.5, 0.05]])
    figure = pattern_picture({"four rays": rays}, {"four rays": 0.1})
    titles = [axes.get_title() for axes in figure.axes]
    assert titles == ["four rays\n2 rays in 0.1 s", "on a car's rear at 60 m:\n2 rays on average"]
