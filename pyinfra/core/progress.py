"""Progress lines on a terminal. Only commands show them; functions of the library are silent."""

from __future__ import annotations

import sys
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import TypeVar

Item = TypeVar("Item")

DELAY_S = 2.0  # a loop that ends sooner shows nothing
_SHOWN: ContextVar[bool] = ContextVar("shown", default=False)


@contextmanager
def shown() -> Iterator[None]:
    """Context manager in which `track` shows progress, if stderr is a terminal."""
    token = _SHOWN.set(True)
    try:
        yield
    finally:
        _SHOWN.reset(token)


def track(items: Collection[Item], unit: str) -> Iterator[Item]:
    """Yields the items. On a terminal, shows their number so far, the rate and the time left.

    unit: singular name of an item, such as `frame`.
    """
    if not (_SHOWN.get() and sys.stderr.isatty()):
        yield from items
        return
    from tqdm import tqdm

    yield from tqdm(items, unit=unit, delay=DELAY_S, leave=False, file=sys.stderr)
