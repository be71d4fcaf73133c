"""Keeps training frames in memory, and the points of objects that are pasted into other frames.

A training of many steps uses each frame many times. The frames are read once, before the first
step, and worker processes share them.
"""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial

import numpy as np

from pyinfra.core.arrays import FloatArray, Points
from pyinfra.core.boxes import rows_in_box
from pyinfra.models.training.samples import Frames

SHARE = 0.4  # largest share of the machine's memory that frames take


def kept(frames: Frames, *, pasted: bool) -> Frames:
    """Returns the frames with their clouds in memory, or unchanged if the memory is too small.

    pasted: whether the points of the objects are also needed, as `Frames.objects`.
    """
    if len(frames) == 0 or frames.clouds[0]().nbytes * len(frames) > SHARE * memory():
        return frames
    with ThreadPoolExecutor(min(16, os.cpu_count() or 1)) as pool:
        clouds = list(pool.map(lambda read: read(), frames.clouds))
        objects = list(pool.map(objects_of, clouds, frames.boxes)) if pasted else []
    readers: tuple[Callable[[], Points], ...] = tuple(partial(_same, cloud) for cloud in clouds)
    return replace(frames, clouds=readers, objects=tuple(objects))


def objects_of(points: Points, boxes: FloatArray) -> tuple[Points, ...]:
    """Returns the points (m, 4 or 5) of the object in each box (k, 7)."""
    x = np.ascontiguousarray(points[:, 0])
    return tuple(points[rows_in_box(points, x, box)] for box in boxes)


def memory() -> float:
    """Returns the size of the machine's memory in bytes; 0 if it is unknown."""
    try:
        return float(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
    except (ValueError, OSError, AttributeError):
        return 0.0


def _same(cloud: Points) -> Points:
    return cloud
