"""Counts and findings of an import."""

from collections import Counter
from dataclasses import dataclass, field

import numpy as np

from pyinfra.core.arrays import FloatArray
from pyinfra.dataset.health import FrameHealth, HealthMonitor
from pyinfra.exchange.coverage import Coverage


@dataclass
class ImportSummary:
    """Counts of an import, collected while the frames are written."""

    frames: int = 0
    points: int = 0
    without_return: int = 0  # number of dropped points, which are not finite or 0 0 0
    without_intensity: int = 0  # number of points whose intensity, which is not finite, is set to 0
    empty: list[str] = field(default_factory=list)  # names of frames without a return
    # Names of frames with the same points as another frame.
    doubled: list[str] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)  # objects that could not be read, and why
    bad: list[str] = field(default_factory=list)  # frames that could not be read, and why
    assumed: tuple[str, ...] = ()
    not_read: list[str] = field(default_factory=list)  # parts of the recording that are not read
    unread_keys: set[str] = field(default_factory=set)  # keys of labels that are not read
    types: Counter[str] = field(default_factory=Counter)
    tracked: int = 0  # number of labels whose track is known
    wide: int = 0  # number of labelled vehicles that are wider than long
    bottoms: list[FloatArray] = field(default_factory=list)  # z of the vehicles' bottoms
    coverage: Coverage = field(default_factory=Coverage)
    monitor: HealthMonitor = field(default_factory=HealthMonitor)
    health: list[FrameHealth] = field(default_factory=list)

    @property
    def below_m(self) -> float | None:
        """Median depth of the labelled vehicles' bottoms below the sensor, in metres.

        The depth is None if there is no labelled vehicle.
        """
        bottoms = np.concatenate([np.empty(0), *self.bottoms])
        return -float(np.median(bottoms)) if len(bottoms) else None
