"""The occupancy of the past of a fixed sensor: an input of networks that a single cloud lacks."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pyinfra.core.arrays import Points
from pyinfra.core.boxes import points_in_boxes
from pyinfra.core.errors import Error
from pyinfra.core.vocabulary import ObjectClass
from pyinfra.models.detectors.sample import Sample, with_columns
from pyinfra.models.training import past
from pyinfra.models.training.past import Memory, PastFrames, frames_with_past, occupied, with_past
from pyinfra.models.training.samples import Augmentation, augmented

CLASSES: tuple[ObjectClass, ...] = ("vehicle", "pedestrian", "cyclist")
WALL = np.array([[10.0, 0.1, 0.1, 0.5], [10.0, 0.5, 0.1, 0.5]], np.float32)
CAR = np.array([[5.0, 3.0, 0.5, 0.2]], np.float32)


def clouds(visible: list[bool]) -> list[Points]:
    """Returns one cloud per frame: a wall, and a car in the frames where it is visible."""
    return [np.concatenate([WALL, CAR]) if there else WALL for there in visible]


def test_the_share_of_a_wall_is_one_and_that_of_a_new_car_is_zero() -> None:
    seen = [occupied(cloud) for cloud in clouds([False] * 5)]
    points = Memory().added(np.concatenate([WALL, CAR]), seen)
    np.testing.assert_allclose(points[:, 4], [1, 1, 0])
    np.testing.assert_allclose(points[:, 5], 5 / past.PAST_FRAMES)
    np.testing.assert_array_equal(points[:, :4], np.concatenate([WALL, CAR]))


def test_a_car_in_a_queue_has_the_share_of_its_standing_time() -> None:
    memory = Memory()
    visible = [False] * 10 + [True] * 10
    seen = [occupied(cloud) for cloud in clouds(visible)]
    shares = [memory.added(CAR, seen[:n])[0, 4] for n in (10, 15, 20)]
    np.testing.assert_allclose(shares, [0, 5 / 15, 0.5])
    for number, cloud in enumerate(clouds(visible)[:3]):  # the counts are cleared after each cloud
        assert memory.added(cloud, [])[:, 4:].max() == 0, number


def test_points_without_a_voxel_have_no_past() -> None:
    points = np.array([[np.nan, 0, 0, 0], [1e6, 0, 0, 0], [1, 1, np.inf, 0]], np.float32)
    assert len(occupied(points)) == 0
    assert Memory().added(points, [occupied(WALL)])[:, 4].tolist() == [0, 0, 0]
    assert Memory().added(np.zeros((0, 4), np.float32), [occupied(WALL)]).shape == (0, 6)


def test_the_past_is_the_first_frame_of_each_slot_before_the_frame() -> None:
    every = PastFrames(lambda _: WALL, range(1000), 0.1, 60.0)
    assert every.before(0) == every.before(29) == []
    assert every.before(30) == every.before(59) == [0]
    assert every.before(899) == list(range(270, 870, 30))
    some = PastFrames(lambda _: WALL, [5, 31, 200], 0.1, 60.0)
    assert some.before(200) == [5, 31]
    assert frames_with_past([5, 6, 31, 200], [5, 31, 200], 0.1, 60.0) == 2
    assert frames_with_past([5], [], 0.1, 60.0) == frames_with_past([5], [1], 0.1, 0.0) == 0


def test_frames_in_any_order_have_the_same_past(monkeypatch: pytest.MonkeyPatch) -> None:
    read = list[int]()
    visible = np.random.default_rng(1).random(300) < 0.5

    def cloud(frame: int) -> Points:
        read.append(frame)
        return clouds([bool(visible[frame])])[0]

    frames = list(range(0, 300, 7))

    def made(order: list[int]) -> list[Points]:
        whole = [lambda: np.concatenate([WALL, CAR])] * len(order)
        return [c() for c in with_past(whole, cloud, order, range(300), 0.1, 6.0)]

    forward = made(frames)
    assert len(read) == len(set(read))  # each remembered frame is read once
    for a, b in zip(forward, made(frames[::-1])[::-1], strict=True):
        np.testing.assert_array_equal(a, b)
    monkeypatch.setattr(past, "MOST_KEPT", 3)  # a long recording forgets its first frames
    for a, b in zip(forward, made(frames), strict=True):
        np.testing.assert_array_equal(a, b)


def test_without_seconds_of_the_past_clouds_are_unchanged() -> None:
    (cloud,) = with_past([lambda: WALL], lambda _: WALL, [3], range(5), 0.1, 0.0)
    assert cloud().shape == (2, 4)


def test_a_single_cloud_has_an_empty_past_and_other_missing_columns_are_refused() -> None:
    assert with_columns(WALL, 6, past=True)[:, 4:].tolist() == [[0, 0], [0, 0]]
    assert with_columns(np.ones((2, 6), np.float32), 4).shape == (2, 4)
    with pytest.raises(Error):
        with_columns(WALL, 5)
    with pytest.raises(Error):  # ages are missing, not only the past
        with_columns(WALL, 7, past=True)


def test_augmentation_leaves_the_past_with_its_points_or_out() -> None:
    points = Memory().added(np.concatenate([WALL, CAR]), [occupied(WALL)] * 4)
    sample = Sample(points, np.array([[5, 3, 0.5, 2, 2, 2, 0.0]]))
    turned = Augmentation(flip=True, rotation_deg=180, scale=0.05, drop_out=0.01)
    kept = augmented(sample, None, turned, np.random.default_rng(3))
    np.testing.assert_array_equal(kept.points[:, 4:], points[:, 4:])
    out = augmented(sample, None, replace(turned, no_past=1.0), np.random.default_rng(3))
    assert not out.points[:, 4:].any()
    np.testing.assert_array_equal(out.points[:, :4], kept.points[:, :4])
    dark = Augmentation(no_intensity=1.0)
    assert not augmented(sample, None, dark, np.random.default_rng(1)).points[:, 3].any()
    scaled = [
        augmented(sample, None, Augmentation(intensity_gain=2), np.random.default_rng(i)).points
        for i in range(20)
    ]
    gains = np.array([cloud[2, 3] / 0.2 for cloud in scaled])
    assert gains.min() >= 0.5
    assert gains.max() <= 2
    assert np.ptp(gains) > 0.5


def test_samples_of_a_stream_have_a_past_in_which_driving_vehicles_are_new() -> None:
    from pyinfra.models.training.generated_sites import StreamPlan, site_stream
    from pyinfra.scenes.generator import lidar_catalogue

    plan = StreamPlan(seed=3, lidars=1, frames=4, mixed=1, label_time="scan")
    only = lidar_catalogue.only(["helios_16"], {"datasheet": 1.0})
    stream, again = (site_stream(plan, only, CLASSES, past_s=60.0) for _ in range(2))
    samples = [stream.samples.sample(i) for i in range(4)]
    on_vehicles, elsewhere = [], []
    for sample in samples:
        assert sample.points.shape[1] == 6
        known = sample.points[:, 5]
        assert known.min() == known.max() <= 1
        if known.max() < 0.1:
            assert sample.points[:, 4].max() <= 1
            continue
        inside = np.array([points_in_boxes(sample.points[i : i + 1], sample.boxes).any()
                           for i in range(0, len(sample.points), 50)])  # fmt: skip
        on_vehicles += sample.points[::50, 4][inside].tolist()
        elsewhere += sample.points[::50, 4][~inside].tolist()
    assert np.mean(elsewhere) > 0.4
    assert not on_vehicles or np.mean(on_vehicles) < np.mean(elsewhere)
    np.testing.assert_array_equal(samples[2].points, again.samples.sample(2).points)
    with pytest.raises(Error):  # a site of 60 s has 20 slots of 3 s
        site_stream(replace(plan, frames=50), only, CLASSES, past_s=60.0).samples.sample(0)


def test_the_stream_of_the_pilots_has_lidars_of_no_product_and_choose_some_more_often() -> None:
    from pyinfra.models.training.generated_sites import SiteSamples, read_stream
    from reproduction import ROOT

    samples = read_stream(ROOT / "configs/streams/pilots.yaml", CLASSES, 60.0).samples
    assert isinstance(samples, SiteSamples)
    assert samples.narrow is not None
    names = {file.stem for file in (*samples.sensors.files, *samples.narrow.files)}
    assert {"spinning_24", "prisms_wide_1", "prisms_wide_2", "prisms_round"} <= names
    assert not names & {"hesai_ot128", "hesai_xt32", "livox_horizon"}
    random = np.random.default_rng(1)
    chosen = [lidar.name for _ in range(200) for lidar in samples.sensors.draw(random, 1)]
    counts = {name: chosen.count(name) for name in ("helios_16", "velodyne_vls_128")}
    assert counts["helios_16"] > 1.5 * counts["velodyne_vls_128"] > 0


@pytest.mark.nightly
def test_a_network_begins_with_the_boxes_of_another_and_then_uses_its_past(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Trains a pilot for two steps on toy streams, and detects with and without the past."""
    torch = pytest.importorskip("torch", reason="the extra `train` is not installed")
    import pyinfra as pi
    from pyinfra.cli import main
    from pyinfra.dataset import catalogue, runs
    from pyinfra.dataset.frame_sequence import RecordedFrames
    from pyinfra.models.detectors.centerpoint_pillar import CenterPointPillar
    from pyinfra.models.inference import detect
    from pyinfra.models.training import checkpoint
    from pyinfra.models.training.generated_sites import StreamPlan, site_stream
    from pyinfra.models.training.recipe import read_recipe
    from pyinfra.models.training.train import _begun_with, _provenance, train
    from pyinfra.scenes.generator import lidar_catalogue
    from reproduction import ROOT

    recipe = read_recipe(ROOT / "configs/detectors/pilots.yaml", "full")
    recipe = replace(recipe, learning=replace(recipe.learning, steps=2, batch=2))
    plan = StreamPlan(seed=3, lidars=1, frames=4, mixed=1, label_time="scan")
    only = lidar_catalogue.only(["helios_16"], {"datasheet": 1.0})
    stream = site_stream(plan, only, recipe.classes, past_s=recipe.past_s)
    torch.manual_seed(1)
    network = checkpoint.build(recipe.detector, recipe.network, stream.site)
    _begun_with(network, Path("generalist"), _provenance(recipe, stream, 1))
    before = checkpoint.load(detect.model_file(Path("generalist"))).network()
    cloud = stream.samples.sample(0).points
    network.eval()
    before.calibration = None
    for points in (cloud, cloud[:, :4]):
        ours, theirs = network.predict(points), before.predict(points)
        assert len(theirs) > 0
        np.testing.assert_allclose(ours.boxes, theirs.boxes, atol=1e-3)

    words = ["--set", "duration_s=12", "--set", "traffic.warm_up_s=20", "--frames", "0:90:30"]
    scene, lidar = catalogue.scene_file("highway"), catalogue.lidar_file("helios_16")
    runs.infrasim("run", scene, "--lidar", lidar, *words, "--out", tmp_path / "data")
    folder = tmp_path / "data/helios_16"
    train(recipe, stream, tmp_path / "run", quiet=True)
    with torch.no_grad():  # after two steps the weights of the past are small
        loaded = checkpoint.load(tmp_path / "run/last.safetensors")
        trained = loaded.network()
        assert isinstance(trained, CenterPointPillar)
        i = trained.encoder.inputs.index("past_share")
        weight = trained.encoder.linear.weight
        assert isinstance(weight, torch.Tensor)
        assert weight[:, i].abs().max() > 0
        weight[:, i] += 0.5
        trained.calibration = None
        checkpoint.save(tmp_path / "run/last.safetensors", trained, {}, loaded.provenance)
    whole = pi.detect(tmp_path / "run", folder)
    assert whole.attrs["inputs"] == "single frames with the past of up to 60 s (2 of 3 frames)"
    alone = pi.detect(tmp_path / "run", RecordedFrames(folder, (0,)))
    assert alone.attrs["inputs"] == "single frames, without the past"
    out = tmp_path / "out"
    words = ["detect", str(folder), "--model", str(tmp_path / "run"), "--out", str(out)]
    assert main.main([*words, "--frames", "30:31"]) == 0
    assert "input: single frames with the past of up to 60 s (1 of 1 frames)" in (
        capsys.readouterr().out
    )
    assert len(whole) > 0


def test_frames_with_a_past_have_a_calibration_of_their_own() -> None:
    torch = pytest.importorskip("torch", reason="the extra `train` is not installed")
    from pyinfra.models.detectors.centerpoint_config import Config
    from pyinfra.models.detectors.centerpoint_pillar import CenterPointPillar
    from pyinfra.models.detectors.detection_area import Area, Site
    from pyinfra.models.onnx.detector import OnnxDetector

    site = Site(Area((-20.0, -12.0, -1.0), (28.0, 12.0, 4.5)), 0.3)
    config = Config(pillar_width=16, head_width=8, past_s=60.0)
    torch.manual_seed(1)
    network = CenterPointPillar(config, site).eval()
    torch.nn.init.constant_(network.head.heat.bias, 0.0)
    weights = {name: tensor.numpy() for name, tensor in network.state_dict().items()}
    network.calibration, network.calibration_past = (1.0, 0.0), (1.0, -3.0)
    by_onnx = OnnxDetector(
        config, weights, site, calibration=(1.0, 0.0), calibration_past=(1.0, -3.0)
    )
    points: Points = np.random.default_rng(1).random((500, 4)).astype(np.float32)
    points[:, :2] *= 10
    empty: Points = np.pad(points, ((0, 0), (0, 2)))
    known = empty.copy()
    known[:, 5] = 0.05
    for detector in (network, by_onnx):
        single, without, with_past = (detector.predict(p) for p in (points, empty, known))
        assert len(single) > 0
        np.testing.assert_array_equal(single.scores, without.scores)
        assert with_past.scores.max() < 0.5 * single.scores.max()
