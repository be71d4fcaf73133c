"""An outline is proposed from where vehicles drive. The clouds are made up."""

import itertools
import re
from pathlib import Path

import numpy as np
import pytest
import shapely

import pyinfra as pi
from pyinfra.cli import main
from pyinfra.core.errors import Error
from pyinfra.dataset.outlines import in_outline
from pyinfra.dataset.regions import drawn_of, read_outline
from pyinfra.exchange.data_set import LidarFacts
from pyinfra.exchange.imports import import_recording
from pyinfra.exchange.recording import Options
from pyinfra.models.inference.path_area import MOST_CORNERS, area_of, simplified
from pyinfra.models.inference.region_proposal import (
    MOST_FRAMES,
    in_windows,
    propose_outline,
    spaced,
    write_outline,
)

PERIOD_S = 0.25
FRAMES = 120  # 30 s
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
    for k in range(FRAMES):
        cloud(k).tofile(tmp_path / f"source/{k:03d}.bin")
    folder, out = tmp_path / "data/pole", tmp_path / "out/outline.yaml"
    facts = LidarFacts("pole", "data", period_s=PERIOD_S, height_m=6)
    import_recording(tmp_path / "source", "bin", folder, facts, Options(), upright="as-is")
    assert main.main(["region", str(folder), "--out", str(out)]) == 0
    captured = capsys.readouterr()
    assert captured.err == ""
    printed = re.search(r"(\d+) corners, (\d+) m2, .* (\d+) tracks", captured.out)
    assert printed is not None
    drawn = read_outline(out)
    assert len(drawn.corners) == int(printed[1]) <= MOST_CORNERS
    assert 120 * 10 < int(printed[2]) < 150 * 16
    assert int(printed[3]) >= 6
    x = np.arange(-50.0, 51, 5)
    for y in LANES_Y_M:
        assert drawn.holds(np.column_stack([x, np.full(len(x), y)])).all()
    assert not drawn.holds(np.array([BUSH])).any()
    assert main.main(["region", str(folder), "--out", str(tmp_path / "outline.csv")]) == 2
    assert "--out: expected a file name that ends in .yaml" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("frames", "still", "message"),
    [
        (39, False, "expected a recording of 10 s or more, got 9.75 s"),
        (FRAMES, True, "expected 5 or more tracks of vehicles, got 0 in 30 s"),
        (0, False, "expected a recording of 10 s or more, got 0 s"),
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


def ring(low: float, high: float) -> np.ndarray:
    return np.array([[low, low], [high, low], [high, high], [low, high]])


TWO = {"outlines_m": [ring(-20, 20), ring(30, 40)], "holes_m": [ring(-5, 5)]}
POLYGON = shapely.union_all(
    [shapely.Polygon(ring(-20, 20), [ring(-5, 5)]), shapely.Polygon(ring(30, 40))]
)
AREAS = {
    "keys": TWO,
    "both keys": {**TWO, "outline_m": ring(-20, 20), "outlines_m": [ring(30, 40)]},
    "shapely": POLYGON,
    "shapely with z": shapely.force_3d(POLYGON),
}


@pytest.mark.parametrize("name", [*AREAS, "file"])
def test_areas_have_several_outlines_and_holes(name: str, tmp_path: Path) -> None:
    """Compared with shapely for random points, with and without a margin."""
    drawn = drawn_of(AREAS.get(name, TWO))
    if name == "file":
        write_outline(tmp_path / "a.yaml", drawn)
        drawn = read_outline(tmp_path / "a.yaml")
    assert drawn.area_m2 == pytest.approx(POLYGON.area)
    points = np.random.default_rng(1).uniform(-30, 50, (4000, 2))
    away = shapely.distance(POLYGON, shapely.points(points))
    for margin in (0.0, 2.0):
        assert np.array_equal(drawn.holds(points, margin), away <= margin)


@pytest.mark.parametrize(
    ("area", "message"),
    [
        ({"outlines_m": []}, "expected `outline_m` or `outlines_m`, got neither"),
        ({"outlines_m": [ring(0, 1), [[0, 0], [1, 1]]]}, "outlines_m.1: expected 3 or more"),
        ({"outline_m": ring(0, 1), "holes_m": [ring(1, 1)]}, "holes_m.0: expected an outline with"),
        (
            {"outline": ring(0, 1)},
            "expected the keys outline_m, outlines_m and holes_m, got 'outline'",
        ),
        (shapely.Point(1, 2), "expected a Polygon or MultiPolygon, got Point"),
        ([[0, 0], [1, "a"]], "corners: expected an array"),
    ],
)
def test_wrong_areas_are_named(area: object, message: str) -> None:
    with pytest.raises(Error, match=f"region: {message}"):
        pi.detect(lambda points: np.empty((0, 7)), [np.zeros((1, 4))], region=area)


def paths_along(corners: np.ndarray, step_m: float = 5.0) -> np.ndarray:
    """Returns paths (p, 2, 2) along the sides of an outline."""
    parts = []
    for a, b in itertools.pairwise([*corners, corners[0]]):
        count = int(np.linalg.norm(b - a) / step_m)
        at = a + np.linspace(0, 1, count + 1)[:, None] * (b - a)
        parts.append(np.stack([at[:-1], at[1:]], axis=1))
    return np.concatenate(parts)


def test_a_block_between_streets_is_a_hole_and_a_far_street_an_outline() -> None:
    near, far = paths_along(ring(-40, 40)), paths_along(np.array([[150.0, 0], [190, 0]]))
    drawn = area_of(np.concatenate([near, far]))
    assert (len(drawn.outlines), len(drawn.holes)) == (2, 1)
    assert not drawn.holds(np.array([[0.0, 0], [110, 0], [-60, 0]])).any()
    assert drawn.holds(np.concatenate([near[:, 0], far[:, 0]])).all()


def test_a_short_recording_gives_a_warning(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "source").mkdir()
    for k in range(41):
        cloud(k).tofile(tmp_path / f"source/{k:03d}.bin")
    facts = LidarFacts("pole", "data", period_s=PERIOD_S, height_m=6)
    folder, out = tmp_path / "data/pole", tmp_path / "outline.yaml"
    import_recording(tmp_path / "source", "bin", folder, facts, Options(), upright="as-is")
    assert main.main(["region", str(folder), "--out", str(out)]) == 0
    assert capsys.readouterr().err.startswith("pyinfra: warning: the recording has 10.25 s; lanes")


def test_a_proposal_from_ten_seconds_is_an_area_for_detect_and_shapely() -> None:
    proposal = propose_outline(cloud, range(42), PERIOD_S)
    assert shapely.geometry.shape(proposal).area == pytest.approx(proposal.area_m2)
    drawn = drawn_of(proposal)
    assert drawn.area_m2 == pytest.approx(proposal.area_m2)
    x = np.arange(-50.0, 51, 5)
    for y in LANES_Y_M:
        assert drawn.holds(np.column_stack([x, np.full(len(x), y)])).mean() > 0.9
