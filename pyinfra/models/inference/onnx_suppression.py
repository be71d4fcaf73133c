"""Non-maximum suppression in operators that ONNX has, for boxes of any heading.

The operator `NonMaxSuppression` of ONNX has boxes without a heading, which overlap their
neighbours on diagonal roads. The suppression here is that of the detectors (`suppression.py`): a
box is left out if its footprint overlaps a better remaining box of its class by more than NMS_IOU.
"""

import torch
from torch import Tensor

from pyinfra.models.detectors.suppression import NMS_IOU

# Number of steps of the suppression. Whether a box remains can depend on a chain of better boxes,
# and each step decides one box of the chain. Chains are shorter than STEPS in practice.
STEPS = 12
FLAT = 1e-6  # smaller changes of a coordinate along an edge are set to this value, metres


def remaining(boxes: Tensor, scores: Tensor, classes: Tensor, min_score: float) -> Tensor:
    """Returns the indices of the boxes that remain, best first.

    boxes: (k, 7). scores, classes: (k,). Boxes below min_score are left out.
    """
    good = torch.nonzero(scores >= min_score).flatten()
    order = good[torch.argsort(scores[good], descending=True)]
    boxes, classes = boxes[order], classes[order]
    radius = boxes[:, 3:5].square().sum(dim=1).sqrt() / 2
    apart = boxes[:, None, :2] - boxes[None, :, :2]
    near = apart.square().sum(dim=2).sqrt() < radius[:, None] + radius[None, :]
    rank = torch.arange(boxes.shape[0])
    worse = (rank[:, None] > rank[None, :]) & (classes[:, None] == classes[None, :])
    pairs = torch.nonzero(near & worse)
    later, better = pairs[:, 0], pairs[:, 1]
    overlap = (overlaps(boxes[later], boxes[better]) > NMS_IOU).to(boxes.dtype)
    above = torch.zeros_like(near, dtype=boxes.dtype).index_put((later, better), overlap)
    kept = torch.ones_like(radius)
    for _ in range(STEPS):
        kept = ((above * kept[None, :]).sum(dim=1) < 0.5).to(boxes.dtype)
    return order[torch.nonzero(kept > 0.5).flatten()]


def overlaps(a: Tensor, b: Tensor) -> Tensor:
    """Returns the IoU (m,) of the footprints of boxes (m, 7) and (m, 7).

    The border of the intersection consists of the parts of each footprint's edges inside the other.
    """
    shift = b[:, :2] - a[:, :2]
    none = torch.zeros_like(shift)
    common = _inside(_corners(a, none), b, shift) + _inside(_corners(b, shift), a, none)
    areas = a[:, 3] * a[:, 4] + b[:, 3] * b[:, 4]
    return common / (areas - common).clamp(min=FLAT)


def _turned(xy: Tensor, headings: Tensor) -> Tensor:
    """Returns points (m, 4, 2) that are turned by headings (m,)."""
    cos, sin = headings.cos()[:, None], headings.sin()[:, None]
    x, y = xy[..., 0], xy[..., 1]
    return torch.stack([cos * x - sin * y, sin * x + cos * y], dim=2)


def _corners(boxes: Tensor, centres: Tensor) -> Tensor:
    """Returns the corners (m, 4, 2) of boxes moved to `centres` (m, 2), counterclockwise."""
    signs = torch.tensor([[1.0, 1], [-1, 1], [-1, -1], [1, -1]], dtype=boxes.dtype)
    corners = signs[None] * boxes[:, None, 3:5] / 2
    return _turned(corners, boxes[:, 6]) + centres[:, None]


def _inside(corners: Tensor, boxes: Tensor, centres: Tensor) -> Tensor:
    """Returns the area (m,) swept from the origin along the parts of the edges in the boxes."""
    start, edge = corners, torch.cat([corners[:, 1:], corners[:, :1]], dim=1) - corners
    at = _turned(start - centres[:, None], -boxes[:, 6])
    along = _turned(edge, -boxes[:, 6])
    along = torch.where(along.abs() < FLAT, torch.full_like(along, FLAT), along)
    half = boxes[:, None, 3:5] / 2
    one, two = (-half - at) / along, (half - at) / along
    enter = torch.minimum(one, two).amax(dim=2).clamp(min=0)
    leave = torch.maximum(one, two).amin(dim=2).clamp(max=1)
    first, last = start + enter[..., None] * edge, start + leave[..., None] * edge
    cross = first[..., 0] * last[..., 1] - first[..., 1] * last[..., 0]
    return torch.where(leave > enter, cross, torch.zeros_like(cross)).sum(dim=1) / 2
