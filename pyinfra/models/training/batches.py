"""Makes the batches of a training in advance, in a thread or in worker processes.

A batch is a function of its step, so it is the same with any number of workers.
"""

import multiprocessing
from collections import deque
from collections.abc import Callable, Generator, Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

from torch.utils.data import DataLoader, Dataset

from pyinfra.models.detectors.batch import Batch

AHEAD = 16  # number of batches made in advance, more than the about 12 that a stream makes at once
FETCHED = 3  # number of tasks that each worker begins in advance

Make = Callable[[int], Batch]  # makes the batch of a step


def ahead(make: Make, steps: range) -> Generator[tuple[int, Batch]]:
    """Yields each step with its batch. A second thread makes the batches in advance.

    If making a batch fails, the error is raised when its step is due.
    """
    pool, begun = ThreadPoolExecutor(1), deque[tuple[int, Future[Batch]]]()
    try:
        for step in steps:
            begun.append((step, pool.submit(make, step)))
            if len(begun) > AHEAD:
                first, batch = begun.popleft()
                yield first, batch.result()
        for step, batch in begun:
            yield step, batch.result()
    finally:
        pool.shutdown(cancel_futures=True)


@dataclass(frozen=True)
class _Tasks(Dataset[list[tuple[int, Batch | Exception]]]):
    """The tasks of workers. A task makes the batches of some consecutive steps."""

    make: Make
    steps: range
    together: int

    def __len__(self) -> int:
        return -(-len(self.steps) // self.together)

    def __getitem__(self, task: int) -> list[tuple[int, Batch | Exception]]:
        made: list[tuple[int, Batch | Exception]] = []
        for step in self.steps[task * self.together : (task + 1) * self.together]:
            try:
                made.append((step, self.make(step)))
            except Exception as error:  # the error is raised when its step is due
                made.append((step, error))
        return made


def from_workers(
    make: Make, steps: range, workers: int, *, together: int = 1, pinned: bool = False
) -> Generator[tuple[int, Batch]]:
    """Yields each step with its batch, which worker processes make in advance.

    The processes start at once, so that they are forked before this process uses a GPU. together:
    number of consecutive steps that one worker makes, because they share work. pinned: whether the
    batches are in memory from which a GPU copies while the CPU goes on.
    """
    if not steps:
        return _batches(())
    forks = "fork" in multiprocessing.get_all_start_methods()
    loader: DataLoader[Any] = DataLoader(
        _Tasks(make, steps, together),
        batch_size=None,
        sampler=range(-(-len(steps) // together)),
        num_workers=workers,
        collate_fn=_as_it_is,
        prefetch_factor=FETCHED,
        pin_memory=pinned,
        # A forked worker shares the frames in memory, and can run the caller's own functions.
        multiprocessing_context="fork" if forks else None,
    )
    return _batches(iter(loader))


def _batches(tasks: Iterable[Any]) -> Generator[tuple[int, Batch]]:
    """Yields the batches of tasks; raises the error of a batch when its step is due."""
    for task in tasks:
        for step, made in task:
            if isinstance(made, Exception):
                raise made
            yield step, made


def _as_it_is(made: Any) -> Any:
    return made
