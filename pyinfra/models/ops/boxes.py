"""Overlap of rotated boxes and non-maximum suppression, in PyTorch.

A box is `x y z dx dy dz heading` as in `pyinfra.core.boxes`, which has the same functions for
NumPy. The overlaps are differentiable in all seven numbers of both boxes, except for equal or
touching boxes. For such boxes the gradient is finite and equal to a one-sided gradient.
"""

import torch
from torch import Tensor

from pyinfra.models.ops.constants import constant
from pyinfra.models.ops.kernels import kernels, on_cpu
from pyinfra.models.ops.points import chunk_of

# An overlap counts as 0 if it is below this number of rounding errors of the squared size of the
# larger box.
_ROUNDING = 4
_PAIRS = 1 << 22  # number of pairs whose overlaps are computed together
_ROUNDS = 8  # number of rounds of a suppression before each test of whether it has ended

# Corners of the unit box, counter-clockwise from front right.
_AHEAD = (0.5, 0.5, -0.5, -0.5)
_LEFT = (-0.5, 0.5, 0.5, -0.5)


@torch.no_grad()
def best_overlap(a: Tensor, b: Tensor) -> tuple[Tensor, Tensor]:
    """Returns the highest 3-D IoU of each box of a with a box of b, and the row of that box.

    a: (n, 7), b: (m, 7), in the same frame. The results are (n,) in [0, 1] and (n,) int64. A box
    without overlap has an IoU of exactly 0, and row 0. If b is empty, all boxes have these values.
    """
    if not len(b):
        return a.new_zeros(len(a)), torch.zeros_like(a[:, 0], dtype=torch.int64)
    i, j = _near_pairs(a, b)
    overlap = iou_3d_pairs(a[i], b[j])
    best = overlap.new_zeros(len(a), len(b)).index_put((i, j), overlap).max(dim=1)
    return best.values, best.indices


def bev_iou_pairs(a: Tensor, b: Tensor) -> Tensor:
    """Returns the IoU of the footprints, row by row: (n, 7) and (n, 7) to (n,) in [0, 1].

    The IoU of a pair without overlap is exactly 0.
    """
    a, b = _at_least_float32(a), _at_least_float32(b)
    overlap = bev_overlap_pairs(a, b)
    return _ratio(overlap, a[:, 3] * a[:, 4] + b[:, 3] * b[:, 4] - overlap)


def iou_3d_pairs(a: Tensor, b: Tensor) -> Tensor:
    """Returns the IoU of the volumes, row by row: (n, 7) and (n, 7) to (n,) in [0, 1]."""
    a, b = _at_least_float32(a), _at_least_float32(b)
    between = b[:, 2] - a[:, 2]  # height relative to a's centre, to avoid rounding errors
    top = torch.minimum(a[:, 5] / 2, between + b[:, 5] / 2)
    bottom = torch.maximum(-a[:, 5] / 2, between - b[:, 5] / 2)
    shared = bev_overlap_pairs(a, b) * (top - bottom).clamp(min=0)
    return _ratio(shared, a[:, 3:6].prod(1) + b[:, 3:6].prod(1) - shared)


def bev_overlap_pairs(a: Tensor, b: Tensor) -> Tensor:
    """Returns the area that the footprints of a and b share, row by row: (n, 7), (n, 7) to (n,).

    As in `pyinfra.core.boxes`, Green's theorem is applied along the edges of b in the frame of a.
    The area is the sum over the edges of (mean of x, clipped to a's length) * (change of y, clipped
    to a's width).
    """
    length, width = a[:, 3, None] / 2, a[:, 4, None] / 2
    x, y = _corners_seen_from(a, b)  # corners of b, (n, 4) each
    x_step, y_step = x.roll(-1, 1) - x, y.roll(-1, 1) - y
    from_y = y.clamp(-width, width)
    to_y = from_y.roll(-1, 1)
    # Shares of an edge's length at which the edge enters and leaves the range of y of box a.
    size = torch.maximum(a[:, 3:5], b[:, 3:5]).amax(1).detach()
    level = y_step.abs() <= torch.finfo(y.dtype).eps * size[:, None]
    rise = torch.where(level, 1, y_step)
    enters = torch.where(level, 0, (from_y - y) / rise)
    leaves = torch.where(level, 1, (to_y - y) / rise)
    mean_x = _mean_clipped(x + enters * x_step, x + leaves * x_step, length)
    area = (mean_x * (to_y - from_y)).sum(1)
    area = torch.minimum(area, torch.minimum(a[:, 3] * a[:, 4], b[:, 3] * b[:, 4]))
    touches = area <= _ROUNDING * torch.finfo(y.dtype).eps * size * size
    return torch.where(touches, 0, area)


def nms(boxes: Tensor, scores: Tensor, iou: float, limit: int) -> Tensor:
    """Returns the rows of boxes that remain after greedy non-maximum suppression.

    A box is removed if its IoU with a remaining box of a higher score is above `iou`. If two boxes
    have equal scores, the first row counts as the higher score. boxes: (n, 7), scores: (n,), all
    finite. The result is (k,) int64 by descending score, with k <= limit.
    """
    order = torch.argsort(scores, descending=True, stable=True)
    best_first = boxes.detach()[order].double()
    if kernels is not None and on_cpu(boxes):
        return order[torch.from_numpy(kernels.suppress(best_first.numpy(), iou, limit))]
    return order[_suppress(best_first, iou)[:limit]]


def _suppress(boxes: Tensor, iou: float) -> Tensor:
    """Returns the rows of boxes (n, 7), sorted best first, that remain after suppression: (k,).

    In each round, the boxes that remained in the last round remove others, all at the same time.
    A round fixes at least one more box, from the best to the worst. The rounds end when no box
    changes, and then the result is that of the greedy order.
    """
    better, worse = _overlapping(boxes, iou)
    remains = torch.ones(len(boxes), dtype=torch.bool, device=boxes.device)
    while True:
        for _ in range(_ROUNDS):
            before = remains
            removals = worse.new_zeros(len(boxes)).index_add(0, worse, remains[better].long())
            remains = removals == 0
        if not len((remains != before).nonzero()):
            return remains.nonzero()[:, 0]


def _overlapping(boxes: Tensor, iou: float) -> tuple[Tensor, Tensor]:
    """Returns the pairs of rows (i, j), i < j, of boxes (n, 7) with an IoU above `iou`."""
    i, j = _near_pairs(boxes, boxes)
    i, j = i[i < j], j[i < j]
    above = [
        bev_iou_pairs(boxes[a], boxes[b]) > iou
        for a, b in zip(torch.split(i, _PAIRS), torch.split(j, _PAIRS), strict=True)
    ]
    kept = torch.cat([torch.zeros_like(i[:0], dtype=torch.bool), *above])
    return i[kept], j[kept]


def _near_pairs(a: Tensor, b: Tensor) -> tuple[Tensor, Tensor]:
    """Returns rows i of a and j of b, sorted: the pairs whose circumscribed circles touch."""
    a, b = a.detach(), b.detach()
    reach_a, reach_b = a[:, 3:5].norm(dim=1) / 2, b[:, 3:5].norm(dim=1) / 2
    rows = max(1, chunk_of(a) // max(1, len(b)))
    pairs = [torch.zeros(0, 2, dtype=torch.int64, device=a.device)]
    for start in range(0, len(a), rows):
        part = slice(start, start + rows)
        apart = (a[part, None, 0] - b[:, 0]) ** 2 + (a[part, None, 1] - b[:, 1]) ** 2
        near = (apart <= (reach_a[part, None] + reach_b) ** 2).nonzero()
        near[:, 0] += start
        pairs.append(near)
    i, j = torch.cat(pairs).unbind(1)
    return i, j


def _corners_seen_from(a: Tensor, b: Tensor) -> tuple[Tensor, Tensor]:
    """Returns x and y of b's corners in a's frame, (n, 4) each."""
    cos, sin = a[:, 6].cos(), a[:, 6].sin()
    dx, dy = b[:, 0] - a[:, 0], b[:, 1] - a[:, 1]
    x, y = (cos * dx + sin * dy)[:, None], (cos * dy - sin * dx)[:, None]
    turn = (b[:, 6] - a[:, 6])[:, None]
    ahead, left = b[:, 3, None] * constant(_AHEAD, b), b[:, 4, None] * constant(_LEFT, b)
    cos, sin = turn.cos(), turn.sin()
    return x + cos * ahead - sin * left, y + sin * ahead + cos * left


def _mean_clipped(start: Tensor, end: Tensor, limit: Tensor) -> Tensor:
    """Returns the mean of clip(x, -limit, limit) for x from start to end.

    The mean is computed from the middle of the clipped part and the shares above and below it.
    Therefore neither the value nor the gradient divides a difference of large numbers by a small
    number.
    """
    first, last = torch.minimum(start, end), torch.maximum(start, end)
    middle = (first.clamp(-limit, limit) + last.clamp(-limit, limit)) / 2
    span = torch.where(last > first, last - first, 1)
    above = ((last - limit) / span).clamp(0, 1)
    below = ((-limit - first) / span).clamp(0, 1)
    return middle + above * (limit - middle) - below * (limit + middle)


def _ratio(part: Tensor, whole: Tensor) -> Tensor:
    """Returns part / whole, and 0 where whole is 0."""
    return torch.where(whole > 0, part / torch.where(whole > 0, whole, 1), 0)


def _at_least_float32(boxes: Tensor) -> Tensor:
    return boxes.to(torch.promote_types(boxes.dtype, torch.float32))
