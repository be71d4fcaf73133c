"""The ONNX file of a dense detector gives the same boxes as the network, for any number of
points."""

import json
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
from pyinfra.models.training import checkpoint  # noqa: E402
from pyinfra.models.training.provenance import Provenance  # noqa: E402
from pyinfra.models.training.recipe import read_recipe  # noqa: E402

ROOT = Path(__file__).resolve().parents[2]


def saved(name: str, folder: Path, steps: int = 0) -> Path:
    """Writes a checkpoint of a small network after a few training steps. That of the generalist has
    several classes."""
    tier: Tier = "full" if name == "generalist" else "smoke"
    recipe = read_recipe(ROOT / f"configs/detectors/{name}.yaml", tier)
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
    [pytest.param("pointpillars", marks=pytest.mark.nightly), "centerpoint-pillar", "generalist"],
)
def test_the_file_gives_the_boxes_of_the_network(name: str, tmp_path: Path) -> None:
    run, file = saved(name, tmp_path / "run", 60), tmp_path / "d.onnx"
    assert main.main(["onnx", str(run), "--out", str(file)]) == 0
    assert b".py" not in file.read_bytes()  # no path of a source file
    session = onnxruntime.InferenceSession(file, providers=["CPUExecutionProvider"])
    network = checkpoint.load(run / "last.safetensors").network()
    for points in (road_sample(1).points, road_sample(2).points[::3], road_sample(3).points[:1]):
        inside = network.site.area.crop(points)
        outputs = session.run(None, {"points": inside})
        ours = network.best(*(torch.from_numpy(column) for column in outputs))
        theirs = network.predict(points)
        np.testing.assert_allclose(ours.boxes, theirs.boxes, atol=1e-3)
        np.testing.assert_allclose(ours.scores, theirs.scores, atol=1e-4)
        assert ours.names.tolist() == theirs.names.tolist()
    assert len(network.predict(road_sample(1).points)) > 0
    kept = session.get_modelmeta().custom_metadata_map
    assert json.loads(kept["about"])["detector"] in (name, "centerpoint-pillar")
    assert json.loads(kept["area"])["floor_z"] == SITE.floor_z


def test_a_detector_that_is_not_dense_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = saved("dsvt", tmp_path / "run")
    assert main.main(["onnx", str(run), "--out", str(tmp_path / "d.onnx")]) == 2
    assert "pointpillars or centerpoint-pillar, got a model of dsvt" in capsys.readouterr().err
    assert not (tmp_path / "d.onnx").exists()
