"""The passages of tracks over lines: when, which way, in which lane and how fast."""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from pyinfra.core.arrays import BoolArray, FloatArray, IntArray
from pyinfra.core.vocabulary import KM_H, PERSON_TYPES
from pyinfra.tracking.lines import Line
from pyinfra.tracking.table_file import HIDDEN, MISSED

COLUMNS = [
    "t_s", "line", "direction", "sign", "lane", "id", "type", "speed_km_h", "length_m", "x", "y",
    "offset_m", "headway_s", "gap_s", "unseen",
]  # fmt: skip
LANE_M = 2.2  # maximum distance between the mean offsets of two groups of passages in one lane
# A passage is unseen if the track's boxes before and after it are further apart than this. Tracks
# in view end after this time without a box, so the track was hidden, or stood without a box.
UNSEEN_S = 1.5


def passages(tracks: pd.DataFrame, lines: Sequence[Line]) -> pd.DataFrame:
    """Returns the passages of tracks over lines, ordered by time.

    A track passes a line at most once: a passage and a passage back cancel out. Only vehicles have
    lanes and headways; the lane of people is 0. Passages without boxes near them are `unseen`, and
    have no speed.

    tracks : frame, t_s, id, type, x y dx, speed_m_s, ordered by frame. Without `state`, each row
        has a box
    """
    rows = tracks.sort_values(["id", "t_s"], kind="stable")
    values = rows[["x", "y", "t_s", "speed_m_s"]].to_numpy(np.float64)
    ids = rows["id"].to_numpy(np.int64)
    unseen = _unseen(rows)
    parts = []
    for line in lines:
        found = _crossings(values, ids, line)
        if found is not None:
            row, share, sign, offset = found
            at = values[row] + share[:, None] * (values[row + 1] - values[row])
            part = pd.DataFrame(at, columns=["x", "y", "t_s", "speed_m_s"])
            part["id"], part["sign"], part["offset_m"] = ids[row], sign, offset
            part["type"], part["length_m"] = (
                rows["type"].to_numpy()[row],
                rows["dx"].to_numpy()[row],
            )
            part["unseen"] = unseen[row].astype(int)
            part["line"] = line.name
            part["direction"] = np.where(sign > 0, line.forward, line.backward)
            parts.append(part)
    if not parts:
        return pd.DataFrame(columns=COLUMNS)
    table = pd.concat(parts).sort_values(["t_s", "id"], ignore_index=True)
    table["speed_km_h"] = KM_H * table.pop("speed_m_s").where(table.unseen == 0)
    table["lane"] = 0
    for _, part in table[~table["type"].isin(PERSON_TYPES)].groupby(["line", "sign"]):
        table.loc[part.index, "lane"] = _lanes(part.offset_m.to_numpy(), int(part["sign"].iloc[0]))
    return with_headways(table)[COLUMNS]


def _unseen(rows: pd.DataFrame) -> BoolArray:
    """Returns for each row, (n,), whether the time to the next row is in a gap without boxes.

    rows: ordered by id and time. A gap is longer than UNSEEN_S, or has no box at one of its ends.
    """
    if "state" not in rows:
        return np.zeros(len(rows), np.bool_)
    seen = ~rows.state.isin([MISSED, HIDDEN])
    times = rows.t_s.astype(float).where(seen).groupby(rows["id"])
    gap_s = times.bfill().shift(-1) - times.ffill()
    both = seen & seen.shift(-1, fill_value=False)  # frames may be far apart
    return np.asarray((gap_s.isna() | (gap_s > UNSEEN_S)) & ~both, np.bool_)


def _crossings(
    values: FloatArray, ids: IntArray, line: Line
) -> tuple[IntArray, FloatArray, IntArray, FloatArray] | None:
    """Returns four values of each passage; None if there is no passage.

    They are the row before it, its share of the step to the next row, its direction (1 or -1), and
    its offset along the line.
    """
    start, end = np.array(line.start), np.array(line.end)
    along = (end - start) / line.length_m
    left = np.array([-along[1], along[0]])
    side, offset = (values[:, :2] - start) @ left, (values[:, :2] - start) @ along
    step = np.flatnonzero((ids[1:] == ids[:-1]) & ((side[1:] > 0) != (side[:-1] > 0)))
    share = side[step] / (side[step] - side[step + 1])
    where = offset[step] + share * (offset[step + 1] - offset[step])
    sign = np.where(side[step + 1] > 0, 1, -1)
    within = (where >= 0) & (where <= line.length_m)
    step, share, sign, where = step[within], share[within], sign[within], where[within]
    net = pd.Series(sign).groupby(ids[step]).transform("sum").to_numpy()
    counts = pd.Series(sign == np.sign(net))  # passages in the net direction
    first = counts & (counts.groupby(ids[step]).cumsum() == 1)
    keep = first.to_numpy() & (net != 0)
    return (step[keep], share[keep], sign[keep], where[keep]) if keep.any() else None


def _lanes(offset: FloatArray, sign: int) -> IntArray:
    """Returns lane numbers from 1, from the right in the direction of travel.

    This is clustering by average linkage. On a line, the average distance of two clusters is that
    of their means, and only neighbours are joined. SciPy's linkage would need the distances of
    all pairs in memory.
    """
    order = np.argsort(-sign * offset, kind="stable")
    means, sizes = -sign * offset[order], np.ones(len(offset), np.int64)
    while len(means) > 1 and (apart := np.diff(means)).min() <= LANE_M:
        i = int(apart.argmin())
        means[i] = np.average(means[i : i + 2], weights=sizes[i : i + 2])
        sizes[i] += sizes[i + 1]
        means, sizes = np.delete(means, i + 1), np.delete(sizes, i + 1)
    lanes = np.empty(len(offset), np.int64)
    lanes[order] = np.repeat(np.arange(1, len(sizes) + 1), sizes)
    return lanes


def with_headways(table: pd.DataFrame) -> pd.DataFrame:
    """Adds times to the previous vehicle of the lane: between centres, and without its length."""
    lanes = [table.line, table["sign"], table.lane.where(table.lane > 0)]
    headway = table.t_s.groupby(lanes).diff()
    passing_s = table.length_m / np.maximum(table.speed_km_h / KM_H, 0.5)
    before = passing_s.groupby(lanes).shift(1)
    return table.assign(headway_s=headway, gap_s=np.maximum(headway - before, 0))
