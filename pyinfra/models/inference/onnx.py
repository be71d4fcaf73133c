"""Exports a dense detector, from points to boxes, as one ONNX graph.

The input is `points` (n, 4) float32, n >= 1, inside the area in the file's metadata: x y z and
intensity (0 to 1). The outputs are `boxes` (k, 7) and `scores` (k,), best first, after non-maximum
suppression; k may be 0. A network with several classes also has the output `classes` (k,) with
class numbers. x and y of points and boxes are in the levelled LiDAR frame, and z is measured from
the road. Scores are those before calibration.
"""

import json
import logging
import warnings
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from pyinfra.core.config import as_plain
from pyinfra.core.errors import Error
from pyinfra.core.files import check_output, replacing
from pyinfra.models.detectors.batch import Batch
from pyinfra.models.detectors.centerpoint_pillar import CenterPointPillar
from pyinfra.models.detectors.pillars import PillarEncoder
from pyinfra.models.detectors.pointpillars import PointPillars
from pyinfra.models.inference.detect import check_single, model_file
from pyinfra.models.inference.onnx_suppression import remaining
from pyinfra.models.training import checkpoint

DENSE = (PointPillars, CenterPointPillar)
OPSET = 18  # first version of the ONNX operators in which a scatter can take a maximum


class Graph(nn.Module):
    """A dense detector for one frame, whose tensor shapes do not depend on point positions."""

    def __init__(self, network: PointPillars | CenterPointPillar, *, suppress: bool = True) -> None:
        super().__init__()
        self.network, self.suppress = network, suppress

    def forward(self, points: Tensor) -> tuple[Tensor, ...]:
        canvas = whole_canvas(self.network.encoder, points)
        ((boxes, scores, *numbers),) = self.network.head.candidates(self.network.bev(canvas))
        if not self.suppress:
            return boxes, scores, *numbers
        classes = numbers[0] if numbers else torch.zeros_like(scores, dtype=torch.int64)
        kept = remaining(boxes, scores, classes, self.network.min_score)
        return tuple(column[kept] for column in (boxes, scores, *numbers))


def whole_canvas(encoder: PillarEncoder, points: Tensor) -> Tensor:
    """Returns the canvas of the encoder, computed with a pillar in every cell: (1, C, H, W)."""
    batch = Batch(points, (points.shape[0],), ())
    cells = encoder.rows * encoder.columns
    member = encoder.pillar_of(batch)
    features = encoder.point_features(batch, torch.arange(cells), member)
    features_of_cells = encoder.pooled(features, member, cells)
    return features_of_cells.view(1, encoder.rows, encoder.columns, -1).permute(0, 3, 1, 2)


def export(run: Path, file: Path, *, suppress: bool = True) -> None:
    """Writes a trained detector as an ONNX file.

    suppress: whether the graph ends with the suppression; without it, boxes overlap.

    Raises Error for a detector that is not dense or that needs stacked frames, and if `file` exists
    and is not an ONNX model. Raises ImportError if onnxscript is not installed.
    """
    check_output(file, b"\x08")
    loaded = checkpoint.load(model_file(run))
    check_single(run, loaded.provenance.accumulate)
    network = loaded.network()
    if not isinstance(network, DENSE) or len(network.encoder.before) > 0:
        raise Error(
            f"{run}: expected a model of pointpillars or centerpoint-pillar, got a model of "
            f"{loaded.provenance.detector}"
        )
    low, high = (torch.tensor(side) for side in (network.site.area.low, network.site.area.high))
    xyz = low + torch.rand(100, 3, generator=torch.Generator().manual_seed(1)) * (high - low)
    points = torch.cat([xyz, torch.full((100, network.columns - 3), 0.5)], dim=1)
    logging.getLogger("torch.onnx").setLevel(logging.ERROR)
    with warnings.catch_warnings():  # the exporter's own packages cause warnings
        warnings.simplefilter("ignore")
        program = torch.onnx.export(
            Graph(network, suppress=suppress).eval(),
            (points,),
            input_names=["points"],
            output_names=["boxes", "scores", *["classes"] * (len(network.classes) > 1)],
            dynamic_shapes=({0: torch.export.Dim("n", min=1)},),
            opset_version=OPSET,
            dynamo=True,
            verbose=False,
        )
    if program is None:
        raise RuntimeError(
            f"{run}: expected an ONNX program from torch.onnx.export, got None; check the versions "
            "of torch and onnxscript"
        )
    metadata = {
        "about": json.dumps(as_plain(loaded.provenance)),
        "area": json.dumps(as_plain(network.site)),
    }
    _remove_source_paths(program.model)
    program.model.metadata_props.update(metadata)
    with replacing(file) as beside:
        program.save(str(beside), external_data=False)


def _remove_source_paths(model: Any) -> None:
    """Removes what the exporter recorded of each node: source files and lines of this machine."""
    for graph in model.graphs():
        for node in graph:
            for part in (node, *node.inputs, *node.outputs):
                if part is not None:
                    part.metadata_props.clear()
                    part.doc_string = None
        graph.metadata_props.clear()
