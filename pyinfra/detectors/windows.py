"""Windows of the canvas to learn from, so that a step costs the same over a wide site.

Convolutions look no further than some 30 m around a cell, so a vehicle is learnt as in the whole
canvas but for what stands beyond the rim; detection looks at the whole canvas.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from pyinfra.detectors.batch import Area, Batch, Sample
from pyinfra.detectors.network import Network
from pyinfra.detectors.pillars import PillarEncoder
from pyinfra.kitti import FloatArray


def check(network: Network, most_m2: float) -> None:
    """Raises ValueError if windows are asked of a network that has no canvas to cut."""
    if most_m2 > 0 and not isinstance(getattr(network, "encoder", None), PillarEncoder):
        name = type(network).__name__
        raise ValueError(f"learning.window_m2: found {most_m2:g} for {name}, allowed 0")


def centre_of(sample: Sample, area: Area, draw: np.random.Generator) -> FloatArray:
    """(2,) where to look: at one of the vehicles, or anywhere in the area if there is none."""
    if len(sample.boxes) > 0:
        return sample.boxes[draw.integers(len(sample.boxes)), :2]
    return draw.uniform(area.low[:2], area.high[:2])


def cut(
    canvas: Tensor, batch: Batch, encoder: PillarEncoder, step: int
) -> tuple[Tensor, tuple[Tensor, ...]]:
    """The batch's windows of the canvas (B, C, H, W), and the boxes in them.

    A window begins at multiples of `step` cells. Boxes (k, 7) are moved as each window is to the
    first cell of the canvas.
    """
    if batch.windows is None:
        return canvas, batch.boxes
    whole = (encoder.rows, encoder.columns)
    sides = sides_of(whole, batch.windows.most_m2 / encoder.pillar_m**2, step)
    if sides == whole:
        return canvas, batch.boxes
    low = torch.tensor(encoder.area.low[:2])
    parts, boxes = [], []
    for i, centre in enumerate(batch.windows.centres):
        column, row = (
            _start(middle, side, most, step)
            for middle, side, most in zip(
                ((centre - low) / encoder.pillar_m).tolist(), sides[::-1], whole[::-1], strict=True
            )
        )
        parts.append(canvas[i, :, row : row + sides[0], column : column + sides[1]])
        moved = batch.boxes[i].clone()
        moved[:, :2] -= moved.new_tensor([column, row]) * encoder.pillar_m
        cell = (moved[:, :2] - low.to(moved)) / encoder.pillar_m
        inside = (cell >= 0).all(dim=1) & (cell < cell.new_tensor(sides[::-1])).all(dim=1)
        boxes.append(moved[inside])
    return torch.stack(parts).contiguous(memory_format=torch.channels_last), tuple(boxes)


def sides_of(whole: tuple[int, int], cells: float, step: int) -> tuple[int, int]:
    """Rows and columns of a window of at most so many cells, as square as the whole allows."""
    rows, columns = whole
    if rows * columns <= cells:
        return whole
    height = min(rows, max(cells**0.5, cells / columns))
    width = min(columns, cells / height)
    return max(step, int(height / step) * step), max(step, int(width / step) * step)


def _start(middle: float, side: int, whole: int, step: int) -> int:
    """The first cell of a window around a place, within the canvas, a multiple of `step`."""
    return min(max(0, round((middle - side / 2) / step) * step), whole - side)
