"""The classes that a network tells apart: their numbers, and the types that files have of them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pyinfra.core.arrays import IntArray, NameArray
from pyinfra.core.vocabulary import OBJECT_CLASSES, VEHICLES, ObjectClass
from pyinfra.metrics.matching import Metric

# What a network writes, as it knows no more of a vehicle.
TYPES: dict[ObjectClass, str] = {
    "vehicle": "vehicle",
    "pedestrian": "Pedestrian",
    "cyclist": "Cyclist",
}
# How one of them is found: people by their centres, as their footprints are as small as boxes err.
METRICS: dict[ObjectClass, Metric] = {"vehicle": "bev", "pedestrian": "centre", "cyclist": "centre"}
ALONG_ROADS = ("vehicle", "cyclist")  # the others go any way


def classes_of(config: object) -> tuple[ObjectClass, ...]:
    """That a network with this Config tells apart; most know vehicles alone."""
    classes: tuple[ObjectClass, ...] = getattr(config, "classes", VEHICLES)
    return classes


def numbers_of(types: NameArray, classes: Sequence[ObjectClass]) -> IntArray:
    """(n,) the place of the class of each type (n,) among the classes; -1: none of them."""
    numbers = np.full(len(types), -1)
    for number, name in enumerate(classes):
        numbers[np.isin(types, OBJECT_CLASSES[name])] = number
    return numbers
