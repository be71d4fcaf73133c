"""Pillars: the points of a vertical column as one feature vector, and a picture of them.

PointPillars, Lang et al., CVPR 2019, section 2.1, with the dynamic voxels of MVF, Zhou et al.,
CoRL 2019: every point counts, so there is no cap on pillars nor on points in one.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

from pyinfra.detectors.batch import Area, Batch


class PillarEncoder(nn.Module):
    """Points (n, 4) -> canvas (B, width, H, W); row = y, column = x.

    Of each point: x y z intensity, offset to the mean of its pillar (3), offset to the middle of
    the pillar (3); a linear layer, batch norm, ReLU, the maximum over the pillar.
    """

    FEATURES = 10

    def __init__(self, area: Area, pillar_m: float, width: int) -> None:
        super().__init__()
        self.area, self.pillar_m, self.width = area, pillar_m, width
        self.columns, self.rows = (round(area.size[axis] / pillar_m) for axis in (0, 1))
        self.linear = nn.Linear(self.FEATURES, width, bias=False)
        self.norm = nn.BatchNorm1d(width, eps=1e-3)

    def forward(self, batch: Batch) -> Tensor:
        cells = batch.size * self.rows * self.columns
        canvas = batch.points.new_zeros(cells, self.width)
        if len(batch.points) > 0:
            pillar, member = torch.unique(self.pillar_of(batch), return_inverse=True)
            features = self.point_features(batch, pillar, member)  # (n, 10)
            canvas = canvas.index_put((pillar,), self.pooled(features, member, len(pillar)))
        shape = (batch.size, self.rows, self.columns, self.width)
        return canvas.view(shape).permute(0, 3, 1, 2)  # channels last in memory

    def pillar_of(self, batch: Batch) -> Tensor:
        """(n,) number of each point's pillar on the canvas."""
        low = batch.points.new_tensor(self.area.low[:2])
        cell = ((batch.points[:, :2] - low) / self.pillar_m).long()
        column = cell[:, 0].clamp(max=self.columns - 1)
        row = cell[:, 1].clamp(max=self.rows - 1)
        return (batch.frame * self.rows + row) * self.columns + column

    def point_features(self, batch: Batch, pillar: Tensor, member: Tensor) -> Tensor:
        """(n, 10); pillar: (p,) numbers on the canvas, member: (n,) index into them."""
        xyz = batch.points[:, :3]
        count = torch.bincount(member, minlength=len(pillar)).clamp(min=1).to(xyz.dtype)
        mean = xyz.new_zeros(len(pillar), 3).index_add(0, member, xyz) / count[:, None]
        within = pillar % (self.rows * self.columns)
        middle = torch.stack(
            [
                self.area.low[0] + (within % self.columns + 0.5) * self.pillar_m,
                self.area.low[1] + (within // self.columns + 0.5) * self.pillar_m,
                torch.full_like(within, 0.0, dtype=xyz.dtype)
                + (self.area.low[2] + self.area.high[2]) / 2,
            ],
            dim=1,
        )
        place = torch.stack([xyz, xyz - mean[member], xyz - middle[member]], dim=1).flatten(1)
        return torch.cat([place, batch.points[:, 3:]], dim=1)

    def pooled(self, features: Tensor, member: Tensor, pillars: int) -> Tensor:
        """(p, width): the largest of each feature over the points of a pillar."""
        found = torch.relu(self.norm(self.linear(features)))
        index = member[:, None].expand_as(found)
        return found.new_zeros(pillars, self.width).scatter_reduce(0, index, found, "amax")
