"""PointRCNN: 3D Object Proposal Generation and Detection from Point Cloud, Shi et al., CVPR 2019.

Stage 1 classifies points as vehicle or other, and proposes a box at each vehicle point. Stage 2
transforms the points around a proposal into its frame, refines the proposal and scores it.

Deviations from the paper:

- as in OpenPCDet: boxes are residuals from the point or the proposal instead of bins; both stages
  are trained together; the second stage gets scores instead of a mask
- offsets are in metres; divided by a box's diagonal, an error of 0.5 m would hardly change the loss
- both stages have batch norm
- the features of a point are its intensity, its height above the road and its position in the area;
  the position is useful, because one or two points alone do not show which side of a vehicle they
  are on, and a roadside sensor measures vehicles from all sides
- points up to 5 cm outside a box belong to its vehicle
- training proposals are sampled without repetition, from the proposals and from slightly shifted
  labels
- see also pointnet.py

The random generators of GPU and CPU differ, so they sample different points and proposals.

`sampling: faithful` samples a fixed number of points of the whole frame with equal probability, as
in the paper. If most points are on the ground, distant vehicles lose their few points, and the
farthest point sampling of the set abstractions mostly selects points on the ground. OpenPCDet keeps
all points beyond 40 m, which is useful for its range of 70 m. At a roadside site most of the area
is beyond 40 m.

`sampling: remedied` is the same network, but selects its points differently. Points lower than
`clearance_m` above the road are left out, so the road must be level. The other points are sampled
evenly by area: one point is sampled from each square of `cell_m`, then a second, and so on.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import torch
from torch import Tensor, nn
from torch.nn import functional

from pyinfra.core.boxes import AROUND_M, CAR_M
from pyinfra.core.config import ruled
from pyinfra.models.detectors.batch import Batch
from pyinfra.models.detectors.detection_area import Site
from pyinfra.models.detectors.distributed import of_all
from pyinfra.models.detectors.losses import focal, smooth_l1
from pyinfra.models.detectors.network import Losses, Network
from pyinfra.models.detectors.pointnet import (
    Ball,
    Clouds,
    FeaturePropagation,
    SetAbstraction,
    WholeAbstraction,
    mlp,
)
from pyinfra.models.ops.boxes import best_overlap, nms
from pyinfra.models.ops.clouds import farthest_of_clouds, sizes_of
from pyinfra.models.ops.constants import constant
from pyinfra.models.ops.points import box_of_points, points_in_boxes, turned

POINT_FEATURES = 4  # input features of a point: intensity, height, x, y
RADII_M = ((0.1, 0.5), (0.5, 1.0), (1.0, 2.0), (2.0, 4.0))
NEIGHBOURS = (16, 32)
DOWN = (
    ((16, 16, 32), (32, 32, 64)),
    ((64, 64, 128), (64, 96, 128)),
    ((128, 196, 256), (128, 196, 256)),
    ((256, 256, 512), (256, 384, 512)),
)
UP = ((128, 128), (256, 256), (512, 512), (512, 512))
HEAD = (256, 256)

LOCAL_FEATURES = 6  # features of a point: x y z in the proposal's frame, intensity, score, distance
LOCAL = (128, 128)
MERGED = (128,)
ROI_LEVELS = ((128, Ball(0.2, 16, (128, 128, 128))), (32, Ball(0.4, 16, (128, 128, 256))))
ROI_WHOLE = (256, 256, 512)

BEFORE_NMS = 9000  # maximum number of boxes that enter the non-maximum suppression
DOUBT_M = 0.2  # points from AROUND_M to this distance outside a box are left out of the loss
CONTEXT_M = 1.0  # a proposal grows by this in all dimensions when its points are collected
DEPTH_M = 100.0

# Thresholds of the 3-D IoU of a proposal and a vehicle.
REFINED = 0.55  # minimum IoU of proposals whose refinement is trained
GOOD, BAD = 0.6, 0.45  # a proposal is a vehicle at an IoU of GOOD or more, and background below BAD
HARD, HARD_SHARE = 0.05, 0.8  # minimum IoU of hard background, and its share of the background


@dataclass(frozen=True)
class Config:
    """Sizes of the network; the defaults are the published sizes, except for `size_m`."""

    # with `faithful`, all points are equally likely; with `remedied`, points are sampled evenly by
    # area, without the ground
    sampling: Literal["faithful", "remedied"] = "faithful"
    points: int = ruled(16384, 64, 1_000_000)  # points sampled from a frame
    clearance_m: float = ruled(0.2, 0, 5)  # with `remedied`, lower points count as ground
    cell_m: float = ruled(1.0, 0.1, 20)  # with `remedied`, side of a square of the sampling by area
    levels: tuple[int, int, int, int] = ruled((4096, 1024, 256, 64), 4, 65536)  # points per level
    width: float = ruled(1.0, 0.05, 4)  # factor by which the published layer widths are multiplied
    size_m: tuple[float, float, float] = ruled(CAR_M, 0.1, 30)  # size that residuals refer to
    # proposals whose footprints have a higher IoU with a better proposal are removed
    proposal_iou: float = ruled(0.85, 0.05, 1)
    proposals: int = ruled(512, 1, 4096)  # proposals of a training frame, to sample from
    rois: int = ruled(128, 2, 1024)  # sampled proposals of a training frame
    rois_detected: int = ruled(100, 1, 1024)  # proposals of a frame that are refined in detection
    roi_points: int = ruled(512, 16, 4096)  # maximum number of points used in a proposal


@dataclass(frozen=True, eq=False)
class Seen:
    """The output of the first stage for a batch."""

    clouds: Clouds  # points of the frames, with semantic features; `counts` are integers
    intensity: Tensor  # (n,) intensity of each point
    logits: Tensor  # (n,) logits that a point belongs to a vehicle
    residuals: Tensor  # (n, 8) residuals of the box at each point


@dataclass(frozen=True, eq=False)
class SampledRois:
    """The sampled training proposals of all frames."""

    rois: Tensor  # (r, 7) boxes of the proposals
    counts: list[int]  # number of proposals in each frame
    overlap: Tensor  # (r,) highest 3-D IoU with a vehicle
    boxes: Tensor  # (r, 7) box of the vehicle with the highest IoU; undefined if overlap is 0


class Backbone(nn.Module):
    """Computes semantic features of all points."""

    def __init__(self, config: Config) -> None:
        super().__init__()
        self.levels = config.levels
        channels = [POINT_FEATURES]
        self.down = nn.ModuleList()
        for radii, widths in zip(RADII_M, DOWN, strict=True):
            balls = [
                Ball(radius, most, scaled(layer_widths, config.width))
                for radius, most, layer_widths in zip(radii, NEIGHBOURS, widths, strict=True)
            ]
            self.down.append(SetAbstraction(channels[-1], balls))
            channels.append(sum(ball.widths[-1] for ball in balls))
        self.up = nn.ModuleList()
        coarse = channels[-1]
        for fine, up in zip(channels[-2::-1], UP[::-1], strict=True):
            self.up.append(FeaturePropagation(fine, coarse, scaled(up, config.width)))
            coarse = scaled(up, config.width)[-1]
        self.channels = coarse

    def forward(self, clouds: Clouds) -> Clouds:
        """Maps features (n, 4) to (n, channels)."""
        steps = [clouds]
        for most, layer in zip(self.levels, self.down, strict=True):
            rows, counts = farthest_of_clouds(steps[-1].xyz.detach(), steps[-1].counts, most)
            steps.append(layer(steps[-1], steps[-1].xyz[rows], counts))
        coarse = steps.pop()
        for layer in self.up:
            coarse = layer(steps.pop(), coarse)
        return coarse


class Refiner(nn.Module):
    """The second stage: confidence and box residuals of each proposal, from the points in it."""

    def __init__(self, config: Config, channels: int) -> None:
        super().__init__()
        self.most = config.roi_points
        local, merged = scaled(LOCAL, config.width), scaled(MERGED, config.width)
        self.local = mlp(LOCAL_FEATURES, local)
        self.merge = mlp(local[-1] + channels, merged)
        self.levels = tuple(most for most, _ in ROI_LEVELS)
        self.down = nn.ModuleList()
        width = merged[-1]
        for _, ball in ROI_LEVELS:
            ball = Ball(ball.radius_m, ball.most, scaled(ball.widths, config.width))
            self.down.append(SetAbstraction(width, [ball]))
            width = ball.widths[-1]
        self.whole = WholeAbstraction(width, scaled(ROI_WHOLE, config.width))
        width = scaled(ROI_WHOLE, config.width)[-1]
        self.confidence = head(width, 1, config.width)
        self.box = head(width, 7, config.width)

    def forward(
        self, seen: Seen, rois: Tensor, counts: Sequence[int]
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Returns logits (r,), residuals (r, 7) and the number of points (r,) of proposals.

        rois: (r, 7). counts: number of proposals in each frame.
        """
        rows, owners = pooled(seen.clouds, rois, counts, self.most)
        xyz = seen.clouds.xyz[rows]
        canonical = turned_into(xyz, rois[owners])
        score = torch.sigmoid(seen.logits[rows])
        distance = xyz.norm(dim=1) / DEPTH_M - 0.5
        more = torch.stack([seen.intensity[rows], score, distance], dim=1)
        local = self.local(torch.cat([canonical, more], dim=1))
        merged = self.merge(torch.cat([local, seen.clouds.features[rows]], dim=1))
        held = rois.new_zeros(len(rois), dtype=torch.int64)
        held = held.index_add(0, owners, torch.ones_like(owners))
        clouds = Clouds(canonical, merged, held)
        for most, layer in zip(self.levels, self.down, strict=True):
            centres, numbers = farthest_of_clouds(clouds.xyz.detach(), clouds.counts, most)
            clouds = layer(clouds, clouds.xyz[centres], numbers)
        whole = self.whole(clouds)
        return self.confidence(whole)[:, 0].float(), self.box(whole).float(), held


class PointRCNN(Network):
    """The network PointRCNN: features of points, proposals at points, and their refinement."""

    draws: Tensor

    def __init__(self, config: Config, site: Site) -> None:
        super().__init__(site)
        self.config = config
        self.backbone = Backbone(config)
        self.score = head(self.backbone.channels, 1, config.width)
        self.box = head(self.backbone.channels, 8, config.width)
        self.refiner = Refiner(config, self.backbone.channels)
        # Number of random samplings so far, which seeds the next sampling. The number is saved with
        # the weights, so that a resumed training gives the same result. `draw` is the same number
        # for the CPU, so that it need not be read from a GPU in each step.
        self.register_buffer("draws", torch.zeros((), dtype=torch.int64))
        self.draw = 0
        self.register_load_state_dict_post_hook(_read_draw)  # type: ignore[no-untyped-call]

    def losses(self, batch: Batch) -> Losses:
        seen = self.seen(batch)
        sampled = self.sampled(seen, batch.boxes)
        return self.point_losses(seen, batch.boxes) | self.roi_losses(seen, sampled)

    def candidates(self, batch: Batch) -> list[tuple[Tensor, Tensor]]:
        seen = self.seen(batch)
        rois = self.proposals(seen, self.config.rois_detected)
        counts = [len(r) for r in rois]
        all_rois = torch.cat(rois)
        logits, residuals, point_counts = self.refiner(detached(seen), all_rois, counts)
        # A proposal without points gets the score 0.
        scores = torch.sigmoid(logits) * (point_counts > 0)
        boxes = refined(residuals, all_rois)
        return list(
            zip(boxes.split_with_sizes(counts), scores.split_with_sizes(counts), strict=True)
        )

    def seen(self, batch: Batch) -> Seen:
        """Runs the first stage."""
        generator = self.generator()
        parts = [points[self.chosen(points, generator)] for points in batch.clouds()]
        points = torch.cat(parts)
        clouds = Clouds(points[:, :3].contiguous(), self.described(points), [len(p) for p in parts])
        clouds = self.backbone(clouds)
        logits, residuals = self.score(clouds.features)[:, 0], self.box(clouds.features)
        return Seen(clouds, points[:, 3], logits.float(), residuals.float())

    def generator(self) -> torch.Generator:
        """Returns a random generator on the device of the network.

        In detection its seed is 0. In training each call has a new seed.
        """
        generator = torch.Generator(self.draws.device)
        if self.training:
            self.draws += 1
            self.draw += 1
            return generator.manual_seed(self.draw)
        return generator.manual_seed(0)

    def chosen(self, points: Tensor, generator: torch.Generator) -> Tensor:
        """Returns the rows of a frame's points (n, 4) that are used, in random order."""
        if not self.training:
            generator.manual_seed(0)  # so that a frame's result does not depend on earlier frames
        rows = torch.randperm(len(points), generator=generator, device=generator.device)
        if self.config.sampling == "remedied":
            rows = rows[points[rows, 2] > self.site.floor_z + self.config.clearance_m]
            rows = rows[by_area(points[rows, :2], self.config.cell_m)]
        return rows[: self.config.points]

    def described(self, points: Tensor) -> Tensor:
        """Returns the input features (n, 4) of points (n, 4)."""
        area = self.site.area
        low, size = constant(area.low[:2], points), constant(area.size[:2], points)
        normalised_xy = (points[:, :2] - low) / size * 2 - 1
        height = points[:, 2:3] - self.site.floor_z
        return torch.cat([points[:, 3:], height, normalised_xy], dim=1)

    @torch.no_grad()
    def proposals(self, seen: Seen, most: int) -> list[Tensor]:
        """Returns at most `most` proposals (k, 7) of each frame, best first."""
        counts = list(sizes_of(seen.clouds.counts))
        size = constant(self.config.size_m, seen.logits)
        parts = (seen.clouds.xyz, seen.residuals, seen.logits)
        proposals = []
        for xyz, residuals, logits in zip(
            *(p.split_with_sizes(counts) for p in parts), strict=True
        ):
            best = logits.topk(min(BEFORE_NMS, len(logits)))
            boxes = decode(residuals[best.indices], xyz[best.indices], size)
            is_finite = torch.isfinite(boxes).all(dim=1)
            boxes, scores = boxes[is_finite], best.values[is_finite]
            proposals.append(boxes[nms(boxes, scores, self.config.proposal_iou, most)])
        return proposals

    def point_losses(self, seen: Seen, boxes: tuple[Tensor, ...]) -> Losses:
        positive, counted, assigned = [], [], []
        sizes = list(sizes_of(seen.clouds.counts))
        for xyz, b in zip(seen.clouds.xyz.split_with_sizes(sizes), boxes, strict=True):
            box = box_of_points(xyz, grown(b, 2 * AROUND_M))
            positive.append(box >= 0)
            counted.append((box >= 0) | (box_of_points(xyz, grown(b, 2 * DOUBT_M)) < 0))
            assigned.append(b[box[box >= 0]])
        is_vehicle, counts = torch.cat(positive), torch.cat(counted)
        number = of_all(is_vehicle.sum())
        score = focal(seen.logits[counts], is_vehicle[counts].to(seen.logits.dtype)).sum() / number
        size = constant(self.config.size_m, seen.logits)
        wanted = encode(torch.cat(assigned), seen.clouds.xyz[is_vehicle], size)
        box_loss = smooth_l1(seen.residuals[is_vehicle], wanted).sum() / number
        return {"score": score, "box": box_loss}

    def sampled(self, seen: Seen, boxes: tuple[Tensor, ...]) -> SampledRois:
        """Samples training proposals of each frame.

        At most half of them have an IoU of REFINED or more.
        """
        generator = self.generator()
        parts = []
        for proposed, b in zip(self.proposals(seen, self.config.proposals), boxes, strict=True):
            rois = torch.cat([proposed, moved(b, generator)])
            overlap, box = best_overlap(rois, b)
            rows = balanced(overlap, self.config.rois, generator)
            assigned = b[box[rows]] if len(b) else rois[rows]
            parts.append((rois[rows], overlap[rows], assigned))
        rois, overlap, assigned = (torch.cat(column) for column in zip(*parts, strict=True))
        return SampledRois(rois, [len(part[0]) for part in parts], overlap, assigned)

    def roi_losses(self, seen: Seen, sampled: SampledRois) -> Losses:
        logits, residuals, point_counts = self.refiner(detached(seen), sampled.rois, sampled.counts)
        good = sampled.overlap >= GOOD
        counts = (good | (sampled.overlap < BAD)) & (point_counts > 0)
        confidence = functional.binary_cross_entropy_with_logits(
            logits[counts], good[counts].to(logits.dtype), reduction="sum"
        ) / of_all(counts.sum())
        near = (sampled.overlap >= REFINED) & (point_counts > 0)
        number = of_all(near.sum())
        rois, boxes, predicted = sampled.rois[near], sampled.boxes[near], residuals[near]
        refinement = smooth_l1(predicted, refinements(boxes, rois)).sum() / number
        apart = corner_distances(refined(predicted, rois), boxes)
        corners = smooth_l1(apart, torch.zeros_like(apart), beta=1.0).mean(dim=1).sum() / number
        return {"confidence": confidence, "refinement": refinement, "corners": corners}


def _read_draw(network: nn.Module, _: object) -> None:
    """Copies the number of samplings of loaded weights to the CPU."""
    assert isinstance(network, PointRCNN)
    network.draw = int(network.draws)


def scaled(widths: Sequence[int], share: float) -> tuple[int, ...]:
    return tuple(max(4, round(width * share)) for width in widths)


def head(channels: int, out: int, share: float) -> nn.Sequential:
    """Returns layers that map (n, channels) to (n, out)."""
    widths = scaled(HEAD, share)
    last = nn.Linear(widths[-1], out)
    nn.init.normal_(last.weight, std=0.001)
    nn.init.zeros_(last.bias)
    return nn.Sequential(*mlp(channels, widths), last)


def detached(seen: Seen) -> Seen:
    """Returns the input of the second stage, without gradients to the first stage."""
    clouds = seen.clouds.with_features(seen.clouds.features.detach())
    return Seen(clouds, seen.intensity, seen.logits.detach(), seen.residuals.detach())


def by_area(xy: Tensor, cell_m: float) -> Tensor:
    """Returns the rows (n,) of positions (n, 2) in an order that is even by area.

    The order begins with one position of each square of side `cell_m`. A second position of each
    square follows, and so on.
    """
    cell = torch.floor(xy / cell_m).long()
    _, square = torch.unique(cell, dim=0, return_inverse=True)
    return torch.argsort(rank_in(square), stable=True)


def rank_in(group: Tensor) -> Tensor:
    """Returns for each row how many earlier rows are in the same group: (n,).

    group: (n,) int64 group numbers, 0 or more.
    """
    order = torch.argsort(group, stable=True)
    sizes = torch.bincount(group)
    start = torch.repeat_interleave(sizes.cumsum(0) - sizes, sizes)
    rank = torch.empty_like(group)
    rank[order] = torch.arange(len(group), device=group.device) - start
    return rank


def grown(boxes: Tensor, by_m: float) -> Tensor:
    """Returns boxes that are longer, wider and higher by `by_m`, with the same centres."""
    return torch.cat([boxes[:, :3], boxes[:, 3:6] + by_m, boxes[:, 6:]], dim=1)


def pooled(clouds: Clouds, rois: Tensor, counts: Sequence[int], most: int) -> tuple[Tensor, Tensor]:
    """Returns the pairs of a point and a proposal, enlarged by CONTEXT_M, that contains the point.

    The results are rows of points (p,) and rows of proposals (p,), ordered by proposal. rois: (r,
    7). counts: number of proposals in each frame. most: largest number of points of a proposal; if
    there are more, the first points by row are returned.
    """
    rows, owners = [], []
    start = first = 0
    sizes = list(sizes_of(clouds.counts))
    for xyz, frame_boxes in zip(
        clouds.xyz.split_with_sizes(sizes), rois.split_with_sizes(list(counts)), strict=True
    ):
        owner, row = points_in_boxes(xyz, grown(frame_boxes, CONTEXT_M)).t().nonzero().unbind(1)
        few = rank_in(owner) < most
        rows.append(row[few] + start)
        owners.append(owner[few] + first)
        start, first = start + len(xyz), first + len(frame_boxes)
    return torch.cat(rows), torch.cat(owners)


def turned_into(xyz: Tensor, boxes: Tensor) -> Tensor:
    """Returns points (n, 3) in the frames of boxes (n, 7)."""
    return turned(xyz - boxes[:, :3], -boxes[:, 6])


def turned_out_of(xyz: Tensor, boxes: Tensor) -> Tensor:
    """Returns points (n, 3) from the frames of boxes (n, 7), the inverse of turned_into."""
    return turned(xyz, boxes[:, 6]) + boxes[:, :3]


def wrapped(angle: Tensor) -> Tensor:
    """Returns angles in [-pi, pi)."""
    return (angle + math.pi) % (2 * math.pi) - math.pi


def encode(boxes: Tensor, xyz: Tensor, size: Tensor) -> Tensor:
    """Returns the residuals (n, 8) of boxes (n, 7) relative to points (n, 3) and `size` (3,)."""
    sizes, heading = (boxes[:, 3:6] / size).log(), boxes[:, 6:]
    return torch.cat([boxes[:, :3] - xyz, sizes, heading.cos(), heading.sin()], dim=1)


def decode(residuals: Tensor, xyz: Tensor, size: Tensor) -> Tensor:
    """Returns boxes (n, 7), the inverse of encode."""
    sizes = residuals[:, 3:6].clamp(-5, 5).exp() * size
    heading = torch.atan2(residuals[:, 7:8], residuals[:, 6:7])
    return torch.cat([residuals[:, :3] + xyz, sizes, heading], dim=1)


def refinements(boxes: Tensor, rois: Tensor) -> Tensor:
    """Returns the residuals (n, 7) of boxes (n, 7) relative to proposals (n, 7).

    Headings are modulo half a turn.
    """
    sizes = (boxes[:, 3:6] / rois[:, 3:6]).log()
    turn = (boxes[:, 6:] - rois[:, 6:] + math.pi / 2) % math.pi - math.pi / 2
    return torch.cat([turned_into(boxes[:, :3], rois), sizes, turn], dim=1)


def refined(residuals: Tensor, rois: Tensor) -> Tensor:
    """Returns boxes (n, 7), the inverse of refinements."""
    centre = turned_out_of(residuals[:, :3], rois)
    sizes = residuals[:, 3:6].clamp(-5, 5).exp() * rois[:, 3:6]
    return torch.cat([centre, sizes, wrapped(residuals[:, 6:] + rois[:, 6:])], dim=1)


def corner_distances(a: Tensor, b: Tensor) -> Tensor:
    """Returns the distances between the corners of boxes a and b, (n, 7) each, in metres: (n, 8).

    A box of b is turned by half a turn if this makes the sum of its distances smaller.
    """
    target = corners(b)
    back = corners(torch.cat([b[:, :6], b[:, 6:] + math.pi], dim=1))
    predicted = corners(a)
    # A small constant is added, because the gradient of the square root is infinite at 0.
    straight, turned = (((predicted - c) ** 2).sum(2).add(1e-12).sqrt() for c in (target, back))
    return torch.where((straight.sum(1) <= turned.sum(1))[:, None], straight, turned)


def corners(boxes: Tensor) -> Tensor:
    """Returns the corners of boxes: (n, 8, 3)."""
    signs = torch.cartesian_prod(*(constant([-0.5, 0.5], boxes) for _ in range(3)))  # (8, 3)
    local = (boxes[:, None, 3:6] * signs).reshape(-1, 3)
    return turned_out_of(local, boxes.repeat_interleave(8, dim=0)).reshape(-1, 8, 3)


def moved(boxes: Tensor, generator: torch.Generator) -> Tensor:
    """Returns boxes (n, 7) with small random changes of position, size and heading."""
    noise = torch.rand(len(boxes), 7, generator=generator, device=generator.device) * 2 - 1
    centre = boxes[:, :3] + 0.1 * noise[:, :3] * boxes[:, 3:6]
    sizes = boxes[:, 3:6] * (1 + 0.1 * noise[:, 3:6])
    return torch.cat([centre, sizes, wrapped(boxes[:, 6:] + 0.1 * noise[:, 6:])], dim=1)


def balanced(overlap: Tensor, most: int, generator: torch.Generator) -> Tensor:
    """Samples at most `most` proposals by their overlap (n,); returns their rows (k,).

    At most half of them have an overlap of REFINED or more. Of the other proposals, a share of
    HARD_SHARE is hard background, if there are enough such proposals.
    """
    order = torch.randperm(len(overlap), generator=generator, device=generator.device)
    overlaps = overlap[order]
    near, hard = order[overlaps >= REFINED], order[(overlaps < REFINED) & (overlaps >= HARD)]
    easy = order[overlaps < HARD]
    near = near[: most // 2]
    background = most - len(near)
    few = min(len(hard), max(round(HARD_SHARE * background), background - len(easy)))
    return torch.cat([near, hard[:few], easy[: background - few]])
