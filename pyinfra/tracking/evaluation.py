"""Compares tracks and passages with simulated truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.optimize import linear_sum_assignment

from pyinfra.core.arrays import BoolArray, FloatArray, IntArray
from pyinfra.core.errors import Error
from pyinfra.core.present import Presented
from pyinfra.core.public import public
from pyinfra.core.vocabulary import KM_H, VEHICLE_TYPES
from pyinfra.dataset.data_set import ids_are_tracks
from pyinfra.dataset.frame_sequence import FrameSequence, RecordedFrames
from pyinfra.dataset.frames import data_set_of, recorded_s
from pyinfra.dataset.object_rows import BOX
from pyinfra.tracking.hota import ZERO_M, Hota, Sightings, clear, distances, hota
from pyinfra.tracking.lines import AnyLines, Line, lines_of
from pyinfra.tracking.movements import movements
from pyinfra.tracking.passages import passages
from pyinfra.tracking.table_file import check_columns

VISIBLE = 0.2  # minimum visible share of an evaluated vehicle
PASSAGE_S, PASSAGE_M = 1.5, 2.5  # maximum time and offset between a passage and the true passage
_NEEDED = ("frame", "id", "type", "state", *BOX, "speed_m_s")  # columns of tracks
_RISE = 5  # number of frames on each side of a frame over which the true speed is computed


class UnknownIds(Error):
    """Raised if the ids do not show which boxes belong to the same vehicle."""


@dataclass(frozen=True, eq=False, repr=False)
class TrackEvaluation(Presented):
    """Measures of the tracks of vehicles that are visible and within `within_m` of the sensor.

    Attributes
    ----------
    measures : one row: hota, det_a, ass_a, loc_a, mota (percent), switches, objects (true
        vehicles), tracks, false_tracks, false_tracks_per_min, speed_error_km_h (median),
        speed_p95_km_h, hidden_error_m (median distance to vehicles that are not visible)
    movements : one row per movement: true, counted, never (true vehicles of which no passage was
        found), extra (tracks of which no passage is true), error_percent, geh (of flows per hour)
    passages : the passages of the tracks; `true_id` is -1 if no true passage matches
    missed : the true passages that were never counted
    """

    measures: pd.Series
    movements: pd.DataFrame
    passages: pd.DataFrame
    missed: pd.DataFrame

    def facts(self) -> dict[str, object]:
        found = int((self.passages.true_id >= 0).sum())
        return {
            "hota": f"{self.measures.hota:.1f}",
            "mota": f"{self.measures.mota:.1f}",
            "switches": int(self.measures.switches),
            "passages": f"{found} of {found + len(self.missed)}",
            "false passages": len(self.passages) - found,
        }


@public()
def evaluate_tracks(
    frames: FrameSequence,
    tracks: pd.DataFrame,
    *,
    within_m: float = 80.0,
    lines: AnyLines | tuple[Line, ...] | None = None,
) -> TrackEvaluation:
    """Compares the tracks of vehicles with the objects of simulated frames.

    Tracks of other objects (hidden, too far, persons) are ignored. The similarity of a track and an
    object is 1 - d / 2 m, for centres that are d apart on the ground.

    Parameters
    ----------
    frames : the frames that were tracked, with objects
    tracks : table of `track`, in any order; the times are those of the frames
    within_m : largest distance of a vehicle from the sensor, metres
    lines : lines at which passages are compared, as `site` of `count`; by default those of the
        site's roads

    Returns
    -------
    TrackEvaluation : HOTA and its parts, MOTA, speed errors, and passages by movement

    Raises
    ------
    Error : for frames without objects or with objects without track ids, for tracks of other
        frames or without a column, and for lines that no site has

    Examples
    --------
    >>> import pyinfra as pi
    >>> frames = pi.simulate(pi.load_scene("highway", seed=1), "helios_16", range(20))
    >>> result = pi.evaluate_tracks(frames, pi.track(frames.objects.assign(score=0.9), frames))
    >>> bool(result.measures.hota > 90)
    True
    """
    if not 0 < within_m < np.inf:
        raise Error(f"within_m: expected a number above 0, got {within_m:g}")
    truth = true_objects(frames)
    if not len(truth):
        raise Error(
            "frames: expected objects of simulated frames, got none; tracks are compared with them"
        )
    if isinstance(frames, RecordedFrames) and not ids_are_tracks(data_set_of(frames.folder)):
        raise UnknownIds("frames: expected a track id for each vehicle, got `ids: unknown`")
    if not isinstance(lines, (list, tuple)):
        lines = lines_of(frames if lines is None else lines)
    seconds = recorded_s(frames.numbers, frames.period_s)
    tracks = in_frames(tracks, frames)
    return compare_with(truth, tracks, lines, within_m=within_m, seconds=seconds)


def in_frames(tracks: pd.DataFrame, frames: FrameSequence) -> pd.DataFrame:
    """Returns tracks in the order and with the times of their frames.

    Raises Error for a missing column, and for tracks of other frames.
    """
    check_columns(tracks, _NEEDED, "tracks")
    if len(other := np.setdiff1d(tracks.frame, frames.numbers)):
        raise Error(f"tracks: frame: expected frame numbers of `frames`, got {other[0]}")
    ordered = tracks.sort_values("frame", kind="stable", ignore_index=True)
    return ordered.assign(t_s=(ordered.frame + 0.5) * frames.period_s)


def check_ids(vehicles: pd.DataFrame) -> None:
    """Raises UnknownIds for vehicles without ids, and for an id that a frame has twice."""
    unknown, twice = vehicles.id < 0, vehicles.duplicated(["frame", "id"])
    if (unknown | twice).any():
        row = vehicles[unknown | twice].iloc[0]
        got = f"the id {row.id}" + (" twice" if row.id >= 0 else "")
        raise UnknownIds(
            f"frames: expected a track id for each vehicle, got {got} in frame {row.frame}"
        )


def true_objects(frames: FrameSequence) -> pd.DataFrame:
    """Returns frame, t_s, id, type, box, visibility and speed_m_s of the objects of frames."""
    objects = frames.objects
    middle = frames.vehicles().mid_frame
    table = objects.assign(t_s=(objects.frame + 0.5) * frames.period_s)
    table[["mid_x", "mid_y"]] = middle[:, :2]
    return with_true_speed(table)


def with_true_speed(table: pd.DataFrame) -> pd.DataFrame:
    """Adds speed_m_s, from the positions at mid-frame some frames before and after."""
    table = table.sort_values(["id", "frame"])
    by_id = table.groupby("id")
    columns = ["mid_x", "mid_y", "t_s"]
    before, after = by_id[columns].shift(_RISE), by_id[columns].shift(-_RISE)
    first, last = by_id[columns].transform("first"), by_id[columns].transform("last")
    step = after.fillna(last) - before.fillna(first)
    speed = np.hypot(step.mid_x, step.mid_y) / step.t_s.where(step.t_s > 0)
    return table.assign(speed_m_s=speed).sort_values(["frame", "id"], ignore_index=True)


def compare_with(
    truth: pd.DataFrame,
    tracks: pd.DataFrame,
    lines: Sequence[Line],
    *,
    within_m: float,
    seconds: float,
) -> TrackEvaluation:
    """Compares tracks with a table of `true_objects`. seconds: duration of the recording."""
    tracks = tracks[tracks.type.isin(VEHICLE_TYPES)].reset_index(drop=True)
    distance = np.hypot(truth.x, truth.y)
    vehicle = truth.type.isin(VEHICLE_TYPES)
    counts = (vehicle & (distance <= within_m) & (truth.visibility >= VISIBLE)).to_numpy()
    check_ids(truth[vehicle if lines else counts])
    everything, all_tracks = sightings(truth), sightings(tracks)
    to_object = nearest(everything, all_tracks)
    of_none = to_object < 0
    near = np.hypot(tracks.x, tracks.y).to_numpy() <= within_m
    evaluated = np.where(of_none, near, counts[to_object])
    a, b = sightings(truth[counts]), sightings(tracks[evaluated])
    parts: Hota = hota(a, b)
    mot = clear(a, b)
    false = false_tracks(tracks[evaluated].id.to_numpy(), of_none[evaluated])
    matched = tracks[evaluated].iloc[mot.pairs[:, 1]]
    true_speed = truth[counts].speed_m_s.to_numpy()[mot.pairs[:, 0]]
    speed_error = KM_H * np.abs(matched.speed_m_s.to_numpy() - true_speed)
    speed_error = speed_error[np.isfinite(speed_error)]
    hidden = ~of_none & (truth.visibility.to_numpy()[to_object] < VISIBLE) & near
    hidden &= (truth.visibility.to_numpy()[to_object] >= 0) & (tracks.state != "seen").to_numpy()
    apart = np.hypot(*(everything.xy[to_object[hidden]] - all_tracks.xy[hidden]).T)
    table, found, missed = compare_passages(truth[vehicle], tracks, lines, seconds)
    measures = {
        **vars(parts),
        "mota": mot.mota,
        "switches": mot.switches,
        "objects": len(np.unique(a.ids)),
        "tracks": len(np.unique(b.ids)) - false,
        "false_tracks": false,
        "false_tracks_per_min": 60 * false / seconds,
        "speed_error_km_h": float(np.median(speed_error)) if len(speed_error) else np.nan,
        "speed_p95_km_h": float(np.percentile(speed_error, 95)) if len(speed_error) else np.nan,
        "hidden_error_m": float(np.median(apart)) if len(apart) else np.nan,
        "seconds": seconds,
    }
    return TrackEvaluation(pd.Series(measures), table, found, missed)


def sightings(table: pd.DataFrame) -> Sightings:
    ids, frame = table["id"].to_numpy(np.int64), table["frame"].to_numpy(np.int64)
    return Sightings(frame, ids, table[BOX[:2]].to_numpy(np.float64))


def nearest(truth: Sightings, tracks: Sightings) -> IntArray:
    """Returns the row of the object that each row of the tracks is matched with; -1 for none."""
    out = np.full(len(tracks.ids), -1)
    for frame in np.unique(tracks.frame):
        a, b = truth.at(frame), tracks.at(frame)
        apart = distances(truth.xy[a], tracks.xy[b])
        i, j = linear_sum_assignment(np.minimum(apart, ZERO_M))
        ok = apart[i, j] < ZERO_M
        out[j[ok] + b.start] = i[ok] + a.start
    return out


def false_tracks(ids: IntArray, of_none: BoolArray) -> int:
    """Counts the tracks that match no object in most of their frames."""
    return int((pd.Series(of_none).groupby(ids).mean() > 0.5).sum())


def compare_passages(
    truth: pd.DataFrame, tracks: pd.DataFrame, lines: Sequence[Line], seconds: float
) -> tuple[pd.DataFrame, pd.DataFrame, pd.DataFrame]:
    """Returns the counts by movement, the passages with `true_id`, and missed true passages."""
    real, found = passages(truth, lines), passages(tracks, lines)
    found = found.assign(true_id=-1)
    matched: list[int] = []  # rows of true passages
    for key, part in found.groupby(["line", "sign"]):
        same = real[(real.line == key[0]) & (real["sign"] == key[1])]
        late = np.abs(part.t_s.to_numpy()[:, None] - same.t_s.to_numpy()) / PASSAGE_S
        aside = np.abs(part.offset_m.to_numpy()[:, None] - same.offset_m.to_numpy()) / PASSAGE_M
        cost = np.where((late < 1) & (aside < 1), late + aside, 9.0)
        i, j = linear_sum_assignment(cost)
        ok = cost[i, j] < 9
        found.loc[part.index[i[ok]], "true_id"] = same.id.to_numpy()[j[ok]]
        matched += same.index[j[ok]].tolist()
    missed = real.drop(index=matched)
    a, b = movements(real, lines), movements(found, lines)
    parts = {
        "true": a,
        "counted": b,
        "never": a[~a.id.isin(found.true_id)],
        "extra": b[~b.id.isin(found.id[found.true_id >= 0])],
    }
    sizes = [part.groupby("movement").size() for part in parts.values()]
    table = pd.concat(sizes, axis=1, keys=[*parts]).fillna(0).astype(int)
    table["error_percent"] = 100 * (table.counted - table.true) / table.true.where(table.true > 0)
    table["geh"] = geh(table.counted * 3600 / seconds, table.true * 3600 / seconds)
    return table.reset_index(), found, missed


def geh(counted: FloatArray, true: FloatArray) -> FloatArray:
    """Returns the GEH statistic of flows per hour; below 5 is the usual limit of agreement."""
    total = np.asarray(counted) + np.asarray(true)
    difference = np.asarray(counted) - np.asarray(true)
    return np.sqrt(2 * difference**2 / np.where(total > 0, total, 1))
