"""An outline is proposed from where vehicles drive. The clouds are made up."""

import re
from pathlib import Path

import numpy as np
import pytest

from pyinfra.cli import main
from pyinfra.core.errors import Error
from pyinfra.dataset.outlines import in_outline
from pyinfra.dataset.regions import read_outline
from pyinfra.exchange.data_set import LidarFacts
from pyinfra.exchange.imports import import_recording
from pyinfra.exchange.recording import Options
from pyinfra.models.inference.region_proposal import (
    MOST_CORNERS,
    MOST_FRAMES,
    in_windows,
    propose_outline,
    simplified,
    spaced,
)

PERIOD_S = 0.25
FRAMES = 121
SPEED_M_S = 12.0
LANES_Y_M = (-4.0, 4.0)  # one in each direction
BUSH = (20.0, 20.0)


def cloud(number: int, *, still: bool = False) -> np.ndarray:
    """A level road 6 m below the sensor, with six cars and a bush whose leaves move."""
    random = np.random.default_rng(number)
    x, y = np.meshgrid(np.arange(-60.0, 60, 3), np.arange(-30.0, 30, 3))
    parts = [np.column_stack([x.ravel(), y.ravel(), np.full(x.size, -6.0)])]
    for i in range(0 if still else 6):
        way = 1 if i % 2 else -1
        middle = way * ((SPEED_M_S * PERIOD_S * number + 37 * i) % 110 - 55)
        body = random.uniform([-2.2, -0.9, 0.3], [2.2, 0.9, 1.5], (60, 3))
        parts.append(np.add(body, [middle, LANES_Y_M[i % 2], -6]))
    leaves = random.uniform([-1.5, -1.5, 0.3], [1.5, 1.5, 2], (20, 3))
    parts.append(np.add(leaves, [*BUSH, -6]))
    xyz = np.concatenate(parts)
    return np.column_stack([xyz, np.full(len(xyz), 0.5)]).astype(np.float32)


def test_the_outline_holds_the_lanes_and_not_the_bush(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The command prints how well the outline fits, and writes what the import reads."""
    (tmp_path / "source").mkdir()
    for k in range(FRAMES + 1):
        cloud(k).tofile(tmp_path / f"source/{k:03d}.bin")
    folder, out = tmp_path / "data/pole", tmp_path / "out/outline.yaml"
    facts = LidarFacts("pole", "data", period_s=PERIOD_S, height_m=6)
    import_recording(tmp_path / "source", "bin", folder, facts, Options(), upright="as-is")
    assert main.main(["region", str(folder), "--out", str(out)]) == 0
    printed = re.search(r"(\d+) corners, (\d+) m2, .* (\d+) tracks", capsys.readouterr().out)
    assert printed is not None
    corners = read_outline(out)
    assert len(corners) == int(printed[1]) <= MOST_CORNERS
    assert 120 * 10 < int(printed[2]) < 150 * 16
    assert int(printed[3]) >= 6
    x = np.arange(-50.0, 51, 5)
    for y in LANES_Y_M:
        assert in_outline(corners, np.column_stack([x, np.full(len(x), y)]), 0).all()
    assert not in_outline(corners, np.array([BUSH]), 0).any()
    assert main.main(["region", str(folder), "--out", str(tmp_path / "outline.csv")]) == 2
    assert "--out: expected a .yaml file" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("frames", "still", "message"),
    [
        (FRAMES - 24, False, "expected a recording of 30 s or more, got 24 s"),
        (FRAMES + 1, True, "expected 5 or more tracks of vehicles, got 0 in 30.25 s"),
        (0, False, "expected a recording of 30 s or more, got 0 s"),
    ],
)
def test_too_little_is_refused(frames: int, still: bool, message: str) -> None:
    with pytest.raises(Error, match=message):
        propose_outline(lambda k: cloud(k, still=still), range(frames), PERIOD_S)


def test_few_frames_per_second_are_refused() -> None:
    with pytest.raises(Error, match=r"expected 0\.25 s or less between frames, got 0\.5 s"):
        propose_outline(cloud, range(0, 200, 2), PERIOD_S)


def test_a_gap_loses_no_later_frame() -> None:
    """After the gap, the numbers of a recording with every second frame are odd."""
    numbers = [*range(0, 80, 2), *range(85, 320, 2)]
    read = []

    def made(number: int) -> np.ndarray:
        read.append(number)
        return cloud(number // 2)

    assert propose_outline(made, numbers, PERIOD_S / 2).vehicles >= 6
    assert set(read) == set(numbers)
    assert spaced([0, 1, 2, 5, 6, 7], 2) == [0, 2, 5, 7]


def test_long_recordings_are_sampled_in_windows() -> None:
    chosen = in_windows(range(5000))
    assert len(chosen) == MOST_FRAMES
    assert [chosen[0], chosen[-1]] == [0, 4999]
    assert (np.diff(chosen) == 1).sum() == MOST_FRAMES - 20
    assert in_windows(range(7)) == list(range(7))


def test_an_outline_with_many_corners_is_simplified() -> None:
    angle = np.linspace(0, 2 * np.pi, 200, endpoint=False)
    circle = 50 * np.column_stack([np.cos(angle), np.sin(angle)])
    few = simplified(circle)
    assert len(few) <= MOST_CORNERS
    assert in_outline(few, 0.9 * circle, 0).all()
