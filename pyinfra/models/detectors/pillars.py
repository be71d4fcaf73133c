"""Pillars: one feature vector for the points of each vertical column, arranged as a canvas.

The module follows section 2.1 of PointPillars, Lang et al., CVPR 2019, with the dynamic voxels of
MVF, Zhou et al., CoRL 2019. All points are used. Neither the number of pillars nor the number of
points in a pillar is limited.
"""

import torch
from torch import Tensor, nn

from pyinfra.models.detectors import distributed
from pyinfra.models.detectors.batch import Batch, CanvasPart
from pyinfra.models.detectors.detection_area import Area
from pyinfra.models.ops.constants import constant


class PillarEncoder(nn.Module):
    """Encodes points (n, 4 or 5) as a canvas (B, C, H, W) with C channels; row = y, column = x.

    The inputs of each point are x y z, offset to the mean of its pillar (3), offset to the middle
    of the pillar (3), age, intensity. The inputs pass a linear layer, batch norm and ReLU, followed
    by the maximum over the pillar. If there are several layers, each layer except the last is half
    as wide. Each of these layers returns the features of a point together with the features of the
    point's pillar.

    intensity, age, with_xy: whether the intensity, the age, and x and y are inputs. If x and y are
    not used, the features of a vehicle do not depend on its position.
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
        """Returns features (p, C) and ascending numbers (p,) of the p pillars with points."""
        pillar, member = torch.unique(self.pillar_of(batch), return_inverse=True)
        # A batch norm is undefined without points, and in training also for a single point. With
        # several processes, the shared batch norm handles such batches, because it must run in all
        # processes.
        if len(batch.points) < (2 if self.training else 1) and distributed.count() == 1:
            return batch.points.new_zeros(0, self.width), pillar[:0]
        features = self.point_features(batch, pillar, member)  # features (n, 7 to 11)
        for layer in self.before:
            activations = torch.relu(layer(features))  # activations (n, width / 2)
            features = torch.cat(
                [activations, _most(activations, member, len(pillar))[member]], dim=1
            )
        return self.pooled(features, member, len(pillar)), pillar

    def canvas(
        self, features: Tensor, pillar: Tensor, frames: int, view: CanvasPart | None = None
    ) -> Tensor:
        """Returns the canvas (B, C, H, W) with the features (p, C) of the pillars.

        Cells without a pillar are 0. view: the part to fill; by default the whole area.
        """
        rows, columns = (self.rows, self.columns) if view is None else view.sides
        if view is not None and view.first is not None:
            seen = self.seen(pillar, view)
            features, (frame, row, column) = features[seen], self.cells_of(pillar[seen])
            row, column = row - view.first[frame, 0], column - view.first[frame, 1]
            pillar = (frame * rows + row) * columns + column
        canvas = features.new_zeros(frames * rows * columns, self.width)
        canvas.index_put_((pillar,), features)
        # In memory, the channels of a cell are adjacent (channels last).
        return canvas.view(frames, rows, columns, self.width).permute(0, 3, 1, 2)

    def seen(self, pillar: Tensor, view: CanvasPart) -> Tensor:
        """Returns which pillars are in the part `view` of the canvas: (p,) bool.

        pillar: (p,) numbers of pillars on the canvas.
        """
        if view.first is None:
            return torch.ones_like(pillar, dtype=torch.bool)
        frame, row, column = self.cells_of(pillar)
        row, column = row - view.first[frame, 0], column - view.first[frame, 1]
        rows, columns = view.sides
        return (row >= 0) & (row < rows) & (column >= 0) & (column < columns)

    def cells_of(self, pillar: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Returns frame, row and column of pillars, (p,) each. pillar: (p,) numbers of pillars."""
        row = pillar // self.columns
        return row // self.rows, row % self.rows, pillar % self.columns

    def pillar_of(self, batch: Batch) -> Tensor:
        """Returns the number of each point's pillar on the canvas: (n,)."""
        low = constant(self.area.low[:2], batch.points)
        cell = ((batch.points[:, :2] - low) / self.pillar_m).long()
        column = cell[:, 0].clamp(max=self.columns - 1)
        row = cell[:, 1].clamp(max=self.rows - 1)
        return (batch.frame * self.rows + row) * self.columns + column

    def point_features(self, batch: Batch, pillar: Tensor, member: Tensor) -> Tensor:
        """Returns the inputs of each point: (n, 7 to 11).

        pillar: (p,) numbers of pillars on the canvas. member: (n,) index of each point's pillar.
        """
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
        # x, y and the intensity are at the ends, so that a slice removes unused columns.
        return torch.cat(parts, dim=1)[:, self.first : self.last]

    def pooled(self, features: Tensor, member: Tensor, pillars: int) -> Tensor:
        """Applies the last layer and returns the maximum over each pillar's points: (p, C)."""
        return _most(torch.relu(self.norm(self.linear(features))), member, pillars)


def _layer(inputs: int, width: int) -> nn.Sequential:
    return nn.Sequential(nn.Linear(inputs, width, bias=False), nn.BatchNorm1d(width, eps=1e-3))


def _most(features: Tensor, member: Tensor, pillars: int) -> Tensor:
    """Returns the maximum of each feature over the points of a pillar: (p, C).

    features: (n, C), not negative.
    """
    index = member[:, None].expand_as(features)
    return features.new_zeros(pillars, features.shape[1]).scatter_reduce(0, index, features, "amax")
