"""Maps the class names of other tools to the types of this package."""

from collections.abc import Mapping, Sequence

import numpy as np

from pyinfra.core.arrays import NameArray
from pyinfra.core.errors import Error
from pyinfra.formats.csv_table import plain_cell

# Maps parts of names to types. The parts of a name such as `vehicle.bus.rigid` are looked up from
# the last to the first.
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


# Maps names in public roadside data sets that are not in TYPES or that TYPES would map wrongly.
_CHINESE = {
    "tricyclist": "Misc",
    "barrowlist": "Misc",
    "trafficcone": "Misc",
    "CarIgnore": "Misc",
    "PedestrianIgnore": "Misc",
    "OtherIgnore": "Misc",
    "unknown_movable": "Misc",
    "unknown_unmovable": "Misc",
    "unknown": "Misc",
}
_WAYS = (str.upper, str.capitalize)  # functions that give other spellings of a name
PUBLIC = {
    "dair-v2x": _CHINESE,
    "rcooper": _CHINESE | {"tricycle": "Misc", "huge_vehicle": "vehicle"},
    "tumtraf": {"trailer": "vehicle", "emergency_vehicle": "vehicle", "other": "Misc"},
}


def with_public_types(format: str, user_types: Mapping[str, str]) -> dict[str, str]:
    """Returns the types by name of a public data set, in all spellings, and the user's types.

    The user's types take precedence.
    """
    public = PUBLIC.get(format, {})
    written = {spelling(name): kind for name, kind in public.items() for spelling in (str, *_WAYS)}
    return {**written, **user_types}


def types_of(names: NameArray, user_types: Mapping[str, str]) -> NameArray:
    """Returns the types (k,) of names (k,): by `user_types`, else by TYPES, else the name itself.

    If the name itself is returned, `_` replaces blanks, and a first sign such as `=` that would
    make the name a formula in a spreadsheet.
    """
    return np.array([_type(str(name), user_types) for name in names], dtype=np.str_)


def parse_types(words: Sequence[str]) -> dict[str, str]:
    """Parses texts `NAME=TYPE` into a dict of types by name. Raises Error for other texts."""
    types = {}
    for word in words:
        name, equals, kind = word.rpartition("=")
        if not equals or not name or not kind or len(kind.split()) != 1:
            raise Error(f"types: expected NAME=TYPE, got '{word}'")
        types[name] = kind
    return types


def _type(name: str, user_types: Mapping[str, str]) -> str:
    if name in user_types:
        return user_types[name]
    parts = reversed(name.lower().split("."))
    types = (TYPES[part] for part in parts if part in TYPES)
    return next(types, plain_cell("_".join(name.split())))
