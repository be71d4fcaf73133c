"""`pyinfra.track`: tracks of a table of boxes, smoothed over the whole recording."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd

from pyinfra.core.arrays import FloatArray, IntArray, concatenated
from pyinfra.core.errors import Error
from pyinfra.core.names import suggestion
from pyinfra.core.public import public
from pyinfra.dataset.frame_sequence import FrameSequence, RecordedFrames
from pyinfra.dataset.object_rows import BOX
from pyinfra.dataset.simulated_frames import SimulatedFrames
from pyinfra.formats import kitti
from pyinfra.tracking import motion
from pyinfra.tracking.occlusion import View
from pyinfra.tracking.state import TYPES, Boxes, Tracks
from pyinfra.tracking.table_file import HIDDEN, MISSED, SEEN, TRACK_COLUMNS, check_columns
from pyinfra.tracking.tracker import Tracker, TrackSettings


@public()
def track(
    detections: pd.DataFrame,
    frames: FrameSequence | None = None,
    *,
    period_s: float | None = None,
    settings: TrackSettings | None = None,
    smooth: bool = True,
) -> pd.DataFrame:
    """Joins the boxes of a fixed sensor's frames into tracks.

    A Kalman filter predicts each track, and a box is assigned to the track whose prediction is
    nearest in units of its covariance. Calibrated scores decide when a track begins. A track that
    is hidden or standing is kept without boxes for some seconds. Rows of such frames have another
    `state`.

    Parameters
    ----------
    detections : table of `detect`: columns frame, type, x y z dx dy dz heading, score, in the
        levelled LiDAR frame, metres and radians. It may have a column `t_s`, the time in seconds,
        which must be the same for all boxes of a frame
    frames : the frames in which boxes were searched; they give the times, and the frames without
        boxes
    period_s : frame period in seconds, in place of `frames` and `t_s`
    settings : when tracks begin and end
    smooth : whether states use all boxes of the track, also later ones; without, they use the boxes
        up to their frame, as in live tracking

    Returns
    -------
    DataFrame : one row per frame and track, ordered by frame and id: frame, t_s, id, type, box,
        speed_m_s, acceleration_m_s2 (along the direction of motion), vx_m_s, vy_m_s, variances and
        covariance of position and speed, score (probability that the track is an object),
        frames_seen and frames_missed so far, state (`seen`, `missed` or `hidden`)

    Raises
    ------
    Error : for boxes without times, frames out of order, unknown types or invalid boxes

    Examples
    --------
    >>> import pyinfra as pi
    >>> frames = pi.simulate(pi.load_scene("highway", seed=1), "helios_16", range(10))
    >>> boxes = frames.labels.assign(score=0.9)
    >>> tracks = pi.track(boxes, frames)
    >>> bool(abs(tracks.speed_m_s.median() - 17) < 3)
    True
    """
    settings = settings or TrackSettings()
    numbers, times = frame_times(detections, frames, period_s)
    boxes = boxes_of(detections)
    frame = detections["frame"].to_numpy(np.int64)
    starts = np.searchsorted(frame, numbers, side="left")
    ends = np.searchsorted(frame, numbers, side="right")
    tracker, parts = Tracker(settings, view_of(frames)), []
    for number, time_s, start, end in zip(numbers, times, starts, ends, strict=True):
        tracks = tracker.step(time_s, boxes.select(np.arange(start, end)))
        parts.append((number, time_s, tracks.select(np.arange(len(tracks)))))
    return _table(parts, smooth=smooth)


def view_of(frames: FrameSequence | None) -> View:
    """Returns the view of the frames' sensors; without frames, that of a sensor at the origin."""
    if frames is None or frames.lidar is None:
        return View()
    assert isinstance(frames, RecordedFrames | SimulatedFrames)
    tilt = frames.tilt if isinstance(frames, SimulatedFrames) else kitti.read_tilt(frames.folder)
    sensors = np.array([[s.x, s.y, s.z] for s in frames.lidar.sensors])
    return View(sensors, frames.lidar, tilt, frames.region)


def frame_times(
    detections: pd.DataFrame, frames: FrameSequence | None, period_s: float | None
) -> tuple[Sequence[int], Sequence[float]]:
    """Returns the frame numbers and their times, mid-frame. Raises Error."""
    check_columns(detections, ("frame", "type", *BOX, "score"), "detections")
    frame = detections["frame"].to_numpy()
    if len(frame) and not (np.isfinite(frame) & (frame == np.round(frame))).all():
        wrong = frame[~(np.isfinite(frame) & (frame == np.round(frame)))][0]
        raise Error(f"detections: frame: expected whole numbers, got {wrong}")
    if (np.diff(frame) < 0).any():
        row = int(np.flatnonzero(np.diff(frame) < 0)[0]) + 1
        raise Error(
            f"detections: frame: expected ascending numbers, got {frame[row]} after "
            f"{frame[row - 1]} in row {row}"
        )
    present = np.unique(frame).astype(np.int64)
    if frames is not None:
        if period_s is not None:
            raise Error("period_s: use `period_s` or `frames`, not both; `frames` have a period")
        numbers = np.array(sorted(frames.numbers), dtype=np.int64)
        if len(other := np.setdiff1d(present, numbers)):
            raise Error(f"detections: expected boxes of `frames`, got a box of frame {other[0]}")
        return numbers.tolist(), ((numbers + 0.5) * frames.period_s).tolist()
    if "t_s" in detections:
        if period_s is not None:
            raise Error("period_s: use `period_s` or a column t_s, not both")
        return present.tolist(), _times_of(detections, present)
    if period_s is None:
        raise Error(
            "detections: expected times from `frames`, `period_s` or a column t_s, got none of them"
        )
    if not 0.001 <= period_s <= 60:
        raise Error(f"period_s: expected 0.001 to 60, got {period_s:g}")
    return present.tolist(), ((present + 0.5) * period_s).tolist()


def _times_of(detections: pd.DataFrame, present: IntArray) -> list[float]:
    per_frame = detections.groupby("frame").t_s.agg(["min", "max"])
    good = np.isfinite(per_frame).all(axis=1) & (per_frame["min"] == per_frame["max"])
    if not good.all():
        number = good.idxmin()
        low, high = per_frame.loc[number]
        raise Error(
            f"detections: t_s: expected one finite time for each frame, got {low:g} to {high:g} in "
            f"frame {number}"
        )
    times = per_frame["min"].to_numpy()
    if (back := np.flatnonzero(np.diff(times) <= 0)).size:
        i = int(back[0])
        raise Error(
            f"detections: t_s: expected more than {times[i]:g} in frame {present[i + 1]}, got "
            f"{times[i + 1]:g}"
        )
    return [float(time) for time in times]


def boxes_of(detections: pd.DataFrame) -> Boxes:
    """Returns the boxes of a table with the columns type, BOX and score. Raises Error."""
    values = detections[BOX].to_numpy(np.float64)
    scores = detections["score"].to_numpy(np.float64)
    good = np.isfinite(values).all(axis=1) & (values[:, 3:6] > 0).all(axis=1)
    if not good.all():
        row = int(good.argmin())
        raise Error(
            f"detections: row {row}: expected finite values and sizes above 0, got "
            f"{values[row].tolist()}"
        )
    if (wrong := ~((scores >= 0) & (scores <= 1))).any():
        raise Error(f"detections: score: expected 0 to 1, got {scores[wrong][0]:g}")
    kinds = pd.Index(TYPES).get_indexer(detections["type"].astype(str))
    if (kinds < 0).any():
        name = str(detections["type"].iloc[int(np.argmin(kinds))])
        raise Error(
            f"detections: type: expected a known type, got '{name}'{suggestion(name, TYPES)}"
        )
    votes = np.zeros((len(scores), len(TYPES)))
    votes[np.arange(len(scores)), kinds] = scores
    return Boxes(values, votes)


def _table(parts: Sequence[tuple[int, float, Tracks]], *, smooth: bool) -> pd.DataFrame:
    """Returns the rows of the tracks that were confirmed at some time.

    Rows after a track's last box are left out.
    """
    if not parts:
        return pd.DataFrame(columns=TRACK_COLUMNS)
    sizes = [len(tracks) for _, _, tracks in parts]
    frame = np.repeat([number for number, _, _ in parts], sizes)
    time_s = np.repeat([time for _, time, _ in parts], sizes)
    all_rows = concatenated([tracks for _, _, tracks in parts])
    last_s = pd.Series(all_rows.last_s).groupby(all_rows.ids).transform("max").to_numpy()
    real = np.isin(all_rows.ids, all_rows.ids[all_rows.confirmed]) & (time_s <= last_s)
    order = np.flatnonzero(real)
    order = order[np.lexsort((frame[order], all_rows.ids[order]))]
    rows, frame, time_s = all_rows.select(order), frame[order], time_s[order]
    if smooth:
        _smooth(rows, time_s)
    return table_of(rows, frame, time_s).sort_values(["frame", "id"], ignore_index=True)


def _smooth(rows: Tracks, time_s: FloatArray) -> None:
    """Replaces the states, sizes and types of rows that are ordered by track and time."""
    starts = np.flatnonzero(np.diff(rows.ids, prepend=-1))
    for start, end in zip(starts, [*starts[1:], len(rows)], strict=False):
        part = slice(start, end)
        rows.votes[part] = rows.votes[end - 1]
        rows.size[part] = rows.size[end - 1]
        rows.state[part], rows.covariance[part] = motion.smoothed(
            rows.state[part], rows.covariance[part], time_s[part], rows.noise[part]
        )


def table_of(rows: Tracks, frame: IntArray, time_s: FloatArray) -> pd.DataFrame:
    """Returns rows of tracks as a table with the columns TRACK_COLUMNS."""
    state, spread, speed = rows.state, rows.covariance, rows.speed()
    direction = state[:, 2:4] / np.maximum(speed, 1e-9)[:, None]
    ahead = np.column_stack([np.cos(rows.heading), np.sin(rows.heading)])
    direction = np.where((speed > 0.3)[:, None], direction, ahead)
    table = pd.DataFrame({"frame": frame, "t_s": np.round(time_s, 6), "id": rows.ids})
    table["type"] = np.array(TYPES, dtype=object)[rows.types]
    table[BOX] = rows.boxes()
    table["speed_m_s"] = speed
    table["acceleration_m_s2"] = (state[:, 4:6] * direction).sum(1)
    table[["vx_m_s", "vy_m_s"]] = state[:, 2:4]
    table["x_var_m2"], table["y_var_m2"] = spread[:, 0, 0], spread[:, 1, 1]
    table["xy_cov_m2"] = spread[:, 0, 1]
    table["speed_var_m2_s2"] = np.einsum("ni,nij,nj->n", direction, spread[:, 2:4, 2:4], direction)
    table["score"] = 1 / (1 + np.exp(-rows.odds))
    table["frames_seen"], table["frames_missed"] = rows.frames_seen, rows.frames_missed
    table["state"] = np.where(rows.seen, SEEN, np.where(rows.hidden, HIDDEN, MISSED))
    return table[TRACK_COLUMNS]
