"""A benchmark of a few small experiments: its rows, and its behaviour after errors."""

import math
import os
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import joblib
import numpy as np
import pandas as pd
import psutil
import pytest
from benchmark_data import with_r1000
from pool_tasks import dies, dies_once, takes_a_gpu

from pyinfra.cli import main
from pyinfra.core import machine_load as load
from pyinfra.core.errors import ConfigError
from pyinfra.dataset.catalogue import configs
from pyinfra.experiments import gpus, pool, store
from pyinfra.experiments.benchmark import frames, matrix, measure
from pyinfra.experiments.benchmark.latency import time_untimed
from pyinfra.experiments.benchmark.matrix import Experiment, read_plan
from pyinfra.experiments.benchmark.workspace import Workspace
from pyinfra.experiments.gpus import exclusive_gpu
from pyinfra.experiments.value import KEY, Costs, covered, value_table
from pyinfra.models.training.recipe import read_recipe

TINY = """
detector: pointpillars
tiers:
  {tier}:
    network:
      pillar_m: 0.8
      pillar_width: 8
      bev: {{layers: [1, 1], widths: [8, 8], strides: [2, 2], up_width: 8}}
    learning: {{steps: 3, batch: 2}}
  quick: {{}}
  full: {{}}
"""
MATRIX = """
frames: 0:5000:250
matrix:
  - scenes: [highway]
    lidars: [helios_16, livox_avia]
    presets: [paper]
    detectors: [background, tiny.yaml]
"""
MEASURED = ["train_seconds", "latency_p50_ms", "latency_p95_ms", "latency_other_cores"]
EXPERIMENTS = 4


@pytest.fixture
def config(tmp_path: Path) -> Path:
    (tmp_path / "tiny.yaml").write_text(TINY.format(tier="smoke"))
    file = tmp_path / "small.yaml"
    file.write_text(MATRIX)
    return file


def words(config: Path, out: Path, *more: object) -> list[str]:
    paths = [str(config), "--tier", "smoke", "--out", str(out), "--work", f"{out}-work"]
    return ["benchmark", *paths, *map(str, more)]


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Returns the tables of an uninterrupted run with one process."""
    folder = tmp_path_factory.mktemp("benchmark")
    (folder / "tiny.yaml").write_text(TINY.format(tier="smoke"))
    (folder / "small.yaml").write_text(MATRIX)
    assert main.main(words(folder / "small.yaml", folder / "out", "--jobs", 1)) == 0
    return folder / "out"


def experiments_of(results: Path) -> pd.DataFrame:
    """Returns the rows in the order of their keys, without columns that contain times."""
    table = pd.read_csv(results / "smoke.csv").sort_values(KEY, ignore_index=True)
    return table.drop(columns=MEASURED)


def test_an_experiment_is_a_row_with_what_repeats_it(results: Path) -> None:
    table = pd.read_csv(results / "smoke.csv")
    assert len(table) == EXPERIMENTS
    assert set(zip(table.lidar, table.detector, strict=True)) == {
        (lidar, detector)
        for lidar in ("helios_16", "livox_avia")
        for detector in ("background", "tiny")
    }
    assert (table.tier == "smoke").all()
    assert table.version.notna().all()
    assert (table.objects > 0).all()
    assert (table.off_region_per_min >= 0).all()
    assert (table.ap_low <= table.ap).sum() + table.ap_low.isna().sum() == EXPERIMENTS


def test_each_experiment_has_areas_distances_and_a_price(results: Path) -> None:
    for name in ("areas", "distance", "value"):
        table = pd.read_csv(results / f"smoke_{name}.csv")
        assert len(table[KEY].drop_duplicates()) == EXPERIMENTS, name
    windows = pd.read_csv(results / "smoke_distance.csv")
    assert set(windows.ground_truth) == {"captured", "all", "present"}
    lidars = pd.read_csv(results / "lidars.csv").set_index("lidar")
    assert lidars.price_low_usd["livox_avia"] == 2079
    assert lidars.horizontal_fov_deg["helios_16"] == pytest.approx(360, abs=1)
    hits = pd.read_csv(results / "smoke_hits.csv").set_index("lidar")
    assert (hits.frames == 20).all()
    assert (hits.vehicle_points_per_frame < hits.hits_per_frame).all()


def test_the_same_command_again_computes_nothing(results: Path, config: Path) -> None:
    before = (results / "smoke.csv").read_bytes()
    assert main.main(words(results.parent / "small.yaml", results)) == 0
    assert (results / "smoke.csv").read_bytes() == before


def test_detectors_are_timed_one_by_one_after_the_last_experiment(
    config: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    config.write_text(MATRIX.replace("tiny.yaml", "background").replace("[background, b", "[b"))
    assert main.main(words(config, tmp_path / "out", "--jobs", 2)) == 0
    lines = capfd.readouterr().err.splitlines()
    done = [i for i, line in enumerate(lines) if ": AP " in line]
    timed = [i for i, line in enumerate(lines) if " ms a frame; other processes used " in line]
    assert len(done) == len(timed) == 2
    assert max(done) < min(timed)
    table = pd.read_csv(tmp_path / "out/smoke.csv")
    assert (table.latency_p50_ms > 0).all()
    assert (table.latency_other_cores >= 0).all()
    assert (table.latency_frames > 0).all()
    assert (table.latency_threads == 1).all()


def test_a_benchmark_stopped_before_the_timing_is_timed_by_the_same_command(
    results: Path, tmp_path: Path
) -> None:
    file = results / "smoke.csv"
    measured = pd.read_csv(file)
    columns = [name for name in measured if name.startswith("latency_")]
    kept_ms = 1e6  # no detector here takes so long
    untimed = measured.astype(dict.fromkeys(columns, object))
    untimed["latency_p50_ms"] = kept_ms
    untimed.loc[0, columns] = None
    untimed.to_csv(file, index=False)
    assert main.main(words(results.parent / "small.yaml", results, "--jobs", 1)) == 0
    latency_ms = pd.read_csv(file).latency_p50_ms
    assert (latency_ms > 0).all()
    # The latency of the other experiments is not measured again.
    assert (latency_ms == kept_ms).sum() == EXPERIMENTS - 1
    measured.to_csv(file, index=False)


def test_nothing_is_timed_while_another_command_runs_experiments(
    results: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan = read_plan(results.parent / "small.yaml", "smoke")
    workspace = Workspace(Path(f"{results}-work"), results, "smoke")
    monkeypatch.setattr(Workspace, "without_row", lambda *_: list(plan.experiments[:1]))
    monkeypatch.setattr(measure, "timed_alone", lambda *_, **_how: pytest.fail("timed"))
    messages: list[str] = []
    time_untimed(plan, workspace, progress=messages.append)
    assert len(messages) == 1


@pytest.mark.parametrize(("first_ms", "frames"), [(1, 100), (60, 50), (2000, 15)])
def test_slow_detectors_are_timed_on_fewer_frames_spread_over_the_test_time(
    first_ms: float, frames: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    read: list[int] = []
    monkeypatch.setattr(measure, "frame_numbers", lambda _: list(range(300)))
    monkeypatch.setattr(measure, "computer", lambda *_: "a computer")
    monkeypatch.setattr(measure.detect, "detector_at", lambda *_, **_how: None)
    monkeypatch.setattr(measure.detect, "detect", lambda *_: ([], np.array([9e9, first_ms])))
    monkeypatch.setattr(measure.detect, "timed", lambda *_: (None, 0.1))
    monkeypatch.setattr(measure.kitti, "read_points", lambda file: read.append(int(file.stem)))
    columns, _ = measure.timed_alone(tmp_path, tmp_path, "cpu")
    assert columns["latency_frames"] == len(read) == frames
    assert read == sorted(read)
    assert read[-1] >= 300 - 300 // frames


def test_the_load_of_others_is_what_they_compute_and_not_what_is_timed(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    ticks = os.sysconf("SC_CLK_TCK")
    clocks = {"perf_counter": iter([10.0, 12.0]), "process_time": iter([5.0, 6.0])}
    for name, clock in clocks.items():
        monkeypatch.setattr(
            f"pyinfra.core.machine_load.time.{name}", lambda clock=clock: next(clock)
        )
    monkeypatch.setattr(load, "_TIMES", tmp_path / "stat")
    (tmp_path / "stat").write_text(f"cpu  {100 * ticks} 0 0 70 80 0 0 0 9 9\ncpu0 1 1 1\n")
    # Two cores are busy for three seconds; this process uses one of them.
    with load.other_load() as others:
        (tmp_path / "stat").write_text(f"cpu  {103 * ticks} 0 0 90 99 0 0 0 99 99\ncpu0 1 1 1\n")
    assert others.cores == pytest.approx(1.0)
    assert others.text == "other processes used 1.0 cores"
    monkeypatch.undo()
    with load.other_load() as real:
        sum(range(100_000))
    assert 0 <= real.cores <= (os.cpu_count() or 1)


def test_latency_can_be_measured_again_alone(results: Path) -> None:
    before = pd.read_csv(results / "smoke.csv")
    before.assign(latency_p50_ms=-1.0).to_csv(results / "smoke.csv", index=False)
    assert main.main([*words(results.parent / "small.yaml", results), "--only-latency"]) == 0
    after = pd.read_csv(results / "smoke.csv")
    assert (after.latency_p50_ms > 0).all()
    assert list(after.columns) == list(before.columns)
    assert sorted(after.ap) == sorted(before.ap)


def test_a_latency_names_the_gpu_of_a_network(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    torch = pytest.importorskip("torch")
    monkeypatch.setattr(torch.cuda, "get_device_name", lambda device: f"GPU of {device}")
    (tmp_path / "background.npz").touch()
    assert measure.computer(tmp_path, "cuda:1") == measure.machine()
    (tmp_path / "last.safetensors").touch()
    assert measure.computer(tmp_path, "cuda:1") == f"{measure.machine()} with GPU of cuda:1"
    assert measure.computer(tmp_path, "cpu") == measure.machine()


def test_latency_without_a_run_is_an_error(
    results: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    again = ["--work", str(tmp_path), "--only-latency"]
    assert main.main([*words(results.parent / "small.yaml", results), *again]) == 1
    assert (
        f"The folder has no run of the {EXPERIMENTS} finished experiments"
        in capsys.readouterr().err
    )


def test_a_failed_experiment_is_a_row_with_its_reason_and_is_tried_again(
    config: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    config.write_text(MATRIX.replace(", livox_avia", ""))
    good = (tmp_path / "tiny.yaml").read_text()
    (tmp_path / "tiny.yaml").write_text(good.replace("steps: 3", "steps: 0"))
    assert main.main(words(config, tmp_path / "out", "--jobs", 1)) == 1
    table = pd.read_csv(tmp_path / "out/smoke.csv").set_index("detector")
    assert pd.isna(table.reason["background"])
    assert ", got 0" in table.reason["tiny"]
    (tmp_path / "tiny.yaml").write_text(good)
    assert main.main(words(config, tmp_path / "out", "--jobs", 1)) == 0
    assert experiments_of(tmp_path / "out").get("reason", pd.Series()).isna().all()


@pytest.mark.nightly
@pytest.mark.timeout(600)
def test_a_run_killed_and_resumed_equals_an_uninterrupted_one(
    results: Path, config: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    # file to wait for, by number of jobs
    first_file = {1: "out-work/data/**/velodyne/*.bin", 2: "out/smoke.csv"}
    for jobs, pattern in first_file.items():
        kill_when_there(tmp_path, pattern, words(config, out, "--jobs", jobs))
    assert 0 < len(experiments_of(out)) < EXPERIMENTS
    assert main.main(words(config, out, "--jobs", 2)) == 0
    pd.testing.assert_frame_equal(experiments_of(out), experiments_of(results))
    for name in ("areas", "distance"):
        mine, theirs = (pd.read_csv(f / f"smoke_{name}.csv") for f in (out, results))
        order = [*KEY, "ground_truth", "road", *(["s"] if name == "distance" else [])]
        pd.testing.assert_frame_equal(
            mine.sort_values(order, ignore_index=True), theirs.sort_values(order, ignore_index=True)
        )


def kill_when_there(folder: Path, pattern: str, words: list[str]) -> None:
    """Runs a pyinfra command until a file exists, then kills all its processes."""
    command = [sys.executable, "-m", "pyinfra", *words]
    with subprocess.Popen(command, start_new_session=True) as process:
        while not any(folder.glob(pattern)):
            assert process.poll() is None
            time.sleep(0.02)
        os.killpg(process.pid, signal.SIGKILL)


def not_there(group: list[Path]) -> list[Path]:
    return [task for task in group if not task.exists()]


def test_a_training_that_went_on_has_the_seconds_of_all_its_steps(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def goes_on(_recipe: object, _sources: object, run: Path, **_how: object) -> None:
        (run / "log.csv").write_text("step,seconds,cpu_seconds\n1,9,2.5\n2,3,1.5\n")

    monkeypatch.setattr(measure, "train", goes_on)
    monkeypatch.setattr(measure, "read_source", lambda *_, **_how: None)
    experiment = Experiment("highway", "ruby_plus", "paper", "dsvt", "quick", 1)
    recipe = read_recipe(configs() / "detectors/dsvt.yaml", "quick")
    assert measure.trained(experiment, recipe, tmp_path, tmp_path, "cpu") == 4.0


@pytest.mark.parametrize("backend", pool.BACKENDS)
def test_the_tasks_of_a_killed_worker_are_done_by_others(
    backend: pool.Backend, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parent))  # folder of pool_tasks
    tasks = [tmp_path / name for name in (*"abcdef", "victim")]
    lost: list[Path] = []
    where = pool.Pool(backend, 2)
    pool.run(dies_once, tasks, where, left=not_there, lost=lambda task, _: lost.append(task))
    assert not_there(tasks) == []
    assert lost == []


def test_experiments_take_turns_on_the_gpus(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(gpus, "POLL_S", 0.01)
    monkeypatch.setattr(gpus, "visible", lambda: ["0", "1"])
    tasks = [tmp_path / name for name in "abcdefgh"]
    with ThreadPoolExecutor(4) as four:
        list(four.map(takes_a_gpu, tasks))
    assert {task.read_text() for task in tasks} == {"cuda:0", "cuda:1"}


def test_a_device_that_is_named_is_taken_as_it_is(tmp_path: Path) -> None:
    for device in ("cpu", "cuda:3"):
        with exclusive_gpu(device, tmp_path) as gpu:
            assert gpu == device


def test_gpus_are_named_as_the_process_sees_them(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("torch.cuda.device_count", lambda: 2)
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "4,7")
    assert gpus.visible() == ["4", "7"]
    monkeypatch.delenv("CUDA_VISIBLE_DEVICES")
    assert gpus.visible() == ["0", "1"]


def assert_this_machine_alone_is_listened_to() -> None:
    me = psutil.Process()
    addresses = {c.laddr.ip for p in (me, *me.children(recursive=True)) for c in listening(p)}
    assert addresses
    assert {ip.removeprefix("::ffff:") for ip in addresses} == {"127.0.0.1"}


def listening(process: psutil.Process) -> list[Any]:
    try:
        return [c for c in process.net_connections("inet") if c.status == psutil.CONN_LISTEN]
    except psutil.Error:  # the process has ended
        return []


def test_dask_runs_tasks_where_gpus_are_and_listens_to_this_machine_alone() -> None:
    with pool.workers(pool.Pool("dask", 2, gpu=True)):
        assert joblib.Parallel()(joblib.delayed(abs)(-i) for i in range(3)) == [0, 1, 2]
        assert_this_machine_alone_is_listened_to()


def test_a_task_that_always_kills_its_worker_is_lost_alone(tmp_path: Path) -> None:
    tasks = [tmp_path / name for name in (*"abc", "victim")]
    lost: list[Path] = []
    messages: list[str] = []
    where = pool.Pool("local", 2)
    pool.run(dies, tasks, where, not_there, lambda task, _: lost.append(task), messages.append)
    assert lost == [tmp_path / "victim"]
    assert [line.split(":")[1] for line in messages][-1] == " a worker stopped, 1 tasks are left"
    assert not_there(tasks) == lost


@pytest.mark.nightly
def test_a_cluster_gives_the_same_rows(results: Path, config: Path, tmp_path: Path) -> None:
    assert main.main(words(config, tmp_path / "out", "--jobs", 2, "--backend", "dask")) == 0
    pd.testing.assert_frame_equal(experiments_of(tmp_path / "out"), experiments_of(results))


def test_a_dry_run_names_the_experiments_and_their_time(
    config: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main.main(words(config, tmp_path / "out", "--dry-run", "--jobs", 2)) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "highway helios_16 paper background smoke 1: 20 s"
    # Two experiments take 20 s each, and two take 60 s each.
    assert lines[-1] == "4 of 4 experiments to do: 3 core-minutes, about 1 minutes with 2 jobs"
    assert not (tmp_path / "out").exists()


def test_a_dry_run_refuses_a_preset_that_a_lidar_lacks(
    config: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config.write_text(config.read_text().replace("helios_16", "hesai_xt32"))
    assert main.main(words(config, tmp_path / "out", "--dry-run")) != 0
    assert (
        "hesai_xt32.yaml:14:3: presets: expected equal, datasheet, got unknown preset 'paper'"
        in capsys.readouterr().err
    )


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            ("highway", "motorway"),
            r"small.yaml:4: matrix.0.scenes.0: expected a .yaml file or .*, got 'motorway'",
        ),
        (
            ("[paper]", "[other]"),
            r"small.yaml:6: matrix.0.presets.0: expected one of paper, .*; got 'other'",
        ),
        (
            ("helios_16", "helios"),
            r"small.yaml:5: matrix.0.lidars.0: expected a .yaml file or one of the package's "
            "lidars, got 'helios'; did you mean 'helios_16'",
        ),
        (
            ("tiny.yaml", "none.yaml"),
            r"small.yaml:7: matrix.0.detectors.1: expected .*, got .none.yaml.",
        ),
        (("0:5000:250", "'5:5'"), r"frames: expected A:B.* with A below B, .*, got '5:5'"),
        (("0:5000:250", "0:68719476736"), r"frames: expected A:B.*, got '0:68719476736'"),
        (("0:5000:250", "0:500000000"), r"frames: expected .* up to 360000, got '0:500000000'"),
        (("[highway]", "[]"), r"matrix: expected 1 to 100000 experiments, got none"),
        (
            ("[paper]", "[paper, paper]"),
            r":6: matrix.0.presets.1: expected each value once, got 'paper' twice",
        ),
        (
            ("[paper]", "[paper]\n    seeds: [1, 1]"),
            r":7: matrix.0.seeds.1: expected each value once, got '1' twice",
        ),
        (
            ("[paper]", "[paper]\n    seeds: [-1]"),
            r":7: matrix.0.seeds.0: expected 0 to .*, got -1",
        ),
        (
            ("[paper]", "[paper]\n    seeds: [1e400]"),
            r":7: matrix.0.seeds.0: expected .*, got '1e400'",
        ),
        (
            ("frames:", "costs: {years: .nan}\nframes:"),
            r":2: costs.years: expected 0 to 100, got nan",
        ),
        (("frames:", "costs: {years: -1}\nframes:"), r":2: costs.years: expected 0 to 100, got -1"),
    ],
)
def test_a_wrong_benchmark_says_where(
    change: tuple[str, str], message: str, config: Path, tmp_path: Path
) -> None:
    config.write_text(MATRIX.replace(*change))
    with pytest.raises(ConfigError, match=message):
        frames.shards(read_plan(config, "smoke"), tmp_path, 1)


def test_a_benchmark_of_absurd_size_is_refused_at_once(
    config: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(matrix, "MOST_EXPERIMENTS", 400)
    seeds = ", ".join(map(str, range(101)))
    config.write_text(MATRIX.replace("[paper]", f"[paper]\n    seeds: [{seeds}]"))
    with pytest.raises(ConfigError, match="matrix: expected 1 to 400 experiments, got 404"):
        read_plan(config, "smoke")


def test_keys_of_many_experiments_are_looked_up_together() -> None:
    experiments = [vars(EXPERIMENT) | {"seed": seed} for seed in range(20_000)]
    known = store.has_each(pd.DataFrame(experiments[::2]), experiments)
    assert known == [True, False] * 10_000
    assert store.has_each(pd.DataFrame(), experiments[:2]) == [False, False]
    assert store.has_each(pd.DataFrame(experiments), []) == []


def test_every_benchmark_of_the_package_has_its_files() -> None:
    folder = Path(__file__).resolve().parents[2] / "configs/benchmarks"
    sizes = {file.stem: len(read_plan(file, "quick").experiments) for file in folder.glob("*.yaml")}
    assert sizes == {
        "demo": 8,
        "paper": 3 * 4 * 7 + 3 + 8,
        "datasheet": 48,
        "example": 1,
        "first_look": 4,
        "junction": 4,
    }


@pytest.mark.parametrize(
    ("asked", "parts", "expected"),
    [
        ("0:10", 2, ["0:5:1", "5:10:1"]),
        ("0:10:5", 3, ["0:1:5", "5:6:5"]),
        ("3:20:5", 2, ["3:9:5", "13:19:5"]),
    ],
)
def test_shards_hold_each_frame_once(asked: str, parts: int, expected: list[str]) -> None:
    assert frames.parts_of(asked, parts) == expected


EXPERIMENT = Experiment("road", "lidar", "paper", "net", "quick", 1)


def key_of(**changes: object) -> dict[str, object]:
    return vars(EXPERIMENT) | changes


def road_of(ap: dict[float, float], name: str = "a", end: float = 100) -> pd.DataFrame:
    """Returns windows of a road from -100 m to `end`. Only the given windows have an AP."""
    windows = {-100.0: None, end: None} | ap
    table = pd.DataFrame({"s": windows.keys(), "ap": pd.Series(windows.values(), dtype=float)})
    return with_r1000(table.assign(ground_truth="all", road=name))


def made_up(detectors: dict[str, tuple[float, float]]) -> dict[str, pd.DataFrame]:
    """Returns tables of LiDARs with a price and an AP. `ap` and `ap_all` are equal."""
    keys = [key_of(lidar=name) for name in detectors]
    prices = [price for price, _ in detectors.values()]
    ap = [value for _, value in detectors.values()]
    return {
        "experiments": with_r1000(pd.DataFrame(keys).assign(ap=ap, ap_all=ap)),
        "areas": pd.DataFrame(keys).assign(ground_truth="all", road="a", n_hqda=4),
        "distance": pd.DataFrame(keys).merge(road_of({0: 90.0}), how="cross"),
        "lidars": pd.DataFrame(
            {
                "lidar": list(detectors),
                "preset": "paper",
                "price_low_usd": prices,
                "price_high_usd": prices,
            }
        ),
        "hits": pd.DataFrame(keys)[["scene", "preset", "lidar"]].assign(
            vehicle_points_per_frame=500.0
        ),
    }


def test_value_by_hand() -> None:
    table = value_table(made_up({"a": (2000, 80)}), Costs()).iloc[0]
    assert table.ap_per_1000_usd == 40
    assert table.usd_per_hq_area == 500
    assert table.covered_m == 20
    assert table.usd_per_m_road == 100
    assert table.points_per_1000_usd == 250


def test_an_option_without_an_ap_of_all_vehicles_is_not_on_the_front() -> None:
    tables = made_up({"a": (2000, 80), "b": (900, 70)})
    tables["experiments"].loc[1, "ap_all_r1000"] = math.nan
    table = value_table(tables, Costs()).set_index("lidar")
    assert table.pareto.to_dict() == {"a": True, "b": False}


def test_areas_of_a_scene_with_two_roads_count_once() -> None:
    tables = made_up({"a": (2000, 80)})
    areas = pd.concat([tables["areas"].assign(road=name) for name in ("all", "main", "side")])
    areas["n_hqda"] = [8, 5, 3]
    assert value_table(tables | {"areas": areas}, Costs()).iloc[0].usd_per_hq_area == 250


@pytest.mark.parametrize(("within_m", "covered_m"), [(100.0, 20.0), (10.0, 20.0), (3.0, 6.0)])
def test_road_is_covered_to_the_metre_that_is_asked(within_m: float, covered_m: float) -> None:
    distance = made_up({"a": (2000, 80)})["distance"]
    assert covered(distance, within_m=within_m).covered_m.item() == covered_m


def test_a_site_costs_what_its_owner_says() -> None:
    costs = Costs(pole_usd=100, power_w=1000, usd_per_kwh=0.1, years=2)
    # The energy is 1 kW for two years of 8,766 hours, at 0.1 dollars per kWh.
    assert costs.site_usd == pytest.approx(100 + 1753.2)
    table = value_table(made_up({"a": (2000, 80)}), costs).iloc[0]
    assert table.price_usd == pytest.approx(3853.2)


def test_a_mount_costs_a_lidar_a_pole_and_an_installation() -> None:
    costs = Costs(pole_usd=100, installation_usd=50, computer_usd=800)
    tables = made_up({"a": (2000, 80)})
    alone = value_table(tables, costs).iloc[0]
    assert alone.price_usd == 2000 + 150 + 800
    four = value_table(tables | {"hits": tables["hits"].assign(mounts=4)}, costs).iloc[0]
    assert (four.lidar_usd, four.pole_usd, four.installation_usd) == (8000, 400, 200)
    assert four.price_usd == 8000 + 600 + 800
    assert four.ap_per_1000_usd == pytest.approx(1000 * 80 / 9400)


def test_the_dominated_are_named_with_what_beats_them() -> None:
    options = {"cheap": (1000, 50), "good": (3000, 90), "dear": (4000, 80), "same": (3000, 90)}
    table = value_table(made_up(options), Costs()).set_index("lidar")
    assert table.pareto.to_dict() == {"cheap": True, "good": True, "dear": False, "same": True}
    assert table.dominated_by["dear"] == "good net"


def test_windows_that_overlap_count_their_road_once() -> None:
    rows = pd.concat([road_of({0: 90, 5: 86, 50: 85}), road_of({100: 99}, "b")]).assign(**key_of())
    # Road a is covered from -10 to 15, and road b from 90 to 100, where the region ends. An AP of
    # 85 is not above 85.
    assert covered(rows).covered_m.tolist() == [25 + 10]


def test_road_beyond_the_last_window_is_not_covered() -> None:
    rows = road_of({40: 90, 55: 90}, end=60).assign(**key_of())
    assert covered(rows).covered_m.tolist() == [20 + 10]
    assert covered(rows, within_m=52).covered_m.tolist() == [20 + 2]
    assert covered(rows, above=95).covered_m.tolist() == [0]


def test_text_stays_text_beside_an_empty_cell(tmp_path: Path) -> None:
    for name, date in (("a", "2025"), ("b", ""), ("c", "2026-01")):
        store.put(tmp_path / "t.csv", pd.DataFrame([{"lidar": name, "date": date}]), ["lidar"])
    assert (tmp_path / "t.csv").read_text().split() == ["lidar,date", "a,2025", "b,", "c,2026-01"]


def test_rows_of_two_processes_are_all_there(tmp_path: Path) -> None:
    code = (
        "import sys, pandas as pd; from pathlib import Path\n"
        "from pyinfra.experiments import store\n"
        "for i in range(20):\n"
        "    row = pd.DataFrame([{'who': sys.argv[1], 'i': i}])\n"
        f"    store.put(Path({str(tmp_path / 't.csv')!r}), row, ['who', 'i'])"
    )
    both = [subprocess.Popen([sys.executable, "-c", code, name]) for name in "ab"]
    assert [process.wait(60) for process in both] == [0, 0]
    table = store.read(tmp_path / "t.csv", ["who"])
    assert sorted(zip(table.who, table.i, strict=True)) == [(w, i) for w in "ab" for i in range(20)]
