"""Measures on frames without labels distinguish a good detector from a bad one."""

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pyinfra.cli import main
from pyinfra.core.arrays import FloatArray
from pyinfra.formats import kitti
from pyinfra.metrics.label_free_quality import (
    COLUMNS,
    BoxSeries,
    Trust,
    refusal,
    stands,
    travels,
    trust,
)
from pyinfra.models.inference.label_free_checks import NoQuality, trust_of

FRAMES = 50
CAR = (4.5, 1.9, 1.6)
Boxes = tuple[FloatArray, FloatArray]
Made = Callable[[np.random.Generator, FloatArray], Boxes]


@pytest.fixture(scope="module")
def lidar(
    infrasim: Callable[..., object],
    run_command: Callable[..., list[str]],
    tmp_path_factory: pytest.TempPathFactory,
) -> Path:
    """Simulates ten seconds of a motorway, every frame at 5 Hz."""
    out = tmp_path_factory.mktemp("row") / "data"
    words = run_command("hesai_xt32", frames=f"0:{FRAMES}", preset="datasheet", out=out)
    words += ["--rate-hz", "5"]
    infrasim(*words, check=True)
    return out / "hesai_xt32"


def good(draw: np.random.Generator, truth: FloatArray) -> Boxes:
    """Returns the boxes of nearly all vehicles, with errors of 10 cm."""
    boxes = truth[draw.random(len(truth)) < 0.95].copy()
    boxes[:, :2] += draw.normal(0, 0.1, (len(boxes), 2))
    return boxes, draw.uniform(0.7, 1, len(boxes))


def cars_at(positions: FloatArray) -> FloatArray:
    rows = np.tile([-5.2, *CAR, 0.0], (len(positions), 1))
    return np.column_stack([positions, rows])


def and_background(draw: np.random.Generator, truth: FloatArray) -> Boxes:
    boxes, scores = good(draw, truth)
    background = cars_at(draw.uniform(-60, 60, (8, 2)))
    return np.concatenate([boxes, background]), np.append(scores, draw.uniform(0.1, 0.45, 8))


def and_hedges(draw: np.random.Generator, truth: FloatArray) -> Boxes:
    boxes, scores = good(draw, truth)
    hedges = cars_at(np.column_stack([np.arange(-50.0, 50, 10), np.full(10, 25.0)]))
    hedges[:, :2] += draw.normal(0, 0.1, (10, 2))
    return np.concatenate([boxes, hedges]), np.append(scores, draw.uniform(0.1, 0.45, 10))


def half_blind(draw: np.random.Generator, truth: FloatArray) -> Boxes:
    boxes, scores = good(draw, truth)
    keep = draw.random(len(boxes)) < 0.5
    return boxes[keep], scores[keep]


def predictions(lidar: Path, made: Made, to: Path) -> Path:
    draw = np.random.default_rng(0)
    to.mkdir()
    for frame in kitti.frames(lidar):
        objects = kitti.read_objects(kitti.frame_file(lidar, "objects", frame))
        boxes, scores = made(draw, objects.label_boxes("scan")[objects.points >= 3])
        labels = kitti.Labels(np.full(len(boxes), "vehicle"), boxes, scores)
        kitti.write_labels(to / f"{frame:06d}.txt", labels, None)
    return to


@pytest.fixture(scope="module")
def tables(lidar: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[Trust]]:
    folder = tmp_path_factory.mktemp("pred")
    kinds = (good, and_background, and_hedges, half_blind)
    return {m.__name__: trust_of(lidar, predictions(lidar, m, folder / m.__name__)) for m in kinds}


def test_a_good_detector_looks_good(tables: dict[str, list[Trust]]) -> None:
    low = tables["good"][0]
    assert low.frames == FRAMES
    assert low.confirmed_share > 0.7
    assert low.recall > 0.8
    assert low.flicker_share < 0.05
    assert low.standing_share < 0.05


def test_background_flickers_and_nothing_moves_in_it(tables: dict[str, list[Trust]]) -> None:
    background, low = tables["and_background"][0], tables["good"][0]
    assert background.flicker_share > low.flicker_share + 0.2
    assert background.confirmed_share < low.confirmed_share - 0.2
    assert background.off_region_share > low.off_region_share + 0.1
    assert background.recall == pytest.approx(low.recall, abs=0.05)


def test_hedges_stand(tables: dict[str, list[Trust]]) -> None:
    hedges, low = tables["and_hedges"][0], tables["good"][0]
    assert hedges.standing_share > low.standing_share + 0.3
    assert hedges.confirmed_share < low.confirmed_share - 0.2
    assert hedges.flicker_share < 0.05


def test_a_blind_detector_finds_less_of_what_travels(tables: dict[str, list[Trust]]) -> None:
    blind, low = tables["half_blind"][0], tables["good"][0]
    assert blind.recall < low.recall - 0.3
    assert blind.confirmed_share == pytest.approx(low.confirmed_share, abs=0.1)


def test_a_higher_cut_leaves_the_background_out(tables: dict[str, list[Trust]]) -> None:
    cut = next(row for row in tables["and_background"] if row.score == 0.5)
    low = tables["good"][0]
    assert cut.boxes_per_frame == pytest.approx(low.boxes_per_frame, rel=0.05)
    assert cut.confirmed_share == pytest.approx(low.confirmed_share, abs=0.05)


def test_the_command_prints_and_writes_the_table(
    lidar: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pred = predictions(lidar, and_background, tmp_path / "pred")
    words = ["validate", lidar, "--pred", pred, "--unlabelled", "--out", tmp_path / "out"]
    assert main.main([str(word) for word in words]) == 0
    table = pd.read_csv(tmp_path / "out/trust.csv")
    assert tuple(table) == COLUMNS
    assert table.score.tolist() == [0.1, 0.2, 0.3, 0.5, 0.7]
    assert "confirmed_share" in capsys.readouterr().out


def test_labelled_frames_are_asked_for_it(
    lidar: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pred = predictions(lidar, good, tmp_path / "pred")
    assert main.main(["validate", str(lidar), "--pred", str(pred)]) == 0
    assert "confirmed_share" not in capsys.readouterr().out
    assert main.main(["validate", str(lidar), "--unlabelled"]) == 2
    assert (
        "--pred: expected a folder with --unlabelled or --out, got none" in capsys.readouterr().err
    )


# --- faults, and recordings that show too little


def recorded(lidar: Path, folder: Path) -> Path:
    """Copies the frames as a recording without labels."""
    out = folder / "data/pole"
    shutil.copytree(lidar / "training/velodyne", out / "training/velodyne")
    text = (lidar / "lidar.yaml").read_text()
    (out / "lidar.yaml").write_text(text.replace('preset: "datasheet"', 'preset: "recorded"'))
    shutil.copy(lidar.parent / "roads.csv", out.parent)
    return out


def half_the_lines(points: FloatArray, frame: int) -> FloatArray:
    elevation = np.degrees(np.arctan2(points[:, 2], np.hypot(points[:, 0], points[:, 1])))
    return points[np.floor(elevation + 0.5).astype(int) % 2 == 0]


def leaning(points: FloatArray, frame: int) -> FloatArray:
    a = np.radians(4)
    turn = np.array([[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]])
    return np.column_stack([points[:, :3] @ turn.T, points[:, 3]])


def nothing_near(points: FloatArray, frame: int) -> FloatArray:
    return points[np.arctan2(points[:, 1], points[:, 0]) > -0.5]


@pytest.fixture(scope="module")
def clean(lidar: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path, list[Trust]]:
    """Returns a recording, predictions for it, and their measures."""
    folder = tmp_path_factory.mktemp("clean")
    pole, pred = recorded(lidar, folder), predictions(lidar, good, folder / "pred")
    return pole, pred, trust_of(pole, pred)


@pytest.mark.parametrize("fault", [half_the_lines, leaning, nothing_near])
def test_a_fault_raises_no_measure(
    fault: Callable[[FloatArray, int], FloatArray],
    clean: tuple[Path, Path, list[Trust]],
    tmp_path: Path,
) -> None:
    source, pred, before = clean
    pole = tmp_path / "data/pole"
    shutil.copytree(source.parent, pole.parent)
    assert before[0].faulty_frames == 0
    for frame in kitti.frames(pole)[-20:]:
        file = kitti.frame_file(pole, "velodyne", frame)
        fault(kitti.read_points(file), frame).astype("<f4").tofile(file)
    after = trust_of(pole, pred)
    assert after[0].faulty_frames == 20
    for one, other in zip(before, after, strict=True):
        assert other.confirmed_share <= one.confirmed_share
        assert other.recall <= one.recall
        for name in ("off_region_share", "flicker_share", "standing_share"):
            assert getattr(other, name) >= getattr(one, name)
    for frame in kitti.frames(pole)[-30:-20]:
        file = kitti.frame_file(pole, "velodyne", frame)
        fault(kitti.read_points(file), frame).astype("<f4").tofile(file)
    with pytest.raises(NoQuality, match="expected a fault in at most 50 % of the frames, got 30"):
        trust_of(pole, pred)


def test_recordings_that_show_too_little_are_refused(
    lidar: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert refusal(range(100), 0.1, (), has_region=True) == ""
    assert "10 s or more, got 9.9 s" in refusal(range(99), 0.1, (), has_region=True)
    assert "80 % or more" in refusal(range(0, 200, 2), 0.1, (), has_region=True)
    assert "outline" in refusal(range(100), 0.1, (), has_region=False)
    pole = recorded(lidar, tmp_path)
    (pole.parent / "roads.csv").unlink()
    words = ["validate", str(pole), "--pred", str(predictions(lidar, good, tmp_path / "pred"))]
    main.main(words)
    output = capsys.readouterr()
    assert "recall" not in output.out
    assert "`pyinfra region` proposes one" in output.err
    assert main.main([*words, "--unlabelled"]) == 2


# --- tracks by hand


def row(per_frame: list[list[tuple[float, float]]]) -> BoxSeries:
    """Returns a series of boxes at the positions of frames 0, 1, ..."""
    frame = np.repeat(np.arange(len(per_frame)), [len(positions) for positions in per_frame])
    xy = np.array(
        [position for positions in per_frame for position in positions], dtype=np.float64
    ).reshape(-1, 2)
    return BoxSeries(frame, cars_at(xy), np.ones(len(frame)))


def test_what_goes_straight_travels_and_leaves_do_not() -> None:
    car = [(1.5 * k, 0.0) for k in range(8)]
    leaf = [(50 + 2.0 * (k % 2), 30 + 1.5 * (k // 2 % 2)) for k in range(8)]
    parked = [(0.1 * (k % 2), -20.0) for k in range(8)]
    seen = row([list(positions) for positions in zip(car, leaf, parked, strict=True)])
    assert travels(seen, 0.1).tolist() == [True, False, False] * 8


def test_a_gap_in_the_frames_ends_a_track() -> None:
    seen = row([[(1.5 * k, 0.0)] for k in range(6)])
    apart = BoxSeries(np.array([0, 1, 2, 10, 11, 12]), seen.boxes, seen.scores)
    assert travels(seen, 0.1).all()
    assert not travels(apart, 0.1).any()


def test_what_moves_in_its_place_does_not_stand() -> None:
    seen = row([[(10.0, 0.0), (20.0, 0.0), (1.5 * k, 9.0)] for k in range(10)])
    confirmed = np.tile([False, True, True], 10)
    assert stands(seen, confirmed, 10).tolist() == [True, False, False] * 10


def test_nothing_detected_has_no_shares() -> None:
    nothing = BoxSeries(np.empty(0, np.int64), np.empty((0, 7)), np.empty(0))
    (low, *_) = trust(range(10), 0.1, nothing, np.empty(0, np.int64), None, nothing)
    assert low.boxes_per_frame == 0
    assert np.isnan([low.confirmed_share, low.recall, low.off_region_share]).all()
