"""Voxels and the sparse three-dimensional network on them.

The network follows SECOND, Yan et al., Sensors 2018, with the widths and strides of PV-RCNN, Shi et
al., CVPR 2020. It has several levels. Each level has half the resolution of the previous level. A
last layer halves only the height; its output is the bird's-eye canvas.
"""

import itertools
import math
import operator

import torch
from torch import Tensor, nn
from torch.nn import functional

from pyinfra.models.detectors.batch import Batch, CanvasPart
from pyinfra.models.detectors.detection_area import Area
from pyinfra.models.detectors.pointnet import Clouds, Norm
from pyinfra.models.ops.constants import constant
from pyinfra.models.ops.sparse import SparseConv3d, SparseTensor, SubmanifoldConv3d


class SparseBlock(nn.Module):
    """A sparse convolution with batch norm and ReLU."""

    def __init__(self, convolution: SubmanifoldConv3d | SparseConv3d, width: int) -> None:
        super().__init__()
        self.convolution, self.norm = convolution, Norm(width)

    def forward(self, x: SparseTensor) -> SparseTensor:
        x = self.convolution(x)
        return x.with_features(torch.relu(self.norm(x.features)))


class VoxelBackbone(nn.Module):
    """Maps points (n, 4) to the voxels of each level and a canvas (B, channels, H / s, W / s).

    s is the product of the strides along x and y. Along z, each level has a stride of 2.
    """

    def __init__(
        self,
        area: Area,
        voxel_m: float,
        height_m: float,
        widths: tuple[int, ...],
        strides: tuple[int, ...],
        canvas_width: int,
    ) -> None:
        """Makes the network for an area, whose sides must be multiples of s voxels.

        strides: along x and y, for each level except the first.
        """
        super().__init__()
        self.area, self.size = area, (voxel_m, voxel_m, height_m)
        columns, rows = (round(area.size[axis] / voxel_m) for axis in (0, 1))
        self.shape = math.ceil(area.size[2] / height_m - 1e-6), rows, columns
        along = list(itertools.accumulate(strides, operator.mul, initial=1))
        self.strides = [(s, s, 2**i) for i, s in enumerate(along)]  # voxel sizes of each level
        self.levels = nn.ModuleList()
        channels = 4
        for i, width in enumerate(widths):
            first: SubmanifoldConv3d | SparseConv3d
            if i == 0:
                first = SubmanifoldConv3d(channels, width, "level 0")
            else:
                first = _halving(channels, width, f"to level {i}", strides[i - 1])
            more = 1 if i == 0 else 2
            same = (SubmanifoldConv3d(width, width, f"level {i}") for _ in range(more))
            self.levels.append(nn.Sequential(*(SparseBlock(c, width) for c in (first, *same))))
            channels = width
        self.flat = SparseBlock(_halving(channels, canvas_width, "canvas", 1), canvas_width)
        depth = self.shape[0]
        for _ in range(len(widths)):
            depth = (depth + 1) // 2
        self.channels = canvas_width * depth
        self.grid = rows // along[-1], columns // along[-1]  # rows and columns of the canvas

    def forward(self, batch: Batch, view: CanvasPart | None = None) -> tuple[list[Clouds], Tensor]:
        """Returns the voxels of each level and the canvas.

        view: the part of the area to which the batch was cropped (windows.py).
        """
        x, levels = self.voxels(batch, view), []
        for level, stride in zip(self.levels, self.strides, strict=True):
            x = level(x)
            levels.append(self.middles(x, stride))
        return levels, self.flat(x).to_dense()

    def voxels(self, batch: Batch, view: CanvasPart | None = None) -> SparseTensor:
        """Returns the mean x y z intensity of the points in each voxel, with x y z scaled to ±1."""
        depth, rows, columns = self.shape
        if view is not None:
            rows, columns = view.sides
        low = constant(self.area.low, batch.points)
        extent = constant(self.area.size, batch.points)
        away = batch.points[:, :3] - low
        cell = (away / constant(self.size, batch.points)).long()  # cells x y z (n, 3)
        cell = torch.minimum(cell, constant([columns, rows, depth], cell) - 1)
        key = ((batch.frame * depth + cell[:, 2]) * rows + cell[:, 1]) * columns + cell[:, 0]
        keys, member = torch.unique(key, return_inverse=True)
        if view is not None and view.first is not None:
            moved = functional.pad(view.first.flip(1), (0, 1)) * constant(self.size, away)
            away = away + moved[batch.frame]
        inputs = torch.cat([2 * away / extent - 1, batch.points[:, 3:]], dim=1)  # inputs (n, 4)
        count = torch.bincount(member, minlength=len(keys)).clamp(min=1).to(inputs.dtype)
        mean = inputs.new_zeros(len(keys), 4).index_add(0, member, inputs) / count[:, None]
        above, x = keys // columns, keys % columns
        above, y = above // rows, above % rows
        coordinates = torch.stack([above // depth, above % depth, y, x], dim=1)
        return SparseTensor(mean, coordinates, (depth, rows, columns), batch.size)

    def middles(self, x: SparseTensor, stride: tuple[int, int, int]) -> Clouds:
        """Returns the voxels as points at their centres.

        stride: size of a voxel of this level along x, y, z, in voxels of the finest level.
        """
        # Features may have 16 bits, but positions always have 32.
        low = constant(self.area.low, x.features, torch.float32)
        size = constant(self.size, x.features, torch.float32)
        cells = (x.coordinates[:, 1:].flip(1) + 0.5) * constant(stride, size)
        frame = torch.arange(x.batch_size, device=low.device)
        counts = (x.coordinates[:, :1] == frame).sum(dim=0)
        return Clouds(low + cells * size, x.features, counts)


def _halving(channels: int, width: int, key: str, stride: int) -> SparseConv3d:
    """Returns a convolution with stride 2 along z, and `stride` along x and y.

    If `stride` is 1, the kernel has size 1 along x and y, so that no voxels are added in these
    directions.
    """
    side = 3 if stride > 1 else 1
    return SparseConv3d(
        channels,
        width,
        key,
        kernel=(3, side, side),
        stride=(2, stride, stride),
        padding=(1, side // 2, side // 2),
    )
