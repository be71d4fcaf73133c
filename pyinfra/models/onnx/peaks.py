"""Computes boxes from maps of heat and boxes, as `detectors/centre_head.py`, but in NumPy."""

import math

import numpy as np

from pyinfra.core.arrays import BoolArray, Float32Array, IntArray
from pyinfra.dataset.regions import Region
from pyinfra.models.detectors.detection_area import Site
from pyinfra.models.detectors.head_settings import BOX, PART, PEAKS, ROAD_WEIGHT


class Peaks:
    """Computes boxes at the peaks of a heat map (H, W). axis: whether the head is AxisHead."""

    def __init__(
        self, site: Site, cell_m: float, axis: bool, region: Region | None, shape: tuple[int, int]
    ) -> None:
        self.low = np.array(site.area.low[:2], np.float32)
        self.floor_z, self.cell_m, self.axis = np.float32(site.floor_z), np.float32(cell_m), axis
        self.road_axes: Float32Array | None = None
        if axis and region is not None and region.axes is not None:
            row, column = (numbers.ravel() for numbers in np.indices(shape))
            axes = region.axes(self.middle_of(row, column).astype(np.float64))
            self.road_axes = axes.astype(np.float32).reshape(*shape, 2)

    def near(self, region: Region | None, margin_m: float, shape: tuple[int, int]) -> BoolArray:
        """Returns which cells (H, W) are in the region or at most `margin_m` outside it."""
        if region is None:
            return np.ones(shape, np.bool_)
        row, column = (numbers.ravel() for numbers in np.indices(shape))
        middles = self.middle_of(row, column).astype(np.float64)
        return np.asarray(region.holds(middles, margin_m).reshape(shape))

    def of(
        self, logits: Float32Array, maps: Float32Array, min_score: float, *, along_road: bool
    ) -> tuple[Float32Array, Float32Array]:
        """Returns boxes (k, 7) and scores (k,) of one class at peaks of at least `min_score`.

        logits: (H, W). maps: (8 or 9, H, W).
        """
        # Cells whose logit is lower than that of `min_score` are left out. The margin of 1e-3
        # allows for rounding.
        high = np.flatnonzero(logits >= math.log(min_score / (1 - min_score)) - 1e-3)
        row, column = high // logits.shape[1], high % logits.shape[1]
        peak = is_peak(logits, row, column)
        row, column = row[peak], column[peak]
        scores = sigmoid(logits[row, column])
        best = np.argsort(-scores, kind="stable")[:PEAKS]
        row, column = row[best], column[best]
        boxes = self.decode(maps[:, row, column].T, row, column, along_road=along_road)
        return boxes, scores[best]

    def decode(
        self, residuals: Float32Array, row: IntArray, column: IntArray, *, along_road: bool
    ) -> Float32Array:
        """Returns the boxes (k, 7) of residuals (k, 8 or 9)."""
        xy = self.middle_of(row, column) + residuals[:, :2] * self.cell_m
        z = residuals[:, 2:3] + self.floor_z
        sizes = np.exp(np.clip(residuals[:, 3:6], -5, 5))
        heading = self.heading(residuals, row, column, along_road=along_road)
        return np.concatenate([xy, z, sizes, heading[:, None]], axis=1)

    def heading(
        self, residuals: Float32Array, row: IntArray, column: IntArray, *, along_road: bool
    ) -> Float32Array:
        direction = residuals[:, 6:8]
        if along_road and self.road_axes is not None:
            lacking = np.maximum(1 - np.linalg.norm(direction, axis=1, keepdims=True), 0)
            direction = direction + np.float32(ROAD_WEIGHT) * lacking * self.road_axes[row, column]
        heading = np.arctan2(direction[:, 0], direction[:, 1])
        if not self.axis:
            return heading
        half = np.float32(math.pi)
        heading = (heading / 2 - np.float32(PART)) % half + np.float32(PART)
        heading = heading + half * (residuals[:, BOX] > 0)
        return np.asarray((heading + half) % (2 * half) - half, np.float32)

    def middle_of(self, row: IntArray, column: IntArray) -> Float32Array:
        """Returns x, y of the centres of cells in metres: (k, 2)."""
        cell = np.stack([column, row], axis=1).astype(np.float32)
        return self.low + (cell + np.float32(0.5)) * self.cell_m


def is_peak(heat: Float32Array, row: IntArray, column: IntArray) -> BoolArray:
    """Returns whether no neighbour of a cell of heat (H, W) is higher: (k,) bool."""
    around = np.pad(heat, 1, constant_values=-np.inf)
    peak = np.ones(len(row), np.bool_)
    for down, right in np.ndindex(3, 3):
        peak &= heat[row, column] >= around[row + down, column + right]
    return peak


def sigmoid(logits: Float32Array) -> Float32Array:
    return np.asarray(1 / (1 + np.exp(-logits)), np.float32)
