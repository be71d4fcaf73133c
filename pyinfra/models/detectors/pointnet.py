"""Layers on points: set abstraction at several scales, and propagation of features back.

PointNet++, Qi et al., NeurIPS 2017. Clouds of any size lie under one another, so the same layers
serve the frames of a batch and the regions of a frame. Deviations: a cloud with fewer points than
are sampled keeps each of them once, and a ball with fewer points than its cap is not filled up with
copies of its first one; the maxima are the same, the means of the batch norm are those of points
that exist. A centre with no point around it has features of zeros.

Searches run on the CPU also for tensors of a GPU: their loops over points and clouds are many small
steps there.
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
    """Points of some clouds under one another, with features."""

    xyz: Tensor  # (n, 3) float32
    features: Tensor  # (n, c)
    counts: list[int]  # points of each cloud; some may be 0

    def with_features(self, features: Tensor) -> Clouds:
        return Clouds(self.xyz, features, self.counts)


class Norm(nn.BatchNorm1d):
    """Batch norm that takes what it has learnt where one row is no batch."""

    def forward(self, x: Tensor) -> Tensor:
        if not self.training or len(x) > 1:
            return super().forward(x)
        mean, variance = self.running_mean, self.running_var
        return functional.batch_norm(x, mean, variance, self.weight, self.bias, eps=self.eps)


def mlp(channels: int, widths: Sequence[int]) -> nn.Sequential:
    """Layers of (n, channels) to (n, widths[-1]), the same for each point; never negative."""
    layers: list[nn.Module] = []
    for width in widths:
        linear = nn.Linear(channels, width, bias=False)
        nn.init.kaiming_normal_(linear.weight)
        layers += [linear, Norm(width), nn.ReLU()]
        channels = width
    return nn.Sequential(*layers)


def sampled(clouds: Clouds, most: int) -> tuple[Tensor, list[int]]:
    """Rows (m,) of points far from each other, at most so many of each cloud, and the counts."""
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
    """The points of each cloud in an order that says nothing of their place, always the same one.

    For the balls of voxels, which lie in order of height: by row they would see the lowest alone.
    """
    orders, start = [torch.zeros(0, dtype=torch.int64)], 0
    for count in clouds.counts:
        draw = torch.Generator().manual_seed(count)
        orders.append(start + torch.randperm(count, generator=draw))
        start += count
    order = torch.cat(orders).to(clouds.xyz.device)
    return Clouds(clouds.xyz[order], clouds.features[order], clouds.counts)


def neighbours(
    clouds: Clouds, centres: Tensor, counts: Sequence[int], radius: float, most: int
) -> tuple[Tensor, Tensor]:
    """Pairs (p,) of a point's row and of the row of a centre it is around, by centre.

    centres: (m, 3), counts: of each cloud; at most so many points of each centre, by row.
    """
    xyz, middles = clouds.xyz.detach().cpu(), centres.detach().cpu()
    points, owners = [torch.zeros(0, dtype=torch.int64)], [torch.zeros(0, dtype=torch.int64)]
    start = first = 0
    for n, m in zip(clouds.counts, counts, strict=True):
        if n > 0 and m > 0:
            rows, empty = ball_query(
                xyz[start : start + n], middles[first : first + m], radius, most
            )
            new = rows != rows[:, :1]  # what fills a ball up is its first point
            new[:, 0] = ~empty
            points.append(rows[new] + start)
            owners.append(new.nonzero()[:, 0] + first)
        start, first = start + n, first + m
    device = clouds.xyz.device
    return torch.cat(points).to(device), torch.cat(owners).to(device)


class LocalMax(nn.Module):
    """Points around centres, as offsets and features, through layers; the maximum of each."""

    def __init__(self, channels: int, widths: Sequence[int]) -> None:
        super().__init__()
        # One linear layer of offset and features, so that features pass it once per point.
        self.offset = nn.Linear(3, widths[0], bias=False)
        self.feature = nn.Linear(channels, widths[0], bias=False)
        nn.init.normal_(self.offset.weight, std=(2 / (3 + channels)) ** 0.5)
        nn.init.normal_(self.feature.weight, std=(2 / (3 + channels)) ** 0.5)
        self.rest = nn.Sequential(Norm(widths[0]), nn.ReLU(), *mlp(widths[0], widths[1:]))

    def forward(self, clouds: Clouds, centres: Tensor, points: Tensor, owners: Tensor) -> Tensor:
        """centres: (m, 3), pairs (p,) of rows -> (m, widths[-1])."""
        offset = clouds.xyz[points] - centres[owners]
        first = self.offset(offset) + self.feature(clouds.features)[points]
        x: Tensor = self.rest(first)
        # Never negative, so the zeros are only seen where there is no point.
        index = owners[:, None].expand_as(x)
        return x.new_zeros(len(centres), x.shape[1]).scatter_reduce(0, index, x, "amax")


@dataclass(frozen=True)
class Ball:
    """One scale of a set abstraction."""

    radius_m: float
    most: int  # points
    widths: tuple[int, ...]


class SetAbstraction(nn.Module):
    """What lies around some centres, at several scales, the results side by side."""

    def __init__(self, channels: int, balls: Sequence[Ball]) -> None:
        super().__init__()
        self.balls = tuple(balls)
        self.scales = nn.ModuleList(LocalMax(channels, b.widths) for b in balls)
        self.channels = sum(b.widths[-1] for b in balls)

    def forward(self, clouds: Clouds, centres: Tensor, counts: list[int]) -> Clouds:
        """centres: (m, 3), counts: of each cloud -> features (m, channels)."""
        features = [
            scale(clouds, centres, *neighbours(clouds, centres, counts, b.radius_m, b.most))
            for b, scale in zip(self.balls, self.scales, strict=True)
        ]
        return Clouds(centres, torch.cat(features, dim=1), counts)


class WholeAbstraction(nn.Module):
    """One row of features for each cloud; of zeros for a cloud without points."""

    def __init__(self, channels: int, widths: Sequence[int]) -> None:
        super().__init__()
        self.all = LocalMax(channels, widths)

    def forward(self, clouds: Clouds) -> Tensor:
        """-> (clouds, widths[-1])."""
        device = clouds.xyz.device
        counts = torch.tensor(clouds.counts, dtype=torch.int64, device=device)
        owners = torch.repeat_interleave(torch.arange(len(counts), device=device), counts)
        points = torch.arange(len(clouds.xyz), device=device)
        features: Tensor = self.all(clouds, clouds.xyz.new_zeros(len(counts), 3), points, owners)
        return features


class FeaturePropagation(nn.Module):
    """Features of few points to the many they were sampled from."""

    def __init__(self, fine: int, coarse: int, widths: Sequence[int]) -> None:
        super().__init__()
        self.layers = mlp(fine + coarse, widths)

    def forward(self, fine: Clouds, coarse: Clouds) -> Clouds:
        """Both with the same clouds, a cloud with points has some in both -> the fine ones."""
        brought = propagated(fine, coarse)
        return fine.with_features(self.layers(torch.cat([brought, fine.features], dim=1)))


def propagated(fine: Clouds, coarse: Clouds) -> Tensor:
    """(n, c): of the three nearest points of the coarse clouds, weighted by nearness."""
    xyz, known = fine.xyz.detach().cpu(), coarse.xyz.detach().cpu()
    distances, rows = [xyz.new_zeros(0, 3)], [torch.zeros(0, 3, dtype=torch.int64)]
    start = first = 0
    for n, m in zip(fine.counts, coarse.counts, strict=True):
        if n > 0:
            apart, nearest = three_nearest(xyz[start : start + n], known[first : first + m])
            distances.append(apart)
            rows.append(nearest + first)
        start, first = start + n, first + m
    device = fine.xyz.device
    return interpolate(coarse.features, torch.cat(distances).to(device), torch.cat(rows).to(device))
