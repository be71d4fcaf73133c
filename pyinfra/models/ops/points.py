"""Sampling and search of points for networks on points (Qi et al., PointNet++, 2017).

Each function gets the coordinates of one cloud, (n, 3) float32, metres, because the clouds of a
batch differ in size. Searches have no gradient and raise ValueError for values that are not finite.
Rows are int64.
"""

import torch
from scipy.spatial import cKDTree
from torch import Tensor

from pyinfra.models.ops.kernels import kernels, on_cpu

# Number of distances that are computed at once. The number is larger on a GPU, because small steps
# do not keep a GPU busy.
_CHUNK, _CHUNK_ON_GPU = 1 << 22, 1 << 27


def chunk_of(tensor: Tensor) -> int:
    """Returns how many distances are computed together on the device of a tensor."""
    return _CHUNK if on_cpu(tensor) else _CHUNK_ON_GPU


@torch.no_grad()
def farthest_points(xyz: Tensor, k: int) -> Tensor:
    """Returns k rows of xyz (n, 3) by farthest point sampling.

    The first row is row 0. Each next row is the point that is farthest from all previous points. If
    several points are equally far, the point with the lowest row is taken. If k > n, row 0 is
    repeated. Raises ValueError for n = 0.
    """
    _check(xyz)
    if not len(xyz):
        raise ValueError("xyz: expected points, got none")
    if kernels is not None and on_cpu(xyz):
        return torch.from_numpy(kernels.farthest_points(xyz.contiguous().numpy(), k))
    columns = xyz.t().contiguous()  # coordinates (3, n)
    chosen = torch.zeros(k, dtype=torch.int64, device=xyz.device)
    apart = torch.full_like(columns[0], torch.inf)
    for count in range(1, k):
        # The index is a slice, because reading a single number would make the CPU wait for the GPU.
        last = columns.index_select(1, chosen[count - 1 : count])  # last chosen point (3, 1)
        torch.minimum(apart, squared(*(columns - last)), out=apart)
        chosen[count] = apart.argmax()
    return chosen


@torch.no_grad()
def ball_query(points: Tensor, centres: Tensor, radius: float, k: int) -> tuple[Tensor, Tensor]:
    """Returns the first k points, by row, that are closer to each centre than the radius (metres).

    points: (n, 3), centres: (m, 3). The results are rows (m, k) and a mask (m,) bool, which is true
    for an empty ball. If a ball has fewer than k points, its first point is repeated. The rows of
    an empty ball are 0.
    """
    _check(points)
    _check(centres)
    if radius <= 0 or k < 1:
        raise ValueError(f"radius, k: expected above 0, got {radius}, {k}")
    if kernels is not None and on_cpu(points):
        indices, empty = kernels.ball_query(
            points.contiguous().numpy(), centres.contiguous().numpy(), radius, k
        )
        return torch.from_numpy(indices), torch.from_numpy(empty).bool()
    n = len(points)
    limit = points.new_tensor(radius) ** 2
    row = torch.arange(n, device=points.device)
    parts = [row.new_zeros(0, k)]
    for part in _parts(centres, n):
        near = torch.where(_squared_distances(part, points) < limit, row, n)  # row if near, else n
        first = near.topk(min(k, n), largest=False).values.sort().values
        parts.append(torch.nn.functional.pad(first, (0, k - min(k, n)), value=n))
    indices = torch.cat(parts)
    indices = torch.where(indices == n, indices[:, :1], indices)
    empty = indices[:, 0] == n
    return torch.where(empty[:, None], 0, indices), empty


@torch.no_grad()
def three_nearest(points: Tensor, known: Tensor) -> tuple[Tensor, Tensor]:
    """Returns the distances (n, 3), metres, and rows (n, 3) of the three nearest known points.

    points: (n, 3), known: (m, 3). The nearest point comes first. The order of equally near points
    is undefined. If m < 3, each missing point has row 0 and an infinite distance. Raises ValueError
    for m = 0.
    """
    _check(points)
    _check(known)
    if not len(known):
        raise ValueError("known: expected points, got none")
    if on_cpu(points):
        distances, indices = cKDTree(known.numpy()).query(points.numpy(), k=3)
        indices[indices == len(known)] = 0
        return torch.from_numpy(distances).to(points.dtype), torch.from_numpy(indices)
    return _nearest_of_all(points, known)


def interpolate(features: Tensor, distances: Tensor, rows: Tensor) -> Tensor:
    """Interpolates features (m, c) of known points to (n, c), weighted by 1 / distance.

    distances, rows: (n, 3), the results of `three_nearest`.
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


def _nearest_of_all(points: Tensor, known: Tensor) -> tuple[Tensor, Tensor]:
    """Computes `three_nearest` from the distances of all pairs, without a search tree."""
    most = min(3, len(known))
    squared, indices = [points.new_zeros(0, most)], [points.new_zeros(0, most).long()]
    for part in _parts(points, len(known)):
        nearest = _squared_distances(part, known).topk(most, largest=False)
        squared.append(nearest.values)
        indices.append(nearest.indices)
    distances = torch.cat(squared).sqrt()
    pad = torch.nn.functional.pad
    return pad(distances, (0, 3 - most), value=torch.inf), pad(torch.cat(indices), (0, 3 - most))


def _parts(xyz: Tensor, others: int) -> list[Tensor]:
    """Divides xyz into parts, so that the distances to `others` points fit into memory."""
    rows = max(1, chunk_of(xyz) // max(1, others))
    return [xyz[start : start + rows] for start in range(0, len(xyz), rows)]


def _squared_distances(a: Tensor, b: Tensor) -> Tensor:
    """Returns the squared distances of (n, 3) and (m, 3): (n, m).

    They are sums of squared differences, which are more exact than a difference of large squares.
    """
    return squared(*(a[:, None, axis] - b[:, axis] for axis in range(3)))


def squared(dx: Tensor, dy: Tensor, dz: Tensor) -> Tensor:
    """Returns the squared lengths of offsets along x, y and z."""
    # The order of operations is the same as in the compiled kernels, so that PyTorch and the
    # kernels select the same points.
    return dx * dx + dy * dy + dz * dz


def _check(xyz: Tensor) -> None:
    if xyz.ndim != 2 or xyz.shape[1] != 3 or xyz.dtype != torch.float32:
        actual = f"{tuple(xyz.shape)} {xyz.dtype}"
        raise ValueError(f"points: expected (n, 3) torch.float32, got {actual}")
    if on_cpu(xyz) and not xyz.isfinite().all():
        raise ValueError("points: expected finite values, got NaN or inf")
