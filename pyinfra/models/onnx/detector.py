"""CenterPoint on pillars with ONNX Runtime: the pretrained detector without PyTorch.

The steps are those of `detectors/centerpoint_pillar.py`, and the boxes are equal except for
rounding. Cells more than REGION_MARGIN_M outside the evaluation region are not computed and give no
boxes. The compiled extension computes the pillars and the first convolution. ONNX Runtime computes
the other layers. NumPy computes the boxes at the peaks of the heat.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pyinfra.core.arrays import Float32Array, Points
from pyinfra.core.errors import ConfigError
from pyinfra.core.vocabulary import ObjectClass
from pyinfra.dataset.regions import Region
from pyinfra.models.detectors import Detections
from pyinfra.models.detectors.bev_config import multiple
from pyinfra.models.detectors.catalogue import config_of
from pyinfra.models.detectors.centerpoint_config import Config
from pyinfra.models.detectors.classes import ALONG_ROADS, TYPES
from pyinfra.models.detectors.detection_area import REGION_MARGIN_M, Area, Site, around
from pyinfra.models.detectors.sample import with_columns
from pyinfra.models.detectors.suppression import MIN_SCORE, empty, of_classes, suppressed
from pyinfra.models.onnx.graph import Weights, fused, model_of
from pyinfra.models.onnx.peaks import Peaks
from pyinfra.models.onnx.tiles import tiles_of
from pyinfra.models.ops.kernels import kernels
from pyinfra.models.training.provenance import read_arrays, read_provenance

NO_BOX = np.float32(-1e9)  # logit of cells that are not computed
NAME = "centerpoint-pillar"  # the detector that this module can run


class OnnxDetector:
    """A `Detector` whose z is measured from the road."""

    def __init__(
        self,
        config: Config,
        weights: Weights,
        site: Site,
        *,
        calibration: Sequence[float] | None = None,
        region: Region | None = None,
        threads: int = 1,
    ) -> None:
        cell_m = config.bev.strides[0] * config.pillar_m
        area = site.area.grown(multiple(config.bev, config.pillar_m))
        self.site = Site(area, site.floor_z)
        self.classes: tuple[ObjectClass, ...] = config.classes
        self.columns, self.calibration = config.columns, calibration
        self.min_score = MIN_SCORE
        self.map = PillarMap(config, weights, area)
        rows, columns = self.map.array.shape[2:]
        self.peaks = Peaks(self.site, cell_m, config.axis, region, (rows, columns))
        near = self.peaks.near(region, REGION_MARGIN_M, (rows, columns))
        self.tiles = [
            (tile, session_of(bytes(model_of(config, weights, tile)), threads))
            for tile in tiles_of(near, config.bev)
        ]
        outputs = len(self.classes) + len(weights["head.box.bias"])
        self.maps = np.full((outputs, rows, columns), NO_BOX, np.float32)

    def predict(self, points: Points) -> Detections:
        """Returns the boxes in a cloud, as `Detector.predict` does."""
        inside = with_columns(self.site.area.crop(points), self.columns)
        if len(inside) == 0:
            return empty()
        whole = self.map.of(inside)
        for tile, session in self.tiles:
            rows, columns = tile
            part = np.ascontiguousarray(whole[:, :, rows.computed, columns.computed])
            (maps,) = session.run(None, {"map": part})
            inside_tile = maps[0][:, rows.used_inside, columns.used_inside]
            self.maps[:, rows.used, columns.used] = inside_tile
        return self.best(self.maps)

    def best(self, maps: Float32Array) -> Detections:
        """Returns the detections in maps (classes + 8 or 9, H, W)."""
        logits, boxes = maps[: len(self.classes)], maps[len(self.classes) :]
        parts = []
        for logit, name in zip(logits, self.classes, strict=True):
            peaks = self.peaks.of(logit, boxes, self.min_score, along_road=name in ALONG_ROADS)
            parts.append(suppressed(*peaks, TYPES[name], self.min_score))
        return of_classes(parts, self.calibration)


class PillarMap:
    """The pillar encoder (`detectors/pillars.py`) and the first convolution, without batch norms.

    The map (1, C, H, W) is a single array that each frame overwrites.
    """

    def __init__(self, config: Config, weights: Weights, area: Area) -> None:
        encoder, bias = fused(weights, "encoder.linear", "encoder.norm")
        layer, layer_bias = fused(weights, "bev.blocks.0.0.0", "bev.blocks.0.0.1")
        stride, outputs = config.bev.strides[0], config.bev.widths[0]
        self.low, self.middle_z = area.low[:2], (area.low[2] + area.high[2]) / 2
        self.side = config.pillar_m
        first = 0 if config.place else 2
        rows_first = layer.transpose(2, 3, 1, 0).reshape(-1, outputs)
        self.encoder = np.ascontiguousarray(encoder.T), bias, first
        self.layer = np.ascontiguousarray(rows_first), layer_bias, stride
        columns, rows = (round(area.size[i] / config.pillar_m) // stride for i in (0, 1))
        self.array = np.empty((1, outputs, rows, columns), np.float32)

    def of(self, points: Points) -> Float32Array:
        assert kernels is not None
        points = np.ascontiguousarray(points, np.float32)
        where = self.low, self.middle_z, self.side
        kernels.pillar_map(points, *where, *self.encoder, *self.layer, self.array[0])
        return self.array


def session_of(model: bytes, threads: int) -> Any:
    """Returns a session of ONNX Runtime for a model. threads: number of threads per frame."""
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    options.log_severity_level = 3  # only errors are logged
    # Waiting threads sleep, so that other programs can use the cores.
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    return onnxruntime.InferenceSession(model, options, ["CPUExecutionProvider"])


def load(file: Path, region: Region | None = None, threads: int = 1) -> OnnxDetector:
    """Loads a checkpoint of CenterPoint on pillars.

    region: the region of the frames; by default that of the training. Raises the errors of
    checkpoint.load, and ConfigError if the weights do not fit the settings.
    """
    provenance, weights = read_provenance(file), read_arrays(file)
    config = config_of(provenance.detector, provenance.network)
    site = provenance.site if region is None else around(region, provenance.site)
    try:
        return OnnxDetector(
            config,
            weights,
            site,
            calibration=provenance.calibration,
            region=region,
            threads=threads,
        )
    except KeyError as error:
        raise ConfigError(f"{file}: expected the weights {error}, got none") from None
