"""Faults of a sensor are found in the right frames, and clean recordings have none."""

from pathlib import Path

import numpy as np
import pytest
from health_data import FAULTS, FROM, Frame, clean

from pyinfra.core.files import write
from pyinfra.dataset.health import HealthMonitor, health_text, recorded_health, write_health
from pyinfra.exchange.data_set import LidarFacts
from pyinfra.exchange.imports import import_recording, warnings
from pyinfra.exchange.recording import Options
from pyinfra.formats.csv_table import read_csv
from pyinfra.viz.health_plot import draw_health

FRAMES = 60


@pytest.mark.parametrize("name", FAULTS)
def test_each_fault_is_found_in_its_frames(name: str) -> None:
    word, change = FAULTS[name]
    monitor = HealthMonitor()
    for k, frame in enumerate(clean(3, FRAMES)):
        if k < FROM and k % 3:  # fewer clean frames for a fast test
            continue
        monitor.add(k, *(change(frame) if k >= FROM else frame))
    report = monitor.report()
    named = [row.frame for row in report if word in row.problems.split()]
    assert named == list(range(FROM, FRAMES))
    assert not any(row.problems for row in report if row.frame < FROM)


def test_frozen_frames() -> None:
    frames = list(clean(0, 12))
    monitor = HealthMonitor()
    for k in range(12):
        monitor.add(k, *frames[min(k, 8)])
    assert [row.frame for row in monitor.report() if row.problems == "frozen"] == [9, 10, 11]


@pytest.mark.parametrize("seed", range(4))
def test_a_clean_recording_has_no_fault(seed: int) -> None:
    monitor = HealthMonitor()
    for k, frame in enumerate(clean(seed, 30)):
        monitor.add(k, *frame)
    assert health_text(monitor.report()) == ""


@pytest.mark.nightly
@pytest.mark.parametrize("seed", range(20))
def test_twenty_clean_recordings_have_no_fault(seed: int) -> None:
    monitor = HealthMonitor()
    for k, frame in enumerate(clean(100 + seed, FRAMES)):
        monitor.add(k, *frame)
    assert health_text(monitor.report()) == ""


def without(lines: set[int], frame: Frame) -> Frame:
    keep = ~np.isin(frame[1]["ring"], list(lines))
    return frame[0][keep], frame[1][keep]


@pytest.mark.parametrize("lines", [{12}, {5, 20}, {7, 8}, {1, 16, 17}])
@pytest.mark.parametrize("seed", range(2))
def test_lines_without_points_from_the_first_frame_on(lines: set[int], seed: int) -> None:
    """They do not make a frame wrong, because all frames are the same."""
    monitor = HealthMonitor()
    for k, frame in enumerate(clean(seed, 8)):
        monitor.add(k, *without(lines, frame))
    report = monitor.report()
    assert {row.dead_lines for row in report} == {" ".join(map(str, sorted(lines)))}
    assert not any(row.problems for row in report)
    assert "no frame has points of the lines" in health_text(report)


NUMBERS = {
    "from above": lambda ring: 31 - ring,
    "every second number": lambda ring: 2 * ring,
    "in the order of firing": lambda ring: (ring % 16) * 2 + ring // 16,
}


@pytest.mark.parametrize("name", NUMBERS)
@pytest.mark.parametrize("crop", [False, True])
def test_no_line_is_missing_in_other_numberings_and_cropped_clouds(name: str, crop: bool) -> None:
    """A cropped cloud has no points of the highest lines."""
    monitor = HealthMonitor()
    for k, frame in enumerate(clean(2, 8)):
        points, fields = without(set(range(24, 32)), frame) if crop else frame
        fields["ring"] = NUMBERS[name](fields["ring"].astype(int))
        monitor.add(k, points, fields)
    assert health_text(monitor.report()) == ""


def test_too_few_frames_have_no_report() -> None:
    monitor = HealthMonitor()
    for k, frame in enumerate(clean(0, 3)):
        monitor.add(k, *frame)
    assert monitor.report() == []


def test_an_import_with_a_tilt_warns_once_and_writes_a_table(tmp_path: Path) -> None:
    _, change = FAULTS["tilt 5"]
    (tmp_path / "source").mkdir()
    for k, frame in enumerate(clean(5, 24)):
        points, _ = change(frame) if k >= 12 else frame
        write(tmp_path / f"source/{k:06d}.bin", np.ascontiguousarray(points).tobytes())
    summary, labelled = import_recording(
        tmp_path / "source",
        "bin",
        tmp_path / "in/pole",
        LidarFacts("pole", "street"),
        Options(columns=4),
        upright="as-is",
    )
    (text,) = (line for line in warnings(summary, labelled) if "first minute" in line)
    assert "tilted (frames 12 to 23)" in text
    table = read_csv(tmp_path / "in/pole/health.csv", {"problems", "dead_lines"})
    assert table.tilt_deg[12:].to_numpy() == pytest.approx(5, abs=0.3)
    assert health_text(recorded_health(tmp_path / "in/pole", range(24))) == text
    draw_health(summary.health, tmp_path / "health.png")
    assert (tmp_path / "health.png").stat().st_size > 5000
    write_health(tmp_path / "again.csv", summary.health)
    assert (tmp_path / "again.csv").read_text() == (tmp_path / "in/pole/health.csv").read_text()
