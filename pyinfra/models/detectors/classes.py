"""The classes that a network distinguishes: their numbers, and their types in files."""

from collections.abc import Sequence

import numpy as np

from pyinfra.core.arrays import IntArray, NameArray
from pyinfra.core.vocabulary import OBJECT_CLASSES, VEHICLES, ObjectClass
from pyinfra.metrics.matching import Metric

# Type that a network writes for each class. Networks do not distinguish types of vehicles.
TYPES: dict[ObjectClass, str] = {
    "vehicle": "vehicle",
    "pedestrian": "Pedestrian",
    "cyclist": "Cyclist",
}
# Metric by which boxes of each class are matched. Pedestrians and cyclists are matched by their
# centres, because errors of predicted boxes are as large as the footprints of these objects.
METRICS: dict[ObjectClass, Metric] = {"vehicle": "bev", "pedestrian": "centre", "cyclist": "centre"}
ALONG_ROADS = ("vehicle", "cyclist")  # classes that move along roads; others move in any direction


def classes_of(config: object) -> tuple[ObjectClass, ...]:
    """Returns the classes that a network with this Config distinguishes.

    If the Config has no key `classes`, the only class is `vehicle`.
    """
    classes: tuple[ObjectClass, ...] = getattr(config, "classes", VEHICLES)
    return classes


def numbers_of(types: NameArray, classes: Sequence[ObjectClass]) -> IntArray:
    """Returns the index in `classes` of each type's class: (n,).

    The index is -1 for a type of no class in `classes`.
    """
    numbers = np.full(len(types), -1)
    for number, name in enumerate(classes):
        numbers[np.isin(types, OBJECT_CLASSES[name])] = number
    return numbers
