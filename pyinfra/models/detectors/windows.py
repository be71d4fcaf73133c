"""Training on windows of the canvas, so that a step takes the same time at sites of any size.

The receptive field of the convolutions is about 30 m around a cell. Therefore training on a window
differs from training on the whole canvas only near the border of the window. Detection uses the
whole canvas.
"""

import numpy as np
import torch

from pyinfra.core.arrays import FloatArray
from pyinfra.models.detectors.batch import Batch, CanvasPart
from pyinfra.models.detectors.detection_area import Area
from pyinfra.models.detectors.sample import Sample
from pyinfra.models.ops.constants import constant, numbers


def centre_of(
    sample: Sample, area: Area, rng: np.random.Generator, rare: float = 0.0
) -> FloatArray:
    """Returns the centre of a window, (2,): the centre of a random object of the sample.

    If the sample has no objects, the centre is a random position. rare: share of the samples for
    which a random class is chosen first, and then a random object of this class.
    """
    if rare > 0 and len(sample.boxes) > 0 and rng.random() < rare:
        of_class = np.flatnonzero(sample.numbers == rng.choice(np.unique(sample.numbers)))
        return sample.boxes[rng.choice(of_class), :2]
    if len(sample.boxes) > 0:
        return sample.boxes[rng.integers(len(sample.boxes)), :2]
    return rng.uniform(area.low[:2], area.high[:2])


def view_of(batch: Batch, area: Area, cell_m: float, step: int) -> CanvasPart:
    """Returns the part of the canvas in the batch's windows, which begin at multiples of `step`."""
    columns, rows = (round(area.size[axis] / cell_m) for axis in (0, 1))
    whole = (rows, columns)
    asked = batch.windows
    sides = whole if asked is None else sides_of(whole, asked.most_m2 / cell_m**2, step)
    if asked is None or sides == whole:
        return CanvasPart(whole, None, batch.boxes, batch.classes)
    low = np.array(area.low[:2], np.float32)
    middles = ((np.array(asked.centres) - low) / cell_m)[:, ::-1].tolist()  # row, column
    starts = [
        _start(m, side, most, step)
        for pair in middles
        for m, side, most in zip(pair, sides, whole, strict=True)
    ]
    first = numbers(starts, batch.points.device).view(-1, 2)
    boxes, classes = [], []
    for frame_boxes, of_class, corner in zip(batch.boxes, batch.classes, first, strict=True):
        moved = frame_boxes.clone()
        moved[:, :2] -= corner.flip(0) * cell_m
        cell = (moved[:, :2] - constant(area.low[:2], moved)) / cell_m
        inside = (cell >= 0).all(dim=1) & (cell < constant(sides[::-1], cell)).all(dim=1)
        boxes.append(moved[inside])
        classes.append(of_class[inside])
    return CanvasPart(sides, first, tuple(boxes), tuple(classes))


def cut(batch: Batch, view: CanvasPart, area: Area, cell_m: float) -> Batch:
    """Returns the points and boxes in the view, shifted to the low corner of the area."""
    if view.first is None:
        return batch
    points = batch.points.clone()
    points[:, :2] -= (view.first.flip(1) * cell_m)[batch.frame].to(points)
    offset = points[:, :2] - constant(area.low[:2], points)
    inside = ((offset >= 0) & (offset < constant(view.sides[::-1], offset) * cell_m)).all(dim=1)
    sizes = list(batch.counts)
    frames = zip(points.split_with_sizes(sizes), inside.split_with_sizes(sizes), strict=True)
    parts = [cloud[mask] for cloud, mask in frames]
    counts = tuple(len(part) for part in parts)
    return Batch(torch.cat(parts), counts, view.boxes, classes=view.classes)


def sides_of(whole: tuple[int, int], cells: float, step: int) -> tuple[int, int]:
    """Returns rows and columns of a window of at most `cells` cells, as square as possible.

    Each side is a multiple of `step`, and at least one step.
    """
    rows, columns = whole
    if rows * columns <= cells:
        return whole
    height = min(rows, max(cells**0.5, cells / columns))
    width = min(columns, cells / height)
    return max(step, int(height / step) * step), max(step, int(width / step) * step)


def _start(middle: float, side: int, whole: int, step: int) -> int:
    """Returns the first cell of a window around `middle`: a multiple of `step`.

    The window lies inside the canvas.
    """
    return min(max(0, round((middle - side / 2) / step) * step), whole - side)
