"""PointRCNN: 3D Object Proposal Generation and Detection from Point Cloud, Shi et al., CVPR 2019.

Stage 1 tells points of vehicles from others and proposes a box at each; stage 2 takes the points
around a proposal, turned into its frame, and refines and scores it.

Deviations: boxes as residuals from the point, or from the proposal, in place of bins, both stages
learn at once, and the second one is given scores in place of a mask: as OpenPCDet has it. Offsets
are in metres, because in diagonals of a box half a metre is next to no loss. The second stage has
batch norm as the first one has. A point's features are its intensity, its height over the site's
floor and its place in the area, because a roadside sensor looks at vehicles from all sides, and one
or two points do not say which side they are on. Points up to 5 cm outside a box are its vehicle's.
Proposals to learn from are drawn without repetition, from what was proposed and from the labels,
which are moved a little. See also pointnet.py.

`sampling: faithful` draws a fixed number of points of the whole frame, each as likely as another,
as the paper has it. Where the ground has most of the points, far vehicles lose the few they have;
then the farthest-point sampling of the set abstractions spreads over the ground. OpenPCDet keeps
what is beyond 40 m, which helps at the 70 m of its data; here that is most of the area.

`sampling: remedied` is the same network on other points: those within `clearance_m` over the
site's floor are left out, so the road must be level, and the budget goes by area: each square of
`cell_m` gives one point before one gives two.
"""

from __future__ import annotations

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
    sampled,
)
from pyinfra.models.ops.boxes import best_overlap, nms
from pyinfra.models.ops.points import box_of_points, points_in_boxes

POINT_FEATURES = 4  # intensity, height, place (2)
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

LOCAL_FEATURES = 6  # x y z in the proposal's frame, intensity, score, distance
LOCAL = (128, 128)
MERGED = (128,)
ROI_LEVELS = ((128, Ball(0.2, 16, (128, 128, 128))), (32, Ball(0.4, 16, (128, 128, 256))))
ROI_WHOLE = (256, 256, 512)

BEFORE_NMS = 9000  # points whose boxes are compared
DOUBT_M = 0.2  # and one as far outside is of nothing certain
CONTEXT_M = 1.0  # a proposal is longer, wider and higher by this when points are looked for
DEPTH_M = 100.0

# Overlap (3-D) of a proposal and a vehicle.
REFINED = 0.55  # from here on it is refined
GOOD, BAD = 0.6, 0.45  # from here on it counts as a vehicle, and below as none
HARD, HARD_SHARE = 0.05, 0.8  # of the proposals that are not refined


@dataclass(frozen=True)
class Config:
    """The defaults are the published ones, except for the anchor's size."""

    sampling: Literal["faithful", "remedied"] = "faithful"  # remedied: by area, above the ground
    points: int = ruled(16384, 64, 1_000_000)  # of a frame
    clearance_m: float = ruled(0.2, 0, 5)  # remedied: what is lower is ground
    cell_m: float = ruled(1.0, 0.1, 20)  # remedied: side of a square
    levels: tuple[int, int, int, int] = ruled((4096, 1024, 256, 64), 4, 65536)  # points each
    width: float = ruled(1.0, 0.05, 4)  # share of the published layers' widths
    size_m: tuple[float, float, float] = ruled(CAR_M, 0.1, 30)  # boxes start as this
    proposal_iou: float = ruled(0.85, 0.05, 1)  # that overlap more (footprints) are one
    proposals: int = ruled(512, 1, 4096)  # of a frame, to draw from in training
    rois: int = ruled(128, 2, 1024)  # of a frame, drawn in training
    rois_found: int = ruled(100, 1, 1024)  # of a frame, refined in use
    roi_points: int = ruled(512, 16, 4096)  # drawn in each proposal


@dataclass(frozen=True, eq=False)
class Seen:
    """What the first stage makes of a batch."""

    clouds: Clouds  # of the frames, with semantic features
    intensity: Tensor  # (n,)
    logits: Tensor  # (n,) of points of vehicles
    residuals: Tensor  # (n, 8)


@dataclass(frozen=True, eq=False)
class Drawn:
    """Proposals to learn from, of all frames."""

    rois: Tensor  # (r, 7)
    counts: list[int]  # of each frame
    overlap: Tensor  # (r,) with the vehicle they are nearest to
    boxes: Tensor  # (r, 7) that vehicle; of no meaning where the overlap is 0


class Backbone(nn.Module):
    """Clouds to clouds of the same points with semantic features."""

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
        """(n, 4) -> (n, channels)."""
        steps = [clouds]
        for most, layer in zip(self.levels, self.down, strict=True):
            rows, counts = sampled(steps[-1], most)
            steps.append(layer(steps[-1], steps[-1].xyz[rows], counts))
        coarse = steps.pop()
        for layer in self.up:
            coarse = layer(steps.pop(), coarse)
        return coarse


class Refiner(nn.Module):
    """The second stage: points of each proposal to its confidence and the residuals of its box."""

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
        """rois: (r, 7), counts: of each frame -> logits (r,), residuals (r, 7), points (r,)."""
        rows, owners = pooled(seen.clouds, rois, counts, self.most)
        xyz = seen.clouds.xyz[rows]
        canonical = turned_into(xyz, rois[owners])
        score = torch.sigmoid(seen.logits[rows])
        distance = xyz.norm(dim=1) / DEPTH_M - 0.5
        more = torch.stack([seen.intensity[rows], score, distance], dim=1)
        local = self.local(torch.cat([canonical, more], dim=1))
        merged = self.merge(torch.cat([local, seen.clouds.features[rows]], dim=1))
        held = torch.bincount(owners, minlength=len(rois))
        clouds = Clouds(canonical, merged, held.tolist())
        for most, layer in zip(self.levels, self.down, strict=True):
            centres, numbers = sampled(clouds, most)
            clouds = layer(clouds, clouds.xyz[centres], numbers)
        whole = self.whole(clouds)
        return self.confidence(whole)[:, 0].float(), self.box(whole).float(), held


class PointRCNN(Network):
    """Points, proposals at points, refined proposals."""

    draws: Tensor

    def __init__(self, config: Config, site: Site) -> None:
        super().__init__(site)
        self.config = config
        self.backbone = Backbone(config)
        self.score = head(self.backbone.channels, 1, config.width)
        self.box = head(self.backbone.channels, 8, config.width)
        self.refiner = Refiner(config, self.backbone.channels)
        # Draws so far: the next ones follow from it, also when training goes on.
        self.register_buffer("draws", torch.zeros((), dtype=torch.int64))

    def losses(self, batch: Batch) -> Losses:
        seen = self.seen(batch)
        drawn = self.drawn(seen, batch.boxes)
        return self.point_losses(seen, batch.boxes) | self.roi_losses(seen, drawn)

    def candidates(self, batch: Batch) -> list[tuple[Tensor, Tensor]]:
        seen = self.seen(batch)
        rois = self.proposals(seen, self.config.rois_found)
        counts = [len(r) for r in rois]
        every = torch.cat(rois)
        logits, residuals, held = self.refiner(detached(seen), every, counts)
        # Where there is no point there is nothing to be seen.
        scores = torch.sigmoid(logits) * (held > 0)
        boxes = refined(residuals, every)
        return list(
            zip(boxes.split_with_sizes(counts), scores.split_with_sizes(counts), strict=True)
        )

    def seen(self, batch: Batch) -> Seen:
        """The first stage."""
        draw = self.draw()
        parts = [
            points[self.chosen(points, draw)]
            for points in batch.points.split_with_sizes(
                torch.bincount(batch.frame, minlength=batch.size).tolist()
            )
        ]
        points = torch.cat(parts)
        clouds = Clouds(points[:, :3].contiguous(), self.described(points), [len(p) for p in parts])
        clouds = self.backbone(clouds)
        logits, residuals = self.score(clouds.features)[:, 0], self.box(clouds.features)
        return Seen(clouds, points[:, 3], logits.float(), residuals.float())

    def draw(self) -> torch.Generator:
        """What is random: the same for each frame in use, new for each batch in training."""
        generator = torch.Generator()
        if self.training:
            self.draws += 1
            return generator.manual_seed(int(self.draws))
        return generator.manual_seed(0)

    def chosen(self, points: Tensor, draw: torch.Generator) -> Tensor:
        """Rows of a frame's points (n, 4) that the network is given, in random order."""
        if not self.training:
            draw.manual_seed(0)  # frames do not depend on those before them
        rows = torch.randperm(len(points), generator=draw).to(points.device)
        if self.config.sampling == "remedied":
            rows = rows[points[rows, 2] > self.site.floor_z + self.config.clearance_m]
            rows = rows[by_area(points[rows, :2], self.config.cell_m)]
        return rows[: self.config.points]

    def described(self, points: Tensor) -> Tensor:
        """(n, 4) features of points (n, 4)."""
        area = self.site.area
        low, size = points.new_tensor(area.low[:2]), points.new_tensor(area.size[:2])
        normalised_xy = (points[:, :2] - low) / size * 2 - 1
        height = points[:, 2:3] - self.site.floor_z
        return torch.cat([points[:, 3:], height, normalised_xy], dim=1)

    @torch.no_grad()
    def proposals(self, seen: Seen, most: int) -> list[Tensor]:
        """(k, 7) of each frame, best first."""
        counts = seen.clouds.counts
        size = seen.logits.new_tensor(self.config.size_m)
        parts = (seen.clouds.xyz, seen.residuals, seen.logits)
        proposals = []
        for xyz, residuals, logits in zip(
            *(p.split_with_sizes(counts) for p in parts), strict=True
        ):
            best = logits.topk(min(BEFORE_NMS, len(logits)))
            boxes = decode(residuals[best.indices], xyz[best.indices], size)
            whole = torch.isfinite(boxes).all(dim=1)
            boxes, scores = boxes[whole], best.values[whole]
            proposals.append(boxes[nms(boxes, scores, self.config.proposal_iou, most)])
        return proposals

    def point_losses(self, seen: Seen, boxes: tuple[Tensor, ...]) -> Losses:
        positive, counted, assigned = [], [], []
        for xyz, b in zip(seen.clouds.xyz.split_with_sizes(seen.clouds.counts), boxes, strict=True):
            box = box_of_points(xyz, grown(b, 2 * AROUND_M))
            positive.append(box >= 0)
            counted.append((box >= 0) | (box_of_points(xyz, grown(b, 2 * DOUBT_M)) < 0))
            assigned.append(b[box[box >= 0]])
        is_vehicle, counts = torch.cat(positive), torch.cat(counted)
        number = of_all(is_vehicle.sum())
        score = focal(seen.logits[counts], is_vehicle[counts].to(seen.logits.dtype)).sum() / number
        size = seen.logits.new_tensor(self.config.size_m)
        wanted = encode(torch.cat(assigned), seen.clouds.xyz[is_vehicle], size)
        box_loss = smooth_l1(seen.residuals[is_vehicle], wanted).sum() / number
        return {"score": score, "box": box_loss}

    def drawn(self, seen: Seen, boxes: tuple[Tensor, ...]) -> Drawn:
        """Proposals of each frame, at most half of them good enough to be refined."""
        draw = self.draw()
        parts = []
        for proposed, b in zip(self.proposals(seen, self.config.proposals), boxes, strict=True):
            rois = torch.cat([proposed, moved(b, draw)])
            overlap, box = best_overlap(rois, b)
            rows = balanced(overlap.cpu(), self.config.rois, draw).to(rois.device)
            assigned = b[box[rows]] if len(b) else rois[rows]
            parts.append((rois[rows], overlap[rows], assigned))
        rois, overlap, assigned = (torch.cat(column) for column in zip(*parts, strict=True))
        return Drawn(rois, [len(part[0]) for part in parts], overlap, assigned)

    def roi_losses(self, seen: Seen, drawn: Drawn) -> Losses:
        logits, residuals, held = self.refiner(detached(seen), drawn.rois, drawn.counts)
        good = drawn.overlap >= GOOD
        counts = (good | (drawn.overlap < BAD)) & (held > 0)
        confidence = functional.binary_cross_entropy_with_logits(
            logits[counts], good[counts].to(logits.dtype), reduction="sum"
        ) / of_all(counts.sum())
        near = (drawn.overlap >= REFINED) & (held > 0)
        number = of_all(near.sum())
        rois, boxes, predicted = drawn.rois[near], drawn.boxes[near], residuals[near]
        refinement = smooth_l1(predicted, refinements(boxes, rois)).sum() / number
        apart = corner_distances(refined(predicted, rois), boxes)
        corners = smooth_l1(apart, torch.zeros_like(apart), beta=1.0).mean(dim=1).sum() / number
        return {"confidence": confidence, "refinement": refinement, "corners": corners}


def scaled(widths: Sequence[int], share: float) -> tuple[int, ...]:
    return tuple(max(4, round(width * share)) for width in widths)


def head(channels: int, out: int, share: float) -> nn.Sequential:
    """(n, channels) -> (n, out)."""
    widths = scaled(HEAD, share)
    last = nn.Linear(widths[-1], out)
    nn.init.normal_(last.weight, std=0.001)
    nn.init.zeros_(last.bias)
    return nn.Sequential(*mlp(channels, widths), last)


def detached(seen: Seen) -> Seen:
    """For the second stage, from which nothing flows back to the first."""
    clouds = seen.clouds.with_features(seen.clouds.features.detach())
    return Seen(clouds, seen.intensity, seen.logits.detach(), seen.residuals.detach())


def by_area(xy: Tensor, cell_m: float) -> Tensor:
    """(n,) an order of places xy (n, 2): one of each square, then a second one of each, ..."""
    cell = torch.floor(xy / cell_m).long()
    _, square = torch.unique(cell, dim=0, return_inverse=True)
    return torch.argsort(rank_in(square), stable=True)


def rank_in(group: Tensor) -> Tensor:
    """(n,) how many rows before have the same number; group: (n,) int64, none negative."""
    order = torch.argsort(group, stable=True)
    sizes = torch.bincount(group)
    start = torch.repeat_interleave(sizes.cumsum(0) - sizes, sizes)
    rank = torch.empty_like(group)
    rank[order] = torch.arange(len(group), device=group.device) - start
    return rank


def grown(boxes: Tensor, by_m: float) -> Tensor:
    """Longer, wider and higher, around the same centre."""
    return torch.cat([boxes[:, :3], boxes[:, 3:6] + by_m, boxes[:, 6:]], dim=1)


def pooled(clouds: Clouds, rois: Tensor, counts: Sequence[int], most: int) -> tuple[Tensor, Tensor]:
    """Rows (p,) of the points in and around proposals, and the proposal (p,) of each, ascending.

    rois: (r, 7), counts: of each frame; the first `most` points of a proposal.
    """
    rows, owners = [], []
    start = first = 0
    for xyz, frame_boxes in zip(
        clouds.xyz.split_with_sizes(clouds.counts), rois.split_with_sizes(list(counts)), strict=True
    ):
        owner, row = points_in_boxes(xyz, grown(frame_boxes, CONTEXT_M)).t().nonzero().unbind(1)
        few = rank_in(owner) < most
        rows.append(row[few] + start)
        owners.append(owner[few] + first)
        start, first = start + len(xyz), first + len(frame_boxes)
    return torch.cat(rows), torch.cat(owners)


def turned_into(xyz: Tensor, boxes: Tensor) -> Tensor:
    """(n, 3) seen from boxes (n, 7): from their centres, along their headings."""
    dx, dy, dz = (xyz - boxes[:, :3]).unbind(1)
    cos, sin = boxes[:, 6].cos(), boxes[:, 6].sin()
    return torch.stack([cos * dx + sin * dy, cos * dy - sin * dx, dz], dim=1)


def turned_out_of(xyz: Tensor, boxes: Tensor) -> Tensor:
    """The inverse of turned_into."""
    x, y, z = xyz.unbind(1)
    cos, sin = boxes[:, 6].cos(), boxes[:, 6].sin()
    return torch.stack([cos * x - sin * y, sin * x + cos * y, z], dim=1) + boxes[:, :3]


def wrapped(angle: Tensor) -> Tensor:
    """In [-pi, pi)."""
    return (angle + math.pi) % (2 * math.pi) - math.pi


def encode(boxes: Tensor, xyz: Tensor, size: Tensor) -> Tensor:
    """Residuals (n, 8) of boxes (n, 7) from boxes of the size (3,) around points (n, 3)."""
    sizes, heading = (boxes[:, 3:6] / size).log(), boxes[:, 6:]
    return torch.cat([boxes[:, :3] - xyz, sizes, heading.cos(), heading.sin()], dim=1)


def decode(residuals: Tensor, xyz: Tensor, size: Tensor) -> Tensor:
    """The inverse of encode."""
    sizes = residuals[:, 3:6].clamp(-5, 5).exp() * size
    heading = torch.atan2(residuals[:, 7:8], residuals[:, 6:7])
    return torch.cat([residuals[:, :3] + xyz, sizes, heading], dim=1)


def refinements(boxes: Tensor, rois: Tensor) -> Tensor:
    """Residuals (n, 7) of boxes from proposals (n, 7), up to half a turn of the heading."""
    sizes = (boxes[:, 3:6] / rois[:, 3:6]).log()
    turn = (boxes[:, 6:] - rois[:, 6:] + math.pi / 2) % math.pi - math.pi / 2
    return torch.cat([turned_into(boxes[:, :3], rois), sizes, turn], dim=1)


def refined(residuals: Tensor, rois: Tensor) -> Tensor:
    """The inverse of refinements."""
    centre = turned_out_of(residuals[:, :3], rois)
    sizes = residuals[:, 3:6].clamp(-5, 5).exp() * rois[:, 3:6]
    return torch.cat([centre, sizes, wrapped(residuals[:, 6:] + rois[:, 6:])], dim=1)


def corner_distances(a: Tensor, b: Tensor) -> Tensor:
    """(n, 8) metres between the corners of boxes (n, 7), b turned by half a turn if nearer."""
    there = corners(b)
    back = corners(torch.cat([b[:, :6], b[:, 6:] + math.pi], dim=1))
    here = corners(a)
    # With a floor below the root, which has no slope at 0.
    straight, turned = (((here - c) ** 2).sum(2).add(1e-12).sqrt() for c in (there, back))
    return torch.where((straight.sum(1) <= turned.sum(1))[:, None], straight, turned)


def corners(boxes: Tensor) -> Tensor:
    """(n, 8, 3)."""
    signs = torch.cartesian_prod(*(boxes.new_tensor([-0.5, 0.5]) for _ in range(3)))  # (8, 3)
    local = (boxes[:, None, 3:6] * signs).reshape(-1, 3)
    return turned_out_of(local, boxes.repeat_interleave(8, dim=0)).reshape(-1, 8, 3)


def moved(boxes: Tensor, draw: torch.Generator) -> Tensor:
    """Boxes (n, 7) a little beside themselves, larger or smaller, and turned."""
    noise = (torch.rand(len(boxes), 7, generator=draw) * 2 - 1).to(boxes)
    centre = boxes[:, :3] + 0.1 * noise[:, :3] * boxes[:, 3:6]
    sizes = boxes[:, 3:6] * (1 + 0.1 * noise[:, 3:6])
    return torch.cat([centre, sizes, wrapped(boxes[:, 6:] + 0.1 * noise[:, 6:])], dim=1)


def balanced(overlap: Tensor, most: int, draw: torch.Generator) -> Tensor:
    """Rows (k,) of at most so many proposals (n,): half to be refined, of the rest most hard."""
    order = torch.randperm(len(overlap), generator=draw)
    at = overlap[order]
    near, hard = order[at >= REFINED], order[(at < REFINED) & (at >= HARD)]
    easy = order[at < HARD]
    near = near[: most // 2]
    rest = most - len(near)
    few = min(len(hard), max(round(HARD_SHARE * rest), rest - len(easy)))
    return torch.cat([near, hard[:few], easy[: rest - few]])
