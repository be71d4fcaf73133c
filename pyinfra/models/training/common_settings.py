"""Checks the settings that all data sets of a training must share."""

from collections.abc import Sequence

from pyinfra.core.errors import Error
from pyinfra.core.vocabulary import LabelTime
from pyinfra.models.training.accumulation import Accumulation
from pyinfra.models.training.sources import Source


def common_label_time(sources: Sequence[Source]) -> LabelTime:
    """Returns the label time that all sources share. Raises Error if their label times differ."""
    first = sources[0]
    for other in sources:
        if other.label_time != first.label_time:
            raise Error(
                f"{other.lidar} in {other.scene}: label_time: expected {first.label_time}, got "
                f"{other.label_time}; {first.lidar} in {first.scene} has {first.label_time}"
            )
    return first.label_time


def common_accumulation(sources: Sequence[Source]) -> Accumulation:
    """Returns the accumulation that all sources share. Raises Error if two sources differ."""
    first = sources[0]
    for other in sources:
        if other.accumulation != first.accumulation:
            raise Error(
                f"{other.lidar} in {other.scene}: accumulation: expected the same as for "
                f"{first.lidar} in {first.scene} ({first.accumulation.frames} frames, label at "
                f"{first.accumulation.label_at}), got {other.accumulation.frames} frames, label at "
                f"{other.accumulation.label_at}"
            )
    return first.accumulation
