"""Counts: the recording that flows and queues refer to, lanes, queues and names of lines."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.cluster.hierarchy import fcluster, linkage
from tracking_data import PERIOD_S, boxes, straight

import pyinfra as pi
from pyinfra.cli import main
from pyinfra.dataset.frames import recorded_s
from pyinfra.tracking.lines import Line
from pyinfra.tracking.passages import LANE_M, _lanes
from pyinfra.tracking.table_file import read_tracks, write_tracks
from pyinfra.viz.traffic_page import write_page

GATE = {"gate": [[0, 0], [0, 10]]}
ARM = [Line("W", (20.0, 5.0), (20.0, -5.0), "E", "W", "junction")]  # +1 is east


def later(table: pd.DataFrame, frames: int) -> pd.DataFrame:
    return table.assign(frame=table.frame + frames)


def cars(*first_frames: int) -> pd.DataFrame:
    """Returns boxes of cars that pass x = 0 after 2 s, and stay for 4 s."""
    one = boxes([straight(-20, 5, 10)], 40)
    return pd.concat([later(one, k) for k in first_frames])


def counted(table: pd.DataFrame, **named: object) -> pi.Counts:
    return pi.count(pi.track(table, period_s=PERIOD_S), GATE, **named)  # type: ignore[arg-type]


def test_flows_are_those_of_the_recording_and_not_of_the_first_to_the_last_track() -> None:
    counts = counted(cars(1000), start_s=0, end_s=1800)
    assert counts.seconds == 1800
    assert counts.flows.start_s.tolist() == [0]
    assert counts.flows.flow_per_h.tolist() == [4]
    assert counts.movements.flow_per_h.tolist() == [4]
    assert counts.flows.occupancy_percent[0] == pytest.approx(100 * 0.45 / 900, rel=0.02)
    last = counted(cars(1000), start_s=0, end_s=1200, interval_s=1100).flows
    assert last.flow_per_h[0] == pytest.approx(3600 / 1100)
    assert counted(cars(1000)).seconds == pytest.approx(3.9)


def test_frames_are_the_recording_if_all_tracks_are_theirs() -> None:
    frames = pi.simulate(pi.load_scene("highway", seed=1), "helios_16", range(0, 60, 5))
    nobody = pi.track(frames.objects.assign(score=0.05), frames)
    assert pi.count(nobody, frames).seconds == pytest.approx(6)
    tracks = pi.track(frames.objects.assign(score=0.9), frames)
    assert pi.count(tracks, frames).seconds == pytest.approx(6)
    other = tracks.assign(t_s=tracks.t_s + 1777883410)
    assert pi.count(other, frames).seconds == pytest.approx(5.5)
    assert pi.count(tracks, frames, end_s=10).seconds == 10
    assert pi.evaluate_tracks(frames, tracks).measures.seconds == pytest.approx(6)


def test_a_frame_stands_for_the_usual_step_between_frames() -> None:
    assert recorded_s(range(0, 30, 5), 0.1) == pytest.approx(3)
    assert recorded_s([*range(10), *range(50, 60)], 0.1) == pytest.approx(2)
    assert recorded_s([7], 0.1) == pytest.approx(0.1)


@pytest.mark.parametrize(
    "named", [{"start_s": 101.0}, {"end_s": 103.0}, {"start_s": np.nan}, {"end_s": np.inf}]
)
def test_tracks_outside_the_recording_are_refused(named: dict[str, float]) -> None:
    with pytest.raises(pi.Error, match=next(iter(named))):
        counted(cars(1000), **named)


def test_the_flow_of_a_movement_on_the_page_is_its_count_by_the_recording(tmp_path: Path) -> None:
    counts = counted(cars(0, 100, 200, 300), start_s=0, end_s=120, interval_s=30)
    assert len(counts.movements) == 2
    page = tmp_path / "counts.html"
    write_page(counts, page)
    row = re.search(r"<td>gate &gt; E</td>\s*<td>4</td>\s*<td>(.*)</td>", page.read_text())
    assert row is not None
    assert row[1] == "120.0"


def test_queues_are_means_of_all_frames_of_the_recording() -> None:
    """A car stands for 30 s before the line, and no frame before or after has a track."""
    standing = later(boxes([straight(10, 0, 0.0)], 300), 1000)
    beside = pd.concat([standing, boxes([straight(60, 60, 0.0)], 6000)])
    every = pi.track(beside.sort_values("frame", kind="stable"), period_s=PERIOD_S)
    some = pi.track(standing, period_s=PERIOD_S)
    for tracks in (every, some):
        found = pi.count(tracks, ARM, start_s=0, end_s=600, interval_s=150).queues
        assert found.start_s.tolist() == [0, 150, 300, 450]
        assert found.mean_queued.tolist() == pytest.approx([30 / 150, 0, 0, 0])
        assert found.mean_queue_m.tolist() == pytest.approx([2, 0, 0, 0], abs=0.01)
        assert found.max_queued.tolist() == [1, 0, 0, 0]


def test_a_passage_at_the_end_belongs_to_the_last_interval() -> None:
    """The recording is a multiple of the interval, and a passage is at its end."""
    tracks = pi.track(cars(0), period_s=PERIOD_S)
    (passed_s,) = pi.count(tracks, GATE).passages.t_s
    until = tracks[tracks.t_s <= passed_s + 1e-9]
    line = {"gate": [[until.x.iloc[-1] - 1e-6, 0], [until.x.iloc[-1] - 1e-6, 10]]}
    end_s = float(until.t_s.iloc[-1])
    for interval_s in (end_s, end_s / 4):
        counts = pi.count(until, line, start_s=0, end_s=end_s, interval_s=interval_s)
        assert counts.flows.start_s.tolist() == pytest.approx([end_s - interval_s])
        assert counts.flows.flow_per_h.tolist() == pytest.approx([3600 / interval_s])
        assert counts.movements.flow_per_h.tolist() == pytest.approx([3600 / interval_s])
    found = pi.count(tracks, ARM, start_s=0, end_s=float(tracks.t_s.max()), interval_s=0.5).queues
    assert found.start_s.max() < tracks.t_s.max()


def test_times_are_given_once() -> None:
    table = boxes([straight(-20, 5, 10)], 40).assign(t_s=lambda rows: rows.frame * 1.0)
    with pytest.raises(pi.Error, match="use `period_s` or a column t_s, not both"):
        pi.track(table, period_s=PERIOD_S)


@pytest.mark.parametrize("ends", [[[1, 2], [3]], "text", [["a", 1], [2, 3]]])
def test_a_line_that_is_no_pair_of_points_is_refused(ends: object) -> None:
    tracks = pi.track(cars(0), period_s=PERIOD_S)
    with pytest.raises(pi.Error, match=r"gate: expected two points"):
        pi.count(tracks, {"gate": ends})  # type: ignore[dict-item]


@pytest.mark.parametrize("start_s", [0.0, 108000.0, 1777883410.5])
def test_files_keep_the_time_of_each_frame(tmp_path: Path, start_s: float) -> None:
    table = cars(0, 60)
    tracks = pi.track(table.assign(t_s=start_s + (table.frame + 0.5) * PERIOD_S))
    file = pi.export_tracks(tracks, tmp_path / "tracks.csv")
    back = read_tracks(file)
    np.testing.assert_allclose(back.t_s, tracks.t_s, rtol=0, atol=1e-6)
    counts = pi.count(file, GATE)
    np.testing.assert_allclose(counts.passages.headway_s, [np.nan, 6], atol=1e-3)
    folder = counts.save(tmp_path / "counts")
    for name, column in (("passages", "t_s"), ("flows", "start_s"), ("movements", "start_s")):
        saved = pd.read_csv(folder / f"{name}.csv")[column]
        np.testing.assert_allclose(saved, getattr(counts, name)[column], rtol=0, atol=1e-6)


def test_times_of_short_recordings_have_the_text_of_six_digits(tmp_path: Path) -> None:
    tracks = pi.track(boxes([straight(-20, 5, 1)], 600), period_s=PERIOD_S)
    write_tracks(tmp_path / "ours.csv", tracks)
    tracks.to_csv(tmp_path / "digits.csv", index=False, float_format="%.6g")
    assert (tmp_path / "ours.csv").read_bytes() == (tmp_path / "digits.csv").read_bytes()


@pytest.mark.parametrize("time", ["same", "different"])
def test_a_file_with_other_than_one_time_per_frame_is_refused(tmp_path: Path, time: str) -> None:
    motions = [straight(-20, 5, 10), straight(-20, 15, 10)]
    tracks = pi.track(boxes(motions, 20), period_s=PERIOD_S)
    row = tracks.index[tracks.frame == 7][1]
    tracks.loc[tracks.frame == 7 if time == "same" else [row], "t_s"] = tracks.t_s[0]
    write_tracks(tmp_path / "tracks.csv", tracks)
    with pytest.raises(pi.Error, match=rf"tracks.csv:{row + (time == 'different') + 1}: t_s"):
        read_tracks(tmp_path / "tracks.csv")


@pytest.mark.parametrize("sign", [-1, 1])
@pytest.mark.parametrize("spread_m", [0.2, 0.6, 1.5])
def test_lanes_are_those_of_average_linkage(sign: int, spread_m: float) -> None:
    rng = np.random.default_rng(1)
    for count in (1, 2, 5, 40, 200):
        offset = rng.choice([1.75, 5.25, 8.75], count) + rng.normal(0, spread_m, count)
        lanes = _lanes(offset, sign)
        tree = linkage(offset[:, None], "average") if count > 1 else np.empty((0, 4))
        group = fcluster(tree, LANE_M, "distance") if count > 1 else np.ones(1)
        pairs = pd.DataFrame({"lane": lanes, "group": group}).drop_duplicates()
        assert not pairs.lane.duplicated().any()
        assert not pairs.group.duplicated().any()
        means = pd.Series(-sign * offset).groupby(lanes).mean()
        assert means.is_monotonic_increasing
        assert means.index.tolist() == list(range(1, len(means) + 1))


@pytest.mark.parametrize("y", [5.0, 1.0])
def test_lanes_and_headways_are_those_of_vehicles(y: float) -> None:
    """Someone walks over the line between two cars, in their lane or beside it."""
    person = later(boxes([straight(-3, y, 1.4)], 40, "Pedestrian").assign(dx=0.6, dy=0.6), 20)
    table = pd.concat([cars(0, 60), person]).sort_values("frame", kind="stable")
    passed = counted(table).passages
    assert passed["type"].tolist() == ["Car", "Pedestrian", "Car"]
    assert passed.lane.tolist() == [1, 0, 1]
    np.testing.assert_allclose(passed.headway_s, [np.nan, np.nan, 6], atol=0.02)
    np.testing.assert_allclose(passed.gap_s, [np.nan, np.nan, 5.55], atol=0.02)


@pytest.mark.parametrize(("length_m", "step_m"), [(18.0, 20.0), (4.5, 7.0)])
@pytest.mark.parametrize("gap_m", [0.0, 14.5, 15.5])
def test_a_queue_ends_at_a_gap_between_vehicles(
    length_m: float, step_m: float, gap_m: float
) -> None:
    """Four vehicles stand before the line, and the gap before the last one is longer by gap_m."""
    free_m = step_m - length_m
    behind = np.array([0, 1, 2, 3]) * step_m + [0, 0, 0, max(gap_m - free_m, 0)]
    standing = boxes([straight(18 - length_m / 2 - m, 0, 0.0) for m in behind], 50, "Bus")
    tracks = pi.track(standing.assign(dx=length_m), period_s=PERIOD_S)
    queue = pi.count(tracks, ARM).queues.iloc[0]
    count = 3 if gap_m > 15 else 4
    assert queue.max_queued == count
    assert queue.max_queue_m == pytest.approx(2 + length_m / 2 + behind[count - 1], abs=0.1)


def test_a_line_with_the_name_of_a_direction_is_no_direction(tmp_path: Path) -> None:
    """Two cars pass both lines to the south, and two only the first."""
    lines = {"N": [[-6, 20], [6, 20]], "S": [[-6, -20], [6, -20]]}
    car = boxes([straight(-3, 30, 10, -np.pi / 2)], 60)
    short = car[car.frame < 20]
    table = pd.concat([car, later(short, 100), later(car, 200), later(short, 300)])
    counts = pi.count(pi.track(table, period_s=PERIOD_S), lines)
    assert dict(counts.movements.set_index("movement")["count"]) == {"N > S": 2, "N > (S)": 2}
    write_page(counts, tmp_path / "counts.html")


def hidden(tracks: pd.DataFrame, first_s: float, last_s: float) -> pd.DataFrame:
    """Returns the tracks without boxes between two times."""
    return tracks.assign(state=tracks.state.mask(tracks.t_s.between(first_s, last_s), "hidden"))


@pytest.mark.parametrize(
    ("gap_s", "unseen"), [((1.8, 2.2), 0), ((0.9, 2.6), 1), ((0, 2.2), 1), ((1.8, 9), 1)]
)
def test_a_passage_in_a_gap_between_boxes_is_counted_without_speed(
    gap_s: tuple[float, float], unseen: int, tmp_path: Path
) -> None:
    """The second of two cars has no boxes as it passes the line, 2 s after its first box."""
    tracks = pi.track(cars(0, 60), period_s=PERIOD_S)
    first = hidden(tracks[tracks.id == 1], 9, 9)
    second = hidden(tracks[tracks.id == 2], 6 + gap_s[0], 6 + gap_s[1])
    table = pd.concat([first, second]).sort_values(["frame", "id"])
    if unseen:
        with pytest.warns(pi.FindingWarning, match=r"gate \(1 of 2\); the sensor may not see"):
            counts = pi.count(table, GATE)
    else:
        counts = pi.count(table, GATE)
    assert counts.passages.unseen.tolist() == [0, unseen]
    assert counts.passages.speed_km_h.isna().tolist() == [False, bool(unseen)]
    np.testing.assert_allclose(counts.passages.headway_s, [np.nan, 6], atol=1e-3)
    flow = counts.flows.iloc[0]
    assert flow["count"] == 2
    assert flow.mean_km_h == pytest.approx(36, abs=0.5)
    every = pi.count(tracks, GATE).flows.iloc[0]
    assert flow.occupancy_percent == pytest.approx(every.occupancy_percent, rel=1e-3)
    write_page(counts, tmp_path / "counts.html")
    assert ("1 of them" in (tmp_path / "counts.html").read_text()) == bool(unseen)


def test_without_states_and_between_distant_frames_no_passage_is_unseen() -> None:
    tracks = pi.track(cars(0), period_s=PERIOD_S)
    assert pi.count(tracks.drop(columns="state"), GATE).passages.unseen.tolist() == [0]
    assert pi.count(tracks.assign(state="active"), GATE).passages.unseen.tolist() == [0]
    rare = tracks.assign(t_s=tracks.t_s * 20)
    assert pi.count(rare, GATE).passages.unseen.tolist() == [0]


def test_a_line_without_any_speed_is_printed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_tracks(tmp_path / "t.csv", hidden(pi.track(cars(0), period_s=PERIOD_S), 0.5, 3.5))
    (tmp_path / "lines.yaml").write_text("lines_m:\n  gate: [[0, 0], [0, 10]]\n")
    words = ["count", str(tmp_path / "t.csv"), str(tmp_path / "lines.yaml"), "--out"]
    assert main.main([*words, str(tmp_path / "out")]) == 0
    printed = capsys.readouterr()
    assert "gate E  1, none with a speed" in printed.out
    assert printed.err.count("pyinfra: warning: ") == 1
    saved = pd.read_csv(tmp_path / "out/passages.csv")
    assert saved.columns[-1] == "unseen"
    assert saved[["speed_km_h", "unseen"]].to_numpy().tolist() == [
        [pytest.approx(np.nan, nan_ok=True), 1]
    ]


def test_a_line_that_no_track_comes_near_is_named_with_its_distance(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_tracks(tmp_path / "t.csv", pi.track(cars(0), period_s=PERIOD_S))
    (tmp_path / "lines.yaml").write_text("lines_m:\n  far: [[900, 0], [900, 10]]\n")
    words = ["count", str(tmp_path / "t.csv"), str(tmp_path / "lines.yaml"), "--out"]
    assert main.main([*words, str(tmp_path / "out")]) == 0
    printed = capsys.readouterr()
    assert "line far: no track comes within 880 m; " in printed.err
    assert printed.out == "0 passages in 4 s\n"
    with pytest.warns(pi.FindingWarning, match="line far: no track comes within 880 m"):
        pi.count(tmp_path / "t.csv", {"far": [[900, 0], [900, 10]], **GATE})


def test_the_distance_from_a_line_is_that_from_its_nearest_point() -> None:
    line = Line("a", (0.0, 0.0), (10.0, 0.0))
    xy = np.array([[5, 2], [-3, 4], [13, -4], [10, 0]], np.float64)
    np.testing.assert_allclose(line.distance(xy), [2, 5, 5, 0])
