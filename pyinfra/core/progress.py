"""Progress of long loops: a bar on terminals and in notebooks, nothing otherwise."""

import sys
from collections.abc import Iterable, Iterator
from typing import TypeVar

Item = TypeVar("Item")

DELAY_S = 2.0  # a loop that takes less time shows no progress


def is_shown() -> bool:
    """Returns whether progress is shown: on a terminal and in a notebook."""
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
        yield from items
        return
    from tqdm import tqdm

    yield from tqdm(items, unit=unit, delay=DELAY_S, leave=False, file=sys.stderr)
