"""PV-RCNN: Point-Voxel Feature Set Abstraction for 3D Object Detection, Shi et al., CVPR 2020.

Anchors over sparse voxels propose boxes. Key points gather what the raw points, the voxels of each
level and the canvas say around them; a grid in each proposal gathers from the key points, and a
second stage refines the box and says how well it fits.

Deviations: all points of a voxel count; x y z enter the first layer as -1 to 1 over the area
(voxel_backbone.py); padding along the height in every strided layer, as areas differ in height;
anchors of two sizes and one class that stand on the site's floor (anchors.py); 512 proposals enter
the suppression; second-stage boxes are chosen evenly instead of at random and there is no dropout,
so that a run repeats; a ball without points says 0 after its layers and not before them; frames
with few points have as few key points. With `around_m`, key points are taken only
around proposals, as in PV-RCNN++ (Shi et al., IJCV 2023): over a road of 200 m farthest points
spread so thinly that a car has one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import torch
from torch import Tensor, nn
from torch.nn import functional

from pyinfra.config import ruled
from pyinfra.detectors.anchors import AnchorConfig, Anchors, encode
from pyinfra.detectors.batch import Area, Batch
from pyinfra.detectors.bev import BevConfig, BevNetwork, multiple
from pyinfra.detectors.losses import focal, smooth_l1
from pyinfra.detectors.network import Losses, Network
from pyinfra.detectors.ops.boxes import iou_3d_pairs, nms
from pyinfra.detectors.ops.points import ball_query, box_of_points, farthest_points
from pyinfra.detectors.pointpillars import AnchorHead
from pyinfra.detectors.site import Site
from pyinfra.detectors.voxel_backbone import Cloud, RowNorm, VoxelBackbone

# Metres around a key point: raw points, then the levels of voxels; and around a grid point.
RADII = ((0.4, 0.8), (0.4, 0.8), (0.8, 1.2), (1.2, 2.4), (2.4, 4.8))
GRID_RADII = (0.8, 1.6)

LEARNT_NMS_IOU, FOUND_NMS_IOU = 0.8, 0.7  # of proposals, in training and after it
FOREGROUND_IOU = 0.55  # of proposals that are refined
FOREGROUND_SHARE = 0.5  # at most, of the proposals that are learnt from
BACKGROUND_IOU = 0.1  # those above are hard
HARD_SHARE = 0.8  # of the background
POOR_IOU, GOOD_IOU = 0.25, 0.75  # confidences 0 and 1
UNSURE_M = 0.1  # key points this far outside a vehicle do not count
LARGEST = 5.0  # logarithm of a size over the proposal's


def _published_bev() -> BevConfig:
    return BevConfig(layers=(5, 5), widths=(128, 256), strides=(1, 2), up_width=256)


@dataclass(frozen=True)
class Config:
    """Widths and depths; the defaults are the published ones."""

    voxel_m: float = ruled(0.05, 0.02, 1)
    voxel_height_m: float = ruled(0.1, 0.02, 2)
    widths: tuple[int, int, int, int] = ruled((16, 32, 64, 64), 1, 512)  # of the levels
    strides: tuple[int, int, int] = ruled((2, 2, 2), 1, 4)  # along x and y, to the next level
    canvas_width: int = ruled(128, 1, 512)
    bev: BevConfig = field(default_factory=_published_bev)
    anchors: AnchorConfig = field(default_factory=AnchorConfig)
    key_points: int = ruled(2048, 1, 65536)  # of a frame
    around_m: float = ruled(0.0, 0, 100)  # key points only this far around proposals; 0: anywhere
    neighbours: int = ruled(16, 1, 256)  # in each ball
    key_width: int = ruled(128, 1, 1024)
    proposals: int = ruled(128, 1, 1024)  # of a frame
    grid: int = ruled(6, 1, 16)  # points along each side of a proposal
    grid_width: int = ruled(64, 1, 512)  # for each radius
    head_width: int = ruled(256, 1, 2048)


@dataclass(frozen=True, eq=False)
class Proposals:
    """Boxes of some frames, under one another."""

    boxes: Tensor  # (r, 7)
    frame: Tensor  # (r,) int64, ascending


class SetAbstraction(nn.Module):
    """What the points in the balls around centres say (Qi et al., PointNet++, NeurIPS 2017).

    The first layer of a ball's points, offsets from the centre and features, is a sum of both
    parts: that of the features is found once for a point and not once for a ball.
    """

    def __init__(self, channels: int, radii: tuple[float, ...], most: int, width: int) -> None:
        super().__init__()
        self.radii, self.most, self.width = radii, most, width
        self.features = nn.ModuleList(nn.Linear(channels, width, bias=False) for _ in radii)
        self.offset = nn.ModuleList(nn.Linear(3, width, bias=False) for _ in radii)
        self.rest = nn.ModuleList(
            nn.Sequential(RowNorm(width), nn.ReLU(), *_rows(width, width)) for _ in radii
        )

    def forward(self, cloud: Cloud, xyz: Tensor, frame: Tensor, frames: int) -> Tensor:
        """Around centres xyz (m, 3) of frames (m,): (m, radii * width), 0 for an empty ball."""
        found = []
        layers = zip(self.radii, self.features, self.offset, self.rest, strict=True)
        for radius, features, offset, rest in layers:
            rows, empty = neighbours(cloud, xyz, frame, frames, radius, self.most)
            some = (~empty).nonzero()[:, 0]  # (s,)
            rows = rows[some].flatten()  # (s k,)
            away = cloud.xyz[rows] - xyz[some].repeat_interleave(self.most, dim=0)
            deep = rest(features(cloud.features)[rows] + offset(away))  # (s k, width)
            best = deep.view(len(some), self.most, self.width).max(dim=1).values
            found.append(best.new_zeros(len(xyz), self.width).index_copy(0, some, best))
        return torch.cat(found, dim=1)


class KeyPoints(nn.Module):
    """Key points -> features (m, key_width), weighted by how much they belong to a vehicle."""

    def __init__(self, config: Config, area: Area, canvas_channels: int) -> None:
        super().__init__()
        self.area = area
        channels = (1, *config.widths)  # of raw points and of the levels
        widths = (config.widths[0], *config.widths)
        self.sources = nn.ModuleList(
            SetAbstraction(c, radii, config.neighbours, width)
            for c, radii, width in zip(channels, RADII, widths, strict=True)
        )
        gathered = 2 * sum(widths) + canvas_channels
        self.fuse = _rows(gathered, config.key_width)
        self.foreground = nn.Sequential(
            _rows(gathered, config.head_width, config.head_width), nn.Linear(config.head_width, 1)
        )

    def forward(
        self, clouds: list[Cloud], canvas: Tensor, xyz: Tensor, frame: Tensor
    ) -> tuple[Cloud, Tensor]:
        """clouds: raw points and the levels; returns the key points (m,) and logits (m,)."""
        frames = len(canvas)
        found = [
            source(cloud, xyz, frame, frames)
            for source, cloud in zip(self.sources, clouds, strict=True)
        ]
        gathered = torch.cat([*found, self.seen_from_above(canvas, xyz, frame)], dim=1)
        logits: Tensor = self.foreground(gathered)[:, 0]
        features = self.fuse(gathered) * torch.sigmoid(logits)[:, None]
        return Cloud(xyz, features, frame), logits

    def seen_from_above(self, canvas: Tensor, xyz: Tensor, frame: Tensor) -> Tensor:
        """(m, C): the canvas (B, C, H, W) at the key points, between the middles of its cells."""
        low, size = xyz.new_tensor(self.area.low[:2]), xyz.new_tensor(self.area.size[:2])
        at = 2 * (xyz[:, :2] - low) / size - 1  # (m, 2)
        parts = _by_frame(at, frame, len(canvas))
        found = [
            functional.grid_sample(
                canvas[i : i + 1], part[None, None], padding_mode="border", align_corners=False
            )[0, :, 0].t()
            for i, part in enumerate(parts)
            if len(part)
        ]
        return torch.cat([canvas.new_zeros(0, canvas.shape[1]), *found])


class Refinement(nn.Module):
    """Proposals -> confidences (r,) as logits and residuals (r, 7), from the key points in them."""

    def __init__(self, config: Config) -> None:
        super().__init__()
        self.grid = config.grid
        self.pool = SetAbstraction(
            config.key_width, GRID_RADII, config.neighbours, config.grid_width
        )
        pooled, width = config.grid**3 * len(GRID_RADII) * config.grid_width, config.head_width
        self.shared = _rows(pooled, width, width)
        self.score = nn.Sequential(_rows(width, width, width), nn.Linear(width, 1))
        last = nn.Linear(width, 7)
        nn.init.normal_(last.weight, std=0.001)
        nn.init.zeros_(last.bias)
        self.box = nn.Sequential(_rows(width, width, width), last)

    def forward(self, key: Cloud, proposals: Proposals, frames: int) -> tuple[Tensor, Tensor]:
        places = grid_points(proposals.boxes, self.grid)  # (r, g, 3)
        frame = proposals.frame.repeat_interleave(places.shape[1])
        found = self.pool(key, places.flatten(0, 1), frame, frames)  # (r g, c)
        # Not -1: its size is unknown where there is no proposal.
        x = self.shared(found.reshape(len(places), places.shape[1] * found.shape[1]))
        return self.score(x)[:, 0], self.box(x)


class PvRcnn(Network):
    """Sparse voxels, anchors, key points, a second stage."""

    def __init__(self, config: Config, site: Site) -> None:
        cell_m = math.prod(config.strides) * config.voxel_m
        area = site.area.grown(multiple(config.bev, cell_m))
        super().__init__(Site(area, site.floor_z))
        self.config = config
        self.backbone = VoxelBackbone(
            area,
            config.voxel_m,
            config.voxel_height_m,
            config.widths,
            config.strides,
            config.canvas_width,
        )
        self.bev = BevNetwork(config.bev, self.backbone.channels)
        stride = config.bev.strides[0]
        rows, columns = (n // stride for n in self.backbone.grid)
        anchors = Anchors(config.anchors, self.site, stride * cell_m, (rows, columns))
        self.head = AnchorHead(self.bev.channels, anchors)
        self.key_points = KeyPoints(config, area, self.backbone.channels)
        self.refinement = Refinement(config)

    def losses(self, batch: Batch) -> Losses:
        levels, canvas = self.backbone(batch)
        x = self.bev(canvas)
        first = self.head.losses(x, batch.boxes)
        found = self.proposals(x, LEARNT_NMS_IOU)
        chosen = [
            boxes[spread_by_overlap(best_overlap(boxes, own)[0], self.config.proposals)]
            for boxes, own in zip(found, batch.boxes, strict=True)
        ]
        proposals = _stacked(chosen)
        key, logits = self.gather(batch, levels, canvas, proposals)
        scores, residuals = self.refinement(key, proposals, batch.size)
        second = refinement_losses(scores, residuals, chosen, batch.boxes)
        return {**first, "point": foreground_loss(key, logits, batch.boxes), **second}

    def candidates(self, batch: Batch) -> list[tuple[Tensor, Tensor]]:
        levels, canvas = self.backbone(batch)
        found = self.proposals(self.bev(canvas), FOUND_NMS_IOU)
        proposals = _stacked([boxes[: self.config.proposals] for boxes in found])
        key, _ = self.gather(batch, levels, canvas, proposals)
        scores, residuals = self.refinement(key, proposals, batch.size)
        boxes = refined(proposals.boxes, residuals)
        parts = (_by_frame(x, proposals.frame, batch.size) for x in (boxes, torch.sigmoid(scores)))
        return list(zip(*parts, strict=True))

    @torch.no_grad()
    def proposals(self, x: Tensor, iou: float) -> list[Tensor]:
        """Of each frame the boxes (r, 7) of the anchors that do not overlap more, best first."""
        found = []
        for boxes, scores in self.head.candidates(x):
            good = torch.isfinite(boxes).all(dim=1) & torch.isfinite(scores)
            boxes, scores = boxes[good], scores[good]
            found.append(boxes[nms(boxes, scores, iou, len(boxes))])
        return found

    def gather(
        self, batch: Batch, levels: list[Cloud], canvas: Tensor, proposals: Proposals
    ) -> tuple[Cloud, Tensor]:
        """The key points with their features, and logits (m,) of being on a vehicle."""
        raw = Cloud(batch.points[:, :3].contiguous(), batch.points[:, 3:], batch.frame)
        rows = self.rows_of_key_points(raw, proposals, batch.size)
        key: tuple[Cloud, Tensor] = self.key_points(
            [raw, *levels], canvas, raw.xyz[rows], raw.frame[rows]
        )
        return key

    @torch.no_grad()
    def rows_of_key_points(self, raw: Cloud, proposals: Proposals, frames: int) -> Tensor:
        """(m,): of each frame as many far points as wanted, or all that there are."""
        found, start = [raw.frame[:0]], 0
        boxes = _by_frame(proposals.boxes, proposals.frame, frames)
        for i, xyz in enumerate(_by_frame(raw.xyz, raw.frame, frames)):
            rows = torch.arange(len(xyz), device=xyz.device)
            if self.config.around_m > 0:
                rows = rows[is_around(xyz, boxes[i], self.config.around_m)]
            if len(rows) > self.config.key_points:
                rows = rows[farthest_points(xyz[rows], self.config.key_points)]
            found.append(start + rows)
            start += len(xyz)
        return torch.cat(found)


def neighbours(
    cloud: Cloud, xyz: Tensor, frame: Tensor, frames: int, radius: float, k: int
) -> tuple[Tensor, Tensor]:
    """As `ball_query`, each frame for itself; rows (m, k) of the whole cloud, and (m,) empty."""
    rows, none = [frame.new_zeros(0, k)], [frame.new_zeros(0, dtype=torch.bool)]
    start = 0
    points = _by_frame(cloud.xyz, cloud.frame, frames)
    for own, centres in zip(points, _by_frame(xyz, frame, frames), strict=True):
        found, empty = ball_query(own, centres, radius, k)
        rows.append(start + found)
        none.append(empty)
        start += len(own)
    return torch.cat(rows), torch.cat(none)


def is_around(xyz: Tensor, boxes: Tensor, margin_m: float) -> Tensor:
    """(n,) bool: is a point in the upright cylinder around a box (r, 7), wider by the margin?"""
    if not len(boxes):
        return torch.zeros(len(xyz), dtype=torch.bool, device=xyz.device)
    reach = boxes[:, 3:5].norm(dim=1) / 2 + margin_m
    result = torch.zeros(len(xyz), dtype=torch.bool, device=xyz.device)
    for box, far in zip(boxes, reach, strict=True):
        result |= (xyz[:, 0] - box[0]) ** 2 + (xyz[:, 1] - box[1]) ** 2 < far**2
    return result


def grid_points(boxes: Tensor, grid: int) -> Tensor:
    """(r, grid^3, 3): the middles of the cells of each box (r, 7)."""
    share = (torch.arange(grid, device=boxes.device) + 0.5) / grid - 0.5
    local = torch.cartesian_prod(share, share, share) * boxes[:, None, 3:6]
    return boxes[:, None, :3] + _turned(local, boxes[:, 6, None])


def refined(boxes: Tensor, residuals: Tensor) -> Tensor:
    """Boxes (r, 7) changed by residuals (r, 7) in their own frames; none changes nothing."""
    diagonal = boxes[:, 3:5].norm(dim=1, keepdim=True)
    scale = torch.cat([diagonal, diagonal, boxes[:, 5:6]], dim=1)
    xyz = boxes[:, :3] + _turned(residuals[:, :3] * scale, boxes[:, 6])
    sizes = boxes[:, 3:6] * residuals[:, 3:6].clamp(-LARGEST, LARGEST).exp()
    return torch.cat([xyz, sizes, boxes[:, 6:] + residuals[:, 6:]], dim=1)


def wanted_residuals(boxes: Tensor, own: Tensor) -> Tensor:
    """The inverse of `refined`: (r, 7) from boxes to vehicles (r, 7), headings modulo half a turn.

    What is forward was said by the first stage.
    """
    here = torch.cat([torch.zeros_like(boxes[:, :3]), boxes[:, 3:6], boxes[:, :1] * 0], dim=1)
    offset = _turned(own[:, :3] - boxes[:, :3], -boxes[:, 6])
    turn = (own[:, 6:] - boxes[:, 6:] + math.pi / 2) % math.pi - math.pi / 2
    return encode(torch.cat([offset, own[:, 3:6], turn], dim=1), here)


def best_overlap(boxes: Tensor, own: Tensor) -> tuple[Tensor, Tensor]:
    """Overlap (r,) of volumes of each box with the vehicle (r,) by row that it overlaps most."""
    if not len(own):
        return boxes.new_zeros(len(boxes)), torch.zeros_like(boxes[:, 0], dtype=torch.int64)
    pairs = boxes.repeat_interleave(len(own), dim=0), own.repeat(len(boxes), 1)
    best = iou_3d_pairs(*pairs).view(len(boxes), len(own)).max(dim=1)
    return best.values, best.indices


def spread_by_overlap(overlap: Tensor, most: int) -> Tensor:
    """Rows of at most so many boxes to learn from: on vehicles, near them, and elsewhere."""
    rows = torch.arange(len(overlap), device=overlap.device)
    on = rows[overlap >= FOREGROUND_IOU]
    near = rows[(overlap < FOREGROUND_IOU) & (overlap >= BACKGROUND_IOU)]
    off = rows[overlap < BACKGROUND_IOU]
    on = _evenly(on, int(most * FOREGROUND_SHARE))
    left = most - len(on)
    near = _evenly(near, max(int(left * HARD_SHARE), left - len(off)))
    return torch.cat([on, near, _evenly(off, left - len(near))])


def refinement_losses(
    scores: Tensor, residuals: Tensor, proposals: list[Tensor], boxes: tuple[Tensor, ...]
) -> Losses:
    """scores: (r,), residuals: (r, 7) of the proposals of all frames; boxes: of the vehicles."""
    overlaps, targets = [scores.new_zeros(0)], [residuals.new_zeros(0, 7)]
    for proposed, own in zip(proposals, boxes, strict=True):
        overlap, row = best_overlap(proposed, own)
        overlaps.append(overlap)
        targets.append(own[row] if len(own) else proposed)
    overlap, own, proposed = torch.cat(overlaps), torch.cat(targets), torch.cat(proposals)
    wanted = ((overlap - POOR_IOU) / (GOOD_IOU - POOR_IOU)).clamp(0, 1)
    score = functional.binary_cross_entropy_with_logits(scores, wanted, reduction="sum")
    on = overlap >= FOREGROUND_IOU
    count = on.sum().clamp(min=1)
    box = smooth_l1(residuals[on], wanted_residuals(proposed[on], own[on])).sum()
    corner = corner_loss(refined(proposed[on], residuals[on]), own[on]).sum()
    return {
        "confidence": score / max(1, len(scores)),
        "refinement": box / count,
        "corner": corner / count,
    }


def corner_loss(found: Tensor, own: Tensor) -> Tensor:
    """(r,): mean distance of corners of boxes (r, 7), whichever end is the front."""
    half_turn = own + own.new_tensor([0, 0, 0, 0, 0, 0, math.pi])
    corners = grid_corners(found)
    apart = torch.minimum(
        (corners - grid_corners(own)).norm(dim=2), (corners - grid_corners(half_turn)).norm(dim=2)
    )
    return smooth_l1(apart, torch.zeros_like(apart), beta=1.0).mean(dim=1)


def grid_corners(boxes: Tensor) -> Tensor:
    """(r, 8, 3): those of two cells along each side lie in the middle between centre and corner."""
    middle = boxes[:, None, :3]
    return middle + 2 * (grid_points(boxes, 2) - middle)


def foreground_loss(key: Cloud, logits: Tensor, boxes: tuple[Tensor, ...]) -> Tensor:
    """Focal loss of the key points on vehicles; those just outside do not count."""
    on, near = [logits.new_zeros(0, dtype=torch.bool)], [logits.new_zeros(0, dtype=torch.bool)]
    for xyz, own in zip(_by_frame(key.xyz, key.frame, len(boxes)), boxes, strict=True):
        wider = own + own.new_tensor([0, 0, 0, *[2 * UNSURE_M] * 3, 0])
        on.append(box_of_points(xyz, own) >= 0)
        near.append(box_of_points(xyz, wider) >= 0)
    target = torch.cat(on)
    counts = target | ~torch.cat(near)
    loss = focal(logits[counts], target[counts].to(logits.dtype)).sum()
    return loss / target.sum().clamp(min=1)


def _rows(channels: int, *widths: int) -> nn.Sequential:
    """Linear layers over rows (n, channels), each with batch norm and ReLU."""
    layers: list[nn.Module] = []
    for width in widths:
        layers += [nn.Linear(channels, width, bias=False), RowNorm(width), nn.ReLU()]
        channels = width
    return nn.Sequential(*layers)


def _turned(xyz: Tensor, heading: Tensor) -> Tensor:
    """(..., 3) turned about z by (...)."""
    cos, sin = heading.cos(), heading.sin()
    x, y, z = xyz.unbind(-1)
    return torch.stack([cos * x - sin * y, sin * x + cos * y, z], dim=-1)


def _evenly(rows: Tensor, most: int) -> Tensor:
    if len(rows) <= most:
        return rows
    return rows[torch.arange(most, device=rows.device) * len(rows) // most]


def _by_frame(x: Tensor, frame: Tensor, frames: int) -> tuple[Tensor, ...]:
    """The rows (n, ...) of each frame; frame: (n,) ascending."""
    return x.split_with_sizes(torch.bincount(frame, minlength=frames).tolist())


def _stacked(boxes: list[Tensor]) -> Proposals:
    counts = torch.tensor([len(own) for own in boxes], device=boxes[0].device)
    frame = torch.repeat_interleave(torch.arange(len(boxes), device=counts.device), counts)
    return Proposals(torch.cat(boxes), frame)
