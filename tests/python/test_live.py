"""Tracks of frames that arrive: bounded memory, dropped frames, times of names, JSON lines."""

from __future__ import annotations

import gc
import io
import json
import threading
import time
import tracemalloc
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from tracking_data import boxes, straight

import pyinfra as pi
from pyinfra.cli import main
from pyinfra.core.errors import FindingWarning, FormatError
from pyinfra.dataset.object_rows import BOX
from pyinfra.tracking import live
from pyinfra.tracking.tracker import Tracker


def lines(frames: int) -> list[str]:
    table = boxes([straight(-20, 5, 8), straight(20, 15, 0.0)], frames)
    return [
        json.dumps(
            {"t_s": (k + 0.5) / 10, "boxes": part[["type", *BOX, "score"]].to_dict("records")}
        )
        for k, part in table.groupby("frame")
    ]


def test_standard_input_gives_the_tracks_of_a_table(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO("\n".join(lines(20))))
    assert main.main(["track", "-", "--keep-all"]) == 0
    printed = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    expected = pi.track(boxes([straight(-20, 5, 8), straight(20, 15, 0.0)], 20), period_s=0.1,
                        smooth=False)  # fmt: skip
    last = expected[expected.frame == 19]
    assert [line["t_s"] for line in printed] == pytest.approx((np.arange(20) + 0.5) / 10)
    assert [t["id"] for t in printed[-1]["tracks"]] == last.id.tolist()
    assert [t["x"] for t in printed[-1]["tracks"]] == pytest.approx(last.x.tolist(), abs=1e-3)
    assert printed[-1]["dropped"] == 0


def test_live_commands_name_no_next_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.stdout.isatty", lambda: True)
    monkeypatch.setattr("sys.stdin", io.StringIO(""))
    assert main.main(["track", "-"]) == 0
    assert main.main(["detect", str(tmp_path), "--follow", "--idle-s", "0", "--height-m", "6"]) == 0
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize(
    "line", ["{}", "x", '{"t_s": NaN, "boxes": []}', '{"t_s": 1, "boxes": [{"type": "Car"}]}']
)
def test_a_wrong_line_is_refused(line: str) -> None:
    with pytest.raises(pi.Error):
        live.boxes_of_line(line)


def test_the_first_line_may_begin_with_a_byte_order_mark() -> None:
    time_s, boxes = live.boxes_of_line('\ufeff{"t_s": 1, "boxes": []}')
    assert (time_s, len(boxes)) == (1, 0)


@pytest.mark.parametrize("kind", ["", '"type": 3,', '"type": ["Car"],', '"type": null,'])
def test_a_box_without_a_type_is_refused(kind: str) -> None:
    numbers = ", ".join(f'"{name}": 1' for name in (*BOX, "score"))
    with pytest.raises(FormatError):
        live.boxes_of_line(f'{{"t_s": 1, "boxes": [{{{kind} {numbers}}}]}}')


def test_a_repeated_or_late_frame_is_left_out_and_counted() -> None:
    some = lines(5)
    order = [some[0], some[1], some[1], some[0], some[2]]
    arrivals = live.new_lines(order, drop=False)
    out = [json.loads(x) for x in live.live_lines(arrivals, live.boxes_of_line, Tracker())]
    assert [line["t_s"] for line in out] == [0.05, 0.15, 0.25]
    assert out[-1]["unordered"] == 2


def at(times_s: list[float]) -> list[str]:
    """Returns the lines of a car that drives 0.8 m from frame to frame."""
    boxes_text = [line.partition(', "boxes"')[2] for line in lines(len(times_s))]
    return [f'{{"t_s": {t}, "boxes"{b}' for t, b in zip(times_s, boxes_text, strict=True)]


TIMES_S = [100 + k / 10 for k in range(60)]


@pytest.mark.parametrize(
    ("times_s", "left_out", "warnings"),
    [
        ([*TIMES_S[:20], *(t - 90 for t in TIMES_S[20:])], 0, 1),  # the clock starts again
        ([*TIMES_S[:20], *(t - 5 for t in TIMES_S[20:])], 9, 1),
        ([*TIMES_S[:20], 9e9, *TIMES_S[21:]], 0, 2),  # one time in the future
        ([*TIMES_S[:20], TIMES_S[20] + 5, *TIMES_S[21:]], 9, 1),
        ([*TIMES_S[:20], *(t + 3600 for t in TIMES_S[20:])], 0, 1),
    ],
)
def test_a_jump_of_the_clock_ends_tracks_with_a_warning_and_not_the_output(
    times_s: list[float], left_out: int, warnings: int
) -> None:
    arrivals = live.new_lines(at(times_s), drop=False)
    with pytest.warns(FindingWarning, match="t_s") as found:
        out = [json.loads(x) for x in live.live_lines(arrivals, live.boxes_of_line, Tracker())]
    assert len(found) == warnings
    assert len(out) == len(times_s) - left_out
    assert out[-1]["unordered"] == left_out
    before, after = ({t["id"] for t in line["tracks"]} for line in (out[19], out[-1]))
    assert len(after) == 2
    assert min(after) > max(before)


def test_times_in_nanoseconds_are_not_silent() -> None:
    arrivals = live.new_lines(at([1e9 * t for t in TIMES_S]), drop=False)
    with pytest.warns(FindingWarning, match="got 1e\\+08 s"):
        assert len(list(live.live_lines(arrivals, live.boxes_of_line, Tracker()))) == 60


def test_lines_that_cannot_be_read_do_not_wait_for_ever() -> None:
    def stream() -> Iterator[str]:
        yield "a"
        raise OSError("no more")

    arrivals = live.new_lines(stream())
    assert next(arrivals).item == "a"
    with pytest.raises(OSError, match="no more"):
        next(arrivals)


def test_a_slow_machine_drops_lines_and_keeps_the_newest() -> None:
    arrivals = live.new_lines(str(k) for k in range(1000))
    first = next(arrivals)
    time.sleep(0.2)
    rest = list(arrivals)
    assert rest[-1].item == "999"
    assert len(rest) <= live.WAITING + 1
    assert rest[-1].dropped == 1000 - 1 - len(rest)
    assert first.dropped <= rest[0].dropped


def test_a_growing_folder_gives_new_complete_clouds(tmp_path: Path) -> None:
    (tmp_path / "000000.pcd").write_text("old")

    def write() -> None:
        for k in range(1, 4):
            time.sleep(0.1)
            (tmp_path / f"{k:06d}.pcd").write_text("cloud")

    thread = threading.Thread(target=write)
    thread.start()
    found = [arrival.item.name for arrival in live.new_clouds(tmp_path, idle_s=2)]
    thread.join()
    assert found[-1] == "000003.pcd"
    assert "000000.pcd" not in found
    assert found == sorted(found)


def test_files_that_wait_are_dropped(tmp_path: Path) -> None:
    clouds = live.new_clouds(tmp_path, idle_s=0.5)
    thread = threading.Timer(
        0.1, lambda: [(tmp_path / f"{k}.bin").write_bytes(b"0") for k in range(10, 20)]
    )
    thread.start()
    found = list(clouds)
    assert found[-1].item.name == "19.bin"
    assert found[-1].dropped + len(found) == 10


@pytest.mark.parametrize(
    "names", [["frame_98", "frame_99", "frame_100"], ["9.95", "9.99", "10.05"]]
)
def test_the_newest_of_waiting_files_has_the_highest_number(
    tmp_path: Path, names: list[str]
) -> None:
    """The names differ in their number of digits. A hidden file is still being written."""

    def write() -> None:
        for name in (*names, ".frame_101"):
            (tmp_path / f"{name}.bin").write_bytes(b"0")

    clouds = live.new_clouds(tmp_path, idle_s=0.5)
    threading.Timer(0.1, write).start()
    found = list(clouds)
    assert found[-1].item.name == f"{names[-1]}.bin"
    assert found[-1].dropped + len(found) == 3


def test_the_time_of_a_slow_detector_is_not_idle(tmp_path: Path) -> None:
    clouds, found = live.new_clouds(tmp_path, idle_s=0.5), []
    threading.Timer(0.1, lambda: (tmp_path / "0.bin").write_bytes(b"0")).start()
    for arrival in clouds:
        found.append(arrival.item.name)
        if len(found) < 3:
            (tmp_path / f"{len(found)}.bin").write_bytes(b"0")
            time.sleep(0.7)
    assert found == ["0.bin", "1.bin", "2.bin"]


def test_clouds_are_read_also_if_their_names_begin_again(tmp_path: Path) -> None:
    (tmp_path / "000099.bin").write_bytes(b"0")
    threading.Timer(0.1, lambda: (tmp_path / "000000.bin").write_bytes(b"0")).start()
    found = [arrival.item.name for arrival in live.new_clouds(tmp_path, idle_s=0.7)]
    assert found == ["000000.bin"]


@pytest.mark.parametrize("period_s", [None, 0.1])
@pytest.mark.parametrize(
    ("name", "time_s"),
    [
        ("1777883410500", 1777883410.5),
        ("1777883410500000", 1777883410.5),
        ("cloud_1777883410500000000", 1777883410.5),
        ("1777883410.500000", 1777883410.5),
        ("0000000012.250000000", 12.25),
    ],
)
def test_the_unit_of_a_time_is_that_of_its_size(
    name: str, time_s: float, period_s: float | None
) -> None:
    assert live.time_of(Path(f"{name}.bin"), period_s) == pytest.approx(time_s, abs=1e-6)


@pytest.mark.parametrize("period_s", [None, 0.1])
@pytest.mark.parametrize("name", ["20260504103010123", "10.30.15", "20260504103010"])
def test_a_date_is_no_time(name: str, period_s: float | None) -> None:
    with pytest.raises(pi.Error, match="expected a time"):
        live.time_of(Path(f"{name}.bin"), period_s)


def test_the_time_of_a_cloud_is_that_of_its_name() -> None:
    assert live.time_of(Path("4294967295.bin"), 0.1) == pytest.approx(429496729.55)
    assert live.time_of(Path("1777883410.500000.pcd"), None) == 1777883410.5
    assert live.time_of(Path("000012.bin"), 0.05) == pytest.approx(0.625)
    for name in ("cloud.pcd", "000012.pcd"):
        with pytest.raises(pi.Error):
            live.time_of(Path(name), None)


@pytest.mark.nightly
def test_memory_does_not_grow_with_the_number_of_frames() -> None:
    """After 200 frames, 400 more need no more memory."""
    tracker = Tracker()
    parsed = [live.boxes_of_line(line)[1] for line in lines(20)]

    def step(start: int, end: int) -> None:
        for k in range(start, end):
            tracker.step(0.1 * (k + 1), parsed[k % 20])

    tracemalloc.start()
    step(0, 200)
    gc.collect()
    before = tracemalloc.get_traced_memory()[0]
    step(200, 600)
    gc.collect()
    after = tracemalloc.get_traced_memory()[0]
    tracemalloc.stop()
    assert after - before < 200_000
