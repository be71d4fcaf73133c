"""A researcher's day in the lines that one would guess, from memory alone."""

from __future__ import annotations

import json
import pickle
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml

import pyinfra as pi
from pyinfra.dataset.catalogue import scene_file
from pyinfra.dataset.runs import infrasim
from pyinfra.formats.ply import Triangles, write_ply

ROOT = Path(__file__).resolve().parents[2]
SHORT = {"duration_s": 6, "traffic.warm_up_s": 20}


@pytest.fixture(scope="module")
def frames() -> pi.FrameSequence:
    return pi.simulate(pi.load_scene("highway", seed=1, set=SHORT), "helios_16", range(0, 60, 6))


def test_names_are_listed() -> None:
    assert {"highway", "crossroad"} <= set(pi.list_scenes())
    assert {"ruby_plus", "helios_16"} <= set(pi.list_lidars())
    assert pi.list_presets() == ["datasheet", "equal", "paper"]
    assert "generalist" in pi.list_detectors()


def test_scenes_and_lidars_are_dicts(tmp_path: Path) -> None:
    from pyinfra.dataset.catalogue import lidar_file, scene_file

    lidar = yaml.safe_load(lidar_file("helios_16").read_text())
    scene = yaml.safe_load(scene_file("highway").read_text())
    world = pi.load_scene(scene, seed=1, set={k: np.float64(v) for k, v in SHORT.items()})
    ours = pi.simulate(world, pi.load_lidar(lidar), range(1))
    theirs = pi.simulate(pi.load_scene("highway", seed=1, set=SHORT), "helios_16", range(1))
    np.testing.assert_array_equal(ours[0].points, theirs[0].points)
    with pytest.raises(pi.Error, match="naem"):
        pi.load_lidar({"naem": "x"})


@pytest.mark.filterwarnings("ignore:generalist")
def test_the_pretrained_detector_is_a_function(frames: pi.FrameSequence) -> None:
    model = pi.load_detector("generalist")
    of_frames = pi.detect(model, frames)
    of_frame = model(frames[0])
    pd.testing.assert_frame_equal(of_frame, of_frames[of_frames.frame == 0])
    assert isinstance(of_frames, pi.Detections)


@pytest.mark.filterwarnings("ignore:generalist")
@pytest.mark.filterwarnings("ignore:no region is known")
def test_an_array_is_enough(frames: pi.FrameSequence) -> None:
    pole = frames.lidar.T_world_levelled.z
    boxes = pi.detect("generalist", frames[0].points, height_m=pole)
    near = pi.detect("generalist", frames[0])
    assert len(boxes) >= len(near) > 0


def test_detections_are_saved_and_read(frames: pi.FrameSequence, tmp_path: Path) -> None:
    found = pi.detect(lambda points: frames[0].labels[list(BOX)].to_numpy(), frames)
    read = pi.Detections.from_kitti(found.save(tmp_path / "found"))
    pd.testing.assert_frame_equal(read, found, atol=1e-3, rtol=0, check_like=True)
    one, two = (pi.evaluate(frames, x).ap.ap_r1000[0] for x in (found, tmp_path / "found"))
    assert one == pytest.approx(two, abs=0.2)


def test_an_own_detector_has_a_name(frames: pi.FrameSequence) -> None:
    @pi.register_detector
    class Nearest:
        def predict(self, points: np.ndarray) -> dict[str, object]:
            x, y, z = points[0, :3]
            return {"boxes": [[x, y, z, 4, 2, 1.5, 0]], "names": ["Car"], "scores": [0.5]}

    assert "Nearest" in pi.list_detectors()
    table = pi.detect("Nearest", frames[:2])
    assert table["type"].tolist() == ["Car", "Car"]
    with pytest.raises(pi.Error, match="did you mean 'Nearest'"):
        pi.detect("Nearst", frames)


def test_a_detector_learns_from_memory(frames: pi.FrameSequence, tmp_path: Path) -> None:
    seen: list[tuple[int, int]] = []

    def augment(points: np.ndarray, boxes: np.ndarray, rng: np.random.Generator) -> tuple:
        seen.append((points.shape[1], boxes.shape[1]))
        return points, boxes

    losses: list[list[str]] = []
    steps: list[tuple[int, int]] = []

    def loss(parts: dict, batch: object) -> dict:
        losses.append(sorted(parts))
        return {name: 2 * value for name, value in parts.items()}

    model = pi.train(
        "centerpoint-pillar",
        frames,
        steps=2,
        tier="smoke",
        augment=augment,
        loss=loss,
        progress=lambda done: steps.append((done.step, done.steps)),
    )
    assert len(losses) == 2
    assert steps == [(1, 2), (2, 2)]
    assert set(seen) == {(4, 7)}
    assert len(seen) >= 2
    kept = pi.load_detector(model.save(tmp_path / "kept/model.safetensors"))
    pd.testing.assert_frame_equal(pi.detect(kept, frames[:1]), pi.detect(model, frames[:1]))


def test_frames_are_saved_in_every_format(frames: pi.FrameSequence, tmp_path: Path) -> None:
    for name in ("kitti", "pcd", "openpcdet", "mmdet3d", "nuscenes", "openlabel", "mcap"):
        assert any(frames[:1].save(tmp_path / name, format=name).iterdir())
    with pytest.raises(pi.Error, match=r"format: .*did you mean 'nuscenes'"):
        frames.save(tmp_path / "x", format="nuscens")


def test_everything_can_be_pickled(frames: pi.FrameSequence) -> None:
    result = pi.evaluate(frames, frames.labels.assign(score=1.0))
    for thing in (frames.world, frames.unit, frames, frames[0], result, pi.load_detector()):
        again = pickle.loads(pickle.dumps(thing))
        assert type(again) is type(thing)
    again = pickle.loads(pickle.dumps(frames))
    np.testing.assert_array_equal(again[3].points, frames[3].points)
    pd.testing.assert_frame_equal(
        pickle.loads(pickle.dumps(result)).by_distance, result.by_distance
    )


def test_results_are_saved_and_drawn(frames: pi.FrameSequence, tmp_path: Path) -> None:
    result = pi.evaluate(frames, frames.labels.assign(score=1.0))
    files = result.save(tmp_path / "out")
    assert pd.read_csv(files[0]).ap_r1000[0] == 100
    assert result.plot().get_ylabel()


BOX = ("x", "y", "z", "dx", "dy", "dz", "heading")
HELD = "Detections Evaluation FrameSequence Interval Lidar LidarFrame Plan TrainedDetector World"


@pytest.mark.parametrize("name", HELD.split())
def test_classes_are_exported_and_documented(name: str) -> None:
    assert (getattr(pi, name).__doc__ or "").strip()


# --- wrong arguments ------------------------------------------------------------------------------

WRONG = {
    "frames: ": lambda f: pi.evaluate(f, f.labels, frames=20),
    "budget_usd: ": lambda f: pi.recommend("x", budget_usd="3"),
    "jobs: ": lambda f: pi.plan("crossroad", 9000, jobs=None),
    "tilt_deg: ": lambda f: pi.import_recording("x", "kitti", "y", tilt_deg=3),
    "threads: ": lambda f: pi.simulate("highway", "helios_16", [0], threads=1.5),
    "did you mean 'frames'": lambda f: pi.evaluate(f, f.labels, frame=[1]),
    "missing a required argument": lambda f: pi.evaluate(f),
    "settings: ": lambda f: pi.evaluate(f, f.labels, {"ious": 0.5}),
    "object_class: .*did you mean 'vehicle'": lambda f: pi.evaluate(
        f, f.labels.assign(score=1.0), object_class="vehicles"
    ),
    "config: ": lambda f: pi.train(3, f),
    "steps: ": lambda f: pi.train("pointpillars", f, steps=1.5),
    "tier: .*did you mean 'smoke'": lambda f: pi.train("pointpillars", f, tier="smok"),
    "seed: ": lambda f: pi.train("pointpillars", f, seed=-1),
    "centre: ": lambda f: pi.import_map("x", "y", centre=3),
    "types: ": lambda f: pi.import_recording("x", "kitti", "y", types="Car"),
    "severities: ": lambda f: pi.stress("generalist", "x", work="y", severities=3),
    "within_m: ": lambda f: pi.plan("crossroad", 9000, within_m="60"),
    "min_score: ": lambda f: pi.plot_frame(f[0], min_score="a"),
    "frame: ": lambda f: pi.plot_frame(3),
    "ground_truth: .*did you mean": lambda f: pi.compare([], [], ground_truth="capturd"),
    "by: ": lambda f: pi.compare([], [], by="distanc"),
    "a: ": lambda f: pi.compare(f, f),
    "set: ": lambda f: pi.load_scene("highway", set=3),
    "rate_hz: ": lambda f: pi.load_lidar("ruby_plus", rate_hz="10"),
    "format: ": lambda f: pi.export(f, 3, "x"),
    "device: ": lambda f: pi.load_detector(device=3),
}


@pytest.mark.parametrize("message", WRONG)
def test_wrong_arguments_are_errors_of_the_package(frames: pi.FrameSequence, message: str) -> None:
    with pytest.raises(pi.Error, match=message):
        WRONG[message](frames)


# --- several poles, velocities --------------------------------------------------------------------


def test_frames_of_several_poles_are_those_of_the_simulator(tmp_path: Path) -> None:
    """The points, and the pole of each, are those of `infrasim run --fuse`, with wrong poses."""
    keys = yaml.safe_load((ROOT / "configs/scenes/crossroad_poles.yaml").read_text())
    keys["mounts"]["west"]["calibration_error"] = {"x_m": 0.3, "pitch_deg": 0.5}
    keys["mounts"]["east"] |= {"calibration_error": {"yaw_deg": 1.0, "y_m": 0.2, "roll_deg": 0.3}}
    keys["mounts"] = {name: keys["mounts"][name] for name in ("west", "east")}
    (tmp_path / "poles.yaml").write_text(yaml.safe_dump(keys, sort_keys=False))
    file, out = tmp_path / "poles.yaml", tmp_path / "out"
    infrasim(
        *("run", file, "--lidar", ROOT / "configs/lidars/helios_16.yaml", "--fuse", "--fields"),
        *("--frames", "0:1", "--out", str(out)),
    )
    frames = pi.simulate(file, "helios_16", [0], mount=["west", "east"], fuse=True)
    written = pi.load_dataset(out / "fused")["helios_16"]
    np.testing.assert_allclose(frames[0].points, written[0].points, atol=2e-5)
    mounts = np.fromfile(out / "fused/helios_16/training/mounts/000000.bin", np.uint16)
    np.testing.assert_array_equal(frames[0].fields["mount"], mounts)
    labels = frames.labels.set_index("id").points
    assert labels.to_dict() == written.labels.set_index("id").points.to_dict()
    alone = pi.simulate(file, "helios_16", [0], mount=["west", "east"])
    assert {name: len(one[0].points) for name, one in alone.items()} == {
        "west": int((mounts == 0).sum()),
        "east": int((mounts == 1).sum()),
    }


def test_labels_have_velocities(frames: pi.FrameSequence, tmp_path: Path) -> None:
    labels = frames.labels
    one, two = (labels[labels.frame == k].set_index("id") for k in (0, 6))
    both = one.index.intersection(two.index)
    moved = (two.loc[both, ["x", "y"]] - one.loc[both, ["x", "y"]]).to_numpy() / 0.6
    np.testing.assert_allclose(one.loc[both, ["vx", "vy"]], moved, atol=1.0)
    saved = pi.load_dataset(frames.save(tmp_path / "b/data"))["helios_16"]
    np.testing.assert_allclose(saved.labels.vx, labels.vx, atol=1e-3)
    recorded = pi.import_recording(frames.save(tmp_path / "a/pcd", "pcd"), "pcd", tmp_path / "in/p")
    assert recorded.labels.vx.isna().all()
    assert len(recorded.labels)


# --- what the commands do -------------------------------------------------------------------------


def test_a_data_set_is_divided_checked_described_and_drawn(
    frames: pi.FrameSequence, tmp_path: Path
) -> None:
    data = frames.save(tmp_path / "highway")
    parts = pi.split(data, train_until_s=3, val_from_s=3)
    assert parts[["train", "val"]].values.tolist() == [[5, 5]]
    assert set(pi.validate(data).columns) == {"level", "name", "text"}
    found = pi.Detections(frames.labels.assign(score=1.0)).save(tmp_path / "found", frames.numbers)
    assert not (pi.validate(frames, found).level == "error").any()
    with pytest.raises(pi.Error, match="expected a recording of 10 s or more"):
        pi.trust(frames, found)
    whole = pi.simulate(pi.load_scene("highway"), "helios_16", range(105))
    boxes = pi.Detections(whole.labels.assign(score=1.0)).save(tmp_path / "boxes", whole.numbers)
    assert len(pi.trust(whole, boxes)) > 1
    tables = pi.statistics(data, tmp_path / "statistics")
    assert (tmp_path / "statistics/points_per_vehicle.csv").is_file()
    assert len(tables["points_per_vehicle"])
    page = pi.view(data, tmp_path / "view.html", frames="0:12:6", predictions=found)
    assert page.read_bytes().lower().startswith(b"<!doctype html")
    assert all(file.is_file() for file in pi.pictures(data, tmp_path / "pictures"))


# --- own models -----------------------------------------------------------------------------------


def test_an_own_model_of_returns_decides_what_becomes_a_point() -> None:
    def near(hits: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        kept = hits[np.hypot(hits["x"], hits["y"]) < 30].copy()
        kept["intensity"] = rng.random(len(kept))
        return kept

    scene = pi.load_scene("highway", seed=1, set=SHORT)
    ideal = pi.simulate(scene, pi.load_lidar("helios_16").with_every_hit(), [0])
    ours = pi.simulate(scene, "helios_16", [0], returns=near)
    inside = np.hypot(*ideal[0].points[:, :2].T) < 30
    np.testing.assert_array_equal(ours[0].points[:, :3], ideal[0].points[inside, :3])
    assert len(ours[0].fields) == inside.sum()
    assert len(ideal[0].points) > 1.2 * len(pi.simulate(scene, "helios_16", [0])[0].points)
    counts = ours[0].objects.set_index("id").points
    ids = pd.Series(ours[0].fields["object_id"])
    assert all((ids == number).sum() == count for number, count in counts.items())
    with pytest.raises(pi.Error, match="returns: "):
        _ = pi.simulate(scene, "helios_16", [0], returns=lambda hits, rng: 3)[0].points


def test_an_own_model_of_returns_applies_at_each_mount() -> None:
    def few(hits: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        return hits[:5]

    both = ["west", "east"]
    alone = pi.simulate("crossroad_poles", "helios_16", [0], mount=both, returns=few)
    assert [len(one[0].points) for one in alone.values()] == [5, 5]
    fused = pi.simulate("crossroad_poles", "helios_16", [0], mount=both, fuse=True, returns=few)
    assert fused[0].fields["mount"].tolist() == [0] * 5 + [1] * 5


def test_counts_of_an_own_model_of_returns_can_be_saved(tmp_path: Path) -> None:
    """No object has more points in its box than points, so that the data set can be read."""

    def half(hits: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        return hits[::2]

    scene = pi.load_scene("highway", seed=1, set=SHORT)
    frames = pi.simulate(scene, "helios_16", [0], returns=half)
    saved = pi.load_dataset(frames.save(tmp_path / "data"))["helios_16"]
    pd.testing.assert_series_equal(saved.objects.points, frames.objects.points)


def test_an_own_mesh_hides_what_is_behind_it() -> None:
    corners = np.array([[10, -20, 0], [10, 20, 0], [10, 20, 9], [10, -20, 9]], float)
    pole = pi.load_scene("highway", seed=1, set=SHORT)
    wall = ("structure", corners, [[0, 1, 2], [0, 2, 3]])
    behind = [
        (pi.simulate(scene, "helios_16", [0])[0].points[:, 0] > 12).sum()
        for scene in (pole, pi.load_scene("highway", seed=1, set=SHORT, meshes=[wall]))
    ]
    assert behind[1] < behind[0] / 2
    with pytest.raises(pi.Error, match="meshes: expected faces"):
        pi.load_scene("highway", meshes=[("structure", corners, [0, 1])])


@pytest.mark.parametrize("folder", ["plain", "a, b", "a #b", "a: b", "it's {old}"])
def test_a_scene_with_meshes_takes_further_ones(
    folder: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    corners, faces = np.add([30, 30, 0], np.eye(3)), [[0, 1, 2]]
    (tmp_path / folder).mkdir()
    write_ply(tmp_path / folder / "own.ply", Triangles(corners, np.array(faces)))
    keys = {"meshes": [{"file": "own.ply", "material": "structure"}]}
    text = scene_file("highway").read_text() + yaml.safe_dump(keys)
    (tmp_path / folder / "site.yaml").write_text(text)
    monkeypatch.chdir(tmp_path)
    for file in (f"{folder}/site.yaml", tmp_path / folder / "site.yaml"):
        scene = pi.load_scene(file, set=SHORT, meshes=[("structure", corners, faces)])
        first, second = yaml.safe_load(scene.dump())["meshes"]
        assert Path(first["file"]) == tmp_path / folder / "own.ply"
        assert Path(second["file"]).is_file()


@pytest.mark.parametrize("name", ["a, b", "a #b", "a: b", "a}", "a\\b", "ä 1"])
def test_a_set_text_is_kept(name: str) -> None:
    assert yaml.safe_load(pi.load_scene("highway", set={"name": name}).dump())["name"] == name


def test_set_values_may_be_yaml_or_infinite() -> None:
    changes = {
        "traffic.speed": "{mean_km_h: 50}",
        "weather.visibility_m": np.float64("inf"),
        "duration_s": "3",
        "name": "'quoted'",
    }
    keys = yaml.safe_load(pi.load_scene("highway", set=changes).dump())
    assert keys["traffic"]["speed"]["mean_km_h"] == 50
    assert keys["weather"]["visibility_m"] == np.inf
    assert (keys["duration_s"], keys["name"]) == (3, "quoted")


def test_results_of_nuscenes_are_detections(frames: pi.FrameSequence, tmp_path: Path) -> None:
    """The boxes of a result file that repeats the annotations of an export are its labels."""
    tables = next(frames[:3].save(tmp_path / "nu", "nuscenes").glob("*/sample.json")).parent
    rows = json.loads((tables / "sample_annotation.json").read_text())
    results: dict[str, list] = {
        row["token"]: [] for row in json.loads((tables / "sample.json").read_text())
    }
    for row in rows:
        box = {name: row[name] for name in ("translation", "size", "rotation")}
        box |= {"detection_name": "car", "detection_score": 0.5}
        results[row["sample_token"]].append(box)
    file = tmp_path / "results.json"
    file.write_text(json.dumps({"meta": {}, "results": results}))
    found = pi.Detections.from_nuscenes(file, tmp_path / "nu", frames[:3].numbers)
    assert len(found) == len(rows)
    labels = frames[:3].labels
    for row in labels.itertuples():
        near = found[found.frame == row.frame]
        least = np.hypot(near.x - row.x, near.y - row.y).idxmin()
        np.testing.assert_allclose(
            near.loc[least, ["dx", "dy"]].tolist(), [row.dx, row.dy], atol=0.01
        )
        np.testing.assert_allclose(
            near.loc[least, ["x", "y", "z"]].tolist(), [row.x, row.y, row.z], atol=1
        )
        assert abs(np.sin(near.heading[least] - row.heading)) < 0.02


def test_what_functions_return_has_a_table_in_notebooks(frames: pi.FrameSequence) -> None:
    result = pi.evaluate(frames, frames.labels.assign(score=1.0))
    found = pi.detect(lambda points: np.empty((0, 7)), frames)
    for thing in (frames, frames[0], result, found):
        assert thing._repr_html_().startswith(("<table", "<div"))
    for thing in (frames, frames[0], result, frames.world, frames.unit, pi.load_detector()):
        assert len(repr(thing)) < 300
