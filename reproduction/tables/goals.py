"""Makes tables of detectors on the frozen test sites, on frames with `frames_version` 4."""

from typing import Any

import pandas as pd

from reproduction.tables.common import Rows, results, with_heads

TITLES = {
    "ap_r1000": "AP (R1000)",
    "recall_at_half": "recall at a precision of 0.5",
    "false_per_frame": "false positives per frame",
    "recall": "recall",
}
DIGITS = {"ap_r1000": 1}
SHOWN = {
    ("vehicle", "ap_r1000"),
    ("vulnerable road user", "ap_r1000"),
    ("vehicle, no region", "false_per_frame"),
    ("vehicle in a queue", "recall"),
}
# A pilot is a short training that tests an idea. Maps the part before `_` in the name of its model
# to its description.
PILOTS = {"single": "pilot, single frames", "past": "pilot with the past"}


@with_heads("sites", "kind", "objects", "figure", "version 3", "version 4", "difference")
def goals() -> Rows:
    """Returns a table of both versions of the pretrained detector, by set of sites and kind."""
    table = results("detector_goals").query("objects > 0")
    earlier, present = (table[table.model == name] for name in ("generalist-3", "generalist"))
    for old, new in zip(earlier.itertuples(), present.itertuples(), strict=True):
        kind, figure = str(new.kind), TITLES[str(new.figure)]
        where, values = f"{new.set} ({new.sites})", (_value(old), _value(new))
        yield [where, kind, str(new.objects), figure, *values, _value(new, "difference")]


@with_heads("sites", "kind", "figure", "detector", "value", "difference")
def pilots() -> Rows:
    """Returns a table of the pilots' figures and their differences to version 3."""
    table = results("detector_pilots").query("objects > 0")
    kept = [pair in SHOWN for pair in zip(table.kind, table.figure, strict=True)]
    for row in table[kept].itertuples():
        arm, _, seed = str(row.model).partition("_")
        if arm == "past" and row.inputs != "past":
            continue  # this row was measured without past frames
        name = f"{PILOTS[arm]}, seed {seed}" if arm in PILOTS else "version 3"
        less = _value(row, "difference") if arm in PILOTS else ""
        where = f"{row.set} ({row.sites})"
        yield [where, row.kind, TITLES[row.figure], name, _value(row), less]


def _value(row: Any, name: str = "") -> str:
    """Returns a figure with its interval, if there is one."""
    digits = DIGITS.get(str(row.figure), 2)
    sign = "+" if name else ""
    keys = (name or "value", f"{name}_low".lstrip("_"), f"{name}_high".lstrip("_"))
    value, low, high = (float(getattr(row, key)) for key in keys)
    if pd.isna(low):
        return f"{value:{sign}.{digits}f}"
    return f"{value:{sign}.{digits}f} [{low:.{digits}f}, {high:.{digits}f}]"
