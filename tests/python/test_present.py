"""Ground truth `present`: all vehicles of the region, whether a LiDAR or a mount sees them or
not."""

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from conftest import Infrasim
from evaluation_data import box, car, write_lidar, write_predictions, write_roads

import pyinfra
from pyinfra.cli import main
from pyinfra.core.errors import FormatError
from pyinfra.metrics.ground_truth import read_ground_truth
from pyinfra.metrics.settings import Settings

OUTLINE = "[{name: near, outline_m: [[-60, -30], [60, -30], [60, 30], [-60, 30]]}]"
HOUSE = "[{x_m: 20, y_m: 26, length_m: 60, width_m: 4, height_m: 12}]"
FRAMES = range(0, 100, 20)
Poles = Callable[[str, float, str], Path]


@pytest.fixture(scope="module")
def pole(infrasim: Infrasim, tmp_path_factory: pytest.TempPathFactory) -> Poles:
    """Simulates two LiDARs at a pole on the motorway. One has a narrow field of view, and one has a
    short range."""

    def run(name: str, y_m: float, buildings: str) -> Path:
        out = tmp_path_factory.mktemp(name)
        lidars = ["configs/lidars/livox_avia.yaml", "configs/lidars/helios_16.yaml"]
        keys = ["duration_s=20", "traffic.warm_up_s=20", f"mounts.pole.y_m={y_m}"]
        keys += [f"regions={OUTLINE}", f"buildings={buildings}"]
        words = [word for key in keys for word in ("--set", key)]
        frames = f"{FRAMES.start}:{FRAMES.stop}:{FRAMES.step}"
        options = ["--preset", "paper", "--frames", frames, "--out", out]
        done = infrasim("run", "configs/scenes/highway.yaml", "--lidar", *lidars, *words, *options)
        assert done.returncode == 0, done.stderr
        return out

    return run


def counts(folder: Path, which: str) -> list[int]:
    """Returns the number of vehicles that count in each frame."""
    truth = read_ground_truth(folder, beyond_range=True)
    places = truth.places(truth.vehicles.mid_frame)
    counted = truth.counted(which, truth.vehicles, places, 1)  # type: ignore[arg-type]
    return np.bincount(truth.vehicles.frame[counted], minlength=len(FRAMES)).tolist()


def test_present_is_the_same_for_every_lidar_and_pole_and_all_is_not(pole: Poles) -> None:
    middle, beside = pole("middle", 0.0, "[]"), pole("beside", 34.0, HOUSE)
    folders = [out / name for out in (middle, beside) for name in ("livox_avia", "helios_16")]
    present = [counts(folder, "present") for folder in folders]
    assert present[0] == present[1] == present[2] == present[3]
    hidden = np.array(counts(folders[3], "all"))
    # the house hides more than 30 % of the vehicles
    assert (hidden < 0.7 * np.array(present[0])).all()
    rows = pd.read_csv(middle / "trajectories.csv")
    for k, count in zip(FRAMES, present[0], strict=True):
        at = [rows[(rows.t * 10).round() == i].set_index("id") for i in (k, k + 1)]
        both = (at[0][["x", "y"]] + at[1][["x", "y"]]) / 2
        inside = (both.x.abs() < 60) & (both.y.abs() < 21)  # inside the carriageway
        assert count == inside.sum()


def test_ap_of_present_counts_what_the_pole_cannot_see(tmp_path: Path) -> None:
    write_roads(tmp_path)
    frames = [[car(20), car(40, points=0, visibility=0.0)]]
    folder = write_lidar(tmp_path / "lidar", frames)
    predictions = write_predictions(tmp_path / "pred", [[(box(car(20)), 0.9)]])
    settings = Settings(ground_truths=("all", "present"))
    ap = pyinfra.evaluate(folder, predictions, settings).ap.set_index("ground_truth")
    assert ap.objects.to_dict() == {"all": 1, "present": 2}
    assert ap.ap["all"] == 100
    assert ap.ap["present"] == 50


@pytest.mark.parametrize("asked", [[], ["--ground-truth", "captured", "present"]])
def test_the_hidden_share_is_printed_beside_the_ap_of_visible_vehicles(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], asked: list[str]
) -> None:
    """Three of four vehicles are hidden. The share refers to `present`, even if `present` was not
    requested."""
    write_roads(tmp_path)
    hidden = [car(x, points=0, visibility=0.1) for x in (40, 50, 60)]
    folder = write_lidar(tmp_path / "lidar", [[car(20), *hidden]])
    predictions = write_predictions(tmp_path / "pred", [[(box(car(20)), 0.9)]])
    paths = [folder, predictions, "--out", tmp_path / "out", "--no-figures"]
    assert main.main(["evaluate", *map(str, paths), *asked]) == 0
    rows = {line.split()[1]: line for line in capsys.readouterr().out.splitlines()[2:4]}
    assert {which: line.endswith("75 %") for which, line in rows.items()} == {
        which: which == "all" for which in rows
    }
    assert ("all" in rows) == (not asked)
    assert pyinfra.evaluate(folder, predictions).hidden_percent == {"vehicle": 75}


def test_without_objects_no_hidden_share_is_known(tmp_path: Path) -> None:
    write_roads(tmp_path)
    folder = write_lidar(tmp_path / "lidar", [[car(20)]])
    predictions = write_predictions(tmp_path / "pred", [[(box(car(20)), 0.9)]])
    shutil.rmtree(folder / "training/objects")
    assert pyinfra.evaluate(folder, predictions).hidden_percent == {}


def test_damaged_trajectories_are_named(pole: Poles) -> None:
    out = pole("damaged", 0.0, "[]")
    file = out / "trajectories.csv"
    file.write_text(file.read_text().replace("Car", "Car,1", 1))
    with pytest.raises(FormatError, match=str(file)):
        read_ground_truth(out / "helios_16", beyond_range=True)
