"""Distances and interpolation of points, and points in boxes.

Coordinates are (n, 3) float32, metres. Rows are int64.
"""

import torch
from torch import Tensor

from pyinfra.models.ops.kernels import on_cpu

# Number of distances that are computed at once. The number is larger on a GPU, because small steps
# do not keep a GPU busy.
_CHUNK, _CHUNK_ON_GPU = 1 << 22, 1 << 27


def chunk_of(tensor: Tensor) -> int:
    """Returns how many distances are computed together on the device of a tensor."""
    return _CHUNK if on_cpu(tensor) else _CHUNK_ON_GPU


def interpolate(features: Tensor, distances: Tensor, rows: Tensor) -> Tensor:
    """Interpolates features (m, c) of m points at n other points: (n, c), weighted by 1 / distance.

    distances, rows: (n, 3), the results of `clouds.nearest_of_clouds`.
    """
    weights = 1 / (distances + 1e-8)
    weights = weights / weights.sum(1, keepdim=True)
    return (features[rows] * weights[:, :, None]).sum(1)


@torch.no_grad()
def points_in_boxes(points: Tensor, boxes: Tensor) -> Tensor:
    """Returns whether each point is in each box or on its surface: (n, m) bool.

    points: (n, 3) or more columns. boxes: (m, 7) x y z dx dy dz heading.
    """
    result = torch.zeros(len(points), len(boxes), dtype=torch.bool, device=points.device)
    cos, sin = boxes[:, 6].cos(), boxes[:, 6].sin()
    done = 0
    for part in _parts(points[:, :3], len(boxes)):
        dx, dy, dz = (part[:, None] - boxes[:, :3]).unbind(2)  # offsets (rows, m)
        ahead, left = cos * dx + sin * dy, cos * dy - sin * dx
        inside = (ahead.abs() <= boxes[:, 3] / 2) & (left.abs() <= boxes[:, 4] / 2)
        result[done : done + len(part)] = inside & (dz.abs() <= boxes[:, 5] / 2)
        done += len(part)
    return result


def box_of_points(points: Tensor, boxes: Tensor) -> Tensor:
    """Returns the row of the first box that each point is in: (n,), -1 for none."""
    if not len(boxes):
        return torch.full((len(points),), -1, device=points.device)
    inside = points_in_boxes(points, boxes)
    return torch.where(inside.any(1), inside.int().argmax(1), -1)


def turned(xyz: Tensor, heading: Tensor) -> Tensor:
    """Returns points (..., 3), turned about z by headings (...)."""
    cos, sin = heading.cos(), heading.sin()
    x, y, z = xyz.unbind(-1)
    return torch.stack([cos * x - sin * y, sin * x + cos * y, z], dim=-1)


def _parts(xyz: Tensor, others: int) -> list[Tensor]:
    """Divides xyz into parts, so that the distances to `others` points fit into memory."""
    rows = max(1, chunk_of(xyz) // max(1, others))
    return [xyz[start : start + rows] for start in range(0, len(xyz), rows)]


def squared(dx: Tensor, dy: Tensor, dz: Tensor) -> Tensor:
    """Returns the squared lengths of offsets along x, y and z."""
    # The order of operations is the same as in the compiled kernels, so that PyTorch and the
    # kernels select the same points.
    return dx * dx + dy * dy + dz * dz
