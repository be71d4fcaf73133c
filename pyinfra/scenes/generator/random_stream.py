"""Random samples for one part of a site, which depend only on version, seed and part."""

import zlib
from collections.abc import Mapping
from typing import TypeVar

import numpy as np

VERSION = 5  # version of the generator; it increases if the site of a seed changes
# Key of the random streams. It is the same in all versions, so that a new version changes little in
# the sites of older versions.
KEY = 1

T = TypeVar("T")
Range = tuple[float, float]
Spans = Mapping[str, Range]
Weights = Mapping[str, float]


class RandomStream:
    """A random stream that derives all samples from uniform samples.

    NumPy may change its other distributions between versions.
    """

    def __init__(self, seed: int, part: str) -> None:
        key = [KEY, seed, zlib.crc32(part.encode())]
        self._random = np.random.Generator(np.random.PCG64(key))

    def within(self, span: Range, digits: int = 2) -> float:
        low, high = span
        return round(low + (high - low) * self._random.random(), digits)

    def each(self, spans: Spans) -> dict[str, float]:
        """Returns a sample for each key, in the order of the keys."""
        return {key: self.within(span) for key, span in spans.items()}

    def chance(self, share: float) -> bool:
        return bool(self._random.random() < share)

    def side(self) -> int:
        """Returns 1 for the left or -1 for the right side."""
        return 1 if self.chance(0.5) else -1

    def whole(self, span: tuple[int, int]) -> int:
        """Returns a whole number in the span, both ends included."""
        low, high = span
        return low + int((high - low + 1) * self._random.random())

    def one_of(self, weights: Mapping[T, float]) -> T:
        left = self._random.random() * sum(weights.values())
        for word, weight in weights.items():
            left -= weight
            if left < 0:
                return word
        return word
