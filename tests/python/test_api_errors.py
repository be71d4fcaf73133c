"""Wrong input of any function of the public API raises a pyinfra.Error that names the argument."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import report_data

import pyinfra as pi
from pyinfra.dataset.frame_sequence import FrameSequence
from pyinfra.dataset.object_rows import BOX

SHORT = {"duration_s": 2, "traffic.warm_up_s": 5}
Call = Callable[["Given"], object]


class Given:
    """Valid arguments. Each test replaces one of them by an invalid value."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.scene = pi.load_scene("highway", set=SHORT)
        self.frames = pi.simulate(self.scene, "helios_16", range(0, 20, 10))
        self.table = self.frames.labels[["frame", "type", *BOX]].assign(score=0.5)
        self.result = pi.evaluate(self.frames, self.table)
        self.file = folder / "file.txt"
        self.file.write_text("nothing")
        self.empty = folder / "empty"
        self.empty.mkdir()


@pytest.fixture(scope="module")
def given(tmp_path_factory: pytest.TempPathFactory) -> Given:
    return Given(tmp_path_factory.mktemp("bad"))


def raising(_: Any) -> Any:
    raise ZeroDivisionError("of my own")


def boxes(**columns: Any) -> pd.DataFrame:
    """Returns one box with some other columns."""
    usual: dict[str, Any] = dict(zip(BOX, [10.0, 0, -5, 4, 2, 1.5, 0], strict=True))
    return pd.DataFrame([usual | columns])


def stressed(*lidars: str) -> pd.DataFrame:
    return pd.concat([report_data.stress().assign(lidar=name) for name in lidars])


def without(table: pd.DataFrame, name: str) -> pd.DataFrame:
    return table.drop(columns=name)


PREDICTIONS: dict[str, tuple[Callable[[pd.DataFrame], Any], str]] = {
    "array": (lambda t: t[BOX].to_numpy(), "ndarray"),
    "list": (lambda t: [], "list"),
    "none": (lambda t: None, "NoneType"),
    "wrong column": (lambda t: t.rename(columns={"heading": "headng"}), "did you mean 'headng'"),
    "no frame": (lambda t: without(t, "frame"), "'frame'"),
    "NaN": (lambda t: t.assign(x=np.nan), "x: expected a finite number"),
    "words": (lambda t: t.assign(x="left"), "x: expected numbers"),
    "flat": (lambda t: t.assign(dz=0.0), "dz"),
    "score": (lambda t: t.assign(score=2.0), "score: expected 0 to 1"),
    "another frame": (lambda t: t.assign(frame=5), "frame: expected one of"),
    "type": (lambda t: t.assign(type=3), "type"),
}
MODELS: dict[str, tuple[Any, str]] = {
    "raises": (raising, "frame 0: .*ZeroDivisionError: of my own"),
    "nothing": (lambda p: None, "frame 0: expected a table, .*, got NoneType"),
    "array": (lambda p: np.zeros((1, 6)), r"frame 0: expected a table, .*, got ndarray \(1, 6\)"),
    "wrong column": (lambda p: boxes().rename(columns={"dx": "dxx"}), "did you mean 'dxx'"),
    "NaN": (lambda p: boxes(x=np.nan), "frame 0: expected finite numbers"),
    "words": (lambda p: boxes(x="left"), "frame 0: expected numbers"),
    "flat": (lambda p: boxes(dz=0.0), "dx, dy, dz: expected values above 0"),
    "score": (lambda p: boxes(score=7.0), "score: expected 0 to 1, got 7"),
    "degrees": (lambda p: boxes(heading=90.0), "heading: expected radians"),
    "millimetres": (lambda p: boxes(dx=4500.0), "dx, dy, dz: expected at most 100 m"),
    "type": (lambda p: boxes(type=3), "type: expected a name"),
    "two arguments": (lambda p, q: boxes(), "frame 0: .*TypeError"),
    "no callable": (3, "expected a detector or a callable, got int"),
    "none": (None, "expected a detector or a callable, got NoneType"),
    "name": ("generalst", "did you mean 'generalist'"),
}
CALLS: dict[str, tuple[Call, str]] = {
    "plan: scene": (lambda g: pi.plan("hiway", 9000), "scene: "),
    "plan: find": (lambda g: pi.plan("crossroad", 9000, find=90), "find: expected 0 to 1"),
    "load_scene: name": (lambda g: pi.load_scene("highwy"), "scene: .*did you mean 'highway'"),
    "load_scene: type": (
        lambda g: pi.load_scene(3),
        "scene: expected a text or a path or a dict, got 3",
    ),
    "load_scene: key": (lambda g: pi.load_scene("highway", set={"duraton_s": 1}), "duraton_s"),
    "load_scene: value": (lambda g: pi.load_scene("highway", set={"duration_s": -1}), "duration_s"),
    "load_scene: seed": (lambda g: pi.load_scene("highway", seed=-1), "seed"),
    "load_scene: mount": (lambda g: pi.load_scene("highway", mount="mast"), "mount: "),
    "load_scene: file": (lambda g: pi.load_scene(g.file), "file.txt"),
    "load_lidar: name": (lambda g: pi.load_lidar("rubi_plus"), "lidar: .*did you mean 'ruby_plus'"),
    "load_lidar: preset": (lambda g: pi.load_lidar("ruby_plus", preset="papr"), "papr"),
    "load_lidar: exponent": (
        lambda g: pi.load_lidar("ruby_plus", law_exponent=0.6),
        "law_exponent: expected 0.25 to 0.5, got 0.6",
    ),
    "load_lidar: echo": (
        lambda g: pi.load_lidar("livox_avia", echo="last"),
        "echo: livox_avia: expected a mode that the sensor offers .first, strongest, dual.",
    ),
    "load_lidar: type": (lambda g: pi.load_lidar(None), "lidar: "),
    "simulate: scene": (lambda g: pi.simulate("hiway", "helios_16", [0]), "scene: "),
    "simulate: lidar": (lambda g: pi.simulate(g.scene, "helios", [0]), "lidar: "),
    "simulate: no lidar": (lambda g: pi.simulate(g.scene, [], [0]), "lidar: expected one or more"),
    "simulate: twice": (lambda g: pi.simulate(g.scene, ["helios_16"] * 2, [0]), "lidar: "),
    "simulate: no frames": (lambda g: pi.simulate(g.scene, "helios_16", []), "frames: "),
    "simulate: order": (lambda g: pi.simulate(g.scene, "helios_16", [3, 1]), "frames: "),
    "simulate: beyond": (
        lambda g: pi.simulate(g.scene, "helios_16", [99]),
        "frames: expected 0 to",
    ),
    "simulate: words": (lambda g: pi.simulate(g.scene, "helios_16", ["a"]), "frames: "),
    "simulate: number": (lambda g: pi.simulate(g.scene, "helios_16", 3), "frames: "),
    "simulate: half": (lambda g: pi.simulate(g.scene, "helios_16", [0.5]), "frames: "),
    "simulate: threads": (
        lambda g: pi.simulate(g.scene, "helios_16", [0], threads=-1),
        "threads: ",
    ),
    "load_dataset: folder": (lambda g: pi.load_dataset("/no/such"), "folder: /no/such: No such"),
    "load_dataset: empty": (lambda g: pi.load_dataset(g.empty), "folder: "),
    "load_dataset: file": (lambda g: pi.load_dataset(g.file), "folder: "),
    "load_dataset: type": (lambda g: pi.load_dataset(7), "folder: "),
    "load_detector: name": (lambda g: pi.load_detector("generalst"), "model: .*did you mean"),
    "load_detector: empty": (lambda g: pi.load_detector(g.empty), "model: "),
    "load_detector: type": (lambda g: pi.load_detector(7), "model: "),
    "detect: frames": (lambda g: pi.detect(len, "/no/such"), "frames: "),
    "detect: frames type": (lambda g: pi.detect(len, 7), "frames: "),
    "detect: height": (lambda g: pi.detect("generalist", g.frames, height_m=-1), "height_m: "),
    "detect: region": (lambda g: pi.detect(len, g.frames, region=[[0, 0]]), "region: "),
    "detect: region without effect": (
        lambda g: pi.detect(len, g.frames, region=[[0, 0], [9, 0], [9, 9]]),
        "region: ",
    ),
    "detect: region 3": (lambda g: pi.detect(len, g.frames, region=np.zeros((4, 3))), "region: "),
    "detect: region NaN": (
        lambda g: pi.detect(len, g.frames, region=[[np.nan] * 2] * 3),
        "region: ",
    ),
    "detect: region file": (lambda g: pi.detect(len, g.frames, region="no.yaml"), "region: "),
    "evaluate: gt": (lambda g: pi.evaluate(7, g.table), "gt: "),
    "evaluate: gt folder": (lambda g: pi.evaluate(g.empty, g.table), "gt: "),
    "evaluate: pred folder": (lambda g: pi.evaluate(g.frames, "/no/such"), "pred: "),
    "evaluate: class": (
        lambda g: pi.evaluate(g.frames, g.table, object_class="vehcle"),
        "object_class: .*did you mean 'vehicle'",
    ),
    "evaluate: frames": (lambda g: pi.evaluate(g.frames, g.table, frames=[5]), "frames: "),
    "evaluate: split": (lambda g: pi.evaluate(g.frames, g.table, split="val"), "split: "),
    "evaluate: ground truth": (
        lambda g: pi.evaluate(g.frames, g.table, pi.Settings(ground_truths=("common",))),
        "ground_truths: ",
    ),
    "Settings: ground truth": (lambda g: pi.Settings(ground_truths=("al",)), "ground_truths: "),
    "Settings: IoU": (lambda g: pi.Settings(ious=(2.0,)), "ious: "),
    "compare: one of each": (lambda g: pi.compare(g.result, [g.result]), "compare: "),
    "compare: lengths": (lambda g: pi.compare([g.result] * 2, [g.result] * 3), "compare: "),
    "compare: twice": (lambda g: pi.compare([g.result] * 2, [g.result] * 2), "compare: "),
    "compare: tables": (lambda g: pi.compare(g.table, g.table), "a: "),
    "compare: list of tables": (lambda g: pi.compare([g.table] * 2, [g.result] * 2), "a: "),
    "compare: ground truth": (
        lambda g: pi.compare(g.result, g.result, ground_truth="al"),
        "ground_truth: ",
    ),
    "plot_frame: frame": (lambda g: pi.plot_frame(g.frames), "frame: "),
    "plot_frame: score": (
        lambda g: pi.plot_frame(g.frames[0], g.table, min_score=7),
        "min_score: ",
    ),
    "plot_frame: columns": (
        lambda g: pi.plot_frame(g.frames[0], without(g.table, "dx")),
        "detections: ",
    ),
    "plot_frame: NaN": (
        lambda g: pi.plot_frame(g.frames[0], g.table.assign(x=np.nan)),
        "detections: ",
    ),
    "plot_frame: array": (lambda g: pi.plot_frame(g.frames[0], np.zeros((1, 7))), "detections: "),
    "plot_scene: name": (lambda g: pi.plot_scene("highwy"), "scene: "),
    "plot_scene: type": (lambda g: pi.plot_scene(3), "scene: "),
    "plot_ap_by_distance: table": (lambda g: pi.plot_ap_by_distance(g.table), "results: "),
    "plot_ap_by_distance: none": (lambda g: pi.plot_ap_by_distance({}), "results: "),
    "plot_ap_by_distance: names": (
        lambda g: pi.plot_ap_by_distance({"a": g.table}),
        "results: a: ",
    ),
    "plot_ap_by_distance: ground truth": (
        lambda g: pi.plot_ap_by_distance(g.result, ground_truth="al"),
        "ground_truth: ",
    ),
    "plot_stress: folder": (lambda g: pi.plot_stress(g.empty, "rain"), "rows: "),
    "plot_stress: two LiDARs": (
        lambda g: pi.plot_stress(stressed("ruby_plus", "helios_16"), "rain"),
        "rows: expected rows of one lidar, got ruby_plus, helios_16",
    ),
    "plot_stress: table": (lambda g: pi.plot_stress(g.table, "rain"), "rows: "),
    "train: config": (
        lambda g: pi.train("pointpilars", g.empty, work=g.empty),
        "config: .*did you mean",
    ),
    "train: folder": (
        lambda g: pi.train("pointpillars", g.empty, work=g.folder / "w"),
        "frames: ",
    ),
    "train: none": (lambda g: pi.train("pointpillars", [], work=g.folder / "w"), "frames: "),
    "train: tier": (
        lambda g: pi.train("pointpillars", g.empty, work=g.empty, tier="fast"),
        "tier: ",
    ),
    "benchmark: config": (
        lambda g: pi.benchmark("dmo", g.empty, work=g.empty),
        "config: .*did you mean",
    ),
    "benchmark: jobs": (lambda g: pi.benchmark("demo", g.empty, work=g.empty, jobs=0), "jobs: "),
    "benchmark: tier": (
        lambda g: pi.benchmark("demo", g.empty, work=g.empty, tier="fast"),
        "tier: ",
    ),
    "benchmark: scene": (
        lambda g: pi.benchmark("demo", g.empty, work=g.empty, scene="hiway"),
        "scene: ",
    ),
    "recommend: folder": (lambda g: pi.recommend(g.empty), "results: "),
    "recommend: AP": (lambda g: pi.recommend(g.empty, min_ap=0.8), "min_ap: "),
    "stress: model": (lambda g: pi.stress("generalst", g.empty, work=g.empty), "models: |data: "),
    "stress: name": (
        lambda g: pi.stress(g.empty, g.empty, work=g.empty, stressors=["rian"]),
        "stressors: ",
    ),
    "import_map: file": (lambda g: pi.import_map("/no/such.osm", g.folder / "s"), "file: "),
    "import_map: kind": (lambda g: pi.import_map(g.file, g.folder / "s"), "file.txt"),
    "import_map: radius": (
        lambda g: pi.import_map(g.file, g.folder / "s", radius_m=1),
        "radius_m: ",
    ),
    "import_recording: format": (
        lambda g: pi.import_recording(g.empty, "kiti", g.folder / "r/a"),
        "format: .*did you mean 'kitti'",
    ),
    "import_recording: folder": (
        lambda g: pi.import_recording("/no/such", "pcd", g.folder / "r/a"),
        "source: ",
    ),
    "import_recording: empty": (
        lambda g: pi.import_recording(g.empty, "pcd", g.folder / "r/a"),
        "empty",
    ),
    "track: detections": (lambda g: pi.track(without(g.table, "x"), g.frames), "x"),
    "track: smooth": (lambda g: pi.track(g.table, g.frames, smooth=3), "smooth: expected True"),
    "count: interval": (lambda g: pi.count(g.table, g.frames, interval_s="9"), "interval_s: "),
    "evaluate_tracks: frames": (lambda g: pi.evaluate_tracks(3, g.table), "frames: expected a Fra"),
    "list_scenes: argument": (lambda g: pi.list_scenes(1), "list_scenes: too many"),
    "list_lidars: argument": (lambda g: pi.list_lidars(1), "list_lidars: too many"),
    "list_presets: argument": (lambda g: pi.list_presets(1), "list_presets: too many"),
    "list_detectors: argument": (lambda g: pi.list_detectors(1), "list_detectors: too many"),
    "register_detector: name": (
        lambda g: pi.register_detector(len, "generalist"),
        "name: expected a name that no pretrained detector has",
    ),
    "register_detector: type": (lambda g: pi.register_detector(3), "detector: expected a function"),
    "split: by": (lambda g: pi.split(g.folder, "tim"), "by: .*did you mean 'time'"),
    "split: short": (
        lambda g: pi.split(g.frames.save(g.folder / "short")),
        "short: expected frames before 400 s",
    ),
    "validate: data": (lambda g: pi.validate(g.empty), "data: "),
    "trust: predictions": (lambda g: pi.trust(g.frames, 3), "predictions: "),
    "statistics: accumulate": (
        lambda g: pi.statistics(g.frames, accumulate=0),
        "accumulate: expected 1 to 100, got 0",
    ),
    "propose_region: out": (
        lambda g: pi.propose_region(g.frames, "outline.txt"),
        "out: expected a file name that ends in .yaml",
    ),
    "export_onnx: model": (lambda g: pi.export_onnx(g.empty, "m.onnx"), "model: "),
    "view: lidars": (
        lambda g: pi.view(g.frames, g.folder / "v.html", lidars=["x"]),
        "lidar: expected one of helios_16",
    ),
    "view: frames": (
        lambda g: pi.view(g.frames, g.folder / "v.html", frames=99),
        "frames: expected 0 to 10, got",
    ),
    "pictures: frame": (
        lambda g: pi.pictures(g.frames, g.folder / "p", frame=99),
        "frame: expected",
    ),
    "report: results": (lambda g: pi.report(g.empty, g.folder / "r.html"), "expected tables of"),
    "make_sites: count": (lambda g: pi.make_sites(g.empty, 0), "count: expected 1 or more"),
    "simulate_traffic: site": (lambda g: pi.simulate_traffic(g.empty), "site.yaml"),
    "import_trajectories: classes": (
        lambda g: pi.import_trajectories(g.file, g.empty, classes={"a": "Carr"}),
        "classes: .*did you mean 'Car'",
    ),
    "import_mesh: material": (
        lambda g: pi.import_mesh("a.glb", g.empty, material="strcture"),
        "material: .*did you mean 'structure'",
    ),
    "draw_site: site": (lambda g: pi.draw_site(g.empty, g.folder / "p.svg"), "site: "),
    "export: format": (
        lambda g: pi.export(g.frames, "opnpcdet", g.folder / "e"),
        "format: .*did you mean",
    ),
    "export_tracks: tracks": (
        lambda g: pi.export_tracks(g.table, "a.jsonl"),
        "tracks: expected the column 't_s' of `track`, got none",
    ),
    "export_tracks: file": (
        lambda g: pi.export_tracks(g.table, "a.xyz"),
        "file: expected a file name that ends in .csv",
    ),
    "export: frames": (lambda g: pi.export(3, "pcd", g.folder / "e"), "frames: "),
    "export: out": (lambda g: pi.export(g.frames, "pcd", g.folder), "out: "),
}


@pytest.mark.parametrize("case", CALLS)
def test_a_wrong_argument_is_named(given: Given, case: str) -> None:
    call, message = CALLS[case]
    with pytest.raises(pi.Error, match=message):
        call(given)


@pytest.mark.parametrize("case", MODELS)
def test_a_wrong_detector_is_named(given: Given, case: str) -> None:
    model, message = MODELS[case]
    with pytest.raises(pi.Error, match=f"model: .*{message}"):
        pi.detect(model, given.frames)


@pytest.mark.parametrize("case", PREDICTIONS)
def test_wrong_predictions_are_named(given: Given, case: str) -> None:
    change, message = PREDICTIONS[case]
    with pytest.raises(pi.Error, match=f"pred[a-z]*: .*{message}"):
        pi.evaluate(given.frames, change(given.table))


def test_no_box_is_no_error(given: Given) -> None:
    """This is true for a detector that finds nothing, and for a frame without points."""
    nothing = pi.detect(lambda points: boxes()[:0], given.frames)
    assert len(nothing) == 0
    assert (pi.evaluate(given.frames, nothing).by_distance.ap_r1000.dropna() == 0).all()


def test_every_function_has_bad_input_here() -> None:
    functions = {name for name in pi.__all__ if inspect.isfunction(getattr(pi, name))}
    assert functions - {case.split(":")[0] for case in CALLS} == set()
    assert isinstance(pi.Error("x"), ValueError)


def test_frames_are_a_sequence(given: Given) -> None:
    assert isinstance(given.frames, FrameSequence)
