"""Quality figures of tracks: turns, accelerations, overlaps, and tracks that appear suddenly."""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from pyinfra.core.arrays import FloatArray, IntArray
from pyinfra.core.boxes import pair_bev_overlap, wrapped
from pyinfra.scenes.maps.smoothing import accelerations, turns_deg
from pyinfra.scenes.maps.tracks import Track, TrackTable, table

REGION_M = 100.0  # radius of the region around a mount's foot
_NEIGHBOURS_M = 30.0  # maximum distance between two boxes that are checked for overlap
_TOUCH_M = 0.001  # boxes are shrunk by this length, so that touching boxes do not overlap
_AT_ONCE = 500  # number of instants per batch, including those halfway between two instants
MAX_OVERLAP_SHARE = 0.001  # maximum allowed `overlap_share`
MOST_NOTES = 20  # maximum number of notes in a report
MOST_NAMES = 3  # maximum number of names in a note about several tracks


@dataclass(frozen=True)
class TrafficFigures:
    """Figures of a set of tracks. Shares and maxima of an empty set are 0."""

    classes: dict[str, int]  # number of tracks by class
    turn_deg: float  # largest change of heading in 0.1 s
    acceleration_m_s2: float  # largest acceleration of a box centre over 0.3 s
    overlap_share: float  # share of overlaps among pairs of boxes within 30 m, every 0.05 s
    # Number of tracks that begin or end in the region, except at the first or last instant.
    appearing: int

    def rows(self) -> list[tuple[str, str]]:
        """Returns names and values for a table."""
        counts = ", ".join(f"{n} {name}" for name, n in sorted(self.classes.items()))
        return [
            ("tracks", counts or "none"),
            ("largest turn in 0.1 s, degrees", f"{self.turn_deg:.2f}"),
            ("largest acceleration over 0.3 s, m/s2", f"{self.acceleration_m_s2:.2f}"),
            ("pairs that overlap, percent", f"{100 * self.overlap_share:.4f}"),
            ("tracks that appear or vanish in the region", str(self.appearing)),
        ]


def traffic_figures(tracks: list[Track], feet: FloatArray) -> TrafficFigures:
    """Computes the figures of tracks. The mounts' feet (k, 2) are x y."""
    pairs, overlapping = _pairs(table(tracks))
    turns = [float(t.max()) for t in map(turns_deg, tracks) if len(t)]
    forces = [float(a.max()) for a in map(accelerations, tracks) if len(a)]
    return TrafficFigures(
        dict(Counter(t.object_class for t in tracks)),
        max(turns, default=0.0),
        max(forces, default=0.0),
        len(overlapping) / max(1, pairs),
        appearing(tracks, feet),
    )


def appearing(tracks: list[Track], feet: FloatArray) -> int:
    """Returns the number of tracks that appear or vanish in the region.

    Tracks may begin in the region at the first instant, and end there at the last instant.
    """
    end = max((t.first + len(t.states) for t in tracks), default=0)
    count = 0
    for t in tracks:
        appears = t.first > 0 and _in_region(t.states[0, :2], feet)
        vanishes = t.first + len(t.states) < end and _in_region(t.states[-1, :2], feet)
        count += appears or vanishes
    return count


def without_overlaps(tracks: list[Track]) -> tuple[list[Track], list[str]]:
    """Removes the track with most overlaps until no tracks overlap.

    Returns the remaining tracks, and the names of the removed tracks.
    """
    _, overlapping = _pairs(table(tracks))
    left = [(int(a), int(b)) for a, b in overlapping]
    gone: set[int] = set()
    while left:
        worst = Counter(i for pair in left for i in pair).most_common(1)[0][0]
        gone.add(worst)
        left = [pair for pair in left if worst not in pair]
    kept = [t for i, t in enumerate(tracks) if i not in gone]
    return kept, [tracks[i].name for i in sorted(gone)]


def _in_region(point: FloatArray, feet: FloatArray) -> bool:
    return bool((np.linalg.norm(feet - point, axis=1) < REGION_M).any())


def _pairs(rows: TrackTable) -> tuple[int, IntArray]:
    """Returns the number of neighbouring pairs, and the track pairs (n, 2) that overlap.

    The function counts pairs at all instants and halfway between two instants.
    """
    count, neighbours = 0, [np.zeros((0, 2), np.int64)]
    rows = _with_middles(rows)
    touch = np.array([0, 0, 0, _TOUCH_M, _TOUCH_M, 0, 0])
    last = int(rows.instant.max(initial=-1))
    for start in range(0, last + 1, _AT_ONCE):
        batch = slice(*np.searchsorted(rows.instant, [start, start + _AT_ONCE]))
        boxes, track = rows.boxes[batch], rows.track[batch]
        apart = 2 * _NEIGHBOURS_M * rows.instant[batch]  # separates boxes of different instants
        tree = cKDTree(np.column_stack([boxes[:, :2], apart]))
        pairs = tree.query_pairs(_NEIGHBOURS_M, output_type="ndarray")
        a, b = boxes[pairs[:, 0]], boxes[pairs[:, 1]]
        level = np.abs(a[:, 2] - b[:, 2]) < (a[:, 5] + b[:, 5]) / 2  # excludes bridges
        count += int(level.sum())
        reach = (np.hypot(*a[:, 3:5].T) + np.hypot(*b[:, 3:5].T)) / 2
        near = level & (np.hypot(*(a - b)[:, :2].T) < reach)
        hit = pair_bev_overlap(a[near] - touch, b[near] - touch) > 0
        neighbours.append(track[pairs[near][hit]])
    return count, np.concatenate(neighbours)


def _with_middles(rows: TrackTable) -> TrackTable:
    """Adds boxes halfway between successive instants of each track.

    The result counts instants in half steps.
    """
    order = np.lexsort((rows.instant, rows.track))
    instant, track, boxes = rows.instant[order], rows.track[order], rows.boxes[order]
    on = np.flatnonzero((np.diff(track) == 0) & (np.diff(instant) == 1))
    middles = (boxes[on] + boxes[on + 1]) / 2
    middles[:, 6] = boxes[on, 6] + wrapped(boxes[on + 1, 6] - boxes[on, 6]) / 2
    instant = np.concatenate([2 * instant, 2 * instant[on] + 1])
    track, boxes = np.concatenate([track, track[on]]), np.concatenate([boxes, middles])
    order = np.lexsort((track, instant))
    return TrackTable(instant[order], track[order], boxes[order], np.zeros((len(order), 0)))


def report_lines(
    file: Path, tracks: Sequence[Track], feet: FloatArray, notes: Sequence[str]
) -> list[str]:
    """Returns the lines of a report about the written file, its figures, and the first notes."""
    rows = traffic_figures(list(tracks), feet).rows()
    lines = [str(file), *(f"  {name:45} {value}" for name, value in rows)]
    grouped = by_reason(notes)
    lines += [f"  {note}" for note in grouped[:MOST_NOTES]]
    if len(grouped) > MOST_NOTES:
        lines.append(f"  and {len(grouped) - MOST_NOTES} more")
    return lines


def by_reason(notes: Sequence[str]) -> list[str]:
    """Joins the notes `NAME: REASON` of tracks with the same reason into one line.

    Numbers in a reason are ignored: `cut at 3.1 s` and `cut at 4.5 s` are the same reason.
    """
    groups: dict[str, list[str]] = {}
    for note in notes:
        reason = re.sub(r"\d+(\.\d+)?", "#", note.partition(": ")[2] or note)
        groups.setdefault(reason, []).append(note)
    return [_one_line(group) for group in groups.values()]


def _one_line(group: Sequence[str]) -> str:
    """Returns one line for notes that differ only in the track's name or in numbers."""
    if len(group) == 1:
        return group[0]
    reasons = {note.partition(": ")[2] for note in group}
    if len(reasons) > 1:
        return f"{len(group)} tracks, such as {group[0]}"
    listed = ", ".join(note.partition(": ")[0] for note in group[:MOST_NAMES])
    more = ", ..." if len(group) > MOST_NAMES else ""
    return f"{len(group)} tracks: {reasons.pop()} ({listed}{more})"
