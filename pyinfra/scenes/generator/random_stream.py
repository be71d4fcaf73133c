"""Draws of one part of one site: the same for the same version, seed and part."""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from typing import TypeVar

import numpy as np

VERSION = 5  # of the sites: it goes up where the same seed gives another site
KEY = 1  # of the draws: as it was, so that what a version adds is all that is new in a site

T = TypeVar("T")
Range = tuple[float, float]


class Draws:
    """Uniform numbers, of which all others are made: those of NumPy's other draws may change."""

    def __init__(self, seed: int, part: str) -> None:
        key = [KEY, seed, zlib.crc32(part.encode())]
        self._random = np.random.Generator(np.random.PCG64(key))

    def within(self, span: Range, digits: int = 2) -> float:
        low, high = span
        return round(low + (high - low) * self._random.random(), digits)

    def chance(self, share: float) -> bool:
        return bool(self._random.random() < share)

    def side(self) -> int:
        """1 for the left, -1 for the right."""
        return 1 if self.chance(0.5) else -1

    def whole(self, span: tuple[int, int]) -> int:
        """Both ends included."""
        low, high = span
        return low + int((high - low + 1) * self._random.random())

    def one_of(self, weights: Mapping[T, float]) -> T:
        left = self._random.random() * sum(weights.values())
        for word, weight in weights.items():
            left -= weight
            if left < 0:
                return word
        return word
