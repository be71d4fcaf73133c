"""Layers on points: set abstraction at several scales, and feature propagation.

The layers follow PointNet++, Qi et al., NeurIPS 2017. Clouds of any size are concatenated, so the
same layers work on the frames of a batch and on the proposals of a frame.

Deviations from the paper:

- a cloud with fewer points than requested is not filled with copies of points
- a ball with fewer points than its limit is not filled with copies of its first point; the maxima
  are the same, but batch norms use existing points only
- a centre without points around it has features of 0

Searches run on the CPU, even for tensors on a GPU. Their loops over points and clouds would be many
small steps on a GPU.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional

from pyinfra.models.ops.points import ball_query, farthest_points, interpolate, three_nearest


@dataclass(frozen=True, eq=False)
class Clouds:
    """The concatenated points of some clouds, with features."""

    xyz: Tensor  # (n, 3) float32
    features: Tensor  # (n, c)
    counts: list[int]  # number of points in each cloud; may be 0

    def with_features(self, features: Tensor) -> Clouds:
        return Clouds(self.xyz, features, self.counts)


class Norm(nn.BatchNorm1d):
    """Batch norm that uses its running statistics if the input has a single row."""

    def forward(self, x: Tensor) -> Tensor:
        if not self.training or len(x) > 1:
            return super().forward(x)
        mean, variance = self.running_mean, self.running_var
        return functional.batch_norm(x, mean, variance, self.weight, self.bias, eps=self.eps)


def mlp(channels: int, widths: Sequence[int]) -> nn.Sequential:
    """Returns layers that map (n, channels) to features (n, widths[-1]) that are not negative."""
    layers: list[nn.Module] = []
    for width in widths:
        linear = nn.Linear(channels, width, bias=False)
        nn.init.kaiming_normal_(linear.weight)
        layers += [linear, Norm(width), nn.ReLU()]
        channels = width
    return nn.Sequential(*layers)


def sampled(clouds: Clouds, most: int) -> tuple[Tensor, list[int]]:
    """Samples at most `most` points of each cloud by farthest point sampling.

    Returns the rows (m,) of the sampled points and their number in each cloud.
    """
    xyz = clouds.xyz.detach().cpu()
    indices, start = [torch.zeros(0, dtype=torch.int64)], 0
    for count in clouds.counts:
        if count > most:
            indices.append(start + farthest_points(xyz[start : start + count], most))
        else:
            indices.append(torch.arange(start, start + count))
        start += count
    return torch.cat(indices).to(clouds.xyz.device), [min(most, n) for n in clouds.counts]


def shuffled(clouds: Clouds) -> Clouds:
    """Returns the points of each cloud in a random order that depends only on their number.

    `neighbours` returns the first points of a ball by row. Voxels are ordered by height. Without a
    random order, a ball would therefore get its lowest voxels only.
    """
    orders, start = [torch.zeros(0, dtype=torch.int64)], 0
    for count in clouds.counts:
        rng = torch.Generator().manual_seed(count)
        orders.append(start + torch.randperm(count, generator=rng))
        start += count
    order = torch.cat(orders).to(clouds.xyz.device)
    return Clouds(clouds.xyz[order], clouds.features[order], clouds.counts)


def neighbours(
    clouds: Clouds, centres: Tensor, counts: Sequence[int], radius: float, most: int
) -> tuple[Tensor, Tensor]:
    """Returns the pairs of a point and a centre that are closer than a radius.

    The results are rows of points (p,) and rows of centres (p,), ordered by centre. centres: (m,
    3). counts: number of centres in each cloud. radius: metres. most: largest number of points of a
    centre; if there are more, the first points by row are returned.
    """
    xyz, middles = clouds.xyz.detach().cpu(), centres.detach().cpu()
    points, owners = [torch.zeros(0, dtype=torch.int64)], [torch.zeros(0, dtype=torch.int64)]
    start = first = 0
    for n, m in zip(clouds.counts, counts, strict=True):
        if n > 0 and m > 0:
            rows, empty = ball_query(
                xyz[start : start + n], middles[first : first + m], radius, most
            )
            new = rows != rows[:, :1]  # ball_query fills a ball with copies of its first point
            new[:, 0] = ~empty
            points.append(rows[new] + start)
            owners.append(new.nonzero()[:, 0] + first)
        start, first = start + n, first + m
    device = clouds.xyz.device
    return torch.cat(points).to(device), torch.cat(owners).to(device)


class LocalMax(nn.Module):
    """Layers on the offsets and features of points around a centre, and a maximum over points."""

    def __init__(self, channels: int, widths: Sequence[int]) -> None:
        super().__init__()
        # One linear layer in two parts, so that the features of a point are multiplied only once,
        # even if the point is near several centres.
        self.offset = nn.Linear(3, widths[0], bias=False)
        self.feature = nn.Linear(channels, widths[0], bias=False)
        nn.init.normal_(self.offset.weight, std=(2 / (3 + channels)) ** 0.5)
        nn.init.normal_(self.feature.weight, std=(2 / (3 + channels)) ** 0.5)
        self.rest = nn.Sequential(Norm(widths[0]), nn.ReLU(), *mlp(widths[0], widths[1:]))

    def forward(self, clouds: Clouds, centres: Tensor, points: Tensor, owners: Tensor) -> Tensor:
        """Returns features (m, widths[-1]) of centres (m, 3), from pairs of rows (p,)."""
        offset = clouds.xyz[points] - centres[owners]
        first = self.offset(offset) + self.feature(clouds.features)[points]
        x: Tensor = self.rest(first)
        # Features are not negative, so the initial zeros remain only at centres without points.
        index = owners[:, None].expand_as(x)
        return x.new_zeros(len(centres), x.shape[1]).scatter_reduce(0, index, x, "amax")


@dataclass(frozen=True)
class Ball:
    """One scale of a set abstraction."""

    radius_m: float
    most: int  # largest number of points
    widths: tuple[int, ...]


class SetAbstraction(nn.Module):
    """Features of the points around some centres at several scales, concatenated."""

    def __init__(self, channels: int, balls: Sequence[Ball]) -> None:
        super().__init__()
        self.balls = tuple(balls)
        self.scales = nn.ModuleList(LocalMax(channels, b.widths) for b in balls)
        self.channels = sum(b.widths[-1] for b in balls)

    def forward(self, clouds: Clouds, centres: Tensor, counts: list[int]) -> Clouds:
        """Returns features (m, channels) of centres (m, 3).

        counts: number of centres in each cloud.
        """
        features = [
            scale(clouds, centres, *neighbours(clouds, centres, counts, b.radius_m, b.most))
            for b, scale in zip(self.balls, self.scales, strict=True)
        ]
        return Clouds(centres, torch.cat(features, dim=1), counts)


class WholeAbstraction(nn.Module):
    """One feature vector for each whole cloud; zeros for a cloud without points."""

    def __init__(self, channels: int, widths: Sequence[int]) -> None:
        super().__init__()
        self.all = LocalMax(channels, widths)

    def forward(self, clouds: Clouds) -> Tensor:
        """Returns features (clouds, widths[-1])."""
        device = clouds.xyz.device
        counts = torch.tensor(clouds.counts, dtype=torch.int64, device=device)
        owners = torch.repeat_interleave(torch.arange(len(counts), device=device), counts)
        points = torch.arange(len(clouds.xyz), device=device)
        features: Tensor = self.all(clouds, clouds.xyz.new_zeros(len(counts), 3), points, owners)
        return features


class FeaturePropagation(nn.Module):
    """Interpolates the features of sampled points at all points of the cloud before sampling."""

    def __init__(self, fine: int, coarse: int, widths: Sequence[int]) -> None:
        super().__init__()
        self.layers = mlp(fine + coarse, widths)

    def forward(self, fine: Clouds, coarse: Clouds) -> Clouds:
        """Returns the fine clouds with new features.

        `fine` and `coarse` are two samplings of the same clouds. A cloud with fine points must also
        have coarse points.
        """
        brought = propagated(fine, coarse)
        return fine.with_features(self.layers(torch.cat([brought, fine.features], dim=1)))


def propagated(fine: Clouds, coarse: Clouds) -> Tensor:
    """Returns features (n, c) from the three nearest coarse points, weighted by 1 / distance."""
    xyz, coarse_xyz = fine.xyz.detach().cpu(), coarse.xyz.detach().cpu()
    distances, rows = [xyz.new_zeros(0, 3)], [torch.zeros(0, 3, dtype=torch.int64)]
    start = first = 0
    for n, m in zip(fine.counts, coarse.counts, strict=True):
        if n > 0:
            apart, nearest = three_nearest(xyz[start : start + n], coarse_xyz[first : first + m])
            distances.append(apart)
            rows.append(nearest + first)
        start, first = start + n, first + m
    device = fine.xyz.device
    return interpolate(coarse.features, torch.cat(distances).to(device), torch.cat(rows).to(device))
