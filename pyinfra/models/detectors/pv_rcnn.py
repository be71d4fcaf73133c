"""PV-RCNN: Point-Voxel Feature Set Abstraction for 3D Object Detection, Shi et al., CVPR 2020.

Anchors on sparse voxels propose boxes. Each key point collects the features around it: of the raw
points, of the voxels of each level, and of the canvas. Grid points in each proposal collect
features from the key points. A second stage refines the box and predicts its confidence.

Deviations from the paper:

- all points of a voxel are used, and x y z are scaled to -1 to 1 over the area before the first
  layer (voxel_backbone.py)
- every strided layer has padding along the height, because areas differ in height
- anchors of two sizes and one class, which stand on the road (anchors.py)
- so that a training can be reproduced: proposals for the second stage are evenly spaced instead of
  random; there is no dropout; the points of a full ball (16 at every level) are the same in each
  step
- the same number of proposals is refined in detection as in training
- balls and frames with few points are not filled with copies of points (pointnet.py)
- with `around_m`, key points are sampled only around proposals, as in PV-RCNN++ (Shi et al., IJCV
  2023); on a road of 200 m, farthest point sampling of all points would give one key point per car
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache

import torch
from torch import Tensor, nn
from torch.nn import functional

from pyinfra.core.config import ruled
from pyinfra.models.detectors.anchors import AnchorConfig, Anchors, encode
from pyinfra.models.detectors.batch import Batch
from pyinfra.models.detectors.bev import BevNetwork
from pyinfra.models.detectors.bev_config import BevConfig, multiple
from pyinfra.models.detectors.detection_area import Area, Site
from pyinfra.models.detectors.distributed import of_all
from pyinfra.models.detectors.losses import focal, smooth_l1
from pyinfra.models.detectors.network import Losses, Network
from pyinfra.models.detectors.pointnet import Ball, Clouds, SetAbstraction, mlp, shuffled
from pyinfra.models.detectors.pointpillars import AnchorHead
from pyinfra.models.detectors.voxel_backbone import VoxelBackbone
from pyinfra.models.detectors.windows import cut, view_of
from pyinfra.models.ops.boxes import best_overlap, nms
from pyinfra.models.ops.clouds import farthest_of_clouds, sizes_of
from pyinfra.models.ops.constants import constant
from pyinfra.models.ops.points import box_of_points, turned

# RADII: two radii in metres of balls around a key point, for the raw points and for each level of
# voxels. GRID_RADII: radii of balls around a grid point, for the key points.
RADII = ((0.4, 0.8), (0.4, 0.8), (0.8, 1.2), (1.2, 2.4), (2.4, 4.8))
GRID_RADII = (0.8, 1.6)

LEARNT_NMS_IOU, INFERENCE_NMS_IOU = 0.8, 0.7  # IoU limits of suppression in training and detection
FOREGROUND_IOU = 0.55  # minimum IoU of foreground proposals, whose refinement is trained
FOREGROUND_SHARE = 0.5  # largest share of foreground proposals in a training frame
BACKGROUND_IOU = 0.1  # background proposals with a higher IoU are hard examples
HARD_SHARE = 0.8  # share of hard proposals among the background proposals
POOR_IOU, GOOD_IOU = 0.25, 0.75  # IoU at which the target of the confidence is 0 and 1
UNSURE_M = 0.1  # key points up to this far outside a vehicle are left out of the loss
LARGEST = 5.0  # largest logarithm of the ratio of a box's size to the proposal's size


@dataclass(frozen=True)
class Config:
    """Sizes of the network; the defaults are the published sizes."""

    voxel_m: float = ruled(0.05, 0.02, 1)  # side of a voxel
    voxel_height_m: float = ruled(0.1, 0.02, 2)  # height of a voxel
    widths: tuple[int, int, int, int] = ruled((16, 32, 64, 64), 1, 512)  # channels of each level
    strides: tuple[int, int, int] = ruled((2, 2, 2), 1, 4)  # strides between levels along x and y
    canvas_width: int = ruled(128, 1, 512)  # channels of each height layer of the canvas
    bev: BevConfig = field(
        default_factory=lambda: BevConfig(
            layers=(5, 5), widths=(128, 256), strides=(1, 2), up_width=256
        )
    )
    anchors: AnchorConfig = field(default_factory=AnchorConfig)
    key_points: int = ruled(2048, 1, 65536)  # number of key points of a frame
    # largest distance of key points from proposals; 0 for no limit
    around_m: float = ruled(0.0, 0, 100)
    neighbours: int = ruled(16, 1, 256)  # maximum number of points in each ball
    key_width: int = ruled(128, 1, 1024)  # channels of a key point
    proposals: int = ruled(128, 1, 1024)  # proposals of a frame that are refined
    grid: int = ruled(6, 1, 16)  # grid points along each side of a proposal
    grid_width: int = ruled(64, 1, 512)  # channels of a grid point for each radius
    head_width: int = ruled(256, 1, 2048)  # channels of the layers of the second stage


class KeyPoints(nn.Module):
    """Computes features (m, key_width) of key points, multiplied by P(point is on a vehicle)."""

    def __init__(self, config: Config, area: Area, cell_m: float, canvas_channels: int) -> None:
        super().__init__()
        self.area, self.cell_m = area, cell_m
        widths = (config.widths[0], *config.widths)  # channels for raw points and each level
        sources = [
            SetAbstraction(channels, _balls(radii, config.neighbours, width))
            for channels, radii, width in zip((1, *config.widths), RADII, widths, strict=True)
        ]
        self.sources = nn.ModuleList(sources)
        gathered = canvas_channels + sum(source.channels for source in sources)
        self.fuse = mlp(gathered, [config.key_width])
        width = config.head_width
        self.foreground = nn.Sequential(mlp(gathered, [width, width]), nn.Linear(width, 1))

    def forward(
        self, clouds: list[Clouds], canvas: Tensor, xyz: Tensor, counts: Sequence[int]
    ) -> tuple[Clouds, Tensor]:
        """Returns the key points with features, and their foreground logits (m,).

        clouds: the raw points, followed by the voxels of each level. xyz: (m, 3) key points.
        counts: number of key points in each frame.
        """
        gathered_levels = [
            source(shuffled(cloud), xyz, counts).features
            for source, cloud in zip(self.sources, clouds, strict=True)
        ]
        gathered = torch.cat([*gathered_levels, self.seen_from_above(canvas, xyz, counts)], dim=1)
        logits: Tensor = self.foreground(gathered)[:, 0].float()
        features = self.fuse(gathered) * torch.sigmoid(logits)[:, None]
        return Clouds(xyz, features, counts), logits

    def seen_from_above(self, canvas: Tensor, xyz: Tensor, counts: Sequence[int]) -> Tensor:
        """Returns the features of the canvas (B, C, H, W), interpolated at key points: (m, C)."""
        low = constant(self.area.low[:2], xyz)
        size = constant([canvas.shape[3] * self.cell_m, canvas.shape[2] * self.cell_m], xyz)
        positions = 2 * (xyz[:, :2] - low) / size - 1  # positions (m, 2) in [-1, 1]
        features = [
            functional.grid_sample(
                canvas[i : i + 1], part[None, None], padding_mode="border", align_corners=False
            )[0, :, 0].t()
            for i, part in enumerate(positions.split_with_sizes(list(counts)))
            if len(part)
        ]
        return torch.cat([canvas.new_zeros(0, canvas.shape[1]), *features])


class Refinement(nn.Module):
    """Computes confidence logits (r,) and residuals (r, 7) of proposals from key points."""

    def __init__(self, config: Config) -> None:
        super().__init__()
        self.grid = config.grid
        balls = _balls(GRID_RADII, config.neighbours, config.grid_width)
        self.pool = SetAbstraction(config.key_width, balls)
        pooled, width = config.grid**3 * self.pool.channels, config.head_width
        self.shared = mlp(pooled, [width, width])
        self.score = nn.Sequential(mlp(width, [width, width]), nn.Linear(width, 1))
        last = nn.Linear(width, 7)
        nn.init.normal_(last.weight, std=0.001)
        nn.init.zeros_(last.bias)
        self.box = nn.Sequential(mlp(width, [width, width]), last)

    def forward(self, key: Clouds, boxes: Tensor, counts: list[int]) -> tuple[Tensor, Tensor]:
        """Returns confidences and residuals of the proposals `boxes` (r, 7).

        counts: number of proposals in each frame.
        """
        grid = grid_points(boxes, self.grid)  # grid points (r, g, 3)
        each = grid.shape[1]
        features = self.pool(key, grid.flatten(0, 1), [each * n for n in counts]).features
        # The number of columns is explicit, because -1 is ambiguous if there are no proposals.
        x = self.shared(features.reshape(len(grid), each * features.shape[1]))
        return self.score(x)[:, 0].float(), self.box(x).float()


class PvRcnn(Network):
    """The network PV-RCNN: sparse voxels, anchors, key points and a second stage."""

    learns_in_windows = True

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
        self.key_points = KeyPoints(config, area, cell_m, self.backbone.channels)
        self.refinement = Refinement(config)

    def losses(self, batch: Batch) -> Losses:
        voxel_m, step = self.config.voxel_m, self.bev.step * math.prod(self.config.strides)
        view = view_of(batch, self.site.area, voxel_m, step)
        batch = cut(batch, view, self.site.area, voxel_m)
        key_rows = KeyRows(self, batch)
        levels, canvas = self.backbone(batch, view)
        x = self.bev(canvas)
        first = self.head.losses(x, batch.boxes)
        proposals = self.proposals(x, LEARNT_NMS_IOU)
        chosen = [
            boxes[spread_by_overlap(best_overlap(boxes, truth)[0], self.config.proposals)]
            for boxes, truth in zip(proposals, batch.boxes, strict=True)
        ]
        key, logits = self.gather(key_rows, levels, canvas, chosen)
        scores, residuals = self.refinement(key, torch.cat(chosen), [len(b) for b in chosen])
        second = refinement_losses(scores, residuals, chosen, batch.boxes)
        return {**first, "point": foreground_loss(key, logits, batch.boxes), **second}

    def candidates(self, batch: Batch) -> list[tuple[Tensor, Tensor]]:
        key_rows = KeyRows(self, batch)
        levels, canvas = self.backbone(batch)
        proposals = self.proposals(self.bev(canvas), INFERENCE_NMS_IOU)
        proposals = [boxes[: self.config.proposals] for boxes in proposals]
        key, _ = self.gather(key_rows, levels, canvas, proposals)
        proposed, counts = torch.cat(proposals), [len(boxes) for boxes in proposals]
        scores, residuals = self.refinement(key, proposed, counts)
        boxes = refined(proposed, residuals).split_with_sizes(counts)
        return list(zip(boxes, torch.sigmoid(scores).split_with_sizes(counts), strict=True))

    @torch.no_grad()
    def proposals(self, x: Tensor, iou: float) -> list[Tensor]:
        """Returns the proposals (r, 7) of each frame after suppression with `iou`, best first."""
        remaining = []
        for boxes, scores in self.head.candidates(x):
            good = torch.isfinite(boxes).all(dim=1) & torch.isfinite(scores)
            boxes, scores = boxes[good], scores[good]
            remaining.append(boxes[nms(boxes, scores, iou, len(boxes))])
        return remaining

    def gather(
        self, key_rows: KeyRows, levels: list[Clouds], canvas: Tensor, proposals: list[Tensor]
    ) -> tuple[Clouds, Tensor]:
        """Returns the key points with features, and their foreground logits (m,)."""
        raw = key_rows.raw
        rows, counts = key_rows.result(proposals)
        key: tuple[Clouds, Tensor] = self.key_points([raw, *levels], canvas, raw.xyz[rows], counts)
        return key

    @torch.no_grad()
    def rows_of_key_points(
        self, raw: Clouds, proposals: list[Tensor]
    ) -> tuple[Tensor, Sequence[int]]:
        """Returns the rows (m,) of the key points and their number in each frame.

        Key points are selected by farthest point sampling.
        """
        candidates = torch.arange(len(raw.xyz), device=raw.xyz.device)
        counts = list(sizes_of(raw.counts))
        if self.config.around_m > 0:
            parts = zip(
                candidates.split_with_sizes(counts),
                raw.xyz.split_with_sizes(counts),
                proposals,
                strict=True,
            )
            near = [rows[is_around(xyz, boxes, self.config.around_m)] for rows, xyz, boxes in parts]
            candidates, counts = torch.cat(near), [len(part) for part in near]
        most = self.config.key_points
        rows, key_counts = farthest_of_clouds(raw.xyz[candidates], counts, most)
        return candidates[rows], sizes_of(key_counts)


class KeyRows:
    """The rows of the key points, as `PvRcnn.rows_of_key_points` returns them.

    If key points do not depend on proposals, a GPU samples them on a second stream, while it
    computes the first stage.
    """

    def __init__(self, network: PvRcnn, batch: Batch) -> None:
        self.network, self.raw, self.early = network, raw_points(batch), None
        if network.config.around_m == 0 and self.raw.xyz.is_cuda:
            self.stream = _second_stream(self.raw.xyz.device)
            self.stream.wait_stream(torch.cuda.current_stream())
            with torch.cuda.stream(self.stream):
                self.early = network.rows_of_key_points(self.raw, [])

    def result(self, proposals: list[Tensor]) -> tuple[Tensor, Sequence[int]]:
        if self.early is None:
            return self.network.rows_of_key_points(self.raw, proposals)
        torch.cuda.current_stream().wait_stream(self.stream)
        self.early[0].record_stream(torch.cuda.current_stream())
        return self.early


@cache
def _second_stream(device: torch.device) -> torch.cuda.Stream:
    return torch.cuda.Stream(device)  # type: ignore[no-untyped-call]


def raw_points(batch: Batch) -> Clouds:
    """Returns the points of a batch as clouds; the columns after x y z are the features."""
    return Clouds(batch.points[:, :3].contiguous(), batch.points[:, 3:], list(batch.counts))


def is_around(xyz: Tensor, boxes: Tensor, margin_m: float) -> Tensor:
    """Returns which points are in the vertical cylinder around a box (r, 7): (n,) bool.

    The circle of the cylinder circumscribes the footprint, with a radius that is larger by
    `margin_m`. The height does not matter.
    """
    reach = boxes[:, 3:5].norm(dim=1) / 2 + margin_m
    result = torch.zeros(len(xyz), dtype=torch.bool, device=xyz.device)
    for box, far in zip(boxes, reach, strict=True):
        result |= (xyz[:, 0] - box[0]) ** 2 + (xyz[:, 1] - box[1]) ** 2 < far**2
    return result


def grid_points(boxes: Tensor, grid: int) -> Tensor:
    """Returns the centres of the grid cells in each box (r, 7): (r, grid^3, 3)."""
    share = (torch.arange(grid, device=boxes.device) + 0.5) / grid - 0.5
    local = torch.cartesian_prod(share, share, share) * boxes[:, None, 3:6]
    return boxes[:, None, :3] + turned(local, boxes[:, 6, None])


def refined(boxes: Tensor, residuals: Tensor) -> Tensor:
    """Returns the boxes (r, 7) of residuals (r, 7) in the frames of `boxes` (r, 7)."""
    diagonal = boxes[:, 3:5].norm(dim=1, keepdim=True)
    scale = torch.cat([diagonal, diagonal, boxes[:, 5:6]], dim=1)
    xyz = boxes[:, :3] + turned(residuals[:, :3] * scale, boxes[:, 6])
    sizes = boxes[:, 3:6] * residuals[:, 3:6].clamp(-LARGEST, LARGEST).exp()
    heading = (boxes[:, 6:] + residuals[:, 6:] + math.pi) % (2 * math.pi) - math.pi
    return torch.cat([xyz, sizes, heading], dim=1)


def wanted_residuals(boxes: Tensor, truth: Tensor) -> Tensor:
    """Returns the residuals (r, 7) from boxes to vehicles (r, 7), the inverse of `refined`.

    Headings are modulo half a turn, because the first stage already predicts which end is the
    front.
    """
    at_origin = torch.cat([torch.zeros_like(boxes[:, :3]), boxes[:, 3:6], boxes[:, :1] * 0], dim=1)
    offset = turned(truth[:, :3] - boxes[:, :3], -boxes[:, 6])
    turn = (truth[:, 6:] - boxes[:, 6:] + math.pi / 2) % math.pi - math.pi / 2
    return encode(torch.cat([offset, truth[:, 3:6], turn], dim=1), at_origin)


def spread_by_overlap(overlap: Tensor, most: int) -> Tensor:
    """Returns the rows of at most `most` proposals for training.

    The order is foreground, hard background, other background. overlap: (r,) highest IoU of each
    proposal.
    """
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
    """Returns the losses of the second stage.

    scores: (r,), residuals: (r, 7) of the proposals of all frames. boxes: vehicles of each frame.
    """
    overlaps, targets = [scores.new_zeros(0)], [residuals.new_zeros(0, 7)]
    for proposed, truth in zip(proposals, boxes, strict=True):
        overlap, row = best_overlap(proposed, truth)
        overlaps.append(overlap)
        targets.append(truth[row] if len(truth) else proposed)
    overlap, truth, proposed = torch.cat(overlaps), torch.cat(targets), torch.cat(proposals)
    wanted = ((overlap - POOR_IOU) / (GOOD_IOU - POOR_IOU)).clamp(0, 1)
    score = functional.binary_cross_entropy_with_logits(scores, wanted, reduction="sum")
    on = overlap >= FOREGROUND_IOU
    count = of_all(on.sum())
    box = smooth_l1(residuals[on], wanted_residuals(proposed[on], truth[on])).sum()
    corner = corner_loss(refined(proposed[on], residuals[on]), truth[on]).sum()
    return {
        "confidence": score / of_all(torch.full((), len(scores), device=scores.device)),
        "refinement": box / count,
        "corner": corner / count,
    }


def corner_loss(predicted: Tensor, truth: Tensor) -> Tensor:
    """Returns the mean loss of the corner distances of boxes (r, 7): (r,).

    Each corner has two distances: to the vehicle, and to the vehicle turned by half a turn. The
    smaller distance counts.
    """
    half_turn = truth + constant([0, 0, 0, 0, 0, 0, math.pi], truth)
    corners = grid_corners(predicted)
    apart = torch.minimum(
        (corners - grid_corners(truth)).norm(dim=2), (corners - grid_corners(half_turn)).norm(dim=2)
    )
    return smooth_l1(apart, torch.zeros_like(apart), beta=1.0).mean(dim=1)


def grid_corners(boxes: Tensor) -> Tensor:
    """Returns the corners of boxes: (r, 8, 3).

    The grid points of a 2 x 2 x 2 grid lie halfway between the centre and the corners.
    """
    middle = boxes[:, None, :3]
    return middle + 2 * (grid_points(boxes, 2) - middle)


def foreground_loss(key: Clouds, logits: Tensor, boxes: tuple[Tensor, ...]) -> Tensor:
    """Returns the focal loss of key points. Points just outside vehicles have no loss."""
    on, near = [logits.new_zeros(0, dtype=torch.bool)], [logits.new_zeros(0, dtype=torch.bool)]
    sizes = list(sizes_of(key.counts))
    for xyz, frame_boxes in zip(key.xyz.split_with_sizes(sizes), boxes, strict=True):
        wider = frame_boxes + constant([0, 0, 0, *[2 * UNSURE_M] * 3, 0], frame_boxes)
        on.append(box_of_points(xyz, frame_boxes) >= 0)
        near.append(box_of_points(xyz, wider) >= 0)
    target = torch.cat(on)
    counts = target | ~torch.cat(near)
    loss = focal(logits[counts], target[counts].to(logits.dtype)).sum()
    return loss / of_all(target.sum())


def _balls(radii: tuple[float, ...], most: int, width: int) -> list[Ball]:
    return [Ball(radius, most, (width, width)) for radius in radii]


def _evenly(rows: Tensor, most: int) -> Tensor:
    if len(rows) <= most:
        return rows
    return rows[torch.arange(most, device=rows.device) * len(rows) // most]
