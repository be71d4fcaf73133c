"""Measures the detectors' operations on one core, against torch, scipy, fpsample and spconv.

The command writes out/ops.csv. It skips packages that are not installed; install them with
`pip install fpsample spconv`:

    .venv/bin/python benchmarks/ops.py

A time is the minimum over the repetitions. In each repetition, all implementations of an operation
run in turn.
"""

from __future__ import annotations

import argparse
import importlib
import os
import sys
import time
from collections.abc import Callable, Iterator
from types import ModuleType
from typing import Any
from unittest import mock

# Must be set before torch is imported. spconv gives wrong results with more than one thread.
os.environ["OMP_NUM_THREADS"] = "1"

import numpy as np
import pandas as pd
import torch
from scipy.spatial import cKDTree
from torch import Tensor

from pyinfra.core import boxes as exact
from pyinfra.core.version import __version__
from pyinfra.models.ops import boxes, clouds, rulebooks, sparse
from reproduction import add_out

GRID = (41, 1600, 1408)  # numbers of voxels (z, y, x) of 0.1 m by 0.05 m by 0.05 m, as in PV-RCNN
Ways = dict[str, Callable[[], object]]


def optional(name: str) -> ModuleType | None:
    try:
        return importlib.import_module(name)
    except ImportError:
        print(f"{name} is not installed, left out", file=sys.stderr)
        return None


def in_torch(work: Callable[[], object]) -> Callable[[], object]:
    """Returns a function that runs `work` without the compiled kernels."""

    def plain() -> object:
        modules: list[Any] = [boxes, clouds, rulebooks]
        kernels = [module.kernels for module in modules]
        for module in modules:
            module.kernels = None
        try:
            return work()
        finally:
            for module, kept in zip(modules, kernels, strict=True):
                module.kernels = kept

    return plain


def as_on_a_gpu(work: Callable[[], object]) -> Callable[[], object]:
    """Returns a function that runs `work` with the code for tensors on a GPU."""

    def together() -> object:
        with mock.patch.object(clouds, "on_cpu", return_value=False):
            return work()

    return together


def frame(random: np.random.Generator, n: int) -> Tensor:
    """Returns points (n, 3) on walls, vehicles and the ground.

    The density of the points on the ground decreases with range.
    """
    ground, wall = n // 2, n // 4
    r, azimuth = random.uniform(8, 70, ground), random.uniform(-0.6, 0.6, ground)
    flat = np.stack([r * np.cos(azimuth), r * np.sin(azimuth), np.full(ground, -6.0)], 1)
    flat[:, 2] += random.normal(0, 0.02, ground)
    walls = random.uniform([5, 25, -6], [70, 25.1, 0], (wall, 3))
    at = random.uniform([10, -15], [65, 15], (30, 2))[random.integers(30, size=n - ground - wall)]
    sides = random.uniform([-2, -0.9, -6], [2, 0.9, -4.4], (len(at), 3))
    sides[np.arange(len(at)), random.integers(2, size=len(at))] = 0.9
    sides[:, :2] += at
    cloud = np.concatenate([flat, walls, sides])[random.permutation(n)]
    return torch.from_numpy(cloud).float()


def crowd(random: np.random.Generator, n: int, clusters: int) -> tuple[Tensor, Tensor]:
    """Returns clustered boxes of cars (n, 7) and scores, like detections before suppression."""
    at = random.integers(clusters, size=n)
    vehicles = np.zeros((n, 7))
    vehicles[:, :2] = random.uniform(-60, 60, (clusters, 2))[at] + random.normal(0, 0.5, (n, 2))
    vehicles[:, 3:6] = [4.2, 1.9, 1.6] * random.uniform(0.9, 1.1, (n, 3))
    vehicles[:, 6] = random.uniform(-3, 3, clusters)[at] + random.normal(0, 0.1, n)
    return torch.from_numpy(vehicles).float(), torch.from_numpy(random.uniform(size=n)).float()


def box_ways(random: np.random.Generator) -> Iterator[tuple[str, Ways]]:
    low, high = [-4, -4, -1, 0.5, 0.5, 1, -7], [4, 4, 1, 12, 3, 4, 7]
    a, b = random.uniform(low, high, (2, 50_000, 7))
    one, two = torch.from_numpy(a).float(), torch.from_numpy(b).float()
    yield (
        "rotated overlap of 50,000 pairs",
        {
            "torch": lambda: boxes.bev_iou_pairs(one, two),
            "numpy, exact": lambda: exact.pair_bev_iou(a, b),
        },
    )
    for n, clusters in ((300, 40), (4000, 40), (4000, 400)):
        vehicles, scores = crowd(random, n, clusters)

        def suppress(vehicles: Tensor = vehicles, scores: Tensor = scores) -> Tensor:
            return boxes.nms(vehicles, scores, 0.1, 500)

        yield (
            f"suppression of {n:,} boxes around {clusters} vehicles",
            {"compiled": suppress, "torch": in_torch(suppress)},
        )


def point_ways(random: np.random.Generator) -> Iterator[tuple[str, Ways]]:
    cloud = frame(random, 16_384)
    array, count = cloud.numpy(), [len(cloud)]
    fpsample = optional("fpsample")

    def farthest() -> Tensor:
        return clouds.farthest_of_clouds(cloud, count, 4096)[0]

    ways = {"compiled": farthest, "torch": in_torch(farthest)}
    if fpsample:
        ways["fpsample"] = lambda: fpsample.bucket_fps_kdline_sampling(array, 4096, 7, 0)
    yield "farthest points, 16,384 to 4,096", ways

    centres = cloud[farthest()]
    for radius, k in ((0.1, 16), (0.5, 32), (2.0, 32)):

        def query(radius: float = radius, k: int = k) -> object:
            return clouds.neighbours(cloud, count, centres, [len(centres)], radius, k)

        def tree(radius: float = radius) -> object:
            return cKDTree(array).query_ball_point(centres.numpy(), radius, return_sorted=True)

        yield (
            f"ball query of {radius} m, {k} of 16,384 for 4,096",
            {"compiled": query, "torch": in_torch(query), "scipy": tree},
        )

    def nearest() -> object:
        return clouds.nearest_of_clouds(cloud, count, centres, [len(centres)])

    yield "three nearest of 4,096 for 16,384", {"scipy": nearest, "torch": as_on_a_gpu(nearest)}


def voxels(cloud: Tensor) -> Tensor:
    size, low = torch.tensor([0.1, 0.05, 0.05]), torch.tensor([-6.5, -40.0, 0.0])
    at = ((cloud[:, [2, 1, 0]] - low) / size).long()
    at = at[((at >= 0) & (at < torch.tensor(GRID))).all(1)].unique(dim=0)
    return torch.nn.functional.pad(at, (1, 0))


def sparse_ways(random: np.random.Generator) -> Iterator[tuple[str, Ways]]:
    at = voxels(frame(random, 40_000))
    other = optional("spconv.pytorch")

    def same() -> rulebooks.Rulebook:
        return rulebooks.submanifold_rulebook(at, GRID, (3, 3, 3))

    def down() -> rulebooks.Rulebook:
        return rulebooks.strided_rulebook(at, GRID, (3, 3, 3), (2, 2, 2), (1, 1, 1))

    n = f"{len(at):,} voxels"
    yield f"submanifold rulebook, {n}", {"compiled": same, "torch": in_torch(same)}
    yield f"strided rulebook, {n}", {"compiled": down, "torch": in_torch(down)}

    rulebook = same()
    for channels in (16, 64):
        x = torch.from_numpy(random.normal(size=(len(at), channels))).float()
        weight = torch.from_numpy(random.normal(size=(27, channels, channels))).float()

        def forward(x: Tensor = x, weight: Tensor = weight) -> Tensor:
            with torch.no_grad():
                return sparse.convolve(x, weight, rulebook)

        def both(x: Tensor = x, weight: Tensor = weight) -> None:
            inputs = x.clone().requires_grad_(), weight.clone().requires_grad_()
            sparse.convolve(*inputs, rulebook).sum().backward()

        ways: Ways = {"ours, forward": forward, "ours, with gradients": both}
        if other:
            ways["spconv, forward"] = of_spconv(other, x, at, weight, forward())
        yield f"submanifold convolution, {channels} channels, {n}", ways


def of_spconv(
    spconv: ModuleType, x: Tensor, at: Tensor, weight: Tensor, wanted: Tensor
) -> Callable[[], object]:
    """Checks that spconv's convolution equals `wanted`, and returns a function that runs it.

    The rulebook (the pairs of voxels that the convolution joins) is made before the timing, as for
    pyinfra's convolution.
    """
    channels = x.shape[1]
    layer = spconv.SubMConv3d(channels, channels, 3, bias=False, indice_key="a")
    with torch.no_grad():  # spconv's weight has the shape (c_out, z, y, x, c_in)
        layer.weight.copy_(weight.permute(2, 0, 1).reshape(layer.weight.shape))
    tensor = spconv.SparseConvTensor(x, at.int(), list(GRID), 1)

    def work() -> Tensor:
        with torch.no_grad():
            features: Tensor = layer(tensor).features
        return features

    tensor.indice_dict = layer(tensor).indice_dict
    error = (work() - wanted).abs().max() / wanted.abs().max()
    if error > 1e-4:
        raise AssertionError(f"spconv: its result differs by {error} of the largest value")
    return work


def best(ways: Ways, repetitions: int) -> dict[str, float]:
    """Returns the minimum time (ms) of each implementation over the repetitions."""
    times = dict.fromkeys(ways, float("inf"))
    for _ in range(repetitions):
        for name, work in ways.items():
            start = time.perf_counter()
            work()
            times[name] = min(times[name], 1000 * (time.perf_counter() - start))
    return times


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    add_out(parser, "ops.csv")
    parser.add_argument(
        "--repetitions",
        type=int,
        default=11,
        help="repetitions of each measurement (default: %(default)s)",
    )
    args = parser.parse_args()
    torch.set_num_threads(1)
    random = np.random.default_rng(1)
    rows = []
    for part in (box_ways, point_ways, sparse_ways):
        for what, ways in part(random):
            for way, value in best(ways, args.repetitions).items():
                rows.append({"what": f"{what}; {way}", "value": value, "unit": "ms"})
                print(f"{rows[-1]['what']:75s} {value:9.2f} ms", flush=True)
    table = pd.DataFrame(rows).assign(
        command=f"benchmarks/ops.py --repetitions {args.repetitions}", seed=1, version=__version__
    )
    table.to_csv(args.out, index=False, float_format="%.4g")


if __name__ == "__main__":
    main()
