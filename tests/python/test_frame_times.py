"""Frame numbers of a recording times its frame period are the times of its clock."""

import json
from pathlib import Path

import numpy as np
import pytest
from recording_files import BagWriter, driver_records, road, write_packets

from pyinfra.exchange.bag import read as read_bag
from pyinfra.exchange.data_set import LidarFacts
from pyinfra.exchange.frame_times import timed
from pyinfra.exchange.imports import import_recording
from pyinfra.exchange.recording import NO_BOXES, Options, RecordedFrame, Recording
from pyinfra.exchange.velodyne_packets import Packets
from pyinfra.exchange.velodyne_packets import read as read_packets
from pyinfra.formats import kitti
from pyinfra.formats.pcd_file import write_pcd

START_S = 1.7e9
EVEN = np.arange(30)
LOST = np.delete(np.arange(30), [4, 11, 12, 13])  # of the frames that the sensor made
FACTS = LidarFacts("pole", "junction")


def recording(names: list[str], times: np.ndarray | None) -> Recording:
    return Recording(
        tuple(names),
        lambda i: RecordedFrame(road(i), NO_BOXES),
        labelled=False,
        times=lambda: None if times is None else START_S + times,
    )


def numbered(numbers: np.ndarray) -> list[str]:
    return [f"{number:06d}" for number in numbers]


@pytest.mark.parametrize("is_given", [False, True])
@pytest.mark.parametrize("jitter_s", [0.0, 0.07])
@pytest.mark.parametrize(
    ("names", "made"),
    [
        (numbered(EVEN), EVEN),
        (numbered(7 + EVEN), EVEN),
        (numbered(LOST), LOST),
        (numbered(np.arange(len(LOST))), LOST),  # the recorder counts files, not frames
        ([f"cloud_{i}" for i in LOST], LOST),
        (numbered(5 * EVEN), 5 * EVEN),  # key frames
        (numbered(100 + 3 * LOST), 3 * LOST),
        (numbered(EVEN), 5 * EVEN),
        (numbered(np.r_[0:10, 20:40]), EVEN),  # numbers with a gap that the clock does not have
    ],
)
def test_numbers_times_the_period_follow_the_clock(
    names: list[str], made: np.ndarray, jitter_s: float, is_given: bool
) -> None:
    times = 0.1 * made
    period_s = float(np.median(np.diff(times))) if is_given else None  # that of the clouds
    times[[6, 17]] += jitter_s * np.array([1, -1])  # stamps that are late and early
    ordered, notes = timed(recording(names, times), period_s)
    assert ordered.period_s is not None
    since = ordered.period_s * (np.array(ordered.numbers()) - ordered.numbers()[0])
    np.testing.assert_allclose(since, 0.1 * made, atol=1e-6)
    in_names = [int(name.removeprefix("cloud_")) for name in names]
    follow = np.unique(np.diff(made) / np.diff(in_names)).size == 1
    is_period = not is_given or np.min(np.diff(in_names)) == 1
    is_kept = list(ordered.numbers()) == in_names
    assert is_kept == (follow and is_period)
    reported = any("numbered by the clock" in note for note in notes)
    assert reported == (not is_kept and names[0].isdecimal())


@pytest.mark.parametrize("period_s", [0.1, 0.5])
def test_a_given_period_may_be_that_of_the_sensor_or_of_its_key_frames(period_s: float) -> None:
    ordered, _ = timed(recording(numbered(5 * EVEN), 0.5 * EVEN), period_s)
    assert ordered.period_s == period_s
    assert ordered.numbers() == tuple(0.5 * EVEN / period_s)


def test_a_long_gap_may_differ_from_its_numbers_by_rounding() -> None:
    """The clock is 0.2 % faster than its median step, because of its few digits."""
    numbers = np.r_[0:10, 5000:5010]
    times = np.round(0.1002 * numbers, 1)
    ordered, notes = timed(recording(numbered(numbers), times))
    assert ordered.numbers() == tuple(numbers)
    assert any("have the same gaps" in note for note in notes)


@pytest.mark.parametrize("period_s", [None, 0.2])
def test_clouds_without_a_clock_keep_their_numbers_with_a_report(period_s: float | None) -> None:
    ordered, notes = timed(recording(numbered(5 * EVEN), None), period_s)
    assert ordered.numbers() == tuple(5 * EVEN)
    seconds = 5 * (period_s or 0.1)
    assert any(f"5 apart, so the clouds are {seconds:g} s apart" in note for note in notes)
    _, notes = timed(recording(numbered(EVEN), None), period_s)
    assert not any("apart" in note for note in notes)


def test_clouds_that_a_bag_lost_leave_a_gap(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "a.bag", "bag") as bag:
        for k in LOST:
            time_s = START_S + 0.1 * float(k)
            bag.write("/points", time_s, bag.cloud(driver_records(int(k), "hesai"), time_s))
    ordered, notes = timed(read_bag(tmp_path / "a.bag", Options()))
    assert ordered.numbers() == tuple(LOST)
    assert any("have the same gaps" in note for note in notes)


def test_turns_that_packets_lost_leave_a_gap(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Packets, "stamps", lambda _: (START_S + 0.1 * LOST).tolist())
    monkeypatch.setattr(Packets, "records", lambda _, i: driver_records(i, "velodyne"))
    ordered, notes = timed(read_packets(write_packets(tmp_path / "a.pcap"), Options()))
    assert ordered.numbers() == tuple(LOST)
    assert any("have the same gaps" in note for note in notes)


def test_key_frames_of_dair_have_the_times_of_data_info(tmp_path: Path) -> None:
    """Every third frame of a sensor with 10 Hz, named by the numbers of its frames."""
    rows = []
    (tmp_path / "set/velodyne").mkdir(parents=True)
    for k in range(8):
        name = f"velodyne/{100 + 3 * k:06d}.pcd"
        kind = [(field, "<f4") for field in ("x", "y", "z", "intensity")]
        write_pcd(tmp_path / "set" / name, np.rec.fromarrays(road(k).T, dtype=kind))
        rows.append(
            {
                "pointcloud_path": name,
                "pointcloud_timestamp": str(round((START_S + 0.3 * k) * 1e6)),
            }
        )
    (tmp_path / "set/data_info.json").write_text(json.dumps(rows))
    out = tmp_path / "in/pole"
    import_recording(tmp_path / "set", "dair-v2x", out, FACTS, Options())
    assert kitti.frames(out) == list(range(100, 124, 3))
    assert kitti.read_lidar(out).period_s == 0.1
