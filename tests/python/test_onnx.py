"""The ONNX file of a dense detector gives the same boxes as the network, for any number of
points."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="the extra `train` is not installed")
onnxruntime = pytest.importorskip("onnxruntime", reason="onnxruntime is not installed")

from detector_data import SITE, road_sample  # noqa: E402

from pyinfra.cli import main  # noqa: E402
from pyinfra.core.config import as_plain  # noqa: E402
from pyinfra.core.vocabulary import Tier  # noqa: E402
from pyinfra.models.detectors.batch import make_batch  # noqa: E402
from pyinfra.models.detectors.classes import TYPES  # noqa: E402
from pyinfra.models.detectors.suppression import MIN_SCORE, NMS_IOU  # noqa: E402
from pyinfra.models.inference.onnx_suppression import remaining  # noqa: E402
from pyinfra.models.ops.kernels import kernels  # noqa: E402
from pyinfra.models.training import checkpoint  # noqa: E402
from pyinfra.models.training.provenance import Provenance  # noqa: E402
from pyinfra.models.training.recipe import read_recipe  # noqa: E402

ROOT = Path(__file__).resolve().parents[2]


def saved(name: str, folder: Path, steps: int = 0) -> Path:
    """Writes a checkpoint of a network with few layers after a few training steps. That of the
    generalist has several classes."""
    tier: Tier = "full" if name == "generalist" else "smoke"
    recipe = read_recipe(ROOT / f"configs/detectors/{name}.yaml", tier)
    if name != "dsvt":
        bev = replace(recipe.network.bev, layers=(0, 1, 1))
        recipe = replace(recipe, network=replace(recipe.network, bev=bev))
    torch.manual_seed(3)
    network = checkpoint.build(recipe.detector, recipe.network, SITE)
    optimizer = torch.optim.AdamW(network.train().parameters(), 0.003)
    for step in range(steps):
        losses = network.losses(make_batch([road_sample(step % 4)], network.site.area))
        optimizer.zero_grad()
        torch.stack(list(losses.values())).sum().backward()
        optimizer.step()
    plain = as_plain(recipe.network)
    provenance = Provenance(recipe.detector, plain, SITE, "ring", "paper", "road", 1, 1, 1)
    folder.mkdir()
    checkpoint.save(folder / "last.safetensors", network, {}, provenance)
    return folder


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [
        pytest.param("pointpillars", marks=pytest.mark.nightly),
        pytest.param("centerpoint-pillar", marks=pytest.mark.nightly),
        "generalist",
    ],
)
def test_the_file_gives_the_boxes_of_the_network(name: str, tmp_path: Path) -> None:
    run, file = saved(name, tmp_path / "run", 60), tmp_path / "d.onnx"
    assert main.main(["onnx", str(run), "--out", str(file)]) == 0
    assert b".py" not in file.read_bytes()  # no path of a source file
    session = onnxruntime.InferenceSession(file, providers=["CPUExecutionProvider"])
    network = checkpoint.load(run / "last.safetensors").network()
    for points in (road_sample(1).points, road_sample(2).points[::3], road_sample(3).points[:1]):
        inside = network.site.area.crop(points)
        boxes, scores, *classes = session.run(None, {"points": inside})
        theirs = network.predict(points)  # the suppression is that of the detectors
        np.testing.assert_allclose(boxes, theirs.boxes, atol=1e-3)
        np.testing.assert_allclose(scores, theirs.scores, atol=1e-4)
        numbers = classes[0] if classes else np.zeros(len(scores), int)
        names = [TYPES[network.classes[number]] for number in numbers]
        assert names == theirs.names.tolist()
    assert len(network.predict(road_sample(1).points)) > 0
    kept = session.get_modelmeta().custom_metadata_map
    assert json.loads(kept["about"])["detector"] in (name, "centerpoint-pillar")
    assert json.loads(kept["area"])["floor_z"] == SITE.floor_z


def test_the_suppression_of_the_graph_is_that_of_the_detectors() -> None:
    """Boxes of any heading overlap in chains, and some are equal or of another class."""
    random = np.random.default_rng(1)
    low, high = np.array([-15, -15, 0, 3, 1.5, 2, -3]), np.array([15, 15, 0, 12, 3, 2, 3])
    boxes = random.uniform(low, high, (300, 7))
    boxes[100:120] = boxes[:20]
    scores = np.sort(random.uniform(0, 1, 300))[::-1].copy()
    classes = np.zeros(300, np.int64)
    kept = remaining(*map(torch.from_numpy, (boxes, scores, classes)), MIN_SCORE).numpy()
    want = kernels.suppress(boxes[scores >= MIN_SCORE], NMS_IOU, 300)
    assert kept.tolist() == want.tolist()
    both = np.concatenate([boxes, boxes])
    twice = remaining(
        torch.from_numpy(both),
        torch.from_numpy(np.concatenate([scores, scores])),
        torch.from_numpy(np.repeat([0, 1], 300)),
        MIN_SCORE,
    )
    assert len(twice) == 2 * len(want)


def test_a_detector_that_is_not_dense_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = saved("dsvt", tmp_path / "run")
    assert main.main(["onnx", str(run), "--out", str(tmp_path / "d.onnx")]) == 2
    assert "pointpillars or centerpoint-pillar, got a model of dsvt" in capsys.readouterr().err
    assert not (tmp_path / "d.onnx").exists()
