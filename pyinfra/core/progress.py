"""Progress of long loops: a bar on terminals and in notebooks, else a line every half minute."""

import multiprocessing
import sys
import time
from collections.abc import Iterable, Iterator
from operator import length_hint
from typing import TypeVar

Item = TypeVar("Item")

DELAY_S = 2.0  # a loop that takes less time shows no progress
LINE_S = 30.0  # minimum time between two lines of progress


def is_shown() -> bool:
    """Returns whether bars are shown: on a terminal and in a notebook."""
    return sys.stderr.isatty() or "ipykernel" in sys.modules


def show_line(line: str) -> None:
    """Shows a line of progress, on terminals and in notebooks."""
    if is_shown():
        sys.stderr.write(f"{line}\n")


def track(items: Iterable[Item], unit: str) -> Iterator[Item]:
    """Yields the items. Shows their number so far, the rate and the time left.

    unit: singular name of an item, such as `frame`.
    """
    if not is_shown():
        yield from in_lines(items, unit)
        return
    from tqdm import tqdm

    yield from tqdm(items, unit=unit, delay=DELAY_S, leave=False, file=sys.stderr)


def in_lines(items: Iterable[Item], unit: str) -> Iterator[Item]:
    """Yields the items, and prints `Lines` where no bar is shown."""
    lines = Lines(unit, length_hint(items))
    for item in items:
        yield item
        lines.update()


class Lines:
    """Lines on stderr, such as `pyinfra: 120 of 300 frames, 2 min left`, where no bar is shown.

    Worker processes print nothing.

    unit: singular name of an item. total: number of all items, 0 if unknown. done: number of items
    that an earlier run has done.
    """

    def __init__(self, unit: str, total: int, done: int = 0) -> None:
        self.unit, self.total, self.first, self.done = unit, total, done, done
        self.start = self.last = time.monotonic()

    def update(self) -> None:
        """Counts an item, and prints a line if the last one is LINE_S ago."""
        self.done += 1
        now = time.monotonic()
        is_last = self.done >= self.total > 0
        if now - self.last < LINE_S or is_last or is_shown() or multiprocessing.parent_process():
            return
        self.last = now
        text = f"{self.done} {self.unit}s"
        if self.total:
            left_s = (now - self.start) / (self.done - self.first) * (self.total - self.done)
            left = f"{left_s / 60:.0f} min" if left_s >= 90 else f"{left_s:.0f} s"
            text = f"{self.done} of {self.total} {self.unit}s, {left} left"
        sys.stderr.write(f"pyinfra: {text}\n")
