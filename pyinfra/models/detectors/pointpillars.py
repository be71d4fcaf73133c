"""PointPillars: Fast Encoders for Object Detection from Point Clouds, Lang et al., CVPR 2019.

Deviations from the paper:

- dynamic pillars, without a limit on the number of pillars or of points in a pillar (pillars.py)
- anchors of two sizes and one class (anchors.py)
- the area is chosen to include the vehicles of the training frames; the anchors stand on the road
"""

import itertools
from dataclasses import dataclass, field

import torch
from torch import Tensor, nn
from torch.nn import functional

from pyinfra.core.config import ruled
from pyinfra.models.detectors.anchors import AnchorConfig, Anchors, decode, encode, is_backwards
from pyinfra.models.detectors.batch import Batch
from pyinfra.models.detectors.bev import BevNetwork
from pyinfra.models.detectors.bev_config import BevConfig, multiple
from pyinfra.models.detectors.detection_area import Site
from pyinfra.models.detectors.losses import focal, smooth_l1, start_rare
from pyinfra.models.detectors.network import Losses, Network
from pyinfra.models.detectors.pillars import PillarEncoder
from pyinfra.models.detectors.windows import view_of
from pyinfra.models.ops.constants import numbers

BOX_WEIGHT, DIRECTION_WEIGHT = 2.0, 0.2


@dataclass(frozen=True)
class Config:
    """Sizes of the network; the defaults are the published sizes."""

    pillar_m: float = ruled(0.16, 0.05, 2)  # side of a pillar
    pillar_width: int = ruled(64, 1, 512)  # channels of a pillar
    intensity: bool = True  # whether intensity is an input; each LiDAR has its own scale
    place: bool = True  # whether x and y are inputs; networks for many sites do not use them
    age: bool = False  # whether the age of points in stacked frames is an input (--accumulate)
    bev: BevConfig = field(default_factory=BevConfig)
    anchors: AnchorConfig = field(default_factory=AnchorConfig)


class AnchorHead(nn.Module):
    """Predicts scores, residuals and directions of the anchors in each cell."""

    def __init__(self, channels: int, anchors: Anchors) -> None:
        super().__init__()
        self.anchors = anchors
        self.per_cell = anchors.config.per_cell
        self.score = start_rare(nn.Conv2d(channels, self.per_cell, 1))
        self.box = nn.Conv2d(channels, self.per_cell * 7, 1)
        self.direction = nn.Conv2d(channels, self.per_cell * 2, 1)
        nn.init.normal_(self.box.weight, std=0.001)

    def forward(self, x: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Maps (B, C, H, W) to (B, n), (B, n, 7) and (B, n, 2), where n = H * W * per_cell."""

        # One matrix product is faster than three convolutions.
        layers = (self.score, self.box, self.direction)
        weight = torch.cat([layer.weight for layer in layers]).flatten(1)
        bias = torch.cat([layer.get_parameter("bias") for layer in layers])
        outputs = functional.linear(x.permute(0, 2, 3, 1), weight, bias).float()
        parts = torch.split(outputs, [layer.out_channels for layer in layers], dim=-1)
        score, box, direction = (part.flatten(1) for part in parts)
        frames = len(x)
        return score, box.view(frames, -1, 7), direction.view(frames, -1, 2)

    def losses(self, x: Tensor, boxes: tuple[Tensor, ...]) -> Losses:
        """Returns the losses of a canvas (B, C, H, W), which may be smaller than the area.

        A smaller canvas has the windows of the frames, shifted to the first cell. boxes: (k, 7) of
        each frame, shifted in the same way.
        """
        scores, residuals, directions = self(x)  # shapes (B, n), (B, n, 7), (B, n, 2)
        grid = (x.shape[2], x.shape[3])
        anchors = self.anchors.boxes[: grid[0], : grid[1]].flatten(0, 2)  # anchor boxes (n, 7)
        targets = [self.anchors.targets(b, grid) for b in boxes]
        positive = torch.stack([t.positive.flatten() for t in targets])  # mask (B, n) of positives
        negative = torch.stack([t.negative.flatten() for t in targets])
        # The loss of a frame is divided by its number of positive anchors.
        share = 1 / (len(boxes) * positive.sum(dim=1).clamp(min=1))  # weights (B,)
        every = focal(scores, positive.to(scores.dtype))
        score = (torch.where(positive | negative, every, 0).sum(dim=1) * share).sum()
        frame, anchor = positive.nonzero().unbind(1)  # rows (p,) of all p positive anchors
        first = numbers([0, *itertools.accumulate(map(len, boxes))][:-1], x.device)
        box_of = torch.stack([t.box.flatten() for t in targets]) + first[:, None]
        # boxes (p, 7), weights (p,)
        assigned, weight = torch.cat(boxes)[box_of[frame, anchor]], share[frame]
        wanted = encode(assigned, anchors[anchor])
        box = (_box_loss(residuals[frame, anchor], wanted).sum(dim=1) * weight).sum()
        backwards = is_backwards(assigned[:, 6]).long()
        direction = functional.cross_entropy(directions[frame, anchor], backwards, reduction="none")
        direction = (direction * weight).sum()
        return {
            "score": score,
            "box": BOX_WEIGHT * box,
            "direction": DIRECTION_WEIGHT * direction,
        }

    def candidates(self, x: Tensor) -> list[tuple[Tensor, Tensor]]:
        anchors = self.anchors.boxes[: x.shape[2], : x.shape[3]].flatten(0, 2)
        candidates = []
        for scores, residuals, directions in zip(*self(x), strict=True):
            best = torch.sigmoid(scores).topk(min(self.anchors.config.candidates, len(scores)))
            rows = best.indices
            backwards = directions[rows].argmax(dim=1) == 1
            candidates.append((decode(residuals[rows], anchors[rows], backwards), best.values))
        return candidates


def _box_loss(predicted: Tensor, wanted: Tensor) -> Tensor:
    """Returns the smooth L1 loss of residuals, (n, 7); headings use the sine of the difference."""
    a, b = predicted[:, 6:], wanted[:, 6:]
    left = torch.cat([predicted[:, :6], a.sin() * b.cos()], dim=1)
    right = torch.cat([wanted[:, :6], a.cos() * b.sin()], dim=1)
    return smooth_l1(left, right)


class PointPillars(Network):
    """The network PointPillars: pillars, a two-dimensional network and an anchor head."""

    learns_in_windows = True

    def __init__(self, config: Config, site: Site) -> None:
        area = site.area.grown(multiple(config.bev, config.pillar_m))
        super().__init__(Site(area, site.floor_z))
        self.columns = 5 if config.age else 4
        looks_at = {"intensity": config.intensity, "with_xy": config.place, "age": config.age}
        self.encoder = PillarEncoder(area, config.pillar_m, config.pillar_width, **looks_at)
        self.bev = BevNetwork(config.bev, config.pillar_width)
        stride = config.bev.strides[0]
        grid = (self.encoder.rows // stride, self.encoder.columns // stride)
        anchors = Anchors(config.anchors, self.site, stride * config.pillar_m, grid)
        self.head = AnchorHead(self.bev.channels, anchors)

    def losses(self, batch: Batch) -> Losses:
        view = view_of(batch, self.site.area, self.encoder.pillar_m, self.bev.step)
        return self.head.losses(self.bev(self.encoder(batch, view)), view.boxes)

    def candidates(self, batch: Batch) -> list[tuple[Tensor, Tensor]]:
        return self.head.candidates(self.bev(self.encoder(batch)))
