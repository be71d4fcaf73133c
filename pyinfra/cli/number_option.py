"""Options whose value is a list of numbers, such as `--mount X,Y,Z,YAW`."""

import argparse
from collections.abc import Callable


def numbers(names: str) -> Callable[[str], tuple[float, ...]]:
    """Returns a function that parses one number for each of `names`, with commas between them."""

    def read(text: str) -> tuple[float, ...]:
        try:
            values = tuple(float(word) for word in text.split(","))
        except ValueError:
            values = ()
        if len(values) != len(names.split(",")) or not all(abs(v) < 1e9 for v in values):
            raise argparse.ArgumentTypeError(f"expected numbers {names}, got '{text[:60]}'")
        return values

    return read
