"""Names of tracks in tables and label files of other tools.

Programs write one id in several ways. A table program that keeps ids as decimals writes 7.0 for 7,
and -1.0 or NaN for an unknown id.
"""

import re
from collections import Counter
from collections.abc import Sequence
from decimal import Decimal

# Words for an unknown track, in lower case.
UNKNOWN = frozenset(("", "none", "null", "nan", "-nan", "na", "n/a", "<na>", "unknown"))
# A whole number, also with zeros as decimals, or with the exponent of a large number.
_WHOLE = re.compile(r"[+-]?[0-9]{1,40}(\.0*|(\.[0-9]{1,40})?e\+[0-9]{1,2})?")


def track_name(word: object) -> str:
    """Returns the name of a track, which is equal for equal ids; empty if the track is unknown.

    A track is unknown if its id is missing, a word of UNKNOWN, or a negative number.
    """
    text = str(word).strip()
    if text.casefold() in UNKNOWN:
        return ""
    value = Decimal(text) if _WHOLE.fullmatch(text) else None
    if value is None or value != int(value):
        return text
    return str(int(value)) if value >= 0 else ""


def names_in_frame(words: Sequence[object], places: Sequence[str]) -> list[str]:
    """Returns the track name of each object of a frame, different for all objects.

    An object whose track is unknown, or is also that of another object of the frame, gets its place
    as its name. `places` are texts such as `FILE: object 3`, which are unique in a recording.
    """
    names = [track_name(word) for word in words]
    count = Counter(names)
    return [
        name if name and count[name] == 1 else place
        for name, place in zip(names, places, strict=True)
    ]
