"""The two-dimensional part of CenterPoint on pillars as an ONNX model.

The model begins after the first convolution, which the extension computes only at the pillars.
The layers are those of `detectors/bev.py` and `detectors/centre_head.py`. Batch norms are fused
into the layers before them, as `detectors/fuse_batchnorm.py` does.
"""

from collections.abc import Mapping

import numpy as np

from pyinfra.core.arrays import Float32Array, IntArray
from pyinfra.models.detectors.centerpoint_config import Config
from pyinfra.models.onnx.model_bytes import Model, Node
from pyinfra.models.onnx.tiles import Tile

Weights = Mapping[str, Float32Array]
EPSILON = np.float32(1e-3)  # added to the variance in all batch norms
MOST = 1 << 30  # end of a slice that contains all channels of any layer


def model_of(config: Config, weights: Weights, tile: Tile) -> Model:
    """Returns the model of a tile. weights: as in the checkpoint.

    The input `map` is (1, C, H, W), row = y: the tile of the output of the first convolution. The
    output `maps` is (1, classes + 8 or 9, rows, columns): logits of the heat, followed by the
    numbers of a box. Its cells include the used ones of the tile.
    """
    rows, columns = tile
    layers = _Layers(weights, tile)
    x, upsampled, factor = "map", list[str](), 1
    for i, n in enumerate(config.bev.layers):
        for j in range(1 if i == 0 else 0, n + 1):
            stride = config.bev.strides[i] if j == 0 else 1
            x = layers.convolution(x, f"bev.blocks.{i}.{j}.0", f"bev.blocks.{i}.{j}.1", stride)
        factor *= config.bev.strides[i] if i > 0 else 1
        part = layers.cropped(x, rows.crops[i], columns.crops[i])
        upsampled.append(layers.enlarged(part, f"bev.ups.{i}.0", f"bev.ups.{i}.1", factor))
    x = layers.joined(upsampled)
    x = layers.convolution(x, "head.shared.0", "head.shared.1")
    layers.maps(x, "head.heat", "head.box")
    maps = len(config.classes) + len(weights["head.box.bias"])
    size = tuple(part.computed.stop - part.computed.start for part in tile)
    return Model(
        layers.nodes,
        layers.constants,
        ("map", (1, config.bev.widths[0], *size)),
        ("maps", (1, maps, "rows", "columns")),
    )


def fused(
    weights: Weights, layer: str, norm: str, *, axis: int = 0
) -> tuple[Float32Array, Float32Array]:
    """Returns the weight and bias of a layer without a bias, fused with the batch norm after it.

    axis: axis of the weight along which the outputs are numbered.
    """
    scale = weights[f"{norm}.weight"] / np.sqrt(weights[f"{norm}.running_var"] + EPSILON)
    weight = weights[f"{layer}.weight"]
    shape = [-1 if i == axis else 1 for i in range(weight.ndim)]
    bias = weights[f"{norm}.bias"] - weights[f"{norm}.running_mean"] * scale
    return weight * scale.reshape(shape), bias


class _Layers:
    """Collects nodes and constants. Each method adds a layer and returns the name of its output."""

    def __init__(self, weights: Weights, tile: Tile) -> None:
        self.weights = weights
        self.pads = zip(*(part.pads for part in tile), strict=True)
        self.nodes: list[Node] = []
        self.constants: dict[str, Float32Array | IntArray] = {}

    def convolution(self, x: str, layer: str, norm: str, stride: int = 1) -> str:
        """3 x 3 convolution, batch norm, ReLU."""
        inputs = self._with(layer, x, *fused(self.weights, layer, norm))
        shape = {**self._kernel(), "strides": (stride, stride)}
        return self._relu(Node("Conv", inputs, layer, shape))

    def cropped(self, x: str, rows: slice, columns: slice) -> str:
        """The part of a map in some rows and columns."""
        starts, ends = f"{x}.starts", f"{x}.ends"
        self.constants[starts] = np.array([0, 0, rows.start, columns.start])
        self.constants[ends] = np.array([1, MOST, rows.stop, columns.stop])
        return self._add(Node("Slice", (x, starts, ends), f"{x}.part"))

    def enlarged(self, x: str, layer: str, norm: str, factor: int) -> str:
        """Transposed convolution whose kernel is as wide as its stride, batch norm, ReLU.

        Because the kernels do not overlap, the layer equals a 1 x 1 convolution whose channels are
        then spread over the cells. ONNX Runtime computes this faster than a transposed convolution.
        """
        weight, bias = fused(self.weights, layer, norm, axis=1)  # (inputs, outputs, rows, columns)
        inputs = len(weight)
        spread = weight.transpose(1, 2, 3, 0).reshape(-1, inputs, 1, 1)
        names = self._with(layer, x, spread, bias.repeat(factor**2))
        small = self._relu(Node("Conv", names, layer, {"kernel_shape": (1, 1)}))
        if factor == 1:
            return small
        how: dict[str, int | str] = {"blocksize": factor, "mode": "CRD"}
        return self._add(Node("DepthToSpace", (small,), f"{layer}.enlarged", how))

    def joined(self, parts: list[str]) -> str:
        return self._add(Node("Concat", tuple(parts), "joined", {"axis": 1}))

    def maps(self, x: str, heat: str, box: str) -> str:
        """The convolutions of heat and box as one convolution."""
        weight, bias = (
            np.concatenate([self.weights[f"{name}.{kind}"] for name in (heat, box)])
            for kind in ("weight", "bias")
        )
        return self._add(Node("Conv", self._with("maps", x, weight, bias), "maps", self._kernel()))

    def _kernel(self) -> dict[str, tuple[int, ...]]:
        """The attributes of the next 3 x 3 convolution, which pads only at borders of the map."""
        (top, bottom), (left, right) = next(self.pads)
        return {"kernel_shape": (3, 3), "pads": (top, left, bottom, right)}

    def _with(
        self, layer: str, x: str, weight: Float32Array, bias: Float32Array
    ) -> tuple[str, ...]:
        names = f"{layer}.weight", f"{layer}.bias"
        self.constants |= dict(zip(names, (weight, bias), strict=True))
        return x, *names

    def _relu(self, node: Node) -> str:
        self._add(node)
        return self._add(Node("Relu", (node.output,), f"{node.output}.relu"))

    def _add(self, node: Node) -> str:
        self.nodes.append(node)
        return node.output
