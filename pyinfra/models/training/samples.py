"""Training samples and their augmentation."""

from __future__ import annotations

import bisect
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np

from pyinfra.core.arrays import BoolArray, FloatArray, IntArray, Points
from pyinfra.core.boxes import bev_iou, points_in_boxes, rows_in_box
from pyinfra.core.config import ruled
from pyinfra.dataset.regions import Region
from pyinfra.models.detectors.sample import Sample
from pyinfra.models.training import sensor_faults

MOST_STD = 3.3  # errors of the sensor's pose are clipped to this many standard deviations
SHADOW_DEG = 0.3  # angular resolution at which pasted objects hide points behind them


@dataclass(frozen=True)
class Augmentation:
    """Random changes of a frame; the defaults change nothing."""

    flip: bool = False  # whether half of the frames are mirrored left to right
    rotation_deg: float = ruled(0.0, 0, 180)  # largest rotation in both directions
    scale: float = ruled(0.0, 0, 0.5)  # largest relative change of scale, up and down
    # maximum number of objects that are pasted from another frame, at the same positions
    pasted: int = ruled(0, 0, 100)
    least_points: int = ruled(5, 0, 1000)  # minimum number of points on a pasted object
    shadows: bool = False  # whether pasted objects hide the points behind them
    drop_out: float = ruled(0.0, 0, 0.99)  # largest share of points that is removed
    lost_lines: float = ruled(0.0, 0, 0.99)  # largest share of elevation rows that is removed
    range_noise_m: float = ruled(0.0, 0, 10)  # largest standard deviation of range noise
    # Errors of the sensor's pose have a normal distribution, clipped at 3.3 standard deviations.
    height_std_m: float = ruled(0.0, 0, 10)  # standard deviation of the height above the road
    level_std_deg: float = ruled(0.0, 0, 10)  # standard deviation of the tilt about x and about y


@dataclass(frozen=True, eq=False)
class SiteSample(Sample):
    """A sample with the region of its site; z of points and boxes is measured from the road."""

    region: Region = field(kw_only=True)  # where vehicles can be, in the frame before augmentation


class Samples(Protocol):
    """The samples of a training, numbered from 0."""

    @property
    def together(self) -> int:
        """Number of consecutive samples that are made together."""

    def __len__(self) -> int:
        """Returns the number of different samples."""

    def nth(self, seed: int, n: int) -> int:
        """Returns which sample is the n-th of the training. n may exceed the number of samples."""

    def sample(self, i: int) -> Sample: ...

    def another(self, i: int, rng: np.random.Generator) -> Sample:
        """Returns a random sample of the LiDAR of sample i. Its objects can be pasted into i."""


@dataclass(frozen=True, eq=False)
class Frames:
    """Frames of one or more LiDARs as samples; clouds are read on demand."""

    clouds: tuple[Callable[[], Points], ...]
    boxes: tuple[FloatArray, ...]  # (k, 7) boxes of each frame's objects with a point
    starts: tuple[int, ...] = (0,)  # index of the first frame of each LiDAR
    classes: tuple[IntArray, ...] = ()  # (k,) class numbers of each frame's boxes; () if all are 0
    heights_m: tuple[float, ...] = ()  # height of each frame's sensor above z = 0; () if all are 0
    # points of each box of each frame, if the frames were read before (kept_frames.py)
    objects: tuple[tuple[Points, ...], ...] = ()
    together: int = 1

    def __len__(self) -> int:
        return len(self.clouds)

    def __add__(self, more: Frames) -> Frames:
        starts = tuple(len(self) + first for first in more.starts)
        starts = self.starts + starts if len(self) else starts
        classes, heights_m = self.classes + more.classes, self.heights_m + more.heights_m
        clouds, boxes = self.clouds + more.clouds, self.boxes + more.boxes
        return Frames(clouds, boxes, starts, classes, heights_m)

    def part(self, rows: slice) -> Frames:
        """Returns the frames `rows`, which must be of one LiDAR."""
        classes, heights_m = self.classes[rows], self.heights_m[rows]
        return Frames(self.clouds[rows], self.boxes[rows], classes=classes, heights_m=heights_m)

    def nth(self, seed: int, n: int) -> int:
        """Returns the n-th frame in random order. All frames occur before a frame is repeated."""
        turn, position = divmod(n, len(self))
        return int(np.random.default_rng([seed, turn]).permutation(len(self))[position])

    def sample(self, i: int) -> Sample:
        height_m = self.heights_m[i] if self.heights_m else 0.0
        return Sample(self.clouds[i](), self.boxes[i], self.numbers(i), height_m=height_m)

    def numbers(self, i: int) -> IntArray:
        """Returns the class numbers of a frame's boxes: (k,)."""
        return self.classes[i] if self.classes else np.zeros(len(self.boxes[i]), np.int64)

    def another(self, i: int, rng: np.random.Generator) -> Sample:
        """Returns a random frame of the same LiDAR as frame i."""
        of = bisect.bisect(self.starts, i)
        chosen = int(rng.integers(self.starts[of - 1], [*self.starts, len(self)][of]))
        sample = self.sample(chosen)
        return replace(sample, objects=self.objects[chosen]) if self.objects else sample


def augmented(
    sample: Sample, other: Sample | None, how: Augmentation, rng: np.random.Generator
) -> Sample:
    """Returns the augmented sample; objects of `other` may be pasted into it."""
    if other is not None and how.pasted > 0:
        sample = with_pasted(sample, other, how, rng)
    turn = np.deg2rad(rng.uniform(-how.rotation_deg, how.rotation_deg))
    scale = 1 + rng.uniform(-how.scale, how.scale)
    flip = how.flip and rng.random() < 0.5
    sample = moved(sample, turn=float(turn), scale=float(scale), flip=flip)
    return with_pose_error(with_faults(sample, how, rng), how, rng)


def with_pose_error(sample: Sample, how: Augmentation, rng: np.random.Generator) -> Sample:
    """Returns the sample with errors of the assumed height and tilt of the sensor.

    Only z is changed, because a tilt of 1 degree shifts points 6 m below the sensor by only 0.1 m
    horizontally. If both standard deviations are 0, no random numbers are used.
    """
    if how.height_std_m == how.level_std_deg == 0:
        return sample
    height, *level = np.clip(rng.normal(size=3), -MOST_STD, MOST_STD)
    slopes = np.tan(np.radians(how.level_std_deg * np.array(level)))

    def rise(xy: FloatArray) -> FloatArray:
        return np.asarray(how.height_std_m * height + xy @ slopes)

    points, boxes = sample.points.copy(), sample.boxes.copy()
    points[:, 2] += rise(points[:, :2].astype(np.float64)).astype(np.float32)
    boxes[:, 2] += rise(boxes[:, :2])
    return replace(sample, points=points, boxes=boxes)


def with_faults(sample: Sample, how: Augmentation, rng: np.random.Generator) -> Sample:
    """Returns the sample with sensor faults.

    The severity of each fault is uniform between 0 and its maximum. Boxes that lose their last
    point are removed. If all maxima are 0, no random numbers are used.
    """
    if how.lost_lines == how.drop_out == how.range_noise_m == 0:
        return sample
    points = lifted(sample.points, -sample.height_m)  # origin at the sensor, as faults need ranges
    for most, fault in (
        (how.lost_lines, sensor_faults.lost_lines),
        (how.drop_out, sensor_faults.drop_out),
    ):
        if most > 0:
            points = fault(points, rng.uniform(0, most), rng)
    boxes, numbers = sample.boxes, sample.numbers
    if len(points) < len(sample.points):
        lost = points_in_boxes(lifted(points, sample.height_m), boxes) == 0
        lost[lost] = points_in_boxes(sample.points, boxes[lost]) > 0
        boxes, numbers = boxes[~lost], numbers[~lost]
    if how.range_noise_m > 0:
        points = sensor_faults.range_noise(points, rng.uniform(0, how.range_noise_m), rng)
    points = lifted(points, sample.height_m)
    return replace(sample, points=points, boxes=boxes, classes=numbers)


def lifted(points: Points, by_m: float) -> Points:
    """Returns points with z increased by `by_m`."""
    out = points.copy()
    out[:, 2] += np.float32(by_m)
    return out


def moved(sample: Sample, *, turn: float, scale: float, flip: bool) -> Sample:
    """Returns the sample mirrored left to right, turned about the sensor (radians) and scaled."""
    side = -1.0 if flip else 1.0
    cos, sin = np.cos(turn), np.sin(turn)
    # Points are row vectors. They are mirrored, then turned, then scaled.
    linear = scale * np.array([[cos, sin, 0], [-side * sin, side * cos, 0], [0, 0, 1]])
    points = sample.points.copy()
    points[:, :3] = points[:, :3] @ linear.astype(np.float32)
    boxes = sample.boxes.copy()
    boxes[:, :3] = boxes[:, :3] @ linear
    boxes[:, 3:6] *= scale
    height_m = scale * sample.height_m
    boxes[:, 6] = (side * boxes[:, 6] + turn + np.pi) % (2 * np.pi) - np.pi
    return replace(sample, points=points, boxes=boxes, height_m=height_m)


def with_pasted(
    sample: Sample, other: Sample, how: Augmentation, rng: np.random.Generator
) -> Sample:
    """Pastes objects of `other`, with their points, into `sample` where it has no objects.

    Objects are pasted from each class in turn, so that rare classes are pasted as often as others.
    """
    order = rng.permutation(len(other.boxes))
    of_class = other.numbers[order]
    earlier = np.tril(of_class[:, None] == of_class, -1).sum(axis=1)  # objects of the same class
    order = order[np.argsort(earlier, kind="stable")]
    free = np.ones(len(order), dtype=np.bool_)
    if len(sample.boxes) > 0:
        free = bev_iou(other.boxes, sample.boxes).max(axis=1, initial=0) == 0
    pasted, boxes, numbers = list[Points](), [sample.boxes], [sample.numbers]
    replaced = np.zeros(len(sample.points), dtype=np.bool_)
    x = np.ascontiguousarray(sample.points[:, 0])
    for i in order[free[order]]:
        if len(boxes) > how.pasted:
            break
        brought = other.points_of(i)
        if len(brought) < how.least_points:
            continue
        replaced[rows_in_box(sample.points, x, other.boxes[i], 0)] = True
        if how.shadows:
            replaced |= hidden_by(brought, sample.points, sample.height_m)
        pasted.append(brought)
        boxes.append(other.boxes[i : i + 1])
        numbers.append(other.numbers[i : i + 1])
    return replace(
        sample,
        points=np.concatenate([sample.points[~replaced], *pasted]),
        boxes=np.concatenate(boxes),
        classes=np.concatenate(numbers),
    )


def hidden_by(hiding: Points, points: Points, height_m: float) -> BoolArray:
    """Returns which points (n, 4) are hidden behind the points `hiding` (m, 4): (n,).

    A point is hidden if its range exceeds the shortest range of `hiding` in the same cell of
    directions or in a neighbouring cell. height_m: height of the sensor above z = 0.
    """
    columns, rows, near = _directions(hiding, height_m)
    around = [(columns + i, rows + k) for i in (-1, 0, 1) for k in (-1, 0, 1)]
    cells = np.concatenate([_cell(*pair) for pair in around])
    order = np.lexsort((np.tile(near, len(around)), cells))
    cells, first = np.unique(cells[order], return_index=True)
    nearest = np.tile(near, len(around))[order][first]
    columns, rows, ranges = _directions(points, height_m)
    cells_of_points = _cell(columns, rows)
    index = np.searchsorted(cells, cells_of_points).clip(max=len(cells) - 1)
    return np.asarray((cells[index] == cells_of_points) & (ranges > nearest[index]))


def _directions(points: Points, height_m: float) -> tuple[IntArray, IntArray, FloatArray]:
    """Returns the cells of azimuth and elevation (n,) of points, and their ranges (n,)."""
    x, y, z = points[:, :3].T.astype(np.float64)
    z -= height_m
    flat = np.hypot(x, y)
    azimuth, elevation = np.degrees(np.arctan2(y, x)), np.degrees(np.arctan2(z, flat))
    columns, rows = (np.floor(a / SHADOW_DEG).astype(np.int64) for a in (azimuth, elevation))
    return columns, rows, np.hypot(flat, z)


def _cell(columns: IntArray, rows: IntArray) -> IntArray:
    around = round(360 / SHADOW_DEG)
    return np.asarray(rows * around + columns % around)
