"""Anchors on a bird's-eye grid: assignment to boxes, and residuals of boxes.

The module follows SECOND, Yan et al., Sensors 2018, as implemented in OpenPCDet. An anchor is
assigned to a box by the IoU of their footprints, after both footprints are turned to the nearest
axis. Residuals are relative to the anchor's diagonal, height and sizes. Headings are predicted
modulo half a turn; a separate classification predicts which half of the turn a heading is in. There
are two sizes of anchors instead of one, because the IoU of a bus with an anchor for cars is too
low.
"""

import math
from dataclasses import dataclass

import torch
from torch import Tensor, nn

from pyinfra.core.boxes import CAR_M, LONG_M
from pyinfra.core.config import ruled
from pyinfra.models.detectors.detection_area import Site
from pyinfra.models.detectors.head_settings import PART

HEADINGS = (0.0, math.pi / 2)


@dataclass(frozen=True)
class AnchorConfig:
    """Anchor boxes; sizes are length, width, height in metres."""

    car_m: tuple[float, float, float] = ruled(CAR_M, 0.1, 30)  # size for cars
    long_m: tuple[float, float, float] = ruled(LONG_M, 0.1, 30)  # size for trucks and buses
    matched: float = ruled(0.6, 0, 1)  # minimum IoU of an anchor that is assigned to a box
    unmatched: float = ruled(0.45, 0, 1)  # anchors with a lower IoU are background
    candidates: int = ruled(4096, 1, 4096)  # maximum number of anchors in non-maximum suppression

    @property
    def sizes(self) -> tuple[tuple[float, float, float], ...]:
        return self.car_m, self.long_m

    @property
    def per_cell(self) -> int:
        return len(self.sizes) * len(HEADINGS)


@dataclass(frozen=True, eq=False)
class Targets:
    """The assignment of anchors to the boxes of one frame."""

    positive: Tensor  # (...) bool: whether an anchor is assigned to a box
    negative: Tensor  # (...) bool: background anchors; anchors of neither kind have no loss
    box: Tensor  # (...) int64: row of the assigned box


class Anchors(nn.Module):
    """Anchors (rows, columns, per_cell, 7) that stand on the road (z = `Site.floor_z`)."""

    x: Tensor  # (columns,) x of the cell centres
    y: Tensor  # (rows,) y of the cell centres
    boxes: Tensor  # (rows, columns, per_cell, 7) anchor boxes

    def __init__(self, config: AnchorConfig, site: Site, cell_m: float, grid: tuple[int, int]):
        super().__init__()
        self.config = config
        rows, columns = grid
        x = site.area.low[0] + (torch.arange(columns) + 0.5) * cell_m
        y = site.area.low[1] + (torch.arange(rows) + 0.5) * cell_m
        # The buffers move to the network's device. They follow from the settings and are not saved.
        self.register_buffer("x", x, persistent=False)
        self.register_buffer("y", y, persistent=False)
        kinds = [
            torch.tensor([site.floor_z + size[2] / 2, *size, heading])
            for size in config.sizes
            for heading in HEADINGS
        ]
        # x y of cells (rows, columns, 2)
        xy = torch.stack(torch.meshgrid(y, x, indexing="ij")[::-1], dim=-1)
        xy = xy[:, :, None].expand(-1, -1, len(kinds), -1)
        boxes = torch.cat([xy, torch.stack(kinds).expand(rows, columns, -1, -1)], dim=-1)
        self.register_buffer("boxes", boxes, persistent=False)

    def targets(self, boxes: Tensor, grid: tuple[int, int] | None = None) -> Targets:
        """Assigns anchors to boxes (k, 7); returns tensors (rows, columns, per_cell).

        grid: how many rows and how many columns are used, counted from the first; by default all.
        """
        rows, columns = grid or self.boxes.shape[:2]
        shape = (rows, columns, self.config.per_cell)
        if len(boxes) == 0:
            no_anchor = torch.zeros(shape, dtype=torch.bool, device=boxes.device)
            return Targets(no_anchor, ~no_anchor, torch.zeros_like(no_anchor, dtype=torch.int64))
        overlap = self.axis_aligned_iou(boxes, grid)  # IoU (rows, columns, per_cell, k)
        best, box = overlap.max(dim=-1)
        positive = best >= self.config.matched
        # A box without a matched anchor is assigned to the anchors that overlap it most.
        most = overlap.flatten(0, 2).amax(dim=0)
        forced = (overlap == most) & (most > 0)
        is_forced, forced_box = forced.max(dim=-1)
        box = torch.where(is_forced, forced_box, box)
        positive = positive | is_forced
        return Targets(positive, ~positive & (best < self.config.unmatched), box)

    def axis_aligned_iou(self, boxes: Tensor, grid: tuple[int, int] | None = None) -> Tensor:
        """Returns the IoU of anchors and boxes: (rows, columns, per_cell, k).

        Before the overlap is computed, footprints are turned to the nearest axis.
        """
        rows, columns = grid or self.boxes.shape[:2]
        across = boxes[:, 6].sin().abs() > math.sqrt(0.5)
        gx = torch.where(across, boxes[:, 4], boxes[:, 3])
        gy = torch.where(across, boxes[:, 3], boxes[:, 4])
        overlaps = []
        for size in self.config.sizes:
            for lx, ly in ((size[0], size[1]), (size[1], size[0])):
                ox = _shared(self.x[:columns], lx, boxes[:, 0], gx)  # overlaps along x (columns, k)
                oy = _shared(self.y[:rows], ly, boxes[:, 1], gy)  # overlaps along y (rows, k)
                shared = oy[:, None] * ox[None]
                overlaps.append(shared / (lx * ly + gx * gy - shared))
        return torch.stack(overlaps, dim=2)


def _shared(centre: Tensor, length: float, other: Tensor, other_length: Tensor) -> Tensor:
    """Returns the length of the overlap of two intervals, for all pairs of intervals."""
    low = torch.maximum(centre[:, None] - length / 2, other - other_length / 2)
    high = torch.minimum(centre[:, None] + length / 2, other + other_length / 2)
    return (high - low).clamp(min=0)


def encode(boxes: Tensor, anchors: Tensor) -> Tensor:
    """Returns the residuals (n, 7) of boxes (n, 7) relative to anchors (n, 7)."""
    diagonal = anchors[:, 3:5].norm(dim=1, keepdim=True)
    xy = (boxes[:, :2] - anchors[:, :2]) / diagonal
    z = (boxes[:, 2:3] - anchors[:, 2:3]) / anchors[:, 5:6]
    sizes = torch.log(boxes[:, 3:6] / anchors[:, 3:6])
    return torch.cat([xy, z, sizes, boxes[:, 6:] - anchors[:, 6:]], dim=1)


def decode(residuals: Tensor, anchors: Tensor, backwards: Tensor) -> Tensor:
    """Returns the boxes (n, 7) of residuals (n, 7), the inverse of encode.

    backwards: (n,) bool, whether the heading is in the second half of the turn.
    """
    diagonal = anchors[:, 3:5].norm(dim=1, keepdim=True)
    xy = residuals[:, :2] * diagonal + anchors[:, :2]
    z = residuals[:, 2:3] * anchors[:, 5:6] + anchors[:, 2:3]
    sizes = torch.exp(residuals[:, 3:6].clamp(-5, 5)) * anchors[:, 3:6]
    heading = in_half_turn(residuals[:, 6] + anchors[:, 6]) + math.pi * backwards
    heading = (heading + math.pi) % (2 * math.pi) - math.pi
    return torch.cat([xy, z, sizes, heading[:, None]], dim=1)


def in_half_turn(heading: Tensor) -> Tensor:
    """Returns the headings modulo half a turn, in [PART, PART + pi)."""
    return (heading - PART) % math.pi + PART


def is_backwards(heading: Tensor) -> Tensor:
    """Returns whether headings are in the second half of the turn: (n,) bool."""
    return (heading - PART) % (2 * math.pi) >= math.pi
