"""Movements: from which arm to which arm of a junction a track goes, or which way on a road."""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from pyinfra.tracking.lines import Line

UNKNOWN = "?"  # start or end of a movement that begins or ends within the junction
COLUMNS = ["id", "type", "movement", "start", "end", "t_s", "travel_s"]


def movements(passages: pd.DataFrame, lines: Sequence[Line]) -> pd.DataFrame:
    """Returns one row per track that passes a line, ordered by time.

    The movement of a track is from the first to the last line that it passes. If both are one
    line that belongs to no junction, the movement is from the line to the direction. A direction is
    in brackets if a line has the same name. `travel_s` is the time between both lines.
    """
    groups = {line.name: line.group for line in lines}
    rows = []
    for _, part in passages.groupby("id", sort=False):
        part = part.sort_values("t_s")
        first, last = part.iloc[0], part.iloc[-1]
        start, end = first.line, last.line
        if start == end:
            if not groups[start]:
                end = first.direction
                end = f"({end})" if end in groups else end
            elif first["sign"] > 0:
                end = UNKNOWN
            else:
                start = UNKNOWN
        travel_s = last.t_s - first.t_s if len(part) > 1 else np.nan
        rows.append((first.id, first.type, f"{start} > {end}", start, end, last.t_s, travel_s))
    return pd.DataFrame(rows, columns=COLUMNS).sort_values(["t_s", "id"], ignore_index=True)
