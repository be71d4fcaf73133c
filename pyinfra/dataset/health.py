"""Finds frames of a recording in which the sensor did not work as in its first minute.

Each frame is compared with the medians of the first minute, or of the first third of a shorter
recording: number of points, points by line and by azimuth, the ground around the sensor, and the
ranges by azimuth. A fault in more than half of these frames cannot be found in this way.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, fields
from hashlib import blake2b
from pathlib import Path

import numpy as np
import pandas as pd

from pyinfra.core.arrays import AnyArray, FloatArray, IntArray, Points, Records
from pyinfra.core.errors import FormatError
from pyinfra.core.files import write
from pyinfra.dataset.dead_lines import dead_lines, elevations_of
from pyinfra.formats import kitti

HEALTH_FILE = "health.csv"
HEALTH_PICTURE = "health.png"
REFERENCE_S = 60.0
LEAST_FRAMES = 5  # recordings with fewer frames are not checked
LEAST_POINTS = 1000  # recordings with fewer points per frame are not checked
MOST_POINTS = 30_000  # maximum number of points of a frame that are used, evenly distributed
SECTORS = 72  # number of azimuth sectors, 5 degrees each
CELL_M, REACH_M, NEAREST_M = 2.0, 40.0, 3.0  # ground grid: cell size, half side, inner radius
SIDE = round(2 * REACH_M / CELL_M)
LEAST_CELLS = 25
FEW, MANY = 0.6, 1.7  # minimum and maximum number of points, relative to the usual number
EMPTY = 0.02
LOST = 0.3  # a line or sector is lost if it has less than this share of its usual points
LEAST_LOST_SECTORS = 3
LEAST_LOST_LINES = 1
LEAST_COUNT = 15  # lines and sectors with a lower usual number of points are not checked
TILT_DEG, LIFT_M = 0.8, 0.3
TURN_SECTORS = 1
FAR_QUANTILE = 0.85
UNMOVED_SHARE = 0.8
# Mean absolute change of ln range above which a sensor has turned or moved. The mean is taken over
# the sectors that change least.
TURNED, MOVED = 0.08, 0.35
# Distance that is next to the sensor, and increase in the share of points within this distance that
# indicates dirt on the window.
NEAR_M, NEAR_SHARE = 1.0, 0.05
MOST_FRAMES = 1000  # maximum number of frames of a recording that are checked
MOST_RANGES = 6  # maximum number of frame ranges in a message


@dataclass(frozen=True)
class FrameHealth:
    """The differences of a frame from the first minute. Unknown values are NaN."""

    frame: int
    points: int
    points_share: float
    tilt_deg: float
    lift_m: float
    turn_deg: float
    lost_lines: int
    lost_sectors_deg: int
    near_share: float
    problems: str  # names of problems, separated by spaces; empty if there is none
    dead_lines: str  # numbers of the lines without points in all frames, separated by spaces


@dataclass(frozen=True, eq=False)
class _Features:
    """The features of a frame that are compared."""

    number: int
    points: int
    sectors: IntArray  # (SECTORS,) number of points in each sector
    ranges: FloatArray  # (SECTORS,) distance of far points in each sector; NaN without points
    ground: FloatArray  # (SIDE * SIDE,) lowest z in each cell; NaN without points
    lines: IntArray  # (lines,) number of points of each line
    elevations: FloatArray  # (lines,) mean elevation of each line, radians
    near: float  # share of the points next to the sensor
    digest: bytes
    end_s: float  # latest time of a point in the frame


@dataclass
class HealthMonitor:
    """Collects features of frames in order, and compares them in `report`."""

    period_s: float = 0.1
    _frames: list[_Features] = field(default_factory=list)

    def add(self, number: int, points: Points, records: Records | None = None) -> None:
        """Adds a frame: points (n, 4) in the levelled frame, and records (n,) of kitti.FIELDS."""
        step = 1 + len(points) // MOST_POINTS
        xyz = points[::step, :3].astype(np.float64)
        x, y, z = xyz.T
        sector = ((np.arctan2(y, x) + math.pi) / (2 * math.pi) * SECTORS).astype(np.int64) % SECTORS
        distance = np.hypot(x, y)
        times = np.zeros(0) if records is None else records["time_s"]
        self._frames.append(
            _Features(
                number=number,
                points=len(points),
                sectors=np.bincount(sector, minlength=SECTORS) * step,
                ranges=_far(sector, distance),
                ground=_lowest(x, y, z, distance),
                lines=np.zeros(0, np.int64) if records is None else np.bincount(records["ring"]),
                elevations=np.zeros(0) if records is None else elevations_of(points, records),
                near=float((distance < NEAR_M).mean()) if len(xyz) else 0.0,
                digest=blake2b(points.tobytes(), digest_size=8).digest(),
                end_s=float(times.max()) if len(times) else 0.0,
            )
        )

    def report(self) -> list[FrameHealth]:
        """Returns the health of each frame; empty for too few frames or points."""
        frames = self._frames
        if len(frames) < LEAST_FRAMES:
            return []
        first = frames[0].number + REFERENCE_S / self.period_s
        count = sum(frame.number < first for frame in frames)
        reference = slice(0, max(min(count, len(frames) // 3), LEAST_FRAMES))
        good = frames[reference]
        width = max(len(frame.lines) for frame in frames)
        lines = np.array([np.pad(f.lines, (0, width - len(f.lines))) for f in frames])
        angles = [
            np.pad(f.elevations, (0, width - len(f.elevations)), constant_values=np.nan)
            for f in good
        ]
        dead_text = " ".join(map(str, dead_lines(lines[reference], np.array(angles))))
        usual = float(np.median([frame.points for frame in good if frame.points > 0] or [0]))
        if usual < LEAST_POINTS:
            return []
        lost_lines = _lost(lines, reference)
        lost_sectors = _lost(np.array([frame.sectors for frame in frames]), reference)
        usual_ranges = _nanmedian(np.array([frame.ranges for frame in good]))
        usual_ground = _nanmedian(np.array([frame.ground for frame in good]))
        usual_near = float(np.median([frame.near for frame in good]))
        usual_end = float(np.median([frame.end_s for frame in good]))
        out, before = [], b""
        for i, frame in enumerate(frames):
            share = frame.points / usual
            tilt, lift = _tilt(frame.ground, usual_ground)
            turn, change = _turned(frame.ranges, usual_ranges)
            is_empty = not share >= EMPTY
            sectors_deg = int(lost_sectors[i]) * 360 // SECTORS
            late_s = abs(frame.end_s - usual_end)
            problems = {
                "empty": is_empty,
                "few-points": not is_empty and share < FEW,
                "many-points": share > MANY,
                "frozen": frame.digest == before and frame.points > 0,
                "tilted": tilt > TILT_DEG,
                "lifted": tilt <= TILT_DEG and abs(lift) > LIFT_M,
                "turned": abs(turn) > TURN_SECTORS * 360 / SECTORS / 2,
                "moved": change > MOVED and not abs(turn) > 0,
                "lost-lines": not is_empty and lost_lines[i] >= LEAST_LOST_LINES,
                "lost-sectors": not is_empty and lost_sectors[i] >= LEAST_LOST_SECTORS,
                "dirt": frame.near > usual_near + NEAR_SHARE,
                "times": not is_empty and usual_end > 0 and late_s > 0.5 * usual_end,
            }
            before = frame.digest
            words = " ".join(name for name, is_present in problems.items() if is_present)
            out.append(
                FrameHealth(
                    *(frame.number, frame.points, round(share, 4), round(tilt, 3), round(lift, 3)),
                    *(round(turn, 1), int(lost_lines[i]), sectors_deg),
                    *(round(frame.near, 4), words, dead_text),
                )
            )
        return out


def folder_health(lidar_folder: Path, numbers: Sequence[int], period_s: float) -> list[FrameHealth]:
    """Returns the health of frames of a folder in the KITTI layout that can be read."""
    monitor = HealthMonitor(period_s)
    has_fields = (lidar_folder / "training/fields").is_dir()
    for number in numbers:
        file = kitti.frame_file(lidar_folder, "fields", number)
        try:
            points = kitti.read_points(kitti.frame_file(lidar_folder, "velodyne", number))
            records = kitti.read_fields(file) if has_fields and file.is_file() else None
        except FormatError:  # other checks report frames that cannot be read
            continue
        if records is not None and len(records) != len(points):
            records = None
        monitor.add(number, points, records)
    return monitor.report()


def recorded_health(lidar_folder: Path, numbers: Sequence[int]) -> list[FrameHealth]:
    """Returns the health of frames of a recording; empty for simulated frames.

    Long recordings are thinned to MOST_FRAMES frames. Raises FormatError for a wrong lidar.yaml.
    """
    if not numbers or not (lidar_folder / "lidar.yaml").is_file():
        return []
    lidar = kitti.read_lidar(lidar_folder)
    if lidar.preset != kitti.RECORDED:
        return []
    step = 1 + (len(numbers) - 1) // MOST_FRAMES
    return folder_health(lidar_folder, numbers[::step], lidar.period_s)


def health_text(health: Iterable[FrameHealth]) -> str:
    """Returns one text with the frames of each problem; empty if no frame has a problem.

    An example is `31 of 60 frames differ from the first minute: tilted (frames 29 to 59)`.
    """
    rows = list(health)
    bad = [row for row in rows if row.problems]
    dead = rows[0].dead_lines.split() if rows else []
    always = ""
    if dead:
        always = f"no frame has points of the lines {', '.join(dead)}: the lasers may be broken"
    if not bad:
        return always
    order = {row.frame: i for i, row in enumerate(rows)}
    texts = []
    for problem in dict.fromkeys(word for row in bad for word in row.problems.split()):
        frames = [row.frame for row in bad if problem in row.problems.split()]
        ranges: list[list[int]] = []
        for frame in frames:
            if ranges and order[frame] == order[ranges[-1][1]] + 1:
                ranges[-1][1] = frame
            else:
                ranges.append([frame, frame])
        words = [f"{a} to {b}" if a < b else str(a) for a, b in ranges[:MOST_RANGES]]
        more = ", ..." if len(ranges) > MOST_RANGES else ""
        texts.append(f"{problem} (frames {', '.join(words)}{more})")
    text = f"{len(bad)} of {len(rows)} frames differ from the first minute: {'; '.join(texts)}"
    return f"{text}; {always}" if always else text


def write_health(file: Path, health: Iterable[FrameHealth]) -> None:
    """Writes one row per frame as CSV."""
    names = [column.name for column in fields(FrameHealth)]
    table = pd.DataFrame(list(health), columns=names)
    write(file, table.to_csv(index=False, na_rep="nan", lineterminator="\n"))


def _far(sector: IntArray, distance: FloatArray) -> FloatArray:
    """Returns a high quantile of the distances of each sector: (SECTORS,), NaN without points.

    Far points lie on buildings, which show a turn; near points lie on the ground.
    """
    out = np.full(SECTORS, np.nan)
    order = np.lexsort([distance, sector])
    starts = np.searchsorted(sector[order], np.arange(SECTORS + 1))
    counts = np.diff(starts)
    has = counts > 0
    out[has] = distance[order][(starts[:-1] + (FAR_QUANTILE * counts).astype(np.int64))[has]]
    return out


def _lowest(x: FloatArray, y: FloatArray, z: FloatArray, distance: FloatArray) -> FloatArray:
    """Returns the lowest z in each cell around the sensor: (SIDE * SIDE,), NaN without points."""
    near = (distance > NEAREST_M) & (np.abs(x) < REACH_M) & (np.abs(y) < REACH_M)
    column, row = ((v[near] + REACH_M) / CELL_M for v in (x, y))
    cell = column.astype(np.int64) * SIDE + row.astype(np.int64)
    out = np.full(SIDE * SIDE, np.inf)
    np.minimum.at(out, cell, z[near])
    return np.where(np.isfinite(out), out, np.nan)


def _nanmedian(values: FloatArray) -> FloatArray:
    """Returns the median of each column; NaN if less than half of its values are finite."""
    often = np.asarray(np.isfinite(values).mean(axis=0) >= 0.5)
    out = np.full(values.shape[1], np.nan)
    if often.any():
        out[often] = np.nanmedian(values[:, often], axis=0)
    return out


def _lost(counts: IntArray, reference: slice) -> IntArray:
    """Returns how many columns have lost their points in each row of counts (frames, columns)."""
    if counts.shape[1] == 0:
        return np.zeros(len(counts), dtype=np.int64)
    usual = np.median(counts[reference], axis=0)
    low = np.quantile(counts[reference], 0.25, axis=0)
    steady = (usual >= LEAST_COUNT) & (low > 0.6 * usual)
    return np.asarray((counts[:, steady] < LOST * usual[steady]).sum(axis=1))


def _tilt(ground: FloatArray, usual: FloatArray) -> tuple[float, float]:
    """Returns angle (degrees) and height (m) of a frame's ground above the usual ground.

    A plane is fitted to the differences of the cells, without the cells that fit worst.
    """
    both = np.flatnonzero(np.isfinite(ground) & np.isfinite(usual))
    if len(both) < LEAST_CELLS:
        return 0.0, 0.0
    difference = (ground[both] - usual[both]).astype(np.float64)
    x, y = (both // SIDE, both % SIDE)
    a = np.column_stack([x * CELL_M - REACH_M, y * CELL_M - REACH_M, np.ones(len(both))])
    kept = np.ones(len(both), dtype=bool)
    solution: AnyArray = np.zeros(3)
    for _ in range(5):
        solution = np.linalg.lstsq(a[kept], difference[kept], rcond=None)[0]
        off = np.abs(difference - a @ solution)
        kept = off <= max(0.1, 2.0 * float(np.median(off)))
    if kept.sum() < max(LEAST_CELLS, 0.5 * len(both)):
        return 0.0, 0.0
    return math.degrees(math.atan(math.hypot(solution[0], solution[1]))), float(solution[2])


def _turned(ranges: FloatArray, usual: FloatArray) -> tuple[float, float]:
    """Returns the sensor's turn about z (degrees), and the change of ranges that it leaves."""
    changes = {}
    for shift in range(-SECTORS // 8, SECTORS // 8 + 1):
        moved = np.abs(np.log(np.maximum(np.roll(ranges, -shift), 0.1) / np.maximum(usual, 0.1)))
        moved = np.sort(moved[np.isfinite(moved)])
        moved = moved[: round(UNMOVED_SHARE * len(moved))]  # leaves out sectors changed by traffic
        changes[shift] = float(moved.mean()) if len(moved) >= SECTORS // 6 else math.inf
    best = min(changes, key=lambda shift: (changes[shift], abs(shift)))
    if math.isinf(changes[0]):
        return 0.0, 0.0
    is_turned = changes[0] > TURNED and changes[best] < 0.4 * changes[0]
    return (best * 360 / SECTORS if is_turned else 0.0), changes[best if is_turned else 0]
