"""A killed training is resumed with the same result, and errors of a training are reported."""

import dataclasses
import json
import pickle
import re
import shutil
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml

torch = pytest.importorskip("torch", reason="the extra `train` is not installed")

from detector_data import road_sample  # noqa: E402
from safetensors.torch import load_file, save_file  # noqa: E402

from pyinfra.cli import main  # noqa: E402
from pyinfra.core.boxes import points_in_box, points_in_boxes  # noqa: E402
from pyinfra.core.errors import ConfigError, Error  # noqa: E402
from pyinfra.dataset.ground import level_ground  # noqa: E402
from pyinfra.formats import (  # noqa: E402
    kitti,
    pcd_file,
)
from pyinfra.models.detectors import Detections, windows  # noqa: E402
from pyinfra.models.detectors.batch import Batch, make_batch  # noqa: E402
from pyinfra.models.detectors.detection_area import Area  # noqa: E402
from pyinfra.models.detectors.sample import Sample  # noqa: E402
from pyinfra.models.detectors.suppression import MIN_SCORE  # noqa: E402
from pyinfra.models.inference import detect  # noqa: E402
from pyinfra.models.training import batches, checkpoint, loop, train, validation  # noqa: E402
from pyinfra.models.training.provenance import is_among  # noqa: E402
from pyinfra.models.training.recipe import Recipe, read_recipe  # noqa: E402
from pyinfra.models.training.samples import (  # noqa: E402
    Augmentation,
    Frames,
    augmented,
    hidden_by,
    lifted,
    moved,
    with_faults,
    with_pasted,
    with_pose_error,
)
from pyinfra.models.training.sources import (  # noqa: E402
    Source,
    common_label_time,
    read_source,
    simulated_source,
)

ROOT = Path(__file__).resolve().parents[2]
CONFIG = ROOT / "configs/detectors/centerpoint-pillar.yaml"
LIDAR = """\
name: "ring"
model: "Ring"
preset: "paper"
price_total_usd: {low: 100, high: 200}
period_s: 0.1
T_world_levelled: {x_m: 0, y_m: 0, z_m: 6, yaw_deg: 0}
T_levelled_sensor: {pitch_deg: 0, roll_deg: 0}
field_of_view:
  - {yaw_deg: 0, pitch_deg: 0, azimuth_deg: [-180, 180], elevation_deg: [-25, 15],
     range_m: [0, 100]}
label_time: frame
"""
FRAMES = 12


@pytest.fixture(scope="module")
def lidar_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Writes frames of an artificial road with a split."""
    folder = tmp_path_factory.mktemp("data") / "road/ring"
    folder.mkdir(parents=True)
    (folder / "lidar.yaml").write_text(LIDAR)
    for frame in range(FRAMES):
        sample = road_sample(frame)
        labels = kitti.Labels(np.full(len(sample.boxes), "Car"), sample.boxes, None)
        kitti.write_frame(folder, frame, sample.points, labels)
    (folder / "ImageSets").mkdir()
    for part, numbers in (("train", range(8)), ("val", range(8, FRAMES))):
        text = "".join(f"{k:06d}\n" for k in numbers)
        (folder / f"ImageSets/{part}.txt").write_text(text)
    return folder


def recipe(steps: int = 6) -> Recipe:
    original = read_recipe(CONFIG, "smoke")
    augmentation = Augmentation(flip=True, rotation_deg=5, scale=0.05, pasted=3)
    learning = dataclasses.replace(original.learning, steps=steps)
    return dataclasses.replace(original, learning=learning, augmentation=augmentation)


def run(folder: Path, out: Path, steps: int = 6) -> Path:
    return train.train(recipe(steps), [read_source(folder, "smoke")], out, quiet=True)


@pytest.fixture(scope="module")
def trained(lidar_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("run")
    run(lidar_folder, out)
    return out


def test_a_killed_run_goes_on_to_the_same_weights(
    lidar_folder: Path, trained: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Killed(BaseException):
        pass

    real, calls = loop.batch_of, []

    def dies(*words: object) -> object:
        calls.append(words)
        if len(calls) > 3:
            raise Killed
        return real(*words)  # type: ignore[arg-type]

    monkeypatch.setattr(loop, "batch_of", dies)
    with pytest.raises(Killed):
        run(lidar_folder, tmp_path)
    monkeypatch.setattr(loop, "batch_of", real)
    run(lidar_folder, tmp_path)
    ours, theirs = (load_file(folder / "last.safetensors") for folder in (tmp_path, trained))
    assert ours.keys() == theirs.keys()
    for name, tensor in ours.items():
        assert torch.equal(tensor, theirs[name]), name
    log = pd.read_csv(tmp_path / "log.csv")
    assert log.step.tolist() == [1, 2, 3, 4, 5, 6]
    kept = pd.read_csv(trained / "log.csv")
    np.testing.assert_array_equal(log.loss, kept.loss)
    assert (log.cpu_seconds > 0).all()


def best_recipe(steps: int = 10) -> Recipe:
    plain = recipe(steps)
    learning = dataclasses.replace(plain.learning, validate_frames=2)
    return dataclasses.replace(plain, learning=learning)


@pytest.mark.nightly
def test_the_best_checkpoint_changes_nothing_of_the_last_one_and_survives_a_kill(
    lidar_folder: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    class Killed(BaseException):
        pass

    measured = iter([20.0, 50.0, 40.0, 50.0, 30.0])
    precision = {step: next(measured) for step in (2, 4, 6, 8, 10)}
    saved = checkpoint.save
    seen: list[int] = []

    def scripted(network: object, frames: object) -> float:
        seen.append(len(frames))  # type: ignore[arg-type]
        real(network, frames)  # type: ignore[arg-type]
        return precision[now[0]]

    real, rate, now = validation.average_precision, loop.set_rate, [0]

    def noted(optimizer: object, learning: object, step: int) -> float:
        now[0] = step + 1
        return rate(optimizer, learning, step)  # type: ignore[arg-type]

    monkeypatch.setattr(validation, "average_precision", scripted)
    monkeypatch.setattr(loop, "set_rate", noted)
    source = read_source(lidar_folder, "smoke")
    whole, killed, without = (tmp_path / name for name in ("whole", "killed", "without"))
    train.train(best_recipe(), [source], whole, quiet=True)
    assert seen == [2] * 5

    def dies(file: Path, *words: object) -> None:
        if file.name == "last.safetensors" and now[0] == 8:
            raise Killed  # after the check of this step
        saved(file, *words)  # type: ignore[arg-type]

    monkeypatch.setattr(checkpoint, "save", dies)
    with pytest.raises(Killed):
        train.train(best_recipe(), [source], killed, quiet=True)
    monkeypatch.setattr(checkpoint, "save", saved)
    train.train(best_recipe(), [source], killed, quiet=True)
    for name in ("last.safetensors", "best.safetensors", "validation.csv"):
        assert (whole / name).read_bytes() == (killed / name).read_bytes(), name
    best = checkpoint.load(whole / "best.safetensors").provenance
    assert best.step == 8
    assert pd.read_csv(whole / "validation.csv").ap.tolist() == [20, 50, 40, 50, 30]
    boxes = source.read_boxes()[:6]
    fewer = dataclasses.replace(source, clouds=source.clouds[:6], read_boxes=lambda: boxes)
    train.train(recipe(10), [fewer], without, quiet=True)
    last = "last.safetensors"
    assert (whole / last).read_bytes() == (without / last).read_bytes()
    assert not (without / "best.safetensors").exists()
    cloud = str(kitti.frame_file(lidar_folder, "velodyne", 9))
    assert detect.model_file(whole).name == last
    assert main.main(["detect", cloud, "--model", str(whole), "--checkpoint", "best"]) == 0
    capsys.readouterr()
    assert main.main(["detect", cloud, "--model", str(without), "--checkpoint", "best"]) == 1
    assert "without: No best.safetensors or background.npz in it" in capsys.readouterr().err


class Known:
    """A detector that returns given boxes for any cloud."""

    training = True

    classes = ("vehicle",)

    def __init__(self, answers: list[Detections]) -> None:
        self.answers = iter(answers)

    def predict(self, _: object) -> Detections:
        return next(self.answers)

    def train(self, mode: bool) -> None:
        self.training = mode

    def eval(self) -> None:
        self.training = False


def test_vehicles_are_pasted_from_frames_of_the_same_lidar() -> None:
    def numbered(*numbers: int) -> Frames:
        return Frames(
            tuple(partial(np.full, 1, n) for n in numbers), (np.empty((0, 7)),) * len(numbers)
        )

    both = Frames((), ()) + numbered(0, 1, 2) + numbered(10, 11)
    draw = np.random.default_rng(1)
    drawn = [{int(both.another(i, draw).points[0]) for _ in range(50)} for i in range(5)]
    assert drawn == [{0, 1, 2}] * 3 + [{10, 11}] * 2


def test_validation_is_the_average_precision_of_all_held_out_frames() -> None:
    boxes = road_sample(1).boxes
    frames = Frames((lambda: boxes,) * 3, (boxes, boxes[:0], boxes))
    wrong = boxes + np.array([0, 100, 0, 0, 0, 0, 0])

    def answer(answered: np.ndarray, score: float) -> Detections:
        return Detections(
            answered, np.full(len(answered), score), np.full(len(answered), "vehicle")
        )

    nothing = answer(boxes[:0], 0)
    for answers, wanted in (
        ([answer(boxes, 0.9), nothing, answer(boxes, 0.8)], 100),
        ([answer(boxes, 0.9), nothing, nothing], 50),
        ([answer(boxes, 0.5), answer(wrong, 0.9), answer(boxes, 0.5)], 100 * 8 / 12),
        ([nothing] * 3, 0),
    ):
        network = Known(answers)
        assert validation.average_precision(network, frames) == pytest.approx(wanted)  # type: ignore[arg-type]
        assert network.training


@pytest.mark.parametrize("steps", [1, 3, 5, 7, 300, 40000])
def test_the_last_step_is_checked_and_few_others(steps: int) -> None:
    due = [step for step in range(1, steps + 1) if validation.is_due(step, steps)]
    assert due[-1] == steps
    assert len(due) == min(5, steps)


def test_held_out_frames_leave_some_to_learn_from_and_show_vehicles(
    lidar_folder: Path, tmp_path: Path
) -> None:
    source = read_source(lidar_folder, "smoke")
    learning = dataclasses.replace(recipe().learning, validate_frames=8)
    every = dataclasses.replace(recipe(), learning=learning)
    with pytest.raises(ValueError, match=r"validate_frames: expected less than 8, .*, got 8"):
        train.train(every, [source], tmp_path, quiet=True)
    boxes = source.read_boxes()[:6]
    none = dataclasses.replace(source, read_boxes=lambda: (*boxes, np.empty((0, 7)), boxes[0][:0]))
    with pytest.raises(ValueError, match="expected one or more vehicles in the last 2 frames"):
        train.train(best_recipe(), [none], tmp_path, quiet=True)
    assert list(tmp_path.iterdir()) == []


def test_a_finished_run_stays_as_it_is(lidar_folder: Path, trained: Path) -> None:
    before = (trained / "last.safetensors").read_bytes()
    run(lidar_folder, trained)
    assert (trained / "last.safetensors").read_bytes() == before


def test_a_run_of_other_steps_does_not_go_on(lidar_folder: Path, trained: Path) -> None:
    before = files_of(trained)
    with pytest.raises(ConfigError, match="got a checkpoint with different values of steps"):
        run(lidar_folder, trained, steps=7)
    assert files_of(trained) == before


def files_of(folder: Path) -> dict[Path, bytes]:
    return {file: file.read_bytes() for file in folder.rglob("*") if file.is_file()}


@pytest.mark.parametrize(
    ("part", "change", "message"),
    [
        (
            "learning",
            {"rate": 0.01},
            "learning.rate: expected 0.01 to resume the training, got 0.003",
        ),
        ("learning", {"batch": 3}, "learning.batch: expected 3 to resume the training, got 2"),
        (
            "augmentation",
            {"flip": False},
            "augmentation.flip: expected False to resume the training, got True",
        ),
        (
            "augmentation",
            {"pasted": 0},
            "augmentation.pasted: expected 0 to resume the training, got 3",
        ),
    ],
)
def test_a_run_that_learns_otherwise_does_not_go_on(
    lidar_folder: Path, trained: Path, part: str, change: dict[str, object], message: str
) -> None:
    other = dataclasses.replace(getattr(recipe(), part), **change)
    before = files_of(trained)
    with pytest.raises(ConfigError, match=re.escape(f"run.yaml: {message}")):
        train.train(
            dataclasses.replace(recipe(), **{part: other}),
            [read_source(lidar_folder, "smoke")],
            trained,
            quiet=True,
        )
    assert files_of(trained) == before


def test_a_run_of_other_frames_does_not_go_on(lidar_folder: Path, trained: Path) -> None:
    source, before = read_source(lidar_folder, "smoke"), files_of(trained)
    boxes = source.read_boxes()  # all boxes are used, so that the site is the same
    fewer = dataclasses.replace(
        source,
        clouds=source.clouds[:7],
        read_boxes=lambda: (*boxes[:6], np.concatenate(boxes[6:])),
    )
    with pytest.raises(
        ConfigError, match=r"run.yaml: frames: expected 7 to resume the training, got 8"
    ):
        train.train(recipe(), [fewer], trained, quiet=True)
    assert files_of(trained) == before


def test_a_run_of_other_traffic_does_not_go_on(lidar_folder: Path, trained: Path) -> None:
    source, before = read_source(lidar_folder, "smoke"), files_of(trained)
    boxes = source.read_boxes()
    other = dataclasses.replace(source, read_boxes=lambda: (*boxes[1:], boxes[0]))
    with pytest.raises(ConfigError, match=r"run.yaml: drawn: expected labels .* got labels .*"):
        train.train(recipe(), [other], trained, quiet=True)
    assert files_of(trained) == before


def test_a_run_of_a_version_without_a_digest_goes_on(lidar_folder: Path, trained: Path) -> None:
    file = trained / "run.yaml"
    file.write_text(re.sub(r"(?m)^drawn: .*$", "drawn: ''", file.read_text()))
    before = (trained / "last.safetensors").read_bytes()
    run(lidar_folder, trained)
    assert (trained / "last.safetensors").read_bytes() == before


def test_a_run_in_half_the_bits_goes_on_in_half_the_bits(
    lidar_folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["train", str(CONFIG), str(lidar_folder), "--tier", "smoke"]
    words += ["--step-factor", "0.07", "--out", str(tmp_path), "--precision"]
    assert main.main([*words, "bfloat16"]) == 0
    before = files_of(tmp_path)
    tensors = load_file(tmp_path / "last.safetensors").values()
    assert {t.dtype for t in tensors} <= {torch.float32, torch.int64}
    assert main.main([*words, "float32"]) == 2
    message = "run.yaml: precision: expected float32 to resume the training, got bfloat16"
    assert message in capsys.readouterr().err
    assert files_of(tmp_path) == before
    assert main.main([*words, "bfloat16"]) == 0
    with pytest.raises(SystemExit):
        main.main([*words, "float16"])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "detector: pointpilars\ntiers: {}\n",
            "1: detector: expected one of background, .*; got 'pointpilars'",
        ),
        ("tiers: {}\n", "1: detector: expected a value, got none"),
        (
            "detector: dsvt\ntiers:\n  smoke: {}\n  huge: {}\n",
            "4: tiers.huge: expected one of the keys smoke, quick, full; got an unknown key",
        ),
        ("detector: dsvt\ntiers: {smoke: {}}\n", "2: tiers.quick: expected a value, got none"),
        (
            "detector: dsvt\ntiers:\n  smoke: {}\n  quick: {learning: {steps: 0}}\n  full: {}\n",
            "4: tiers.quick.learning: steps: expected 1 or more if `start` is not set, got 0",
        ),
        (
            "detector: dsvt\ntiers: {smoke: {learning: {start: me}}, quick: {}, full: {}}\n",
            "2: tiers.smoke.learning.start: expected the folder of a trained detector",
        ),
    ],
)
def test_a_wrong_recipe_is_named_by_file_line_and_key(
    tmp_path: Path, text: str, message: str
) -> None:
    (tmp_path / "r.yaml").write_text(text)
    with pytest.raises(ConfigError, match=f"{tmp_path}/r.yaml:{message}"):
        read_recipe(tmp_path / "r.yaml", "smoke")


def test_a_loss_that_is_no_number_stops_with_the_step_and_the_checkpoint(
    lidar_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = loop.set_rate

    def explodes(optimizer: torch.optim.Optimizer, learning: object, step: int) -> float:
        rate = real(optimizer, learning, step)  # type: ignore[arg-type]
        if step == 3:
            for group in optimizer.param_groups:
                group["lr"] = float("inf")
        return rate

    monkeypatch.setattr(loop, "set_rate", explodes)
    with pytest.raises(loop.TrainingDiverged, match=r"step 4: the loss is nan.*last.safetensors"):
        run(lidar_folder, tmp_path)


def test_gradients_that_are_no_numbers_never_reach_a_checkpoint(
    lidar_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def spoilt(network: torch.nn.Module) -> None:
        next(network.parameters()).grad.fill_(float("nan"))  # type: ignore[union-attr]

    monkeypatch.setattr(loop.distributed, "average_gradients", spoilt)
    message = "step 0: the norm of the gradients is nan; there is no checkpoint"
    with pytest.raises(loop.TrainingDiverged, match=message):
        run(lidar_folder, tmp_path)
    assert not (tmp_path / "last.safetensors").exists()


def test_the_rate_rises_falls_and_spans_all_steps() -> None:
    optimizer = torch.optim.AdamW([torch.nn.Parameter(torch.zeros(1))])
    learning = recipe(100).learning
    rates = np.array([loop.set_rate(optimizer, learning, step) for step in range(100)])
    assert rates.argmax() == 40
    assert rates.max() == pytest.approx(learning.rate)
    assert rates[0] == pytest.approx(learning.rate / 10)
    assert rates[-1] < learning.rate / 500
    assert (np.diff(rates[:41]) > 0).all()
    assert (np.diff(rates[40:]) < 0).all()


def test_a_full_disk_leaves_the_checkpoint_that_was_there(
    trained: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "last.safetensors"
    shutil.copy(trained / "last.safetensors", file)
    loaded = checkpoint.load(file)

    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(checkpoint, "save_file", full)
    with pytest.raises(OSError, match="No space left"):
        checkpoint.save(file, loaded.network(), {}, loaded.provenance)
    assert checkpoint.load(file).provenance == loaded.provenance
    assert list(tmp_path.iterdir()) == [file]


def changed(file: Path, out: Path, **keys: object) -> Path:
    """Copies a checkpoint with changed values in its description."""
    tensors = load_file(file)
    length = int.from_bytes(file.read_bytes()[:8], "little")
    header = json.loads(file.read_bytes()[8 : 8 + length])
    provenance = yaml.safe_load(header["__metadata__"]["about"]) | keys
    save_file(tensors, out, metadata={"about": yaml.safe_dump(provenance)})
    return out


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"format": 2}, "format: expected '1', got '2'"),
        ({"convention": "y up"}, "convention: expected 'levelled LiDAR .*', got 'y up'"),
        ({"above_road": False}, "above_road: expected 'True', got 'False'"),
        ({"detector": "unknown"}, "detector: expected .*pointpillars, .*got 'unknown'"),
        ({"step": "many"}, "step: expected a whole number, got 'many'"),
        ({"network": {"pillar_m": 0.4, "pillar_width": 8}}, "size mismatch"),
    ],
)
def test_a_checkpoint_of_something_else_is_refused(
    trained: Path, tmp_path: Path, keys: dict[str, object], message: str
) -> None:
    file = changed(trained / "last.safetensors", tmp_path / "c.safetensors", **keys)
    with pytest.raises(ConfigError, match=message):
        checkpoint.load(file).network()


def test_what_is_no_checkpoint_is_named_and_never_run(tmp_path: Path) -> None:
    class Bomb:
        def __reduce__(self) -> tuple[Callable[..., object], tuple[str]]:
            return (Path.touch, (tmp_path / "ran",))  # type: ignore[return-value]

    for text in (pickle.dumps(Bomb()), b"", b"text", bytes(100)):
        (tmp_path / "bad.safetensors").write_bytes(text)
        with pytest.raises(
            ConfigError,
            match=r"bad.safetensors: expected a checkpoint, got a file that cannot be read",
        ):
            checkpoint.load(tmp_path / "bad.safetensors")
    save_file({}, tmp_path / "bad.safetensors", metadata={"about": "{a: [1"})
    with pytest.raises(
        ConfigError, match=r"bad.safetensors: expected .*, got a file without metadata `about`"
    ):
        checkpoint.load(tmp_path / "bad.safetensors")
    assert not (tmp_path / "ran").exists()
    with pytest.raises(FileNotFoundError):
        checkpoint.load(tmp_path / "none")


def test_no_vehicle_in_the_whole_training_set_is_an_error(tmp_path: Path) -> None:
    folder = tmp_path / "road/ring"
    folder.mkdir(parents=True)
    (folder / "lidar.yaml").write_text(LIDAR)
    none = kitti.Labels(np.empty(0, dtype=np.str_), np.empty((0, 7)), None)
    for frame in range(2):
        kitti.write_frame(folder, frame, road_sample(frame).points, none)
    (folder / "ImageSets").mkdir()
    (folder / "ImageSets/train.txt").write_text("000000\n000001\n")
    with pytest.raises(
        ValueError, match="expected one or more labelled vehicles in the training frames"
    ):
        run(folder, tmp_path / "out")


def test_detect_writes_results_that_evaluate_reads(
    lidar_folder: Path, trained: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["detect", str(lidar_folder), "--model", str(trained), "--out", str(tmp_path / "pred")]
    assert main.main(words) == 0
    assert "4 frames" in capsys.readouterr().out
    names = sorted(file.name for file in (tmp_path / "pred").glob("*.txt"))
    assert names == [f"{k:06d}.txt" for k in range(8, FRAMES)]
    assert (tmp_path / "pred/origin.yaml").is_file()
    for name in names:
        kitti.read_labels(tmp_path / "pred" / name, scores=True)
    cloud = kitti.frame_file(lidar_folder, "velodyne", 9)
    assert main.main(["detect", str(cloud), "--model", str(trained)]) == 0
    rows = capsys.readouterr().out.splitlines()
    assert rows[0] == "file,class,x,y,z,dx,dy,dz,heading,score"
    labels = kitti.read_labels(tmp_path / "pred/000009.txt", scores=True)
    assert len(rows) == 1 + len(labels)


def test_results_are_in_the_camera_of_the_data(
    lidar_folder: Path, trained: Path, tmp_path: Path
) -> None:
    other = tmp_path / "road/ring"
    shutil.copytree(lidar_folder, other)
    calibration = kitti.read_calibration(kitti.frame_file(other, "calib", 9))
    moved = calibration.Tr_velo_to_cam + np.array([[0, 0, 0, 0.3], [0, 0, 0, -0.1], [0, 0, 0, 2]])
    camera = dataclasses.replace(calibration, Tr_velo_to_cam=moved)
    kitti.write_calibration(kitti.frame_file(other, "calib", 9), camera)
    words = ["detect", str(other), "--model", str(trained), "--out", str(tmp_path / "pred")]
    assert main.main(words) == 0
    ((detections,), _) = detect.detect(
        detect.load_detector(trained), [kitti.frame_file(lidar_folder, "velodyne", 9)], None
    )
    labels = kitti.read_labels(tmp_path / "pred/000009.txt", scores=True, calibration=camera)
    np.testing.assert_allclose(labels.boxes, detections.boxes, atol=1e-3)


def test_two_clouds_of_one_name_are_not_written_over_one_another(
    lidar_folder: Path, trained: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cloud = kitti.frame_file(lidar_folder, "velodyne", 9)
    other = shutil.copy(cloud, tmp_path)
    words = ["detect", str(cloud), other, "--model", str(trained), "--out", str(tmp_path / "pred")]
    assert main.main(words) == 2
    assert (
        f"expected point clouds of different names with --out, got the same name as {cloud}"
        in capsys.readouterr().err
    )
    assert not (tmp_path / "pred").exists()


def test_frames_that_may_have_been_learnt_from_are_a_warning(
    lidar_folder: Path, trained: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    whole = tmp_path / "road/ring"
    shutil.copytree(lidar_folder, whole)
    shutil.rmtree(whole / "ImageSets")
    words = ["detect", str(whole), "--model", str(trained), "--out", str(tmp_path / "pred")]
    assert main.main(words) == 0
    assert "is not split, so all frames are used" in capsys.readouterr().err
    assert main.main([*words, "--split", "all"]) == 0
    assert "is not split" not in capsys.readouterr().err


def test_background_says_what_it_has_no_use_for(
    lidar_folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["train", str(ROOT / "configs/detectors/background.yaml"), str(lidar_folder)]
    words += ["--out", str(tmp_path), "--tier", "smoke"]
    assert main.main([*words, "--seed", "2", "--step-factor", "0.5"]) == 0
    unused = "pyinfra: note: background does not use --seed, --step-factor\n"
    anywhere = (
        f"pyinfra: note: background: {lidar_folder.name}: no roads.csv and no --region, so "
        "every moving object is taken for a vehicle\n"
    )
    assert capsys.readouterr().err == unused + anywhere
    assert main.main(words) == 0
    assert capsys.readouterr().err == anywhere


def test_a_folder_holds_one_kind_of_model(lidar_folder: Path, tmp_path: Path) -> None:
    (tmp_path / "background.npz").touch()
    with pytest.raises(
        FileExistsError,
        match=r"expected a folder without a model of a different detector, got .*background.npz",
    ):
        run(lidar_folder, tmp_path)


@pytest.fixture(scope="module")
def sure(trained: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Writes the trained network with scores near 1 at every position."""
    file = tmp_path_factory.mktemp("sure") / "sure.safetensors"
    loaded = checkpoint.load(trained / "last.safetensors")
    loaded.tensors["network.head.heat.bias"] += 8
    checkpoint.write(file, loaded.tensors, dataclasses.replace(loaded.provenance, ground=None))
    return file


def rows_of(capsys: pytest.CaptureFixture[str], *words: object) -> list[list[str]]:
    """Returns the rows that `pyinfra detect` prints, without the file names."""
    assert main.main(["detect", *map(str, words)]) == 0
    return [row.split(",")[1:] for row in capsys.readouterr().out.splitlines()]


def test_calibration_changes_scores_and_no_box(sure: Path, lidar_folder: Path) -> None:
    cloud = kitti.read_points(kitti.frame_file(lidar_folder, "velodyne", 9))
    points = level_ground(-6.0).above(cloud)
    network = checkpoint.load(sure).network()
    raw = network.predict(points)
    network.calibration = (2.0, -12.0)
    detections = network.predict(points)
    assert len(detections) == len(raw) > 20
    assert raw.scores.min() >= MIN_SCORE > detections.scores.min()
    np.testing.assert_array_equal(detections.boxes, raw.boxes)
    logits = [np.log(s / (1 - s)) for s in (raw.scores, detections.scores)]
    np.testing.assert_allclose(2 * logits[0] - 12, logits[1], rtol=1e-6)


def test_weights_in_half_precision_find_what_whole_ones_do(
    sure: Path, lidar_folder: Path, tmp_path: Path
) -> None:
    whole = checkpoint.load(sure)
    half = {f"network.{k}": v.half() if v.ndim > 1 else v for k, v in whole.weights().items()}
    checkpoint.write(tmp_path / "half.safetensors", half, whole.provenance)
    points = kitti.read_points(kitti.frame_file(lidar_folder, "velodyne", 9))
    files = (sure, tmp_path / "half.safetensors")
    ground = level_ground(-6.0)
    a, b = (detect.load_detector(file, ground=ground).predict(points) for file in files)
    assert files[1].stat().st_size < 0.6 * files[0].stat().st_size
    assert len(a) == pytest.approx(len(b), abs=5)
    assert len(a) > 20
    near = np.abs(a.boxes[:, None, :2] - b.boxes[None, :, :2]).sum(axis=2).min(axis=1)
    assert np.median(near) < 0.02


def test_a_model_of_anywhere_needs_the_height_of_the_road(
    sure: Path, lidar_folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cloud = kitti.frame_file(lidar_folder, "velodyne", 9)
    assert main.main(["detect", "--model", str(sure), str(cloud)]) == 2
    assert (
        "expected the height of the sensor above the road, got none; set --height-m"
        in capsys.readouterr().err
    )
    rows = rows_of(capsys, "--model", sure, cloud, "--height-m", 6)
    assert len(rows) > 1
    lower = rows_of(capsys, "--model", sure, cloud, "--height-m", 5.5)
    assert lower != rows
    assert main.main(["detect", str(cloud), "--model", str(sure), "--height-m", "-6"]) == 2
    assert "--height-m: expected more than 0, at most 100, got -6" in capsys.readouterr().err


def test_a_pcd_file_gives_the_boxes_of_the_bin(
    sure: Path, lidar_folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cloud = kitti.frame_file(lidar_folder, "velodyne", 9)
    records = np.rec.fromarrays(
        kitti.read_points(cloud).T, dtype=[(name, "<f4") for name in ("x", "y", "z", "intensity")]
    )
    pcd_file.write_pcd(tmp_path / "cloud.pcd", records)
    words = ["--model", sure, "--height-m", 6]
    expected = rows_of(capsys, *words, cloud)
    assert rows_of(capsys, *words, tmp_path / "cloud.pcd") == expected
    assert len(expected) > 1


def test_weights_that_are_no_numbers_are_refused(sure: Path, tmp_path: Path) -> None:
    loaded = checkpoint.load(sure)
    loaded.tensors["network.head.heat.bias"] *= float("nan")
    checkpoint.write(tmp_path / "nan.safetensors", loaded.tensors, loaded.provenance)
    with pytest.raises(
        ConfigError, match=r"head\.heat\.bias: expected finite weights, got NaN or inf"
    ):
        detect.load_detector(tmp_path / "nan.safetensors", ground=level_ground(-6.0))


def test_results_of_other_frames_and_labels_in_their_place_are_reported(
    trained: Path, lidar_folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["detect", str(lidar_folder), "--model", str(trained), "--split", "all", "--out"]
    assert main.main([*words, str(lidar_folder / "training/label_2")]) == 2
    assert "--out: expected a folder other than that of the labels" in capsys.readouterr().err
    assert main.main([*words, str(tmp_path), "--max-frames", "1"]) == 0
    error = capsys.readouterr().err
    assert "no box in any frame; check the sensor's height, its frame" in error
    assert "files of other frames" not in error
    (tmp_path / "000099.txt").touch()
    assert main.main([*words, str(tmp_path)]) == 0
    assert "1 result files of other frames, such as 000099" in capsys.readouterr().err
    words[1] = str(lidar_folder.parent)  # a data set with one LiDAR
    assert main.main([*words, str(tmp_path)]) == 0
    two = tmp_path / "two"
    for name in ("a", "b"):
        shutil.copytree(lidar_folder, two / name)
    words[1] = str(two)
    assert main.main([*words, str(tmp_path)]) == 2
    assert (
        f"expected the folder of one LiDAR, got a data set with the LiDARs {two / 'a'}"
        in capsys.readouterr().err
    )


def test_vehicles_are_looked_for_in_the_region(
    sure: Path, lidar_folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "near.yaml").write_text("outline_m: [[10, -4], [14, -4], [14, 4], [10, 4]]\n")
    cloud = kitti.frame_file(lidar_folder, "velodyne", 9)
    words = [cloud, "--model", sure, "--height-m", 6]
    everywhere = np.array(rows_of(capsys, *words)[1:])[:, 1:3].astype(float)
    near = rows_of(capsys, *words, "--region", tmp_path / "near.yaml")[1:]
    x = np.array(near)[:, 1].astype(float)
    assert ((x > -1) & (x < 26)).all()  # a margin of 8 m, and the border of the grid
    assert everywhere[:, 0].max() > 26


def test_a_training_begins_with_the_weights_of_another(
    trained: Path, lidar_folder: Path, tmp_path: Path
) -> None:
    source = read_source(lidar_folder, "smoke")
    slow = recipe(1).begun_with(trained)
    slow = dataclasses.replace(slow, learning=dataclasses.replace(slow.learning, rate=1e-7))
    file = train.train(slow, [source], tmp_path / "tuned", quiet=True)
    loaded, before = checkpoint.load(file), checkpoint.load(trained / "last.safetensors")
    assert loaded.provenance.start == checkpoint.digest(trained / "last.safetensors")
    assert loaded.provenance.calibration is None
    for name, weights in before.weights().items():
        if "running" not in name and "num_batches" not in name:
            torch.testing.assert_close(loaded.weights()[name], weights, atol=1e-5, rtol=1e-4)
    other = read_recipe(ROOT / "configs/detectors/pointpillars.yaml", "smoke")
    with pytest.raises(
        ConfigError, match="expected weights of this network, got weights that do not fit"
    ):
        train.train(other.begun_with(trained), [source], tmp_path / "other", quiet=True)


def test_a_training_keeps_the_line_of_the_scores_that_it_began_with(
    trained: Path, lidar_folder: Path, tmp_path: Path
) -> None:
    line = (2.0, -1.0)
    start = changed(trained / "last.safetensors", tmp_path / "lined.safetensors", calibration=line)
    source = read_source(lidar_folder, "smoke")
    file = train.train(recipe(1).begun_with(start), [source], tmp_path / "tuned", quiet=True)
    assert checkpoint.load(file).network().calibration == line


def test_a_recipe_without_steps_takes_a_network_as_it_comes(
    trained: Path, lidar_folder: Path, tmp_path: Path
) -> None:
    source = read_source(lidar_folder, "smoke")
    still = recipe(1).begun_with(trained)
    still = dataclasses.replace(still, learning=dataclasses.replace(still.learning, steps=0))
    assert still.for_budget(0.5).learning.steps == 0
    file = train.train(still, [source], tmp_path / "as_is", quiet=True)
    assert file.read_bytes() == (trained / "last.safetensors").read_bytes()
    assert train.train(still, [source], tmp_path / "as_is", quiet=True) == file  # trains once more
    other = still.begun_with(Path("generalist"))
    with pytest.raises(FileExistsError, match=r"got a last\.safetensors of a different network"):
        train.train(other, [source], tmp_path / "as_is", quiet=True)
    assert file.read_bytes() == (trained / "last.safetensors").read_bytes()
    with pytest.raises(FileNotFoundError, match="and no pretrained detector"):
        train.train(still.begun_with(Path("nobody")), [source], tmp_path / "as_is", quiet=True)


def test_a_network_of_another_detector_is_not_taken_as_it_comes(
    trained: Path, lidar_folder: Path, tmp_path: Path
) -> None:
    other = read_recipe(ROOT / "configs/detectors/pointpillars.yaml", "smoke").begun_with(trained)
    still = dataclasses.replace(other, learning=dataclasses.replace(other.learning, steps=0))
    with pytest.raises(ConfigError, match="expected a model of pointpillars, got a model of cent"):
        train.train(still, [read_source(lidar_folder, "smoke")], tmp_path / "as_is", quiet=True)


@pytest.mark.parametrize(
    ("name", "names", "expected"),
    [
        ("my lidar", "my lidar", True),
        ("my lidar", "avia my lidar", True),
        ("avia", "avia my lidar", True),
        ("via", "avia my lidar", False),
    ],
)
def test_a_name_with_a_blank_is_among_names(name: str, names: str, expected: bool) -> None:
    assert is_among(name, names) == expected


def test_frames_of_a_test_list_alone_are_not_learnt_from(tmp_path: Path) -> None:
    for k in (0, 1000, 2000, 3000, 4000, 4100, 4200):
        sample = road_sample(k)
        labels = kitti.Labels(np.full(len(sample.boxes), "Car"), sample.boxes, None)
        kitti.write_frame(tmp_path, k, sample.points, labels)
    (tmp_path / "lidar.yaml").write_text(LIDAR)
    (tmp_path / "ImageSets").mkdir()
    (tmp_path / "ImageSets/val.txt").write_text("001000\n002000\n")
    source = read_source(tmp_path, "smoke")
    expected = [road_sample(k).points for k in (0, 3000)]
    for cloud, points in zip(source.clouds, expected, strict=True):
        np.testing.assert_array_equal(cloud(), points)
    kitti.frame_file(tmp_path, "velodyne", 4100).unlink()
    kitti.frame_file(tmp_path, "velodyne", 4200).unlink()
    with pytest.raises(Error, match=f"{tmp_path}: expected frames before 400 s"):
        read_source(tmp_path, "smoke")


def test_another_lidar_or_preset_is_a_warning_unless_it_is_meant(
    lidar_folder: Path, trained: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = tmp_path / "road/other"
    shutil.copytree(lidar_folder, other)
    (other / "lidar.yaml").write_text(LIDAR.replace('"ring"', '"star"').replace("paper", "equal"))
    shutil.rmtree(other / "ImageSets")  # twelve frames are too few for a split by time
    assert detect.transfer(trained, lidar_folder) == ""
    words = ["detect", str(other), "--model", str(trained), "--out", str(tmp_path / "pred")]
    assert main.main(words) == 0
    expected = "LiDAR star (trained on ring), preset equal (trained on paper); set --allow-transfer"
    assert expected in capsys.readouterr().err
    assert main.main([*words, "--allow-transfer"]) == 0
    assert "--allow-transfer" not in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--tier", "huge"], "got 'huge'"),
        (["--seed", "-1"], "--seed: expected 0 or more, got -1"),
        (["--step-factor", "0"], "--step-factor: expected more than 0, at most 100, got 0"),
        (["--device", "tpu"], "--device: expected cpu, .*, got 'tpu'"),
        (["--device", "cuda:99"], "--device: expected cpu, .*, got 'cuda:99'"),
        (["--precision", "float16"], "got 'float16'"),
        (["nowhere"], "nowhere/lidar.yaml: No such file"),
    ],
)
def test_wrong_words_are_one_line(
    lidar_folder: Path,
    tmp_path: Path,
    words: list[str],
    message: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    folder = str(lidar_folder)
    if not words[0].startswith("-"):
        folder, words = str(lidar_folder.parent) if words == ["."] else words[0], []
    given = ["train", str(CONFIG), folder, "--out", str(tmp_path / "o")]
    try:
        code = main.main([*given, *words])
    except SystemExit as end:
        code = int(str(end.code))
    assert code in (1, 2)
    error = capsys.readouterr().err
    assert re.search(message, error)
    assert len(error.splitlines()) == 1


def test_moved_points_stay_in_their_boxes() -> None:
    sample = road_sample(11)
    for turn, scale, flip in ((0.3, 1.05, False), (-2.0, 0.95, True), (0.0, 1.0, True)):
        after = moved(sample, turn=turn, scale=scale, flip=flip)
        for a, b in zip(sample.boxes, after.boxes, strict=True):
            assert points_in_box(after.points, b).sum() == pytest.approx(
                points_in_box(sample.points, a).sum(), abs=8
            )


def test_pasted_vehicles_bring_their_points_and_stand_on_nobody() -> None:
    how = Augmentation(pasted=10)
    sample, other = road_sample(12, 2), road_sample(13, 6)
    pasted = with_pasted(sample, other, how, np.random.default_rng(1))
    assert len(sample.boxes) < len(pasted.boxes) <= 8
    from pyinfra.core.boxes import bev_iou

    overlap = bev_iou(pasted.boxes, pasted.boxes) - np.eye(len(pasted.boxes))
    assert np.abs(overlap).max() < 1e-9
    for box in pasted.boxes:
        assert points_in_box(pasted.points, box).sum() >= 100
    same = augmented(sample, None, Augmentation(), np.random.default_rng(1))
    np.testing.assert_array_equal(same.points, sample.points)


def test_each_class_is_pasted_in_turn() -> None:
    other = dataclasses.replace(road_sample(13, 8), classes=np.array([0, 0, 0, 0, 0, 0, 1, 2]))
    empty = dataclasses.replace(other, points=other.points[:0], boxes=other.boxes[:0], classes=None)
    for seed in range(5):
        pasted = with_pasted(empty, other, Augmentation(pasted=3), np.random.default_rng(seed))
        assert sorted(pasted.numbers) == [0, 1, 2]


def test_with_shadows_no_point_lies_behind_a_pasted_vehicle() -> None:
    sample, other = road_sample(12, 2), road_sample(13, 6)
    plain = with_pasted(sample, other, Augmentation(pasted=10), np.random.default_rng(1))
    shaded = with_pasted(
        sample, other, Augmentation(pasted=10, shadows=True), np.random.default_rng(1)
    )
    np.testing.assert_array_equal(shaded.boxes, plain.boxes)
    assert len(shaded.points) < len(plain.points)
    assert {tuple(p) for p in shaded.points} <= {tuple(p) for p in plain.points}


def test_a_pasted_object_hides_what_lies_behind_it_and_nothing_else() -> None:
    sides, heights = np.meshgrid(np.arange(-2, 2, 0.05), np.arange(-6, -4, 0.05))
    wall = np.column_stack(
        [np.full(sides.size, 20), sides.ravel(), heights.ravel(), np.zeros(sides.size)]
    )
    positions = np.array([[40, 0, -10, 0], [10, 0, -2.5, 0], [40, 10, -10, 0], [40, 0, 3, 0]])
    behind = hidden_by(wall.astype(np.float32), positions.astype(np.float32), 0.0)
    assert behind.tolist() == [True, False, False, False]
    above = (lifted(points.astype(np.float32), 6) for points in (wall, positions))
    assert hidden_by(*above, 6.0).tolist() == behind.tolist()
    # the wall then lies across the azimuth of 180 degrees
    turned = wall[:, :3] @ np.diag([-1.0, -1.0, 1.0])
    there = positions[:, :3] @ np.diag([-1.0, -1.0, 1.0])
    both = (np.insert(xyz, 3, 0, axis=1).astype(np.float32) for xyz in (turned, there))
    assert hidden_by(*both, 0.0).tolist() == behind.tolist()


def test_an_error_of_the_pose_moves_points_and_boxes_alike() -> None:
    sample = road_sample(14)
    how = Augmentation(height_std_m=0.15, level_std_deg=0.3)
    rises = []
    for seed in range(200):
        altered = with_pose_error(sample, how, np.random.default_rng(seed))
        np.testing.assert_array_equal(altered.points[:, :2], sample.points[:, :2])
        for before, after in zip(sample.boxes, altered.boxes, strict=True):
            inside = points_in_box(sample.points, before)
            rise = (altered.points[inside, 2] - sample.points[inside, 2]).mean()
            assert after[2] - before[2] == pytest.approx(rise, abs=0.03)
        at_sensor = np.linalg.lstsq(
            np.column_stack([sample.points[:, :2], np.ones(len(sample.points))]),
            (altered.points[:, 2] - sample.points[:, 2]).astype(np.float64),
            rcond=None,
        )[0]
        rises.append([*np.degrees(np.arctan(at_sensor[:2])), at_sensor[2]])
    assert np.std(rises, axis=0) == pytest.approx([0.3, 0.3, 0.15], rel=0.2)
    assert np.abs(rises)[:, 2].max() < 0.5
    draw, other = np.random.default_rng(1), np.random.default_rng(1)
    assert with_pose_error(sample, Augmentation(), draw) is sample
    assert draw.random() == other.random()


def test_rare_windows_look_at_each_class_as_often() -> None:
    boxes = np.zeros((10, 7))
    boxes[:, 0] = np.arange(10)
    sample = Sample(np.zeros((0, 4), np.float32), boxes, np.array([0] * 9 + [1]))
    area, draw = Area((-50, -50, -5), (50, 50, 5)), np.random.default_rng(1)
    at = [windows.centre_of(sample, area, draw, 1.0)[0] == 9 for _ in range(400)]
    assert 0.4 < np.mean(at) < 0.6
    assert np.mean([windows.centre_of(sample, area, draw)[0] == 9 for _ in range(400)]) < 0.2


def test_faults_that_no_severity_asks_for_draw_nothing() -> None:
    """Runs of recipes without these faults therefore do not change."""
    draw, other = np.random.default_rng(1), np.random.default_rng(1)
    sample = road_sample(14)
    assert with_faults(sample, Augmentation(), draw).points is sample.points
    assert draw.random() == other.random()


@pytest.mark.nightly
def test_dropped_points_and_lines_are_some_up_to_the_severity() -> None:
    sample = road_sample(15)
    for how in (Augmentation(drop_out=0.9), Augmentation(lost_lines=0.9)):
        shares = []
        for k in range(40):
            altered = with_faults(sample, how, np.random.default_rng(k))
            assert {tuple(p) for p in altered.points} <= {tuple(p) for p in sample.points}
            shares.append(len(altered.points) / len(sample.points))
        assert min(shares) < 0.35
        assert max(shares) > 0.85


def test_vehicles_without_a_point_left_are_no_longer_to_be_detected() -> None:
    sample = road_sample(16)
    few = dataclasses.replace(sample, points=sample.points[::40])
    lost = 0
    for k in range(20):
        altered = with_faults(few, Augmentation(drop_out=0.99), np.random.default_rng(k))
        assert (points_in_boxes(altered.points, altered.boxes) > 0).all()
        lost += len(sample.boxes) - len(altered.boxes)
    assert lost > 0


def test_range_noise_is_along_the_rays() -> None:
    sample = road_sample(17)
    altered = with_faults(sample, Augmentation(range_noise_m=0.2), np.random.default_rng(3))
    before, after = (s.points[:, :3].astype(np.float64) for s in (sample, altered))
    np.testing.assert_allclose(np.cross(before, after), 0, atol=1e-3)
    assert 0.001 < np.std(np.linalg.norm(after, axis=1) - np.linalg.norm(before, axis=1)) < 0.25
    np.testing.assert_array_equal(altered.boxes, sample.boxes)


def test_faults_are_of_the_rays_of_a_sensor_above_the_road() -> None:
    of_sensor = road_sample(17)
    how = Augmentation(lost_lines=0.9, range_noise_m=0.2)
    expected = with_faults(of_sensor, how, np.random.default_rng(3))
    boxes = of_sensor.boxes + np.array([0, 0, 6, 0, 0, 0, 0])
    above = dataclasses.replace(
        of_sensor, points=lifted(of_sensor.points, 6), boxes=boxes, height_m=6.0
    )
    altered = with_faults(above, how, np.random.default_rng(3))
    assert len(altered.points) < 0.9 * len(above.points)
    np.testing.assert_allclose(altered.points, lifted(expected.points, 6), atol=1e-4)
    assert moved(above, turn=0.1, scale=0.5, flip=False).height_m == 3


def test_a_scene_that_is_too_short_for_training_is_named() -> None:
    scene, lidar = ROOT / "configs/scenes/curve.yaml", ROOT / "configs/lidars/helios_16.yaml"
    with pytest.raises(Error, match=f"{scene}: expected frames before 400 s"):
        simulated_source(scene, lidar, "smoke", set={"duration_s": 100})


def test_the_simulator_gives_the_frames_that_a_run_writes(
    infrasim: Callable[..., object], tmp_path: Path
) -> None:
    scene, lidar = "configs/scenes/curve.yaml", "configs/lidars/helios_16.yaml"
    short = {"duration_s": 430, "traffic.warm_up_s": 5}
    words = [w for key, value in short.items() for w in ("--set", f"{key}={value}")]
    frames = ["--preset", "paper", "--frames", "0:4300:100", "--out", tmp_path / "curve"]
    infrasim("run", scene, "--lidar", lidar, *frames, *words, check=True)
    disk = read_source(tmp_path / "curve/helios_16", "smoke")
    live = simulated_source(ROOT / scene, ROOT / lidar, "smoke", preset="paper", set=short)
    assert (live.lidar, live.preset, live.scene) == (disk.lidar, disk.preset, disk.scene)
    assert len(disk.clouds) == 40
    assert len(live.clouds) == 200  # every 20th of 4,000 frames
    for i in (0, 3):
        np.testing.assert_array_equal(live.clouds[5 * i](), disk.clouds[i]())
    ours, theirs = live.read_boxes(), disk.read_boxes()
    for i in range(40):
        np.testing.assert_allclose(ours[5 * i], theirs[i], atol=1e-4)


def test_a_training_needs_one_kind_of_source(
    lidar_folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    both = [str(lidar_folder), "--scene", "s.yaml", "--lidar", "l.yaml"]
    for words in ([], both, ["--scene", "s.yaml"]):
        assert main.main(["train", str(CONFIG), *words, "--out", str(tmp_path / "o")]) == 2
        assert (
            "DATA: expected one source of frames (folders, --scene with --lidar"
            in capsys.readouterr().err
        )


@pytest.mark.parametrize(
    ("mount", "message"),
    [
        ("", "mount: expected west, east, south, north, got none"),
        ("middle", "mount: expected west, east, south, north, got 'middle'"),
        ("fused", "expected the name of one mount, got 'fused'; to train on fused frames, run"),
    ],
)
def test_a_scene_with_several_mounts_is_learnt_at_one(
    mount: str, message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene, lidar = ROOT / "configs/scenes/crossroad_poles.yaml", ROOT / "configs/lidars"
    words = ["--scene", str(scene), "--lidar", str(lidar / "helios_16.yaml"), "--mount", mount]
    assert main.main(["train", str(CONFIG), "--out", str(tmp_path / "o"), *words]) == 2
    assert message in capsys.readouterr().err


def test_a_source_is_of_the_mount_that_is_named() -> None:
    scene, lidar = ROOT / "configs/scenes/crossroad_poles.yaml", ROOT / "configs/lidars"
    short = {"duration_s": 430, "traffic.warm_up_s": 5}
    sources = [
        simulated_source(scene, lidar / "helios_16.yaml", "smoke", set=short, mount=name)
        for name in ("west", "north")
    ]
    clouds = [source.clouds[0]() for source in sources]
    assert clouds[0].tobytes() != clouds[1].tobytes()


def test_labels_of_two_times_are_not_learnt_together() -> None:
    one, other = (
        Source("helios_16", "datasheet", scene, time, (), tuple)
        for scene, time in (("highway", "scan"), ("curve", "frame"))
    )
    assert common_label_time([one, one]) == "scan"
    with pytest.raises(
        ValueError, match=r"helios_16 in curve: label_time: expected scan, got frame; .* has scan"
    ):
        common_label_time([one, other])


def test_batches_made_ahead_come_in_their_order_and_what_fails_names_its_step() -> None:
    def make(step: int) -> Batch:
        if step == 30:
            raise OSError("no frame 30")
        return make_batch([road_sample(step)], Area((0, -20, -3), (60, 20, 1)))

    made = batches.ahead(make, range(5, 60))
    for step in range(5, 30):
        came, batch = next(made)
        assert came == step
        torch.testing.assert_close(batch.points, make(step).points)
    with pytest.raises(OSError, match="no frame 30"):
        next(made)
