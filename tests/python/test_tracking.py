"""Tracks: one per object, with its speed, through turns, gaps, stops and wrong headings."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from tracking_data import PERIOD_S, boxes, circle, noisy, straight

import pyinfra as pi
from pyinfra.dataset.frame_sequence import RecordedFrames
from pyinfra.tracking import motion
from pyinfra.tracking.occlusion import hidden_behind
from pyinfra.tracking.tracker import Tracker
from pyinfra.tracking.tracks import boxes_of

FOUR = [straight(-40, y, v) for y, v in ((0, 15), (3.5, 14), (7, 9), (10.5, 12))]


def test_a_track_per_vehicle_with_its_speed() -> None:
    truth = boxes(FOUR, 60)
    tracks = pi.track(noisy(truth, 1), period_s=PERIOD_S)
    assert tracks.id.nunique() == 4
    assert (tracks.groupby("id").size() == 60).all()
    speeds = tracks.groupby("id").speed_m_s.median().sort_values()
    np.testing.assert_allclose(speeds, [9, 12, 14, 15], atol=0.3)


def test_numbers_of_a_turning_vehicle_are_within_their_spread() -> None:
    truth = boxes([circle(12, 6)], 100)
    for seed in range(3):
        tracks = pi.track(noisy(truth, seed), period_s=PERIOD_S)
        assert tracks.id.nunique() == 1
        error = np.hypot(tracks.x - truth.x, tracks.y - truth.y)
        assert error.median() < 0.15
        assert abs(tracks.speed_m_s[10:-10] - 6).max() < 1
        turned = np.angle(np.exp(1j * (tracks.heading - truth.heading)))
        assert np.abs(turned[10:]).max() < 0.4


def test_a_heading_does_not_flip_with_the_boxes() -> None:
    truth = boxes([straight(-20, 5, 8), straight(20, 15, 0.0)], 60)
    flipped = np.random.default_rng(1).random(len(truth)) < 0.3
    tracks = pi.track(truth.assign(heading=truth.heading + np.pi * flipped), period_s=PERIOD_S)
    moving = tracks[tracks.y < 10]
    assert (np.cos(moving.heading[10:]) > 0.9).all()
    standing = tracks[tracks.y > 10]
    steps = np.abs(np.angle(np.exp(1j * np.diff(standing.heading[20:]))))
    assert steps.max() < 0.3


def test_a_standing_vehicle_stays_one_track_through_a_gap() -> None:
    truth = boxes([straight(15, 5, 0.0)], 150)
    seen = truth[(truth.frame < 50) | (truth.frame > 90)]
    tracks = pi.track(noisy(seen, 1, 0.05), period_s=PERIOD_S)
    assert tracks.id.nunique() == 1
    assert tracks.speed_m_s.median() < 0.3


def test_a_hidden_vehicle_is_bridged_and_marked() -> None:
    """A truck between the sensor and a car hides the car for two seconds."""
    truth = boxes([straight(-30, 20, 8), straight(-12, 8, 3.2)], 90)
    truck = truth.id == 1
    truth.loc[truck, ["dx", "dz", "z"]] = 12.0, 4.5, -3.5
    gone = (truth.id == 0) & (truth.frame >= 30) & (truth.frame < 50)
    tracks = pi.track(noisy(truth[~gone], 2, 0.05), numbered(90), period_s=None)
    assert tracks.id.nunique() == 2
    car = tracks[tracks.y > 15]
    bridged = car[(car.frame >= 30) & (car.frame < 50)]
    assert len(bridged) == 20
    assert set(bridged.state) <= {"hidden", "missed"}
    assert (bridged.state == "hidden").any()
    np.testing.assert_allclose(bridged.x, truth[gone].x, atol=0.5)
    assert (np.diff(bridged.frames_missed) == 1).all()


def numbered(count: int) -> RecordedFrames:
    """Returns a sequence of frames without clouds."""
    return RecordedFrames(Path("nowhere"), tuple(range(count)))


def test_a_box_behind_a_truck_is_hidden_and_one_beside_it_is_not() -> None:
    truck = np.array([[10, 0, -3.75, 12, 2.5, 4.5, np.pi / 2]])
    cars = np.array([[20.0, y, -5.25, 4.5, 1.8, 1.5, 0] for y in (0, 18)])
    high = np.array([[20.0, 0, -5.25, 4.5, 1.8, 9.0, 0]])
    origin = np.zeros(3)
    assert hidden_behind(cars, truck, origin).tolist() == [True, False]
    assert not hidden_behind(high, truck, origin)[0]  # its top is above the sensor's ray
    assert not hidden_behind(truck, cars, origin)[0]


def test_doubtful_boxes_make_no_track_and_several_sure_ones_do() -> None:
    truth = boxes([straight(10, 5, 0.0)], 30)
    assert len(pi.track(truth.assign(score=0.4), period_s=PERIOD_S)) == 0
    assert len(pi.track(truth[:1], period_s=PERIOD_S)) == 0
    assert len(pi.track(truth, period_s=PERIOD_S)) == 30


def test_a_doubtful_track_ends_also_where_it_is_hidden() -> None:
    """Without its end, the next vehicle of that place would be counted from the first box on."""
    tracker = Tracker()
    truck = boxes([straight(20, 0, 0.0)], 1).assign(dx=4.0, dy=10.0, dz=4.5, z=-3.5)
    doubtful = boxes([straight(30, 0, 0.0)], 1).assign(score=0.45)
    tracker.step(0.1, boxes_of(pd.concat([truck, doubtful])))
    for k in range(2, 31):
        tracker.step(k / 10, boxes_of(truck))
        if k == 10:
            assert tracker.tracks.hidden.tolist() == [False, True]
    assert tracker.tracks.ids.tolist() == [1]


@pytest.mark.parametrize("period_s", [0.1, 0.5, 2.0])
def test_frames_without_boxes_may_be_left_out(period_s: float) -> None:
    """Two vehicles follow each other after 9 s, on the same path and without a box in between."""
    first = boxes([straight(-20, 5, 5.0 * period_s / PERIOD_S)], 20)  # 5 m/s
    gap = round(9 / period_s)
    both = pd.concat([first, first.assign(frame=first.frame + first.frame.max() + gap)])
    alone = pi.track(both, period_s=period_s)
    parked = boxes([straight(0, 60, 0.0)], both.frame.max() + 1)
    beside = pd.concat([both, parked]).sort_values("frame", kind="stable")
    known = pi.track(beside, period_s=period_s)
    assert alone.id.nunique() == 2
    assert known[known.y < 30].id.nunique() == 2


def test_boxes_of_several_types_of_one_object_are_one_track() -> None:
    rider = boxes([straight(10, 5, 5)], 30).assign(dx=2.0, dy=0.8, score=0.6)
    both = pd.concat([rider, rider.assign(type="Cyclist", score=0.3)]).sort_values("frame")
    tracks = pi.track(both, period_s=PERIOD_S)
    assert tracks.id.nunique() == 1
    assert set(tracks.type) == {"Car"}


def test_sizes_and_types_settle() -> None:
    truth = boxes([straight(-20, 5, 8)], 40)
    rng = np.random.default_rng(3)
    lengths = truth.assign(dx=truth.dx + rng.normal(0, 0.5, len(truth)))
    lengths.loc[lengths.frame % 4 == 0, "type"] = "Van"
    tracks = pi.track(lengths, period_s=PERIOD_S)
    assert tracks.dx.nunique() == tracks.type.nunique() == 1
    assert abs(tracks.dx[0] - 4.5) < 0.3
    assert tracks.type[0] == "Car"


def test_the_rate_of_the_frames_is_not_assumed() -> None:
    """Every fifth frame, and the same as frames of a LiDAR with 2 Hz."""
    truth = boxes(FOUR[:1] + FOUR[2:], 100)
    part = truth[truth.frame % 5 == 0]
    slow = part.assign(frame=part.frame // 5)
    for tracks in (pi.track(part, period_s=0.1), pi.track(slow, period_s=0.5)):
        assert tracks.id.nunique() == 3
        assert sorted(tracks.groupby("id").speed_m_s.median().round()) == [9, 12, 15]


def test_a_jump_of_the_clock_ends_tracks() -> None:
    truth = boxes([straight(10, 5, 0.0)], 40)
    late = truth.assign(t_s=truth.frame * 0.1 + np.where(truth.frame < 20, 0, 3600))
    assert pi.track(late).id.nunique() == 2


def test_live_states_use_no_later_box() -> None:
    truth = noisy(boxes(FOUR, 40), 4)
    live = pi.track(truth, period_s=PERIOD_S, smooth=False)
    first = pi.track(truth[truth.frame < 20], period_s=PERIOD_S, smooth=False)
    pd.testing.assert_frame_equal(live[live.frame < 20], first)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda t: t[::-1], "ascending"),
        (lambda t: t.assign(frame=t.frame + 0.5), "whole numbers"),
        (lambda t: t.assign(score=2.0), "score: expected 0 to 1"),
        (lambda t: t.assign(x=np.nan), "finite"),
        (lambda t: t.assign(dx=0.0), "above 0"),
        (lambda t: t.assign(type="Lorry"), "type: expected a known type, got 'Lorry'"),
        (lambda t: t.drop(columns="score"), "columns score"),
        (lambda t: t.assign(t_s=-t.frame), "t_s: expected more than"),
        (lambda t: t.assign(t_s=np.arange(len(t))), "one finite time"),
    ],
)
def test_wrong_tables_are_refused(change: object, message: str) -> None:
    table = boxes(FOUR, 5)
    period_s = None if "t_s" in message or "time" in message else PERIOD_S
    with pytest.raises(pi.Error, match=message):
        pi.track(change(table), period_s=period_s)  # type: ignore[operator]


def test_times_must_be_known() -> None:
    with pytest.raises(pi.Error, match="expected times"):
        pi.track(boxes(FOUR, 5))
    with pytest.raises(pi.Error, match="period_s: expected"):
        pi.track(boxes(FOUR, 5), period_s=0)


def test_the_smoother_gives_the_conditional_mean_and_covariance() -> None:
    """Oracle: all states as one Gaussian, conditioned on all positions."""
    rng = np.random.default_rng(5)
    count, dt_s, sigma = 6, 0.3, 0.4
    step, drive = motion.transition(dt_s), np.diag([2.0, 0.5])
    grow = motion.process_noise(dt_s, drive[None])[0]
    first = np.diag([0.5, 0.5, 9, 9, 1, 1.0])
    measured = rng.normal(0, 3, (count, 2))
    size = motion.STATES
    whole = np.zeros((count * size, count * size))
    blocks = [first]
    for _ in range(count - 1):
        blocks.append(step @ blocks[-1] @ step.T + grow)
    for i in range(count):
        for j in range(i, count):
            cross = np.linalg.matrix_power(step, j - i) @ blocks[i]
            whole[j * size : (j + 1) * size, i * size : (i + 1) * size] = cross
            whole[i * size : (i + 1) * size, j * size : (j + 1) * size] = cross.T
    look = np.kron(np.eye(count), np.eye(2, size))
    gain = whole @ look.T @ np.linalg.inv(look @ whole @ look.T + sigma**2 * np.eye(2 * count))
    mean, spread = gain @ measured.ravel(), whole - gain @ look @ whole
    noise = sigma**2 * np.eye(2)[None]
    state, covariance = np.zeros((1, size)), first[None]
    states, covariances = [], []
    for i in range(count):
        if i:
            state, covariance = motion.predict(state, covariance, dt_s, drive[None])
        state, covariance = motion.update(state, covariance, measured[i : i + 1], noise)
        states.append(state[0])
        covariances.append(covariance[0])
    times, drives = dt_s * np.arange(count), np.repeat(drive[None], count, axis=0)
    ours, around = motion.smoothed(np.array(states), np.array(covariances), times, drives)
    np.testing.assert_allclose(ours.ravel(), mean, atol=1e-8)
    for i in range(count):
        part = slice(i * size, (i + 1) * size)
        np.testing.assert_allclose(around[i], spread[part, part], atol=1e-8)
