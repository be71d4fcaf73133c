"""Sampling and search of points in concatenated clouds, for a whole batch at once.

On a CPU the clouds are processed one by one, by the compiled extension and SciPy. On a GPU, and
without the extension, all clouds are processed together. On a GPU, no value is read by the CPU, and
farthest point sampling and the search in balls are Triton kernels (triton_kernels.py) if Triton is
installed. The PyTorch code copies the clouds to an array in which all clouds have the length of the
longest.

Coordinates are (n, 3) float32, metres, all clouds concatenated. `counts` are the numbers of points
of the clouds: integers, or a tensor (clouds,) int64 if the CPU does not know them. Rows are int64.
Searches have no gradient. They are those of PointNet++ (Qi et al., 2017).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from scipy.spatial import cKDTree
from torch import Tensor

from pyinfra.models.ops import triton_kernels
from pyinfra.models.ops.constants import constant, numbers
from pyinfra.models.ops.kernels import kernels, on_cpu
from pyinfra.models.ops.points import chunk_of, squared

Counts = Sequence[int] | Tensor


def sizes_of(counts: Counts) -> Sequence[int]:
    """Returns counts as integers. On a GPU this makes the CPU wait."""
    return counts.tolist() if isinstance(counts, Tensor) else counts


def on_device(counts: Counts, like: Tensor) -> Tensor:
    """Returns counts as a tensor (clouds,) int64 on the device of `like`."""
    return counts if isinstance(counts, Tensor) else numbers(counts, like.device)


def most_of(counts: Counts, most: int) -> Counts:
    """Returns the smaller of each count and `most`."""
    if isinstance(counts, Tensor):
        return counts.clamp(max=most)
    return [min(count, most) for count in counts]


def cloud_of_rows(counts: Counts, xyz: Tensor) -> Tensor:
    """Returns the number of the cloud of each point: (n,)."""
    number = on_device(counts, xyz)
    clouds = torch.arange(len(number), device=xyz.device)
    return torch.repeat_interleave(clouds, number, output_size=len(xyz))


@torch.no_grad()
def farthest_of_clouds(xyz: Tensor, counts: Counts, most: int) -> tuple[Tensor, Counts]:
    """Samples at most `most` points of each cloud by farthest point sampling.

    Returns the rows (m,) of the sampled points and their number in each cloud. All points of a
    cloud with up to `most` points are returned, in their order. In a larger cloud, the first point
    is sampled, and then the point that is farthest from all previous points. If several points are
    equally far, the point with the lowest row is taken.
    """
    if kernels is not None and on_cpu(xyz):
        indices, start = [torch.zeros(0, dtype=torch.int64)], 0
        for count in sizes_of(counts):
            if count > most:
                cloud = xyz[start : start + count].contiguous().numpy()
                indices.append(start + torch.from_numpy(kernels.farthest_points(cloud, most)))
            else:
                indices.append(torch.arange(start, start + count))
            start += count
        return torch.cat(indices), most_of(counts, most)
    number = on_device(counts, xyz)
    if triton_kernels.usable(xyz):
        rows = triton_kernels.farthest(xyz, number, most)
    else:
        rows = _farthest_of_all(xyz, number, most)
    if not isinstance(counts, Tensor):  # with known counts, the CPU does not wait for a GPU
        parts = [of_cloud[:count] for of_cloud, count in zip(rows, counts, strict=True)]
        return torch.cat([rows.new_zeros(0), *parts]), most_of(counts, most)
    exists = torch.arange(most, device=xyz.device) < number[:, None]
    return rows[exists], most_of(counts, most)


@torch.no_grad()
def neighbours(
    xyz: Tensor, counts: Counts, centres: Tensor, of_centres: Counts, radius: float, most: int
) -> tuple[Tensor, Tensor]:
    """Returns the pairs of a point and a centre of the same cloud at a distance below a radius.

    The results are rows of points (p,) and rows of centres (p,), ordered by centre and then by
    point. xyz: (n, 3), centres: (m, 3). of_centres: number of centres in each cloud. radius:
    metres. most: largest number of points of a centre; if there are more, the first points by row
    are returned.
    """
    if kernels is not None and on_cpu(xyz):
        return _neighbours_one_by_one(xyz, counts, centres, of_centres, radius, most)
    number, of_centre = on_device(counts, xyz), on_device(of_centres, xyz)
    if triton_kernels.usable(xyz):
        cloud = cloud_of_rows(of_centre, centres)
        rows = triton_kernels.first_near(xyz, number, centres, cloud, radius, most)  # (m, most)
        owner, nth = (rows >= 0).nonzero().unbind(1)
        return rows[owner, nth], owner
    return _neighbours_of_all(xyz, number, centres, of_centre, radius, most)


@torch.no_grad()
def nearest_of_clouds(
    xyz: Tensor, counts: Counts, known: Tensor, of_known: Counts
) -> tuple[Tensor, Tensor]:
    """Returns distances (n, 3) and rows (n, 3) of the three points `known` nearest to each point.

    xyz: (n, 3), known: (m, 3), of the same clouds. of_known: number of known points in each cloud,
    at least 1 where a cloud has points. A missing point has an infinite distance, and the row of
    the cloud's first known point.
    """
    if on_cpu(xyz):
        distances, rows = [xyz.new_zeros(0, 3)], [torch.zeros(0, 3, dtype=torch.int64)]
        start = first = 0
        for n, m in zip(sizes_of(counts), sizes_of(of_known), strict=True):
            if n > 0:
                tree = cKDTree(known[first : first + m].numpy())
                apart, nearest = tree.query(xyz[start : start + n].numpy(), k=3)
                nearest[nearest == m] = 0  # missing points
                distances.append(torch.from_numpy(apart).to(xyz.dtype))
                rows.append(torch.from_numpy(nearest) + first)
            start, first = start + n, first + m
        return torch.cat(distances), torch.cat(rows)
    places, others = _places(xyz, on_device(counts, xyz)), _places(known, on_device(of_known, xyz))
    targets, sources = places.padded(xyz, torch.inf), others.padded(known, torch.inf)
    chunk = max(1, chunk_of(xyz) // max(1, sources.shape[0] * sources.shape[1]))
    parts = [_three_lowest(_apart(part, sources)) for part in torch.split(targets, chunk, dim=1)]
    apart, row = (torch.cat(columns, dim=1) for columns in zip(*parts, strict=True))
    there = torch.isfinite(apart)
    row = torch.where(there, row, 0) + others.start[:, None, None]
    return torch.where(there, apart, torch.inf).sqrt().flatten(0, 1)[places.slot], row.flatten(
        0, 1
    )[places.slot]


def first_of_each(hits: Tensor, most: int) -> Tensor:
    """Returns where `hits` (..., n) bool is true, but only the first `most` times in each line.

    The result has one row of indices per hit, as `nonzero`.
    """
    few = hits.cumsum(-1, dtype=torch.int32) <= most
    return (hits & few).nonzero()


@dataclass(frozen=True, eq=False)
class _Places:
    """The positions of the n points of some clouds in an array (clouds, longest)."""

    start: Tensor  # (clouds,) row of each cloud's first point
    slot: Tensor  # (n,) position of each point in the flattened array
    shape: tuple[int, int]

    def padded(self, values: Tensor, missing: float) -> Tensor:
        """Returns values (n, c) as an array (clouds, longest, c)."""
        clouds, longest = self.shape
        array = values.new_full((clouds * longest, values.shape[1]), missing)
        array = array.index_copy(0, self.slot, values)
        return array.view(clouds, longest, values.shape[1])


def _places(xyz: Tensor, counts: Tensor) -> _Places:
    row = torch.arange(len(xyz), device=xyz.device)
    start = counts.cumsum(0) - counts
    # This is the size of the longest cloud: the number of rows below the maximum of `counts`.
    longest = len((row < counts.amax()).nonzero()) if len(counts) else 0
    cloud = cloud_of_rows(counts, xyz)
    return _Places(start, cloud * longest + row - start[cloud], (len(counts), longest))


def _apart(a: Tensor, b: Tensor) -> Tensor:
    """Returns the squared distances (clouds, n, m) of points (clouds, n, 3) and (clouds, m, 3)."""
    return squared(*(a[:, :, None, axis] - b[:, None, :, axis] for axis in range(3)))


def _farthest_of_all(xyz: Tensor, counts: Tensor, most: int) -> Tensor:
    """Returns the sampled rows (clouds, most); rows beyond the size of a cloud are invalid."""
    places = _places(xyz, counts)
    rows = torch.arange(most, device=xyz.device).expand(len(counts), most)
    if not all(places.shape) or most == 0:
        return rows + places.start[:, None]
    array = places.padded(xyz, 0.0)  # points (clouds, longest, 3)
    exists = torch.arange(array.shape[1], device=xyz.device) < counts[:, None]
    apart = torch.where(exists, torch.inf, -1.0)
    chosen = torch.zeros_like(rows)
    for k in range(1, most):
        last = array.gather(1, chosen[:, k - 1 : k, None].expand(-1, -1, 3))  # (clouds, 1, 3)
        apart = torch.minimum(apart, squared(*(array - last).unbind(2)))
        chosen[:, k] = apart.argmax(1)
    return torch.where(counts[:, None] > most, chosen, rows) + places.start[:, None]


def _neighbours_one_by_one(
    xyz: Tensor, counts: Counts, centres: Tensor, of_centres: Counts, radius: float, most: int
) -> tuple[Tensor, Tensor]:
    assert kernels is not None
    points, owners = [torch.zeros(0, dtype=torch.int64)], [torch.zeros(0, dtype=torch.int64)]
    start = first = 0
    for n, m in zip(sizes_of(counts), sizes_of(of_centres), strict=True):
        if n > 0 and m > 0:
            cloud = xyz[start : start + n].contiguous().numpy()
            around = centres[first : first + m].contiguous().numpy()
            rows, empty = map(torch.from_numpy, kernels.ball_query(cloud, around, radius, most))
            new = rows != rows[:, :1]  # ball_query fills a ball with copies of its first point
            new[:, 0] = empty == 0
            points.append(rows[new] + start)
            owners.append(new.nonzero()[:, 0] + first)
        start, first = start + n, first + m
    return torch.cat(points), torch.cat(owners)


def _neighbours_of_all(
    xyz: Tensor, counts: Tensor, centres: Tensor, of_centres: Tensor, radius: float, most: int
) -> tuple[Tensor, Tensor]:
    places, others = _places(xyz, counts), _places(centres, of_centres)
    points, middles = places.padded(xyz, torch.inf), others.padded(centres, torch.inf)
    limit = constant([radius], xyz) ** 2
    chunk = max(1, chunk_of(xyz) // max(1, points.shape[0] * points.shape[1]))
    pairs, done = [torch.zeros(0, 3, dtype=torch.int64, device=xyz.device)], 0
    for part in torch.split(middles, chunk, dim=1):
        # Differences of two missing points are NaN, which is not below the limit.
        found = first_of_each(_apart(part, points) < limit, most)  # (hits, 3): cloud, centre, point
        found[:, 1] += done
        pairs.append(found)
        done += part.shape[1]
    cloud, centre, point = torch.cat(pairs).unbind(1)
    row, owner = point + places.start[cloud], centre + others.start[cloud]
    order = torch.argsort(owner, stable=True)  # by centre, also for several parts
    return row[order], owner[order]


def _three_lowest(apart: Tensor) -> tuple[Tensor, Tensor]:
    """Returns the three lowest of the last dimension and their indices, (..., 3) each.

    Three minima are faster than `topk` on a GPU.
    """
    values, indices = [], []
    if apart.shape[-1] == 0:
        none = apart.new_full((*apart.shape[:-1], 3), torch.inf)
        return none, torch.zeros_like(none, dtype=torch.int64)
    # The distance of two missing points is NaN.
    apart = torch.where(apart.isnan(), torch.inf, apart)
    for _ in range(3):
        value, index = apart.min(dim=-1, keepdim=True)
        values.append(value)
        indices.append(index)
        apart = apart.scatter_(-1, index, torch.inf)
    return torch.cat(values, dim=-1), torch.cat(indices, dim=-1)
