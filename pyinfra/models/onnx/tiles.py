"""Rectangles of a bird's-eye map that together contain the cells near an evaluation region.

The roads of a junction fill a small part of the square around them. The network is therefore
computed on a few rectangles, which also fit better into the processor's cache. Each layer computes
the cells on which the used values depend, so that these are the values of the whole map.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from pyinfra.core.arrays import BoolArray, IntArray
from pyinfra.models.detectors.bev_config import BevConfig

Band = tuple[int, int, int, int]  # first row, last row + 1, first column, last column + 1
HEAD_LAYERS = 2  # number of 3 x 3 convolutions after the blocks
PER_TILE = 1000.0  # fixed cost of a tile, as a number of cells that take the same time


@dataclass(frozen=True)
class Extent:
    """A tile along one axis: its cells of the map, and the cells that each layer needs.

    pads: cells beyond the map before and after the input of each 3 x 3 convolution, in the order of
    the model. crops: the part of each block's output that is enlarged.
    """

    computed: slice
    used: slice
    used_inside: slice  # the used cells, as a slice of the cells that the model returns
    pads: tuple[tuple[int, int], ...]
    crops: tuple[slice, ...]


# A rectangle of cells of the map that is computed: its rows and columns
Tile = tuple[Extent, Extent]


def extent_of(used: slice, cells: int, bev: BevConfig) -> Extent:
    """Returns the tile along one axis for its used cells. cells: number of cells of the map.

    Each layer computes only the cells on which the used cells depend.
    """
    step = math.prod(bev.strides[1:])
    joined = (
        max(0, (used.start - HEAD_LAYERS) // step * step),
        min(cells, -(-(used.stop + HEAD_LAYERS) // step) * step),
    )
    pads, crops, factor, end = list[tuple[int, int]](), list[slice](), step, joined
    part = joined[0] // factor, joined[1] // factor
    for i in reversed(range(len(bev.layers))):
        start, stop = (cell // factor for cell in joined)
        crops.append(slice(start - part[0], stop - part[0]))
        for j in reversed(range(1 if i == 0 else 0, bev.layers[i] + 1)):
            stride, most = (bev.strides[i] if j == 0 else 1), cells // factor
            low, high = stride * part[0] - 1, stride * (part[1] - 1) + 2
            part = max(0, low), min(stride * most, high)
            pads.append((part[0] - low, high - part[1]))
        factor //= bev.strides[i] if i > 0 else 1
    pads.reverse()
    for _ in range(HEAD_LAYERS):
        pads.append((int(end[0] == 0), int(end[1] == cells)))
        end = end[0] + 1 - pads[-1][0], end[1] - 1 + pads[-1][1]
    inside = slice(used.start - end[0], used.stop - end[0])
    return Extent(slice(*part), used, inside, tuple(pads), tuple(reversed(crops)))


def receptive_cells(bev: BevConfig) -> int:
    """Returns how many cells of the map around a cell its values depend on, rounded up to steps.

    The map is the output of the first convolution. A step is a cell of the last block.
    """
    step = math.prod(bev.strides[1:])
    cells = math.ceil(HEAD_LAYERS / step)  # number of cells of the last block
    for layers, stride in zip(bev.layers[:0:-1], bev.strides[:0:-1], strict=True):
        cells = stride * (cells + layers) + 1
    return math.ceil((cells + bev.layers[0]) / step) * step


def tiles_of(needed: BoolArray, bev: BevConfig) -> list[Tile]:
    """Returns tiles whose used parts contain all needed cells (rows, columns) of a map.

    The map is divided into bands of rows or of columns, whichever has fewer cells to compute. The
    layers compute about half of the receptive field around the used cells, on average.
    """
    step, halo = math.prod(bev.strides[1:]), receptive_cells(bev) // 2
    divisions = [_bands(needed, step, halo), _bands(needed.T, step, halo)]
    turned = divisions[1][1] < divisions[0][1]
    part = needed.T if turned else needed
    return [_tile(band, part.shape, bev, turned=turned) for band in divisions[turned][0]]


def _bands(needed: BoolArray, step: int, halo: int) -> tuple[list[Band], float]:
    """Returns the bands of rows with the fewest cells to compute, and this number.

    `least` holds the number of the bands up to each row, and `start` the first row of the last of
    these bands, both in steps.
    """
    rows, columns = needed.shape
    first, last = _ends(needed, step)
    least, start = [0.0], [0]
    for end in range(1, len(first) + 1):
        low, high, choices = columns, 0, []
        for begin in range(end - 1, -1, -1):
            low, high = min(low, int(first[begin])), max(high, int(last[begin]))
            height = min(rows, end * step + halo) - max(0, begin * step - halo)
            width = min(columns, high + halo) - max(0, low - halo)
            cells = PER_TILE + height * width if low < high else 0.0
            choices.append((least[begin] + cells, begin))
        best, begin = min(choices)
        least.append(best)
        start.append(begin)
    return list(_traced(start, first, last, step)), least[-1]


def _traced(start: list[int], first: IntArray, last: IntArray, step: int) -> Iterator[Band]:
    end = len(start) - 1
    while end > 0:
        begin = start[end]
        low, high = int(first[begin:end].min()), int(last[begin:end].max())
        if low < high:
            yield begin * step, end * step, low, high
        end = begin


def _ends(needed: BoolArray, step: int) -> tuple[IntArray, IntArray]:
    """Returns the first needed column of each `step` rows, and the column after the last one.

    Both are rounded to steps. If no column is needed, they are the number of columns and 0.
    """
    rows, columns = (size // step for size in needed.shape)
    blocks: BoolArray = np.maximum.reduce(needed.reshape(rows, step, columns, step), axis=(1, 3))
    has = blocks.any(axis=1)
    first = np.where(has, blocks.argmax(axis=1), columns)
    last = np.where(has, columns - blocks[:, ::-1].argmax(axis=1), 0)
    return first * step, last * step


def _tile(band: Band, shape: tuple[int, ...], bev: BevConfig, *, turned: bool) -> Tile:
    used = slice(band[0], band[1]), slice(band[2], band[3])
    rows, columns = (extent_of(one, cells, bev) for one, cells in zip(used, shape, strict=True))
    return (columns, rows) if turned else (rows, columns)
