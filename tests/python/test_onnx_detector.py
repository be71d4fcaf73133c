"""The pretrained detector with ONNX Runtime gives PyTorch's boxes and does not need PyTorch."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pyinfra.core.arrays import concatenated
from pyinfra.core.errors import ConfigError, Error
from pyinfra.dataset.frame_sequence import FrameSequence
from pyinfra.dataset.loading import load_scene
from pyinfra.dataset.simulated import simulate
from pyinfra.metrics.evaluate import evaluate
from pyinfra.models.detectors import Detections
from pyinfra.models.detectors.centerpoint_config import Config
from pyinfra.models.detectors.detection_area import Area, Site
from pyinfra.models.detectors.ground_adapter import OnRoad
from pyinfra.models.inference import boxes_table, detect
from pyinfra.models.inference.detections import table_of
from pyinfra.models.onnx import detector as onnx_detector
from pyinfra.models.onnx.graph import model_of
from pyinfra.models.onnx.tiles import extent_of
from pyinfra.models.training.provenance import read_arrays, read_provenance

ROOT = Path(__file__).resolve().parents[2]
FILE = detect.model_file(Path("generalist"))
SITE = Site(Area((-20.0, -12.0, -1.0), (28.0, 12.0, 4.5)), 0.3)


def assert_equal(a: Detections, b: Detections) -> None:
    """Asserts that boxes differ only by rounding. Headings may differ by whole turns, and boxes of
    equal score may be in another order."""
    assert len(a) == len(b)
    pairs = zip(a.boxes, a.names, strict=True)
    off = [np.abs(b.boxes[:, :6] - box[:6]).max(axis=1) + 1e3 * (b.names != n) for box, n in pairs]
    same = np.array([one.argmin() for one in off])
    same = same.astype(np.int64)
    assert a.names.tolist() == b.names[same].tolist()
    np.testing.assert_allclose(a.scores, b.scores[same], atol=1e-4)
    np.testing.assert_allclose(a.boxes[:, :6], b.boxes[same, :6], atol=1e-3)
    np.testing.assert_allclose(np.cos(a.boxes[:, 6] - b.boxes[same, 6]), 1, atol=1e-6)


def near(boxes: Detections, frames: FrameSequence) -> Detections:
    """Returns the boxes in the region or at most 4 m outside it. Farther boxes are not computed."""
    assert frames.region is not None
    keep = frames.region.holds(boxes.boxes, 4.0)
    return Detections(boxes.boxes[keep], boxes.scores[keep], boxes.names[keep])


@pytest.fixture(
    scope="module", params=["ruby_plus", pytest.param("livox_avia", marks=pytest.mark.nightly)]
)
def frames(request: pytest.FixtureRequest) -> FrameSequence:
    scene = load_scene("crossroad", set={"duration_s": 8, "traffic.warm_up_s": 20})
    return simulate(scene, request.param, range(0, 80, 13))


def test_boxes_and_ap_are_those_of_pytorch(frames: FrameSequence) -> None:
    pytest.importorskip("torch", reason="the extra `train` is not installed")
    assert frames.ground is not None
    by_torch = OnRoad(detect.load_network(FILE, frames.region), frames.ground)
    by_onnx = detect.load_detector(FILE, ground=frames.ground, region=frames.region)
    assert isinstance(by_onnx, OnRoad)
    assert isinstance(by_onnx.detector, onnx_detector.OnnxDetector)
    pairs = [
        (near(by_torch.predict(f.points), frames), near(by_onnx.predict(f.points), frames))
        for f in frames
    ]
    assert sum(len(a) for a, _ in pairs) > 50
    for a, b in pairs:
        assert_equal(a, b)
    results = []
    for part in zip(*pairs, strict=True):
        numbers = np.repeat(frames.numbers, [len(detections) for detections in part])
        every = concatenated(part)
        table = table_of(numbers, every.names, every.boxes, every.scores)
        results.append(evaluate(frames, table))
    for column in ("ap", "ap_r1000"):
        wanted, got = (result.ap[column].to_numpy() for result in results)
        assert np.nanmax(wanted) > 50
        np.testing.assert_allclose(got, wanted, atol=1e-3)


@pytest.mark.nightly
def test_boxes_do_not_depend_on_the_number_of_threads(frames: FrameSequence) -> None:
    tables = [
        boxes_table.detect(boxes_table.load_detector(threads=threads), frames) for threads in (1, 2)
    ]
    assert tables[0].equals(tables[1])


@pytest.mark.parametrize(
    "config",
    [
        Config(pillar_width=16, head_width=16),
        Config(pillar_width=32, head_width=8, intensity=False, place=False, axis=True),
        Config(pillar_width=40, head_width=8, age=True, classes=("vehicle", "pedestrian")),
        Config(pillar_width=32, head_width=8, age=True, intensity=False),
    ],
    ids=["published", "axis", "age", "age_without_intensity"],
)
def test_a_network_of_any_settings_gives_the_same_boxes(config: Config) -> None:
    torch = pytest.importorskip("torch", reason="the extra `train` is not installed")
    from pyinfra.models.detectors.centerpoint_pillar import CenterPointPillar

    torch.manual_seed(4)
    small = replace(config.bev, layers=(1, 2), widths=(16, 24), strides=(2, 2), up_width=8)
    config = replace(config, bev=small)
    network = CenterPointPillar(config, SITE).eval()
    torch.nn.init.constant_(network.head.heat.bias, 0.0)
    for module in network.modules():
        if isinstance(module, torch.nn.BatchNorm1d | torch.nn.BatchNorm2d):
            module.running_mean.uniform_(-0.3, 0.3)
            module.running_var.uniform_(0.5, 2)
    weights = {name: tensor.numpy() for name, tensor in network.state_dict().items()}
    ours = onnx_detector.OnnxDetector(config, weights, SITE)
    rng = np.random.default_rng(5)
    low, high = np.array(SITE.area.low), np.array(SITE.area.high)
    extra = rng.random((3000, ours.columns - 3))
    points = np.concatenate([low + rng.random((3000, 3)) * (high - low), extra], 1)
    points = points.astype(np.float32)
    wanted, got = network.predict(points), ours.predict(points)
    assert len(wanted) > 10
    assert_equal(wanted, got)


def test_a_cloud_without_points_in_the_area_has_no_boxes() -> None:
    boxes = onnx_detector.load(FILE).predict(np.full((5, 4), 1e6, np.float32))
    assert len(boxes) == 0
    assert boxes.boxes.shape == (0, 7)


def test_a_network_of_ages_refuses_clouds_without() -> None:
    loaded = onnx_detector.load(FILE)
    loaded.columns = 5
    with pytest.raises(Error, match="points: expected 5 columns, got 4"):
        loaded.predict(np.zeros((5, 4), np.float32))


def test_the_model_keeps_the_rules_of_onnx() -> None:
    onnx = pytest.importorskip("onnx", reason="the extra `train` is not installed")
    config = onnx_detector.config_of("centerpoint-pillar", read_provenance(FILE).network)
    whole = extent_of(slice(0, 64), 64, config.bev)
    model = onnx.load_from_string(bytes(model_of(config, read_arrays(FILE), (whole, whole))))
    onnx.checker.check_model(model, full_check=True)


@pytest.mark.parametrize("rows", [slice(0, 8), slice(40, 48), slice(88, 96)])
@pytest.mark.parametrize("columns", [slice(0, 96), slice(36, 60)])
def test_a_tile_has_the_values_of_the_whole_map(rows: slice, columns: slice) -> None:
    config = onnx_detector.config_of("centerpoint-pillar", read_provenance(FILE).network)
    rng, whole = np.random.default_rng(1), slice(0, 96)
    first = rng.random((1, config.bev.widths[0], 96, 96), np.float32)
    maps = []
    for part in ((rows, columns), (whole, whole)):
        tile = extent_of(part[0], 96, config.bev), extent_of(part[1], 96, config.bev)
        session = onnx_detector.session_of(bytes(model_of(config, read_arrays(FILE), tile)), 1)
        computed = np.ascontiguousarray(first[:, :, tile[0].computed, tile[1].computed])
        assert computed.size < first.size or part[0] == whole
        (out,) = session.run(None, {"map": computed})
        maps.append(out[0][:, tile[0].used_inside, tile[1].used_inside])
    np.testing.assert_allclose(maps[0], maps[1][:, rows, columns], rtol=1e-5, atol=1e-4)
    assert maps[1].shape[1:] == (96, 96)


def test_weights_that_lack_or_are_not_finite_are_refused(tmp_path: Path) -> None:
    from safetensors import safe_open
    from safetensors.numpy import save_file

    with safe_open(FILE, "np") as whole:
        tensors = {name: whole.get_tensor(name) for name in whole.keys()}  # noqa: SIM118
        about = whole.metadata()
    bias = tensors.pop("network.head.box.bias")
    for others in (tensors, tensors | {"network.head.box.bias": bias + np.float32(np.inf)}):
        save_file(others, tmp_path / "bad.safetensors", metadata=about)
        with pytest.raises(ConfigError, match=r"head\.box\.bias"):
            onnx_detector.load(tmp_path / "bad.safetensors")


WITHOUT = """
import sys
from importlib.machinery import PathFinder
find = PathFinder.find_spec
PathFinder.find_spec = lambda name, *rest: None if name == "torch" else find(name, *rest)
import pyinfra as pi
from pyinfra.cli import main
scene = pi.load_scene("highway", set={"duration_s": 2, "traffic.warm_up_s": 5})
frames = pi.simulate(scene, "helios_16", range(0, 20, 10))
assert len(pi.detect(pi.load_detector("generalist"), frames)) > 0
folder = sys.argv[1]
pi.export(frames, "pcd", folder + "/recording")
pi.import_recording(folder + "/recording", "pcd", folder + "/data/pole", height_m=6.0)
words = ["detect", folder + "/data/pole", "--model", "generalist"]
assert main.main([*words, "--out", folder + "/boxes", "--height-m", "6"]) == 0
train = ["train", "configs/detectors/pointpillars.yaml", folder + "/data/pole"]
assert main.main([*train, "--out", folder + "/run", "--tier", "smoke"]) == 2
assert main.main(["onnx", "generalist", "--out", folder + "/model.onnx"]) == 2
"""


def test_detection_needs_no_pytorch_and_training_says_what_installs_it(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT, str(tmp_path)], capture_output=True, text=True, cwd=ROOT
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr.count("pip install 'infrasim[train]'") == 2
    assert list((tmp_path / "boxes").glob("*.txt"))


def test_less_than_one_thread_is_refused() -> None:
    with pytest.raises(Error, match="threads: expected 1 or more, got 0"):
        boxes_table.load_detector(threads=0)


@pytest.mark.parametrize(
    "change",
    [
        {"points": np.zeros((3, 2), np.float32)},
        {"points": np.full((3, 4), 1e3, np.float32)},
        {"points": np.full((3, 4), np.nan, np.float32)},
        {"weight": np.zeros((9, 5), np.float32)},
        {"first": -1},
        {"first": 12},
        {"layer_weight": np.zeros((9, 4), np.float32)},
        {"stride": 0},
        {"map": np.zeros((5, 2, 2), np.float32)},
    ],
)
def test_arrays_that_do_not_fit_are_refused(change: dict[str, object]) -> None:
    assert onnx_detector.kernels is not None
    arguments = {
        "points": np.zeros((3, 4), np.float32),
        "low": (-1.0, -1.0),
        "middle_z": 0.0,
        "side": 0.5,
        "weight": np.zeros((8, 6), np.float32),
        "bias": np.zeros(6, np.float32),
        "first": 2,
        "layer_weight": np.zeros((54, 4), np.float32),
        "layer_bias": np.zeros(4, np.float32),
        "stride": 2,
        "map": np.zeros((4, 2, 2), np.float32),
    }
    onnx_detector.kernels.pillar_map(**arguments)
    with pytest.raises(ValueError, match="expected"):
        onnx_detector.kernels.pillar_map(**arguments | change)
