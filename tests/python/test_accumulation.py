"""Frames that are stacked into one cloud: which frames, their ages, and which frames training may
use."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
import yaml

torch = pytest.importorskip("torch")

from detector_data import SITE, road_sample  # noqa: E402
from safetensors import safe_open  # noqa: E402
from safetensors.torch import load_file, save_file  # noqa: E402
from test_training import CONFIG, LIDAR  # noqa: E402

from pyinfra.cli import main  # noqa: E402
from pyinfra.core.arrays import Points  # noqa: E402
from pyinfra.core.errors import ConfigError  # noqa: E402
from pyinfra.dataset.ground import level_ground  # noqa: E402
from pyinfra.formats import kitti  # noqa: E402
from pyinfra.models.detectors import windows  # noqa: E402
from pyinfra.models.detectors.batch import Windows, make_batch  # noqa: E402
from pyinfra.models.detectors.network import Network  # noqa: E402
from pyinfra.models.detectors.sample import Sample  # noqa: E402
from pyinfra.models.inference import (  # noqa: E402
    detect,
    onnx,
)
from pyinfra.models.training import checkpoint  # noqa: E402
from pyinfra.models.training.accumulation import Accumulation, LabelAt, stacked  # noqa: E402
from pyinfra.models.training.recipe import Recipe, read_recipe  # noqa: E402
from pyinfra.models.training.samples import Augmentation, augmented  # noqa: E402
from pyinfra.models.training.sources import read_source, simulated_source  # noqa: E402
from pyinfra.models.training.train import train  # noqa: E402

ROOT = Path(__file__).resolve().parents[2]
FRAMES = 12
THREE = Accumulation(3)
MIDDLE = Accumulation(3, "middle")


def cloud_of(frame: int) -> Points:
    """Returns a cloud. The intensity of its points is the number of the frame divided by 100."""
    points = road_sample(frame).points
    points[:, 3] = frame / 100
    return points


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Writes frames of an artificial road. Frames 4 and 9 to the last are test frames; frames 6 and
    8 are in no list."""
    lidar = tmp_path_factory.mktemp("data") / "road/ring"
    lidar.mkdir(parents=True)
    (lidar / "lidar.yaml").write_text(LIDAR)
    for frame in range(FRAMES):
        boxes = road_sample(frame).boxes
        labels = kitti.Labels(np.full(len(boxes), "Car"), boxes, None)
        kitti.write_frame(lidar, frame, cloud_of(frame), labels)
    (lidar / "ImageSets").mkdir()
    for part, numbers in (("train", [0, 1, 2, 3, 5, 7]), ("val", [4, 9, 10, 11])):
        text = "".join(f"{k:06d}\n" for k in numbers)
        (lidar / f"ImageSets/{part}.txt").write_text(text)
    return lidar


def recipe(**network: object) -> Recipe:
    original = read_recipe(CONFIG, "smoke")
    return dataclasses.replace(
        original,
        network=dataclasses.replace(original.network, **network),
        learning=dataclasses.replace(original.learning, steps=2),
    )


@pytest.fixture(scope="module")
def trained(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Trains a network that stacks three frames and uses their ages."""
    out = tmp_path_factory.mktemp("run")
    train(recipe(age=True), [read_source(folder, "smoke", MIDDLE)], out, quiet=True)
    return out


def ages_of(points: Points) -> dict[int, float]:
    """Returns the age of each frame in a stacked cloud."""
    frames, first = np.unique(np.round(points[:, 3] * 100).astype(int), return_index=True)
    return {int(k): round(float(points[i, 4]), 6) for k, i in zip(frames, first, strict=True)}


@pytest.mark.parametrize(
    ("frames", "label_at", "numbers"),
    [
        (1, "newest", [7]),
        (3, "newest", [5, 6, 7]),
        (2, "middle", [7, 8]),
        (3, "middle", [6, 7, 8]),
        (10, "middle", list(range(3, 13))),
    ],
)
def test_the_labelled_frame_is_the_newest_or_the_middle_one(
    frames: int, label_at: LabelAt, numbers: list[int]
) -> None:
    assert list(Accumulation(frames, label_at).around(7)) == numbers


def test_gaps_stay_gaps_and_frames_far_apart_are_an_error() -> None:
    assert THREE.stacks([0, 4, 6], [0, 1, 2, 4, 5, 6]) == ([0], [2, 4], [4, 5, 6])
    with pytest.raises(ValueError, match="without two frames whose numbers differ by less than 3"):
        THREE.stacks([0, 5, 10], [0, 5, 10])


@pytest.mark.parametrize(("frames", "label_at"), [(0, "newest"), (101, "newest"), (1, "middle")])
def test_a_wrong_accumulation_says_what_is_allowed(frames: int, label_at: LabelAt) -> None:
    with pytest.raises(ValueError, match=r"(accumulate|label_at): expected .*, got"):
        Accumulation(frames, label_at)


def test_clouds_are_stacked_with_their_age() -> None:
    one, other = np.ones((2, 4), np.float32), np.zeros((1, 4), np.float32)
    points = stacked([one, other], [0.1, 0.0])
    assert points.dtype == np.float32
    np.testing.assert_array_equal(points[:, :4], np.concatenate([one, other]))
    np.testing.assert_array_equal(points[:, 4], np.float32([0.1, 0.1, 0]))


def test_one_frame_is_as_it_was_read(folder: Path) -> None:
    source = read_source(folder, "smoke")
    assert source.accumulation.frames == 1
    np.testing.assert_array_equal(source.clouds[4](), cloud_of(5))


def test_no_frame_to_test_on_is_learnt_from(folder: Path) -> None:
    newest, middle = (read_source(folder, "smoke", how) for how in (THREE, MIDDLE))
    # frame 6 lies between train frames
    assert ages_of(newest.clouds[5]()) == {5: 0.2, 6: 0.1, 7: 0}
    # frame 4 is a test frame, so it is left out
    assert ages_of(newest.clouds[4]()) == {3: 0.2, 5: 0}
    assert ages_of(middle.clouds[4]()) == {5: 0, 6: -0.1}
    # frame 8 comes after the last train frame of the stack
    assert ages_of(middle.clouds[5]()) == {6: 0.1, 7: 0}
    everything = Accumulation(100, "middle")
    for cloud in read_source(folder, "smoke", everything).clouds:
        assert set(ages_of(cloud())) == {0, 1, 2, 3, 5, 6, 7}


def test_without_a_list_of_test_frames_only_train_frames_are_stacked(folder: Path) -> None:
    val = folder / "ImageSets/val.txt"
    aside = val.rename(val.with_suffix(".aside"))
    try:
        source = read_source(folder, "smoke", THREE)
    finally:
        aside.rename(val)
    assert ages_of(source.clouds[5]()) == {5: 0.2, 7: 0}


def test_a_test_frame_looks_at_its_neighbours_of_any_split(folder: Path) -> None:
    file = kitti.frame_file(folder, "velodyne", 9)
    assert ages_of(detect.stacking(folder, [9], THREE)(file)) == {7: 0.2, 8: 0.1, 9: 0}
    np.testing.assert_array_equal(detect.stacking(folder, [9], Accumulation())(file), cloud_of(9))


def test_simulated_frames_are_stacked_among_those_to_learn_from() -> None:
    pytest.importorskip("pyinfra._core")
    scene, lidar = ROOT / "configs/scenes/curve.yaml", ROOT / "configs/lidars/helios_16.yaml"
    short = {"duration_s": 430, "traffic.warm_up_s": 5}
    single, stack = (
        simulated_source(scene, lidar, "smoke", set=short, accumulation=how)
        for how in (Accumulation(), Accumulation(2))
    )
    points = stack.clouds[1]()
    newest = points[points[:, 4] == 0, :4]
    np.testing.assert_array_equal(newest, single.clouds[1]())
    assert set(points[:, 4].tolist()) == {0.0, float(np.float32(0.1))}
    assert set(stack.clouds[0]()[:, 4].tolist()) == {0.0}  # no earlier frames exist


def test_augmentation_and_windows_keep_ages() -> None:
    one, other = (
        Sample(stacked([sample.points], [age]), sample.boxes)
        for sample, age in ((road_sample(1), 0.1), (road_sample(2), 0.2))
    )
    how = Augmentation(True, 10, 0.05, pasted=5, drop_out=0.3, lost_lines=0.1, range_noise_m=0.02)
    sample = augmented(one, other, how, np.random.default_rng(1))
    assert set(sample.points[:, 4].tolist()) == {float(np.float32(a)) for a in (0.1, 0.2)}
    above = level_ground(-6).above(sample.points)
    np.testing.assert_array_equal(above[:, 3:], sample.points[:, 3:])
    batch = make_batch([sample], SITE.area, 5)
    seen = Windows(200, ((20.0, 0.0),))
    batch = dataclasses.replace(batch, windows=seen)
    part = windows.cut(batch, windows.view_of(batch, SITE.area, 0.4, 8), SITE.area, 0.4)
    assert 0 < len(part.points) < len(batch.points)
    assert part.points.shape[1] == 5


def network_of(name: str, **keys: object) -> Network:
    config = read_recipe(ROOT / f"configs/detectors/{name}.yaml", "smoke").network
    torch.manual_seed(1)
    network = checkpoint.build(name, dataclasses.replace(config, **keys), SITE)
    for module in network.modules():  # raises the scores, so that an untrained network has boxes
        if isinstance(module, torch.nn.Conv2d) and module.bias is not None:
            torch.nn.init.constant_(module.bias, 0.0)
    return network.eval()


@pytest.mark.parametrize("name", ["pointpillars", "centerpoint-pillar", "dsvt"])
def test_without_age_a_network_sees_the_first_four_columns(name: str) -> None:
    network, points = network_of(name), road_sample(1).points
    single, aged = network.predict(points), network.predict(stacked([points], [0.3]))
    assert len(single) > 0
    np.testing.assert_array_equal(single.boxes, aged.boxes)
    np.testing.assert_array_equal(single.scores, aged.scores)


@pytest.mark.parametrize("intensity", [True, False])
@pytest.mark.parametrize("name", ["pointpillars", "centerpoint-pillar"])
def test_with_age_a_network_tells_ages_apart(name: str, intensity: bool) -> None:
    network, points = network_of(name, age=True, intensity=intensity), road_sample(1).points
    now, before = (network.predict(stacked([points], [age])) for age in (0.0, 0.3))
    assert not np.array_equal(now.scores, before.scores)
    points[:, 3] += 0.1
    brighter = network.predict(stacked([points], [0.0]))
    assert np.array_equal(now.scores, brighter.scores) == (not intensity)
    with pytest.raises(ValueError, match="expected 5 columns, got 4"):
        network.predict(points)


def test_age_of_single_frames_is_an_error(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"network\.age: expected .*got true"):
        train(recipe(age=True), [read_source(folder, "smoke")], tmp_path, quiet=True)


def test_a_model_says_what_it_learnt_and_goes_on_with_that_alone(
    folder: Path, trained: Path
) -> None:
    provenance = checkpoint.load(trained / "last.safetensors").provenance
    assert (provenance.accumulate, provenance.label_at) == (3, "middle")
    assert detect.accumulation_of(trained / "last.safetensors") == MIDDLE
    assert "accumulate: 3\nlabel_at: middle\n" in (trained / "run.yaml").read_text()
    other = read_source(folder, "smoke", THREE)
    with pytest.raises(ConfigError, match="got a checkpoint with different values of label_at"):
        train(recipe(age=True), [other], trained, quiet=True)


def test_a_run_of_a_version_without_the_keys_goes_on(folder: Path, tmp_path: Path) -> None:
    train(recipe(), [read_source(folder, "smoke")], tmp_path, quiet=True)
    file = tmp_path / "last.safetensors"
    provenance = yaml.safe_load(metadata_of(file))
    del provenance["accumulate"], provenance["label_at"], provenance["network"]["age"]
    save_file(load_file(file), file, metadata={"about": yaml.safe_dump(provenance)})
    assert detect.accumulation_of(file) == Accumulation()
    before = file.read_bytes()
    train(recipe(), [read_source(folder, "smoke")], tmp_path, quiet=True)
    assert file.read_bytes() == before  # the training was already finished
    with pytest.raises(ConfigError, match="got a checkpoint with different values of accumulate"):
        train(recipe(), [read_source(folder, "smoke", THREE)], tmp_path, quiet=True)


def metadata_of(file: Path) -> str:
    with safe_open(file, framework="pt") as opened:
        return str(opened.metadata()["about"])


def test_detect_stacks_data_and_refuses_lone_clouds(
    folder: Path, trained: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main.main(["detect", str(folder), "--model", str(trained), "--out", str(tmp_path)]) == 0
    assert len(list(tmp_path.glob("*.txt"))) == 4
    cloud = kitti.frame_file(folder, "velodyne", 9)
    assert main.main(["detect", str(cloud), "--model", str(trained)]) != 0
    assert "expected a model of single frames, got a model of 3 stacked" in capsys.readouterr().err


def test_single_frames_are_not_given_to_a_model_of_stacked_ones(
    folder: Path, trained: Path, tmp_path: Path
) -> None:
    for use in (
        lambda: detect.detector_at(trained, folder),
        lambda: onnx.export(trained, tmp_path / "model.onnx"),
    ):
        with pytest.raises(ValueError, match="single frames, got a model of 3 stacked frames"):
            use()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--accumulate", "0"], "accumulate: expected 1 to 100, got 0"),
        (["--label-at", "middle"], "label-at: expected 'newest' for a single frame, got 'middle'"),
        (
            ["--sites", "f.yaml", "--accumulate", "2"],
            "--accumulate: expected 1 with --sites, got 2; --sites simulates single frames",
        ),
        (["background", "--accumulate", "2"], "--accumulate: expected 1 for background"),
    ],
)
def test_wrong_words_say_what_is_allowed(
    folder: Path,
    tmp_path: Path,
    words: list[str],
    message: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    name = "background" if words[0] == "background" else "pointpillars"
    data = [] if "--sites" in words else [str(folder)]
    rest = [word for word in words if word != "background"]
    config = str(ROOT / f"configs/detectors/{name}.yaml")
    assert main.main(["train", config, *data, "--out", str(tmp_path / "o"), *rest]) != 0
    assert message in capsys.readouterr().err
