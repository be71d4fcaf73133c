"""The centre head: a heat map of the centres of each class, and a box at each peak.

The head follows the first stage of CenterPoint, Yin et al., CVPR 2021. Deviations from the paper:

- the heat of a vehicle is not a circular Gaussian, but a Gaussian with the length, width and
  heading of the vehicle
- after a shared layer, the heat and the box have one layer each; in the paper they have two layers
  each
- the loss of the box has the weight 0.5; the published weight is 0.25 or 2, depending on the data
  set
"""

import math
from collections.abc import Sequence

import torch
from torch import Tensor, nn
from torch.nn import functional

from pyinfra.core.vocabulary import VEHICLES, ObjectClass
from pyinfra.dataset.regions import Region
from pyinfra.models.detectors.anchors import in_half_turn, is_backwards
from pyinfra.models.detectors.bev import conv
from pyinfra.models.detectors.classes import ALONG_ROADS
from pyinfra.models.detectors.detection_area import Site
from pyinfra.models.detectors.distributed import of_all
from pyinfra.models.detectors.head_settings import BOX, PEAKS, ROAD_WEIGHT
from pyinfra.models.detectors.losses import heat_map_focal, start_rare
from pyinfra.models.detectors.network import Losses
from pyinfra.models.ops.constants import constant, numbers, owners

BOX_WEIGHT, DIRECTION_WEIGHT = 0.5, 0.2
LEAST_CELLS = 0.6  # minimum standard deviation of a Gaussian of the heat map, in cells


class CentreHead(nn.Module):
    """Predicts the heat of each class and a box in each cell of a canvas (B, C, H, W), row = y.

    All classes share the box of a cell.
    """

    def __init__(
        self,
        channels: int,
        width: int,
        site: Site,
        cell_m: float,
        classes: tuple[ObjectClass, ...] = VEHICLES,
    ) -> None:
        super().__init__()
        self.site, self.cell_m, self.classes = site, cell_m, classes
        self.shared = conv(channels, width)
        self.heat: nn.Module = start_rare(nn.Conv2d(width, len(classes), 3, padding=1))
        self.box: nn.Module = nn.Conv2d(width, BOX, 3, padding=1)

    def forward(self, x: Tensor) -> tuple[Tensor, Tensor]:
        """Returns the heatmap as logits (B, classes, H, W), and the boxes (B, H, W, 8).

        A subclass may append numbers to the 8 numbers of a box.
        """
        x = self.shared(x)
        return self.heat(x).float(), self.box(x).permute(0, 2, 3, 1).float()

    def losses(
        self,
        x: Tensor,
        boxes: tuple[Tensor, ...],
        classes: tuple[Tensor, ...] = (),
        balance: float = 0.0,
    ) -> Losses:
        """Returns the losses of a canvas.

        boxes: (k, 7) for each frame. classes: class numbers (k,) of these boxes. balance: a frame
        with n boxes has the weight n ** -balance. With balance 0 all boxes have the same weight.
        With balance 1 all frames have the same weight.
        """
        logits, residuals = self(x)
        sizes = [len(b) for b in boxes]
        counts = numbers(sizes, x.device)
        weights = counts.clamp(min=1).float() ** -balance
        count = of_all((weights * counts).sum())
        heat = {
            "heat" if len(self.classes) == 1 else f"heat_{name}": self.heat_loss(
                logits[:, i], self._of_class(i, boxes, classes), weights
            )
            for i, name in enumerate(self.classes)
        }
        frame = owners(sizes, x.device)
        every = torch.cat(boxes)
        row, column = self.cells_of(every, logits.shape[2:])
        at = residuals[frame, row, column]  # residuals (k, 8)
        parts = self.box_losses(at, every, row, column, weights[frame])
        return {name: part / count for name, part in (heat | parts).items()}

    def _of_class(
        self, number: int, boxes: Sequence[Tensor], classes: Sequence[Tensor]
    ) -> Sequence[Tensor]:
        """Returns the boxes of a class in each frame. classes: class numbers of the boxes."""
        if len(self.classes) == 1:
            return boxes
        return [b[c == number] for b, c in zip(boxes, classes, strict=True)]

    def heat_loss(self, logits: Tensor, boxes: Sequence[Tensor], weights: Tensor) -> Tensor:
        """Returns the loss of one class's heat: the sum over frames, weighted by `weights` (B,).

        logits: (B, H, W). boxes: (k, 7) boxes of the class in each frame.
        """
        heat = torch.stack([self.heat_of(b, logits.shape[1:]) for b in boxes])
        return (weights * heat_map_focal(logits, heat)).sum()

    def box_losses(
        self, at: Tensor, boxes: Tensor, row: Tensor, column: Tensor, weights: Tensor
    ) -> Losses:
        """Returns the losses, summed over boxes (k, 7) with `weights` (k,).

        at: predictions (k, 8) in the cells `row`, `column` of the boxes' centres.
        """
        box = (at[:, :BOX] - self.encode(boxes, row, column)).abs().sum(dim=1)
        return {"box": BOX_WEIGHT * (weights * box).sum()}

    def cells_of(self, boxes: Tensor, shape: Sequence[int]) -> tuple[Tensor, Tensor]:
        """Returns the cells of the boxes' centres: row and column, (k,) each.

        Rounding may move a centre beyond the last cell, so rows and columns are clipped.
        """
        low = constant(self.site.area.low[:2], boxes)
        cell = ((boxes[:, :2] - low) / self.cell_m).long()
        return cell[:, 1].clamp(max=shape[0] - 1), cell[:, 0].clamp(max=shape[1] - 1)

    def middle_of(self, row: Tensor, column: Tensor) -> Tensor:
        """Returns x, y of the centres of cells in metres: (k, 2)."""
        cell = torch.stack([column, row], dim=1)
        low = constant(self.site.area.low[:2], row, torch.float32)
        return low + (cell + 0.5) * self.cell_m

    def encode(self, boxes: Tensor, row: Tensor, column: Tensor) -> Tensor:
        """Returns the residuals of boxes (k, 7) relative to their cells: (k, 8)."""
        offset = (boxes[:, :2] - self.middle_of(row, column)) / self.cell_m
        z = boxes[:, 2:3] - self.site.floor_z
        heading = boxes[:, 6:]
        return torch.cat([offset, z, boxes[:, 3:6].log(), heading.sin(), heading.cos()], dim=1)

    def decode(
        self, residuals: Tensor, row: Tensor, column: Tensor, *, along_road: bool = True
    ) -> Tensor:
        """Returns the boxes (k, 7) of residuals (k, 8).

        along_road: whether objects of this class move along roads.
        """
        xy = self.middle_of(row, column) + residuals[:, :2] * self.cell_m
        z = residuals[:, 2:3] + self.site.floor_z
        sizes = residuals[:, 3:6].clamp(-5, 5).exp()
        heading = torch.atan2(residuals[:, 6:7], residuals[:, 7:8])
        return torch.cat([xy, z, sizes, heading], dim=1)

    def heat_of(self, boxes: Tensor, shape: tuple[int, ...]) -> Tensor:
        """Returns the target heat: (H, W) in [0, 1], 1 in the cell of each box's centre."""
        heat = boxes.new_zeros(tuple(shape))
        if len(boxes) == 0:
            return heat
        row, column = self.cells_of(boxes, shape)
        y = torch.arange(shape[0], device=boxes.device) - row[:, None]  # offsets (k, H) in cells
        x = torch.arange(shape[1], device=boxes.device) - column[:, None]  # offsets (k, W) in cells
        cos, sin = boxes[:, 6].cos()[:, None, None], boxes[:, 6].sin()[:, None, None]
        dx, dy = x[:, None, :], y[:, :, None]
        ahead, left = cos * dx + sin * dy, cos * dy - sin * dx
        sigma = (boxes[:, 3:5] / (6 * self.cell_m)).clamp(min=LEAST_CELLS)[:, :, None, None]
        each = torch.exp(-((ahead / sigma[:, 0]) ** 2 + (left / sigma[:, 1]) ** 2) / 2)
        return each.amax(dim=0)

    def candidates(self, x: Tensor) -> list[tuple[Tensor, ...]]:
        """Returns the boxes at the peaks of each frame, as `Network.candidates` does."""
        logits, boxes = self(x)
        heat = torch.sigmoid(logits)
        peak = functional.max_pool2d(heat, 3, 1, 1) == heat
        score = heat * peak
        parts: list[tuple[Tensor, ...]] = []
        for i in range(len(x)):
            of_classes = [
                self.peaks(score[i, number], boxes[i], along_road=name in ALONG_ROADS)
                for number, name in enumerate(self.classes)
            ]
            parts.append(_numbered(of_classes) if len(of_classes) > 1 else of_classes[0])
        return parts

    def peaks(self, score: Tensor, boxes: Tensor, *, along_road: bool) -> tuple[Tensor, Tensor]:
        """Returns boxes (k, 7) and scores (k,) at the highest cells of one class (H, W)."""
        best = score.flatten().topk(min(PEAKS, score.numel()))
        row, column = best.indices // score.shape[1], best.indices % score.shape[1]
        at = boxes[row, column]
        return self.decode(at, row, column, along_road=along_road), self.score(best.values, at)

    def score(self, heat: Tensor, at: Tensor) -> Tensor:
        """Returns the scores (k,) of peaks. heat: (k,). at: predictions at the peaks, (k, 8)."""
        return heat


def _numbered(of_classes: Sequence[tuple[Tensor, Tensor]]) -> tuple[Tensor, Tensor, Tensor]:
    """Concatenates the boxes and scores of all classes; returns boxes, scores, class numbers."""
    boxes, scores = (torch.cat(parts) for parts in zip(*of_classes, strict=True))
    numbers = [
        torch.full_like(of_class, i, dtype=torch.int64)
        for i, (_, of_class) in enumerate(of_classes)
    ]
    return boxes, scores, torch.cat(numbers)


class AxisHead(CentreHead):
    """A head that predicts the axis of a box and, separately, which end is the front.

    The axis is the sine and cosine of twice the heading. If traffic can come from any direction, a
    network often cannot distinguish front and rear. The mean of two opposite headings is
    meaningless, but their axis is the same. If a vehicle has few points, the predicted axis vector
    is shorter than 1. If the roads are known, the axis of the road is added to the predicted axis.
    The shorter the predicted axis, the larger is the weight of the road's axis.
    """

    def __init__(
        self,
        channels: int,
        width: int,
        site: Site,
        cell_m: float,
        classes: tuple[ObjectClass, ...] = VEHICLES,
    ) -> None:
        super().__init__(channels, width, site, cell_m, classes)
        self.box = nn.Conv2d(width, BOX + 1, 3, padding=1)
        self.road_axes: Tensor | None
        self.register_buffer("road_axes", None, persistent=False)

    def know(self, region: Region, shape: tuple[int, int]) -> None:
        """Stores the axis of the region's road in each cell (H, W), or None without roads."""
        self.road_axes = None
        if region.axes is None:
            return
        cells = torch.meshgrid(*map(torch.arange, shape), indexing="ij")
        row, column = (numbers.flatten() for numbers in cells)
        axes = region.axes(self.middle_of(row, column).double().numpy())
        device = next(self.parameters()).device
        self.road_axes = torch.from_numpy(axes).float().reshape(*shape, 2).to(device)

    def box_losses(
        self, at: Tensor, boxes: Tensor, row: Tensor, column: Tensor, weights: Tensor
    ) -> Losses:
        backwards = is_backwards(boxes[:, 6]).to(at)
        direction = functional.binary_cross_entropy_with_logits(
            at[:, BOX], backwards, weights, reduction="sum"
        )
        losses = super().box_losses(at, boxes, row, column, weights)
        return {**losses, "direction": DIRECTION_WEIGHT * direction}

    def encode(self, boxes: Tensor, row: Tensor, column: Tensor) -> Tensor:
        twice = boxes.clone()
        twice[:, 6] *= 2
        return super().encode(twice, row, column)

    def decode(
        self, residuals: Tensor, row: Tensor, column: Tensor, *, along_road: bool = True
    ) -> Tensor:
        if along_road and self.road_axes is not None:
            predicted_axis = residuals[:, 6:8]
            lacking = (1 - predicted_axis.norm(dim=1, keepdim=True)).clamp(min=0)
            axis = predicted_axis + ROAD_WEIGHT * lacking * self.road_axes[row, column]
            residuals = torch.cat([residuals[:, :6], axis, residuals[:, 8:]], dim=1)
        boxes = super().decode(residuals, row, column)
        heading = in_half_turn(boxes[:, 6] / 2) + math.pi * (residuals[:, BOX] > 0)
        boxes[:, 6] = (heading + math.pi) % (2 * math.pi) - math.pi
        return boxes
