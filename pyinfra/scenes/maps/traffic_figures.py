"""How well tracks move: turns, accelerations, overlaps, and who comes out of nowhere."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from pyinfra.core.arrays import FloatArray, IntArray
from pyinfra.core.boxes import pair_bev_overlap
from pyinfra.scenes.maps.smoothing import accelerations, turns_deg
from pyinfra.scenes.maps.tracks import Track, TrackTable, table, wrap

REGION_M = 100.0  # from a mount's foot
_NEIGHBOURS_M = 30.0
_TOUCH_M = 0.001
_AT_ONCE = 500  # instants and middles
MAX_OVERLAP_SHARE = 0.001
MOST_NOTES = 20  # that are shown


@dataclass(frozen=True)
class TrafficFigures:
    """Of a whole set of tracks; a share of nothing is 0."""

    classes: dict[str, int]  # tracks
    turn_deg: float  # the largest change of heading in 0.1 s
    acceleration_m_s2: float  # the largest of a box centre over 0.3 s
    overlap_share: float  # of pairs of boxes within 30 m of each other, every 0.05 s
    appearing: int  # tracks that begin or end in the region, but at the ends of time

    def rows(self) -> list[tuple[str, str]]:
        """Names and values for a table."""
        counts = ", ".join(f"{n} {name}" for name, n in sorted(self.classes.items()))
        return [
            ("tracks", counts or "none"),
            ("largest turn in 0.1 s, degrees", f"{self.turn_deg:.2f}"),
            ("largest acceleration over 0.3 s, m/s2", f"{self.acceleration_m_s2:.2f}"),
            ("pairs that overlap, percent", f"{100 * self.overlap_share:.4f}"),
            ("tracks that appear or vanish in the region", str(self.appearing)),
        ]


def traffic_figures(tracks: list[Track], feet: FloatArray) -> TrafficFigures:
    """feet: (k, 2) x y of the mounts."""
    rows = table(tracks)
    pairs, overlapping = _pairs(rows)
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
    """How many tracks begin or end in the region, other than with the first or last instant."""
    end = max((t.first + len(t.states) for t in tracks), default=0)
    count = 0
    for t in tracks:
        comes = t.first > 0 and _in_region(t.states[0, :2], feet)
        goes = t.first + len(t.states) < end and _in_region(t.states[-1, :2], feet)
        count += comes or goes
    return count


def without_overlaps(tracks: list[Track]) -> tuple[list[Track], list[str]]:
    """The tracks less those that overlap others most, until none does; and the names of these."""
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
    """Pairs of neighbours over instants and the middles between them, and who overlaps: (n, 2)."""
    count, neighbours = 0, [np.zeros((0, 2), np.int64)]
    rows = _with_middles(rows)
    touch = np.array([0, 0, 0, _TOUCH_M, _TOUCH_M, 0, 0])
    last = int(rows.instant.max(initial=-1))
    for start in range(0, last + 1, _AT_ONCE):
        some = slice(*np.searchsorted(rows.instant, [start, start + _AT_ONCE]))
        boxes, track = rows.boxes[some], rows.track[some]
        apart = 2 * _NEIGHBOURS_M * rows.instant[some]  # no two instants are neighbours
        tree = cKDTree(np.column_stack([boxes[:, :2], apart]))
        pairs = tree.query_pairs(_NEIGHBOURS_M, output_type="ndarray")
        a, b = boxes[pairs[:, 0]], boxes[pairs[:, 1]]
        level = np.abs(a[:, 2] - b[:, 2]) < (a[:, 5] + b[:, 5]) / 2  # not one on a bridge
        count += int(level.sum())
        reach = (np.hypot(*a[:, 3:5].T) + np.hypot(*b[:, 3:5].T)) / 2
        near = level & (np.hypot(*(a - b)[:, :2].T) < reach)
        hit = pair_bev_overlap(a[near] - touch, b[near] - touch) > 0
        neighbours.append(track[pairs[near][hit]])
    return count, np.concatenate(neighbours)


def _with_middles(rows: TrackTable) -> TrackTable:
    """Also the boxes halfway to each track's next instant; instants count half steps."""
    order = np.lexsort((rows.instant, rows.track))
    instant, track, boxes = rows.instant[order], rows.track[order], rows.boxes[order]
    on = np.flatnonzero((np.diff(track) == 0) & (np.diff(instant) == 1))
    middles = (boxes[on] + boxes[on + 1]) / 2
    middles[:, 6] = boxes[on, 6] + wrap(boxes[on + 1, 6] - boxes[on, 6]) / 2
    instant = np.concatenate([2 * instant, 2 * instant[on] + 1])
    track, boxes = np.concatenate([track, track[on]]), np.concatenate([boxes, middles])
    order = np.lexsort((track, instant))
    return TrackTable(instant[order], track[order], boxes[order], np.zeros((len(order), 0)))


def report_lines(
    file: Path, tracks: Sequence[Track], feet: FloatArray, notes: Sequence[str]
) -> list[str]:
    """The written file, its figures and the first of the notes, for a terminal."""
    rows = traffic_figures(list(tracks), feet).rows()
    lines = [str(file), *(f"  {name:45} {value}" for name, value in rows)]
    lines += [f"  {note}" for note in notes[:MOST_NOTES]]
    if len(notes) > MOST_NOTES:
        lines.append(f"  and {len(notes) - MOST_NOTES} more")
    return lines
