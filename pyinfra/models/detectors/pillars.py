"""Pillars: the points of a vertical column as one feature vector, and a picture of them.

PointPillars, Lang et al., CVPR 2019, section 2.1, with the dynamic voxels of MVF, Zhou et al.,
CoRL 2019: every point counts, so there is no cap on pillars nor on points in one.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

from pyinfra.models.detectors import distributed
from pyinfra.models.detectors.batch import Area, Batch, CanvasPart


class PillarEncoder(nn.Module):
    """Points (n, 4 or 5) -> canvas (B, width, H, W); row = y, column = x.

    Of each point: x y z, offset to the mean of its pillar (3), offset to the middle of the pillar
    (3), age, intensity; a linear layer, batch norm, ReLU, the maximum over the pillar. With more
    than one layer, each but the last is half as wide and hands on a point's features and the
    pillar's.

    intensity, age: whether it is looked at. place: whether x and y are; without them a vehicle
    looks the same wherever it stands.
    """

    def __init__(
        self,
        area: Area,
        pillar_m: float,
        width: int,
        *,
        layers: int = 1,
        intensity: bool = True,
        with_xy: bool = True,
        age: bool = False,
    ) -> None:
        super().__init__()
        self.area, self.pillar_m, self.width = area, pillar_m, width
        self.age = age
        self.first, self.last = (0 if with_xy else 2), 9 + age + intensity
        self.columns, self.rows = (round(area.size[axis] / pillar_m) for axis in (0, 1))
        inputs = [self.last - self.first, *[2 * (width // 2)] * (layers - 1)]
        self.before = nn.ModuleList(_layer(n, width // 2) for n in inputs[:-1])
        self.linear, self.norm = _layer(inputs[-1], width)

    def forward(self, batch: Batch, view: CanvasPart | None = None) -> Tensor:
        return self.canvas(*self.occupied(batch), batch.size, view)

    def occupied(self, batch: Batch) -> tuple[Tensor, Tensor]:
        """Of the p pillars with a point: features (p, width) and ascending number (p,)."""
        pillar, member = torch.unique(self.pillar_of(batch), return_inverse=True)
        # Nothing to see, or in training one point, which has no spread to normalise by. With
        # several processes the norm waits for all of them, and knows what to do.
        if len(batch.points) < (2 if self.training else 1) and distributed.count() == 1:
            return batch.points.new_zeros(0, self.width), pillar[:0]
        features = self.point_features(batch, pillar, member)  # (n, 7 to 11)
        for layer in self.before:
            activations = torch.relu(layer(features))  # (n, width / 2)
            features = torch.cat(
                [activations, _most(activations, member, len(pillar))[member]], dim=1
            )
        return self.pooled(features, member, len(pillar)), pillar

    def canvas(
        self, features: Tensor, pillar: Tensor, frames: int, view: CanvasPart | None = None
    ) -> Tensor:
        """(B, width, H, W): the features (p, width) in their places, 0 elsewhere.

        view: the part to fill, if not the whole area.
        """
        rows, columns = (self.rows, self.columns) if view is None else view.sides
        if view is not None and view.first is not None:
            seen = self.seen(pillar, view)
            features, (frame, row, column) = features[seen], self.cells_of(pillar[seen])
            row, column = row - view.first[frame, 0], column - view.first[frame, 1]
            pillar = (frame * rows + row) * columns + column
        canvas = features.new_zeros(frames * rows * columns, self.width)
        canvas = canvas.index_put((pillar,), features)
        # Channels last in memory.
        return canvas.view(frames, rows, columns, self.width).permute(0, 3, 1, 2)

    def seen(self, pillar: Tensor, view: CanvasPart) -> Tensor:
        """(p,) bool: which pillars by number are in the part of the canvas that is filled."""
        if view.first is None:
            return torch.ones_like(pillar, dtype=torch.bool)
        frame, row, column = self.cells_of(pillar)
        row, column = row - view.first[frame, 0], column - view.first[frame, 1]
        rows, columns = view.sides
        return (row >= 0) & (row < rows) & (column >= 0) & (column < columns)

    def cells_of(self, pillar: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Frame, row and column (p,) of pillars by number."""
        row = pillar // self.columns
        return row // self.rows, row % self.rows, pillar % self.columns

    def pillar_of(self, batch: Batch) -> Tensor:
        """(n,) number of each point's pillar on the canvas."""
        low = batch.points.new_tensor(self.area.low[:2])
        cell = ((batch.points[:, :2] - low) / self.pillar_m).long()
        column = cell[:, 0].clamp(max=self.columns - 1)
        row = cell[:, 1].clamp(max=self.rows - 1)
        return (batch.frame * self.rows + row) * self.columns + column

    def point_features(self, batch: Batch, pillar: Tensor, member: Tensor) -> Tensor:
        """(n, 7 to 11); pillar: (p,) numbers on the canvas, member: (n,) index into them."""
        xyz = batch.points[:, :3]
        count = xyz.new_zeros(len(pillar)).index_add(0, member, torch.ones_like(xyz[:, 0]))
        mean = xyz.new_zeros(len(pillar), 3).index_add(0, member, xyz) / count.clamp(min=1)[:, None]
        within = pillar % (self.rows * self.columns)
        middle = torch.stack(
            [
                self.area.low[0] + (within % self.columns + 0.5) * self.pillar_m,
                self.area.low[1] + (within // self.columns + 0.5) * self.pillar_m,
                xyz.new_full(within.shape, (self.area.low[2] + self.area.high[2]) / 2),
            ],
            dim=1,
        )
        coordinates = torch.stack([xyz, xyz - mean[member], xyz - middle[member]], dim=1).flatten(1)
        intensity, age = batch.points[:, 3:4], batch.points[:, 4:5]
        parts = [coordinates, age, intensity] if self.age else [coordinates, intensity]
        return torch.cat(parts, dim=1)[:, self.first : self.last]  # either end may be left out

    def pooled(self, features: Tensor, member: Tensor, pillars: int) -> Tensor:
        """(p, width): the largest of each feature over the points of a pillar."""
        return _most(torch.relu(self.norm(self.linear(features))), member, pillars)


def _layer(inputs: int, width: int) -> nn.Sequential:
    return nn.Sequential(nn.Linear(inputs, width, bias=False), nn.BatchNorm1d(width, eps=1e-3))


def _most(features: Tensor, member: Tensor, pillars: int) -> Tensor:
    """(p, C): the largest of each feature (n, C), 0 or more, over the points of a pillar."""
    index = member[:, None].expand_as(features)
    return features.new_zeros(pillars, features.shape[1]).scatter_reduce(0, index, features, "amax")
