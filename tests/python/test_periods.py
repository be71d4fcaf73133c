"""Frames of LiDARs with 5, 10 and 20 frames per second."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml
from conftest import Infrasim

import pyinfra as pi
from pyinfra.core.errors import Error
from pyinfra.dataset.data_set import read_data_set
from pyinfra.dataset.trajectories import between_rows, existing, read_objects_at
from pyinfra.experiments.requirements import Requirements
from pyinfra.formats import kitti
from pyinfra.metrics.ground_truth import read_ground_truth
from pyinfra.metrics.scanning_statistics import speed_table

HEADER = "t,id,class,x,y,z,heading,dx,dy,dz,speed\n"
POSE = kitti.WorldPose(0, 0, 0, 0)
SCENE = "configs/scenes/highway.yaml"
RATES = (5, 10, 20)


@pytest.fixture(scope="module", params=RATES)
def run(
    request: pytest.FixtureRequest, infrasim: Infrasim, tmp_path_factory: pytest.TempPathFactory
) -> tuple[int, Path]:
    """Returns a rate and a data set with frames 2 to 5 of that rate."""
    out = tmp_path_factory.mktemp("rate") / "highway"
    words = ["--preset", "datasheet", "--set", "duration_s=3", "--rate-hz", request.param]
    result = infrasim("run", SCENE, "--lidar", "helios_16", *words, "--frames", "2:6", "--out", out)
    assert result.returncode == 0, result.stderr
    return request.param, out


def test_period_of_a_run(run: tuple[int, Path]) -> None:
    rate, out = run
    assert kitti.read_lidar(out / "helios_16").period_s == 1 / rate
    keys = yaml.safe_load((out / "helios_16/lidar.yaml").read_text())
    spinning = keys["pattern"]["spinning"]
    assert (spinning["rate_hz"], spinning["columns_per_turn"]) == (rate, 18000 / rate)
    assert read_data_set(out).period_s == 1 / rate
    summary = pd.read_csv(out / "summary.csv").iloc[0]
    assert summary.rays_per_frame == 16 * 18000 / rate


def test_objects_of_trajectories_are_at_mid_frame(run: tuple[int, Path]) -> None:
    rate, out = run
    pose = kitti.read_lidar(out / "helios_16").T_world_levelled
    found = read_objects_at(out / "trajectories.csv", range(2, 6), pose, 1 / rate)
    for index, k in enumerate(range(2, 6)):
        objects = pd.read_csv(kitti.frame_file(out / "helios_16", "objects", k)).set_index("id")
        here = found.frame == index
        table = pd.DataFrame(found.boxes[here], found.ids[here], [*list("xyz"), "l", "w", "h", "a"])
        assert set(objects.index) <= set(table.index)
        near = table.loc[objects.index]
        np.testing.assert_allclose(near[["x", "y", "z"]], objects[["x", "y", "z"]], atol=2e-4)
        np.testing.assert_allclose(near.a, objects.heading, atol=2e-6)


def test_trajectories_have_the_rows_of_the_frames(run: tuple[int, Path]) -> None:
    rate, out = run
    t = pd.read_csv(out / "trajectories.csv").t
    assert (t.min(), t.max()) == (2 / rate, np.ceil(60 / rate - 1e-9) / 10)


def test_speeds_are_those_at_the_starts_of_the_frames(run: tuple[int, Path]) -> None:
    rate, out = run
    truth = read_ground_truth(out / "helios_16", beyond_range=True)
    assert truth.period_s == 1 / rate
    samples = speed_table(read_data_set(out)).samples.sum()
    assert len(truth.vehicles) <= samples <= len(truth.vehicles) + 8


def test_frames_in_memory_are_those_of_the_run(run: tuple[int, Path]) -> None:
    rate, out = run
    scene = pi.load_scene("highway", set={"duration_s": 3})
    lidar = pi.load_lidar("helios_16", rate_hz=rate)
    assert (lidar.period_s, scene.frames_of(lidar.period_s)) == (1 / rate, 3 * rate)
    frames = pi.simulate(scene, lidar, range(2, 6))
    assert frames.period_s == 1 / rate
    assert len(frames.known) == 3 * rate
    for frame in frames:
        file = kitti.frame_file(out / "helios_16", "velodyne", frame.number)
        np.testing.assert_array_equal(frame.points.ravel(), np.fromfile(file, "<f4"))


def test_a_folder_has_lidars_of_one_period(run: tuple[int, Path], infrasim: Infrasim) -> None:
    rate, out = run
    words = ["--preset", "datasheet", "--set", "duration_s=3", "--frames", "2:3", "--out", out]
    other = 10 if rate != 10 else 20
    result = infrasim("run", SCENE, "--lidar", "ruby_plus", "--rate-hz", other, *words)
    assert result.returncode == 1
    assert "period_s: expected one period in a folder, got" in result.stderr


def test_lidars_of_different_periods_are_refused() -> None:
    scene = pi.load_scene("highway", set={"duration_s": 1})
    lidars = [pi.load_lidar("helios_16"), pi.load_lidar("ruby_plus", rate_hz=20)]
    with pytest.raises(
        Error, match=r"expected one frame period in a run, got helios_16 with 0\.1 s"
    ):
        pi.simulate(scene, [*lidars], range(2))
    with pytest.raises(Error, match="rate_hz: expected 5 to 20, got 4"):
        pi.load_lidar("helios_16", rate_hz=4)
    with pytest.raises(Error, match="frames: expected 0 to 19"):
        pi.simulate(scene, lidars[1], range(21))


def test_the_limit_of_latency_is_the_period_of_the_lidar() -> None:
    assert Requirements().limit_ms(50) == 50
    assert Requirements(latency_ms=70).limit_ms(50) == 70


def row(t: float, number: int, x: float) -> str:
    return f"{t:g},{number},Car,{x},0,1,0,4,2,2,0\n"


def test_an_object_exists_in_rows_that_the_file_omits(tmp_path: Path) -> None:
    file = tmp_path / "trajectories.csv"
    file.write_text(
        HEADER + row(0, 1, 0) + row(0, 2, 50) + row(0.1, 1, 1) + row(0.4, 1, 1) + row(0.5, 1, 2)
        + row(0.5, 2, 50) + row(0.5, 3, 70)
    )  # fmt: skip
    objects = read_objects_at(file, range(5), POSE)
    assert objects.frame.tolist() == [0, 0, 1, 1, 2, 2, 3, 3, 4, 4]
    assert objects.ids.tolist() == 5 * [1, 2]
    np.testing.assert_allclose(objects.boxes[::2, 0], [0.5, 1, 1, 1, 1.5])
    np.testing.assert_array_equal(objects.boxes[1::2, 0], 50)
    fast = read_objects_at(file, [1, 8], POSE, 0.05)
    np.testing.assert_allclose(fast.boxes[::2, 0], [0.75, 1.25])
    slow = read_objects_at(file, [0, 1, 2], POSE, 0.2)
    assert slow.frame.tolist() == [0, 0, 1, 1]
    np.testing.assert_allclose(slow.boxes[::2, 0], [0.5, 1])


@pytest.mark.parametrize("seed", range(5))
def test_existing_objects_are_those_of_a_loop_over_all(seed: int) -> None:
    random = np.random.default_rng(seed)
    ids = np.sort(random.integers(0, 6, 30))
    steps = random.integers(0, 40, 30)
    rows = pd.DataFrame({"id": ids, "t": steps / 10}).drop_duplicates()
    rows = rows.sort_values(["id", "t"])
    starts = np.sort(random.uniform(0, 4, 12))
    ends = starts + 0.15
    x = random.uniform(-50, 50, (len(rows), 1))
    found = existing(rows, starts, ends)
    expected = []
    for span, (start, end) in enumerate(zip(starts, ends, strict=True)):
        for number, one in rows.reset_index(drop=True).groupby("id"):
            if one.t.min() <= start and end <= one.t.max():
                at = [np.interp(t, one.t, x[one.index, 0]) for t in (start, end)]
                expected.append((span, number, *at))
    made = zip(
        found.span.tolist(),
        rows.id.to_numpy()[found.row].tolist(),
        between_rows(x, found.start)[:, 0].tolist(),
        between_rows(x, found.end)[:, 0].tolist(),
        strict=True,
    )
    np.testing.assert_allclose(list(made), np.array(expected).reshape(-1, 4), atol=1e-9)
