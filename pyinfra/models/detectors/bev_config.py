"""Sizes of the two-dimensional network on a bird's-eye canvas (bev.py)."""

import math
from dataclasses import dataclass

from pyinfra.core.config import ruled
from pyinfra.core.errors import Error


@dataclass(frozen=True)
class BevConfig:
    """Two-dimensional network on the bird's-eye canvas; lists have one value per block."""

    layers: tuple[int, ...] = ruled((3, 5, 5), 0, 20)  # convolutions after the strided convolution
    widths: tuple[int, ...] = ruled((64, 128, 256), 1, 1024)  # channels of each block
    strides: tuple[int, ...] = ruled((2, 2, 2), 1, 4)  # stride of each block's first convolution
    up_width: int = ruled(128, 1, 1024)  # channels that each block adds to the output

    def __post_init__(self) -> None:
        if not 0 < len(self.layers) == len(self.widths) == len(self.strides):
            lengths = f"{len(self.layers)}, {len(self.widths)} and {len(self.strides)}"
            raise Error(
                f"layers, widths, strides: expected lists of equal lengths, got lengths {lengths}"
            )


def multiple(config: BevConfig, cell_m: float) -> float:
    """Returns the length in metres of which the sides of the area must be multiples."""
    return math.prod(config.strides) * cell_m
