"""What other tools call the vehicles, and what they are called here."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from pyinfra.arrays import NameArray

# By any part of a name such as `vehicle.bus.rigid`, the last one first.
TYPES = {
    "car": "Car",
    "van": "Van",
    "truck": "Truck",
    "bus": "Bus",
    "motorcycle": "Motorcycle",
    "motorcyclist": "Motorcycle",
    "ambulance": "Van",
    "police": "Car",
    "vehicle": "vehicle",
    "bicycle": "Cyclist",
    "cyclist": "Cyclist",
    "pedestrian": "Pedestrian",
}


def types_of(names: NameArray, own: Mapping[str, str]) -> NameArray:
    """Types (k,) of the names (k,): what `own` says, else TYPES, else the name itself."""
    return np.array([_type(str(name), own) for name in names], dtype=np.str_)


def own_types(words: Sequence[str]) -> dict[str, str]:
    """`NAME=TYPE` as names with their types. Raises ValueError for another form."""
    types = {}
    for word in words:
        name, equals, kind = word.rpartition("=")
        if not equals or not name or not kind or len(kind.split()) != 1:
            raise ValueError(f"--type: found '{word}', allowed NAME=TYPE")
        types[name] = kind
    return types


def _type(name: str, own: Mapping[str, str]) -> str:
    if name in own:
        return own[name]
    parts = reversed(name.lower().split("."))
    known = (TYPES[part] for part in parts if part in TYPES)
    return next(known, "_".join(name.split()))
