"""Layers on points: set abstraction at several scales, and feature propagation.

The layers follow PointNet++, Qi et al., NeurIPS 2017. Clouds of any size are concatenated, so the
same layers work on the frames of a batch and on the proposals of a frame.

Deviations from the paper:

- a cloud with fewer points than requested is not filled with copies of points
- a ball with fewer points than its limit is not filled with copies of its first point; the maxima
  are the same, but batch norms use existing points only
- a centre without points around it has features of 0

The order in which balls take their points (`shuffled`) on a GPU differs from that on a CPU.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional

from pyinfra.models.ops.clouds import (
    Counts,
    cloud_of_rows,
    nearest_of_clouds,
    neighbours,
    on_device,
    sizes_of,
)
from pyinfra.models.ops.kernels import on_cpu
from pyinfra.models.ops.points import interpolate
from pyinfra.models.ops.triton_layers import most_of_groups, usable


@dataclass(frozen=True, eq=False)
class Clouds:
    """The concatenated points of some clouds, with features."""

    xyz: Tensor  # (n, 3) float32 coordinates of the points
    features: Tensor  # (n, c) features of the points
    counts: Counts  # number of points in each cloud; may be 0

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


def shuffled(clouds: Clouds) -> Clouds:
    """Returns the points of each cloud in a random order that depends only on their number.

    `neighbours` returns the first points of a ball by row. Voxels are ordered by height. Without a
    random order, a ball would therefore get its lowest voxels only.
    """
    order = _random_order(clouds)
    return Clouds(clouds.xyz[order], clouds.features[order], clouds.counts)


def _random_order(clouds: Clouds) -> Tensor:
    """Returns the rows (n,) of the clouds' points in a random order within each cloud."""
    if on_cpu(clouds.xyz):
        orders, start = [torch.zeros(0, dtype=torch.int64)], 0
        for count in sizes_of(clouds.counts):
            rng = torch.Generator().manual_seed(count)
            orders.append(start + torch.randperm(count, generator=rng))
            start += count
        return torch.cat(orders)
    cloud, counts = cloud_of_rows(clouds.counts, clouds.xyz), on_device(clouds.counts, clouds.xyz)
    row = torch.arange(len(clouds.xyz), device=clouds.xyz.device)
    within = row - (counts.cumsum(0) - counts)[cloud]
    return torch.argsort((cloud << 32) + _scrambled(within + (counts[cloud] << 20)), stable=True)


def _scrambled(numbers: Tensor) -> Tensor:
    """Returns a pseudo-random number below 2^32 for each int64 number; equal inputs, equal results.

    PyTorch's random generators cannot have a seed for each cloud.
    """
    low = 0xFFFFFFFF
    x = numbers & low
    for _ in range(2):
        x = ((x ^ (x >> 16)) * 0x45D9F3B) & low
    return x ^ (x >> 16)


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
        features = self.feature(clouds.features)
        # On a GPU, the gradient of `index_select` needs no sorting, unlike that of an index.
        gathered = features[points] if on_cpu(features) else features.index_select(0, points)
        x: Tensor = self.rest(self.offset(offset) + gathered)
        if usable(x):
            return most_of_groups(x, owners, len(centres))
        # Features are not negative, so the initial zeros remain only at centres without points.
        index = owners[:, None].expand_as(x)
        return x.new_zeros(len(centres), x.shape[1]).scatter_reduce(0, index, x, "amax")


@dataclass(frozen=True)
class Ball:
    """One scale of a set abstraction."""

    radius_m: float
    most: int  # maximum number of points in the ball
    widths: tuple[int, ...]


class SetAbstraction(nn.Module):
    """Features of the points around some centres at several scales, concatenated."""

    def __init__(self, channels: int, balls: Sequence[Ball]) -> None:
        super().__init__()
        self.balls = tuple(balls)
        self.scales = nn.ModuleList(LocalMax(channels, b.widths) for b in balls)
        self.channels = sum(b.widths[-1] for b in balls)

    def forward(self, clouds: Clouds, centres: Tensor, counts: Counts) -> Clouds:
        """Returns features (m, channels) of centres (m, 3).

        counts: number of centres in each cloud.
        """
        where = clouds.xyz.detach(), clouds.counts, centres.detach(), counts
        features = [
            scale(clouds, centres, *neighbours(*where, b.radius_m, b.most))
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
        owners = cloud_of_rows(clouds.counts, clouds.xyz)
        points = torch.arange(len(clouds.xyz), device=clouds.xyz.device)
        origins = clouds.xyz.new_zeros(len(clouds.counts), 3)
        features: Tensor = self.all(clouds, origins, points, owners)
        return features


class FeaturePropagation(nn.Module):
    """Interpolates the features of sampled points at all points of the cloud before sampling."""

    def __init__(self, fine: int, coarse: int, widths: Sequence[int]) -> None:
        super().__init__()
        self.layers = mlp(fine + coarse, widths)

    def forward(self, fine: Clouds, coarse: Clouds) -> Clouds:
        """Returns the fine clouds with new features.

        `fine` and `coarse` are two samplings of the same clouds. A cloud with fine points must also
        have coarse points. The features of the three nearest coarse points are weighted by 1 /
        distance.
        """
        searched = fine.xyz.detach(), fine.counts, coarse.xyz.detach(), coarse.counts
        brought = interpolate(coarse.features, *nearest_of_clouds(*searched))
        return fine.with_features(self.layers(torch.cat([brought, fine.features], dim=1)))
