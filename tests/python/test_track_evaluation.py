"""Measures of tracks against TrackEval and by their definitions; passages, counts and commands."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import openlabel_checker.core
import pandas as pd
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from tracking_data import PERIOD_S, boxes, circle, straight

import pyinfra as pi
from pyinfra.cli import main
from pyinfra.core.errors import Error
from pyinfra.dataset.frame_sequence import RecordedFrames
from pyinfra.dataset.object_rows import BOX
from pyinfra.dataset.simulated_frames import SimulatedFrames
from pyinfra.exchange.track_files import write_json_lines, write_kitti_tracking
from pyinfra.formats import kitti
from pyinfra.tracking.evaluation import UnknownIds, check_ids, geh, true_objects
from pyinfra.tracking.hota import Sightings, clear, hota
from pyinfra.tracking.lines import lines_of
from pyinfra.tracking.passages import passages
from pyinfra.tracking.table_file import read_tracks, write_tracks

SHORT = {"duration_s": 20, "traffic.warm_up_s": 60}
ACROSS = {"gate": [[10, 20], [10, -20]]}  # a line across x = 10 m; +1 is east


def scenario() -> tuple[Sightings, Sightings]:
    """Six objects of 40 frames; tracks with gaps, noise, one swap, one new id, and false boxes."""
    rng = np.random.default_rng(7)
    true, found = list[tuple[float, ...]](), list[tuple[float, ...]]()
    for i in range(6):
        xy = np.column_stack([np.arange(40) * 0.8 + 5 * i, np.full(40, 2.5 * i)])
        for k in range(40):
            true.append((k, i, *xy[k]))
            if rng.random() < 0.85:
                name = 100 + (i if k < 22 or i > 1 else 1 - i) + 10 * (i == 4 and k > 30)
                found.append((k, name, *(xy[k] + rng.normal(0, 0.5, 2))))
        false = np.flatnonzero(rng.random(40) < 0.1)
        found += [(k, 200 + i, *rng.uniform(0, 40, 2)) for k in false]
    return sightings(true), sightings(found)


def sightings(rows: list[tuple[float, ...]]) -> Sightings:
    table = np.array(sorted(rows))
    return Sightings(table[:, 0].astype(int), table[:, 1].astype(int), table[:, 2:])


def test_hota_and_mota_are_those_of_trackeval() -> None:
    """The numbers are those of trackeval 1.3.0, with similarities 1 - d / 2 m."""
    truth, tracks = scenario()
    ours = hota(truth, tracks)
    expected = [45.51894206385146, 50.02531669857265, 41.472587012398456, 77.83140343163743]
    assert [ours.hota, ours.det_a, ours.ass_a, ours.loc_a] == pytest.approx(expected, abs=1e-9)
    mot = clear(truth, tracks)
    assert mot.mota == pytest.approx(70.41666666666667)
    wrong = [len(objects.ids) - len(mot.pairs) for objects in (tracks, truth)]
    assert (mot.switches, *wrong) == (3, 27, 41)


def test_hota_of_the_truth_is_100_and_of_half_of_it_50() -> None:
    truth, _ = scenario()
    assert vars(hota(truth, truth)) == pytest.approx(dict.fromkeys(vars(hota(truth, truth)), 100))
    half = Sightings(truth.frame[::2], truth.ids[::2], truth.xy[::2])
    part = hota(truth, half)
    assert part.det_a == pytest.approx(50)
    renamed = Sightings(truth.frame, truth.ids * 2 + (truth.frame >= 20), truth.xy)
    assert hota(truth, renamed).ass_a == pytest.approx(50)
    assert clear(truth, renamed).switches == 6


def test_geh_is_that_of_its_formula() -> None:
    assert geh(np.array([110.0]), np.array([90.0]))[0] == pytest.approx(2.0)
    assert geh(np.array([0.0]), np.array([0.0]))[0] == 0


def test_a_passage_has_time_direction_and_speed() -> None:
    truth = boxes([straight(0, -5, 10), straight(30, 5, 8, np.pi)], 60)
    found = passages(pi.track(truth, period_s=PERIOD_S), lines_of(ACROSS))
    assert found.direction.tolist() == ["E", "W"]
    np.testing.assert_allclose(found.t_s, [1.0, 2.5], atol=0.05)
    np.testing.assert_allclose(found.speed_km_h, [36, 28.8], atol=0.5)
    np.testing.assert_allclose(found.offset_m, [25, 15], atol=0.1)


def test_going_back_and_forth_is_no_passage() -> None:
    """One vehicle returns before the line, another crosses it three times."""
    x = {0: [8, 9, 11, 12, 11, 9, 8], 1: [8, 11, 12, 9, 8, 11, 13]}
    rows = [
        (k, k * 1.0, i, "Car", v, float(i), 4.5, 1.0)
        for i, values in x.items()
        for k, v in enumerate(values)
    ]
    columns = ["frame", "t_s", "id", "type", "x", "y", "dx", "speed_m_s"]
    found = passages(pd.DataFrame(rows, columns=columns), lines_of(ACROSS))
    assert found.id.tolist() == [1]
    assert found["sign"].tolist() == [1]
    assert found.t_s[0] == pytest.approx(2 / 3)


def test_lanes_count_from_the_right_and_headways_within_a_lane() -> None:
    motions = [straight(x, y, 10) for x, y in ((0, -5), (-10, -5), (-20, -5), (-4, -1.5))]
    found = passages(pi.track(boxes(motions, 50), period_s=PERIOD_S), lines_of(ACROSS))
    assert found.lane.tolist() == [1, 2, 1, 1]
    right = found[found.lane == 1]
    np.testing.assert_allclose(right.headway_s[1:], 1.0, atol=0.05)
    np.testing.assert_allclose(right.gap_s[1:], 0.55, atol=0.05)


def test_flows_and_queues_of_a_small_recording() -> None:
    motions = [straight(0, -5, 10), straight(-10, -5, 10), straight(9, 5, 10, np.pi)]
    counts = pi.count(pi.track(boxes(motions, 50), period_s=PERIOD_S), ACROSS, interval_s=10)
    east = counts.flows[counts.flows.direction == "E"].iloc[0]
    assert east["count"] == 2
    assert east.flow_per_h == pytest.approx(3600 * 2 / counts.seconds)
    assert east.occupancy_percent == pytest.approx(100 * 2 * 0.45 / counts.seconds, rel=0.05)
    assert counts.movements.movement.tolist() == ["gate > E"]
    assert len(counts.queues) == 0


def test_a_left_turn_is_a_movement_between_two_lines() -> None:
    lines = {"south": [[35, -4], [50, -4]], "west": [[26, 5], [26, 20]]}
    counts = pi.count(pi.track(boxes([circle(12, 6)], 60), period_s=PERIOD_S), lines)
    assert counts.movements.movement.tolist() == ["west > W"]
    lines["south"] = [[35, 2], [50, 2]]
    counts = pi.count(pi.track(boxes([circle(12, 6)], 60), period_s=PERIOD_S), lines)
    assert counts.movements.movement.tolist() == ["south > west"]
    assert counts.travel.mean_s[0] == pytest.approx(12 * (np.arccos(-4 / 12) - 1 / 6) / 6, abs=0.1)


@pytest.mark.parametrize(
    ("site", "message"),
    [
        ({}, "one or more lines"),
        ({"a": [[0, 0], [0, 0.1]]}, "0.5 m or more"),
        ({"a": [[0, 0]]}, "array"),
        ("nowhere", "No such file"),
    ],
)
def test_wrong_lines_are_refused(site: object, message: str) -> None:
    tracks = pi.track(boxes([straight(0, 0, 5)], 10), period_s=PERIOD_S)
    with pytest.raises(pi.Error, match=message):
        pi.count(tracks, site)  # type: ignore[arg-type]


def test_a_file_with_lines_is_checked(tmp_path: Path) -> None:
    file = tmp_path / "lines.yaml"
    file.write_text("lines_m:\n  gate: [[10, 20], [10, -20]]\n")
    assert lines_of(file) == lines_of(ACROSS)
    file.write_text("lines_m:\n  gate: [[10, 20]]\n")
    with pytest.raises(pi.Error, match=r"lines.yaml:2: lines_m.gate: expected two points"):
        lines_of(file)


@pytest.fixture(scope="module")
def frames() -> SimulatedFrames:
    return pi.simulate(pi.load_scene("crossroad", seed=1, set=SHORT), "helios_16", range(120))


@pytest.fixture(scope="module")
def objects(frames: SimulatedFrames) -> pd.DataFrame:
    """Returns all objects of the scene within 60 m, without casting rays."""
    truth = frames.everybody()
    pose = frames.lidar.T_world_levelled
    table = pd.DataFrame(
        {"frame": truth.frame, "id": truth.ids, "type": truth.names.astype(object)}
    )
    box = truth.boxes - [pose.x, pose.y, pose.z, 0, 0, 0, 0]
    table[["x", "y", "z", "dx", "dy", "dz", "heading"]] = box
    near = np.hypot(table.x - 25, table.y - 10) < 60
    return table[near].assign(score=0.9).reset_index(drop=True)


def test_true_boxes_give_a_track_per_vehicle_and_no_switch(
    frames: SimulatedFrames, objects: pd.DataFrame
) -> None:
    lasting = objects.groupby("id").frame.transform("size") > 5
    truth = objects[lasting].reset_index(drop=True)
    tracks = pi.track(truth, frames)
    assert abs(tracks.id.nunique() - truth.id.nunique()) <= 0.01 * truth.id.nunique()
    both = [
        Sightings(t.frame.to_numpy(), t.id.to_numpy(), t[["x", "y"]].to_numpy())
        for t in (truth, tracks[tracks.state == "seen"])
    ]
    assert clear(*both).switches == 0
    ours, theirs = (
        passages(t.assign(t_s=(t.frame + 0.5) * 0.1), lines_of(frames))
        for t in (tracks, truth.assign(speed_m_s=0.0))
    )
    keys = ["line", "direction"]
    assert ours.groupby(keys).size().to_dict() == theirs.groupby(keys).size().to_dict()


@pytest.fixture(scope="module")
def tracks(frames: SimulatedFrames) -> pd.DataFrame:
    return pi.track(frames.objects.assign(score=0.9), frames)


def test_the_order_and_clock_of_tracks_change_no_measure(
    frames: SimulatedFrames, tracks: pd.DataFrame
) -> None:
    expected = pi.evaluate_tracks(frames, tracks)
    others = {
        "by id": tracks.sort_values(["id", "frame"]),
        "shuffled": tracks.sample(frac=1, random_state=1),
        "other clock": tracks.assign(t_s=tracks.t_s + 1.7e9),
    }
    for name, other in others.items():
        result = pi.evaluate_tracks(frames, other)
        pd.testing.assert_series_equal(result.measures, expected.measures, obj=name)
        assert result.facts() == expected.facts(), name


def test_tracks_of_other_frames_or_without_a_column_are_refused(
    frames: SimulatedFrames, tracks: pd.DataFrame
) -> None:
    with pytest.raises(Error, match="expected frame numbers of `frames`, got 60"):
        pi.evaluate_tracks(frames[:60], tracks)
    with pytest.raises(Error, match="expected the columns id, state"):
        pi.evaluate_tracks(frames, tracks.drop(columns=["id", "state"]))


def test_missed_and_false_passages_are_told_apart(
    frames: SimulatedFrames, tracks: pd.DataFrame
) -> None:
    """Half of the vehicles are missed, and a false one passes for each of them."""
    real = pi.evaluate_tracks(frames, tracks)
    true = int(real.movements.true.sum())
    assert real.facts()["passages"] == f"{len(real.passages)} of {len(real.passages)}"
    assert real.facts()["false passages"] == 0
    assert not real.movements[["never", "extra"]].to_numpy().any()
    ids = real.passages.id.unique()[::2]
    late = tracks[tracks.id.isin(ids)]
    shifted = late.assign(frame=late.frame + 40)  # four seconds late, so no true passage
    kept = pd.concat([tracks[~tracks.id.isin(ids)], shifted[shifted.frame <= 119]])
    found = pi.evaluate_tracks(frames, kept)
    lost, false = len(found.missed), int((found.passages.true_id < 0).sum())
    assert lost > 0
    assert false > 0
    total = len(real.passages)
    assert found.facts()["passages"] == f"{total - lost} of {total}"
    assert found.facts()["false passages"] == false
    assert found.movements.never.sum() == len(ids)
    counted = found.movements.counted.sum()
    assert found.movements.extra.sum() == counted - (true - len(ids))


def test_lines_of_a_junction_stand_at_its_arms(frames: SimulatedFrames) -> None:
    lines = {line.name: line for line in lines_of(frames)}
    assert sorted(lines) == ["main E", "main W", "side N", "side S"]
    assert {line.group for line in lines.values()} == {"main x side"}
    assert lines["main W"].forward == "E"  # into the junction


def test_commands_make_tables_and_a_page(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    truth = boxes([straight(0, -5, 10), straight(30, 5, 8, np.pi)], 60)
    tracks, lines = tmp_path / "tracks.csv", tmp_path / "lines.yaml"
    write_tracks(tracks, pi.track(truth, period_s=PERIOD_S))
    lines.write_text("lines_m:\n  gate: [[10, 20], [10, -20]]\n")
    assert main.main(["count", str(tracks), str(lines), "--out", str(tmp_path / "out")]) == 0
    assert "2 passages" in capsys.readouterr().out
    files = sorted(path.name for path in (tmp_path / "out").iterdir())
    assert files == ["counts.html", *(f"{n}.csv" for n in ("flows", "movements", "passages",
                                                            "queues", "travel"))]  # fmt: skip
    page = (tmp_path / "out/counts.html").read_text()
    assert page.count("<svg") == 2
    assert "gate" in page
    assert main.main(["count", str(tracks), "nowhere", "--out", str(tmp_path)]) == 1


def test_tracks_are_read_as_they_are_written(tmp_path: Path) -> None:
    tracks = pi.track(boxes([straight(0, -5, 10)], 20), period_s=PERIOD_S)
    file = tmp_path / "tracks.csv"
    write_tracks(file, tracks)
    pd.testing.assert_frame_equal(read_tracks(file), tracks, rtol=1e-5)
    text = file.read_text().splitlines()
    for wrong in ("frame,x\n1,2\n", "\n".join([*text, text[-1], ""]), text[0] + "\n,,,\n"):
        file.write_text(wrong)
        with pytest.raises(pi.Error, match=r"tracks.csv"):
            read_tracks(file)


def test_true_speeds_are_those_of_the_motion() -> None:
    frames = pi.simulate(pi.load_scene("highway", seed=1, set=SHORT), "helios_16", range(12))
    truth = true_objects(frames)
    assert truth.speed_m_s.dropna().between(14, 20).all()
    assert truth.speed_m_s.notna().mean() > 0.9


@pytest.fixture
def saved(tmp_path: Path) -> Path:
    """Returns the folder of a LiDAR with 10 frames."""
    frames = pi.simulate(pi.load_scene("highway", seed=1, set=SHORT), "helios_16", range(10))
    return frames.save(tmp_path / "data") / "helios_16"


@pytest.mark.parametrize("change", ["unknown", "-1"])
def test_vehicles_without_track_ids_have_no_measures(
    saved: Path, change: str, capsys: pytest.CaptureFixture[str]
) -> None:
    frames = pi.load_dataset(saved)
    assert isinstance(frames, RecordedFrames)
    tracks = pi.track(frames.labels.assign(score=0.9), frames)
    pi.evaluate_tracks(frames, tracks, lines=[])
    if change == "unknown":
        with (saved.parent / "dataset.yaml").open("a") as stream:
            stream.write("ids: unknown\n")
    else:
        for file in (saved / "training/objects").iterdir():
            pd.read_csv(file, dtype=str).assign(id=change).to_csv(file, index=False)
    with pytest.raises(UnknownIds):
        pi.evaluate_tracks(frames, tracks, lines=[])
    with pytest.raises(UnknownIds):
        check_ids(pd.DataFrame({"frame": [3, 3], "id": [7, 7]}))
    boxes_folder = pi.Detections(frames.labels.assign(score=0.9)).save(saved.parent / "boxes")
    words = [str(saved), str(boxes_folder), "--out", str(saved.parent / "tracks.csv")]
    assert main.main(["track", *words]) == 0
    printed = capsys.readouterr().out
    assert "track id" in printed
    assert "HOTA" not in printed


def test_other_formats_have_the_same_tracks(tmp_path: Path) -> None:
    tracks = pi.track(
        boxes([straight(0, -5, 10), straight(30, 5, 8, np.pi)], 20), period_s=PERIOD_S
    )
    pi.export_tracks(tracks, tmp_path / "a.jsonl")
    rows = [json.loads(line) for line in (tmp_path / "a.jsonl").read_text().splitlines()]
    assert [row["frame"] for row in rows] == list(range(20))
    assert [t["x"] for row in rows for t in row["tracks"]] == pytest.approx(tracks.x, abs=1e-3)
    write_kitti_tracking(tmp_path / "0000.txt", tracks)
    words = [line.split() for line in (tmp_path / "0000.txt").read_text().splitlines()]
    assert {len(row) for row in words} == {18}
    assert [int(row[1]) for row in words] == tracks.id.tolist()
    values = np.array([row[10:17] for row in words], dtype=np.float64)
    back = kitti.boxes_from_camera(values, kitti.simulated())
    np.testing.assert_allclose(back, tracks[BOX], atol=2e-3)
    pi.export_tracks(tracks, tmp_path / "a.json", lidar="lidar")
    assert [
        str(i) for i in openlabel_checker.core.check_file(str(tmp_path / "a.json")).issues
    ] == []
    document = json.loads((tmp_path / "a.json").read_text())["openlabel"]
    cuboids = [
        (int(number), *item["object_data"]["cuboid"][0]["val"][:3])
        for frame in document["frames"].values()
        for number, item in frame["objects"].items()
    ]
    np.testing.assert_allclose(cuboids, tracks[["id", "x", "y", "z"]])
    with pytest.raises(Error, match=r"ends in \.csv"):
        pi.export_tracks(tracks, tmp_path / "a.xml", lidar="lidar")


@pytest.mark.parametrize("seen", [[*range(4, 14), *range(22, 30)], []])
def test_frames_without_tracks_are_written(seen: list[int], tmp_path: Path) -> None:
    table = pi.track(boxes([straight(0, -5, 10)], 30), period_s=PERIOD_S)
    tracks = table[table.frame.isin(seen)]
    frames = RecordedFrames(Path("nowhere"), tuple(range(32)))  # without clouds
    times = pytest.approx(PERIOD_S * (np.arange(32) + 0.5))
    for end in ("jsonl", "json", "mcap"):
        pi.export_tracks(tracks, tmp_path / f"a.{end}", frames=frames)
    rows = [json.loads(line) for line in (tmp_path / "a.jsonl").read_text().splitlines()]
    assert [row["frame"] for row in rows] == list(range(32))
    assert [row["t_s"] for row in rows] == times
    assert [k for k, row in enumerate(rows) if row["tracks"]] == seen
    issues = openlabel_checker.core.check_file(str(tmp_path / "a.json")).issues
    assert [str(issue) for issue in issues] == []
    document = json.loads((tmp_path / "a.json").read_text())["openlabel"]["frames"]
    assert [float(f["frame_properties"]["timestamp"]) for f in document.values()] == times
    assert [int(k) for k, frame in document.items() if frame["objects"]] == seen
    with (tmp_path / "a.mcap").open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        read = [(c.topic, m) for _, c, _, m in reader.iter_decoded_messages()]
    assert len(read) == 64
    found = [m.detections for topic, m in read if topic == "/lidar/tracks"]
    assert [k for k, detections in enumerate(found) if detections] == seen


def test_variances_keep_their_digits_in_json(tmp_path: Path) -> None:
    tracks = pi.track(boxes([straight(0, -5, 10)], 30), period_s=PERIOD_S)
    file = tmp_path / "tracks.jsonl"
    write_json_lines(file, [(0, 0.05, tracks[-1:])])
    (row,) = json.loads(file.read_text())["tracks"]
    for name in ("x_var_m2", "y_var_m2", "speed_var_m2_s2"):
        assert row[name] == pytest.approx(tracks[name].iloc[-1], rel=1e-3)
    assert row["x"] == round(tracks.x.iloc[-1], 3)


def test_messages_of_ros_have_the_same_tracks(tmp_path: Path) -> None:
    tracks = pi.track(boxes([straight(0, -5, 10)], 20), period_s=PERIOD_S)
    pi.export_tracks(tracks, tmp_path / "a.mcap", lidar="avia")
    with (tmp_path / "a.mcap").open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        read = [(c.topic, m) for _, c, _, m in reader.iter_decoded_messages()]
    detections = [m for topic, m in read if topic == "/avia/tracks"]
    centres = [d.bbox.center.position for m in detections for d in m.detections]
    np.testing.assert_allclose([[p.x, p.y, p.z] for p in centres], tracks[["x", "y", "z"]])
    stamps = [m.header.stamp.sec + 1e-9 * m.header.stamp.nanosec for m in detections]
    np.testing.assert_allclose(stamps, tracks.t_s)
    covariance = [d.results[0].pose.covariance[0] for m in detections for d in m.detections]
    np.testing.assert_allclose(covariance, tracks.x_var_m2)
    markers = [m.markers for topic, m in read if topic == "/avia/track_markers"]
    assert markers[0][2].text == f"{tracks.id[0]}: 36 km/h"


def test_the_command_says_which_files_it_writes(tmp_path: Path) -> None:
    for words in (["x", "--out", "tracks.parquet"], ["x"], ["-", "--out", "a.csv"]):
        assert main.main(["track", *words]) == 2


def test_true_boxes_gave_a_track_per_vehicle_in_the_results() -> None:
    root = Path(__file__).resolve().parents[2]
    table = pd.read_csv(root / "results/tracks.csv")
    true = table[table.boxes == "true"]
    assert (true.all_tracks == true.all_vehicles).all()
    assert (true.switches == 0).all()
