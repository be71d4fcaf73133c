"""Checks of frames and predictions name the error."""

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from evaluation_data import (
    box,
    car,
    fill_clouds,
    noisy,
    perfect,
    traffic,
    write_lidar,
    write_predictions,
)

from pyinfra.cli import main
from pyinfra.formats import kitti
from pyinfra.metrics.evaluate import evaluate
from pyinfra.metrics.frame_checks import validate
from pyinfra.metrics.settings import Settings

FramePredictions = list[list[tuple[list[float], float]]]


@pytest.fixture
def lidar(tmp_path: Path) -> Path:
    """Writes a curve with traffic, so that headings differ and nothing is symmetric."""
    frames = []
    for vehicles in traffic(12):
        for v in vehicles:
            v["heading"] = 0.3 + float(v["x"]) / 200  # type: ignore[arg-type]
        frames.append(vehicles)
    folder = write_lidar(tmp_path / "lidar", frames)
    write_predictions(tmp_path / "pred", perfect(frames))
    for k, vehicles in enumerate(frames):  # a point in the middle of each vehicle
        points = np.array([[*box(v)[:3], 0.5] for v in vehicles], dtype="<f4")
        points.tofile(kitti.frame_file(folder, "velodyne", k))
    return folder


@pytest.fixture
def names_for(lidar: Path, tmp_path: Path) -> Callable[..., set[str]]:
    """Returns a function that changes the vehicles' own boxes, and returns the names of the
    warnings."""

    def names(change: Callable[[list[float]], list[float]], name: str = "Car") -> set[str]:
        predictions: FramePredictions = []
        for k in kitti.frames(lidar):
            boxes = kitti.read_objects(kitti.frame_file(lidar, "objects", k)).boxes
            predictions.append([(change(b.tolist()), 0.9) for b in boxes])
        pred = write_predictions(tmp_path / "changed", predictions, name)
        return {f.name for f in validate(lidar, pred) if f.level == "warning"}

    return names


def edited(index: int, change: Callable[[float], float]) -> Callable[[list[float]], list[float]]:
    def edit(values: list[float]) -> list[float]:
        return [change(v) if i == index else v for i, v in enumerate(values)]

    return edit


def test_good_frames_and_predictions_have_no_warning(lidar: Path, tmp_path: Path) -> None:
    findings = validate(lidar, tmp_path / "pred")
    assert {finding.level for finding in findings} == {"note"}
    assert {finding.name for finding in findings} == {"origin", "z-range", "xy-range"}


def test_noisy_predictions_have_no_warning(tmp_path: Path) -> None:
    frames = traffic(40)
    gt = write_lidar(tmp_path / "lidar", frames)
    pred = write_predictions(tmp_path / "pred", noisy(frames, spread=1.0, ghosts=6))
    warnings = [f for f in validate(gt, pred) if f.level == "warning"]
    assert [f.name for f in warnings] == ["labels-off-points"]  # the clouds are empty


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (lambda b: [b[0], -b[1], *b[2:6], -b[6]], "mirrored-left-right"),
        (lambda b: [-b[0], b[1], *b[2:]], "mirrored-front-back"),
        (lambda b: [b[1], b[0], *b[2:]], "axes-swapped"),
        (lambda b: [-b[1], b[0], *b[2:6], b[6] + math.pi / 2], "turned-quarter-left"),
        (lambda b: [b[0] + 7, b[1] - 5, *b[2:]], "displaced"),
        (lambda b: [b[0], b[1] + 300, *b[2:]], "far-from-vehicles"),
        (edited(2, lambda z: z + 6), "height-offset"),
        (edited(2, lambda z: z - 0.75), "height-offset"),
        (edited(6, lambda h: h + math.pi / 2), "heading-quarter"),
        (edited(6, lambda h: -h), "heading-sign"),
        (edited(6, math.degrees), "heading-degrees"),
        (lambda b: [*b[:3], b[4], b[3], *b[5:]], "length-width"),
    ],
)
def test_usual_mistakes_are_named(
    names_for: Callable[..., set[str]], change: Callable[[list[float]], list[float]], expected: str
) -> None:
    assert expected in names_for(change)


def test_a_bottom_centre_is_not_taken_for_another_height(lidar: Path, tmp_path: Path) -> None:
    boxes = [kitti.read_objects(kitti.frame_file(lidar, "objects", k)).boxes for k in range(12)]
    predictions = [
        [(edited(2, lambda z: z - 0.75)(b.tolist()), 0.9) for b in frame] for frame in boxes
    ]
    (warning,) = [
        f
        for f in validate(lidar, write_predictions(tmp_path / "low", predictions))
        if f.name == "height-offset"
    ]
    assert "z may be the bottom" in warning.text


def test_degrees_are_named_with_file_and_line(lidar: Path, tmp_path: Path) -> None:
    file = tmp_path / "pred/000003.txt"
    lines = file.read_text().splitlines()
    words = lines[2].split()
    lines[2] = " ".join([*words[:14], "-90", words[15]])
    file.write_text("\n".join(lines) + "\n")
    (warning,) = [f for f in validate(lidar, tmp_path / "pred") if f.level == "warning"]
    assert warning.name == "heading-degrees"
    assert warning.text.startswith(f"{file}:3: ")


def test_scores_and_names_that_do_not_fit(lidar: Path, tmp_path: Path) -> None:
    boxes = [[(box(car(20)), 35.0), (box(car(40)), 0.9)]] * 12
    pred = write_predictions(tmp_path / "scores", boxes)
    assert "score-range" in {f.name for f in validate(lidar, pred)}
    low = write_predictions(tmp_path / "low", [[(box(car(20)), 0.05)]] * 12)
    assert "scores-low" not in {f.name for f in validate(lidar, low)}
    noted = evaluate(lidar, low, settings=Settings(min_score=0.1)).findings
    assert "scores-low" in {f.name for f in noted}
    (pred / "000000.txt").write_text(
        (pred / "000000.txt").read_text().replace("vehicle", "bicycle", 1)
    )
    (noted,) = (f for f in validate(lidar, pred) if f.name == "other-classes")
    assert noted.level == "warning"
    (low / "000003.txt").write_text((low / "000003.txt").read_text().replace("vehicle", "Zebra"))
    (low / "000001.txt").write_text((low / "000001.txt").read_text().replace("vehicle", "Cyclist"))
    (noted,) = (f for f in validate(lidar, low) if f.name == "other-classes")
    assert noted.text.startswith(f"{low / '000003.txt'}:1: types that are not evaluated: Zebra (1)")


def test_people_beside_vehicles_are_noted(lidar: Path, tmp_path: Path) -> None:
    pred = write_predictions(tmp_path / "both", [[(box(car(20)), 0.9), (box(car(40)), 0.8)]] * 12)
    first = pred / "000000.txt"
    first.write_text(first.read_text().replace("vehicle", "Pedestrian", 1))
    (finding,) = (f for f in validate(lidar, pred) if f.name == "other-classes")
    text = "types that are not evaluated: Pedestrian (1); `classes` sets the evaluated classes"
    assert str(finding) == f"note: other-classes: {text}"


def test_only_people_among_the_predictions_gives_an_ap_of_0(lidar: Path, tmp_path: Path) -> None:
    pred = write_predictions(tmp_path / "people", [[(box(car(20)), 0.9)]] * 12)
    for file in pred.glob("*.txt"):
        file.write_text(file.read_text().replace("vehicle", "Pedestrian"))
    result = evaluate(lidar, pred)
    assert (result.ap.ap_r1000 == 0).all()
    assert ("warning", "other-classes") in {(f.level, f.name) for f in result.findings}


def test_every_wrong_file_of_the_ground_truth_is_named(lidar: Path) -> None:
    kitti.frame_file(lidar, "label_2", 2).write_text("Car 0 0\n")
    kitti.frame_file(lidar, "objects", 4).write_text("id,class\n")
    kitti.frame_file(lidar, "objects", 5).unlink()
    texts = [str(f) for f in validate(lidar) if f.level == "error"]
    assert len(texts) == 3
    assert "label_2/000002.txt:1: expected 15 columns" in texts[0]
    assert ", got 3" in texts[0]
    assert "objects/000004.csv:1: expected" in texts[1]
    assert ", got 'id,class'" in texts[1]
    assert "objects/000005.csv: missing" in texts[2]


def test_degrees_in_objects_and_labels_are_errors(lidar: Path) -> None:
    objects, label = (kitti.frame_file(lidar, part, 4) for part in ("objects", "label_2"))
    lines = objects.read_text().splitlines()
    cells = lines[2].split(",")
    lines[2] = ",".join([*cells[:8], "90", *cells[9:]])
    objects.write_text("\n".join(lines) + "\n")
    lines = label.read_text().splitlines()
    ignored = "DontCare -1 -1 -10 1 1 9 9 -1 -1 -1 -1000 -1000 -1000 -10"
    lines[1:2] = [ignored, " ".join([*lines[1].split()[:14], "-179.5"])]
    label.write_text("\n".join(lines) + "\n")
    texts = [str(f) for f in validate(lidar) if f.level == "error"]
    expected = "expected -2 pi to 2 pi, in radians"
    assert texts == [
        f"error: wrong-file: {label}:3: rotation_y: {expected}, got -179.5",
        f"error: wrong-file: {objects}:3: heading: {expected}, got 90",
    ]


def test_a_cut_cloud_and_odd_intensities_are_named(lidar: Path) -> None:
    file = kitti.frame_file(lidar, "velodyne", 0)
    file.write_bytes(file.read_bytes()[:-4])
    bright = np.array([[20, 3, -5, 200]], dtype="<f4")
    bright.tofile(kitti.frame_file(lidar, "velodyne", 1))
    assert {"wrong-cloud", "intensity"} <= {f.name for f in validate(lidar)}


def test_labels_away_from_the_points_are_named(lidar: Path) -> None:
    for k in kitti.frames(lidar):
        file = kitti.frame_file(lidar, "velodyne", k)
        points = np.fromfile(file, "<f4").reshape(-1, 4)
        points[:, 2] += 6
        points.tofile(file)
    assert "labels-off-points" in {f.name for f in validate(lidar)}


def test_vehicles_below_the_usual_range_are_named(lidar: Path) -> None:
    (note,) = [f for f in validate(lidar) if f.name == "z-range"]
    assert "The centres of 100 % of the vehicles are below -3 m" in note.text
    assert "z = -6.00 m" in note.text


def test_low_image_boxes_are_named(lidar: Path) -> None:
    for k in kitti.frames(lidar):
        file = kitti.frame_file(lidar, "label_2", k)
        file.write_text(file.read_text().replace("50.00 50.00", "10.00 10.00"))
    assert "image-height" in {f.name for f in validate(lidar)}


def test_frames_without_vehicles_are_valid(tmp_path: Path) -> None:
    gt = write_lidar(tmp_path / "lidar", [[], [car(20)], []])
    assert "empty-frames" in {f.name for f in validate(gt)}
    nothing = write_lidar(tmp_path / "none", [[], []])
    assert "no-labels" in {f.name for f in validate(nothing)}
    (tmp_path / "bare/training/velodyne").mkdir(parents=True)
    assert [f.name for f in validate(tmp_path / "bare")] == ["no-frames"]


def test_command_prints_findings_and_its_exit_code_counts_errors(
    lidar: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main.main(["validate", str(lidar), "--pred", str(tmp_path / "pred")]) == 0
    out = capsys.readouterr().out
    assert "note: z-range: " in out
    assert out.endswith("0 errors, 0 warnings\n")
    (tmp_path / "pred/000001.txt").unlink()
    assert main.main(["validate", str(lidar), "--pred", str(tmp_path / "pred")]) == 1
    assert "error: wrong-predictions: " in capsys.readouterr().out
    assert main.main(["validate", str(tmp_path / "nowhere")]) == 1
    assert f"{tmp_path / 'nowhere'}: No such file" in capsys.readouterr().err


def test_command_checks_every_lidar_of_a_data_set(
    lidar: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_lidar(tmp_path / "other", traffic(2))
    assert main.main(["validate", str(tmp_path)]) == 0
    out = capsys.readouterr().out
    assert f"{lidar}: " in out
    assert f"{tmp_path / 'other'}: " in out
    assert main.main(["validate", str(tmp_path), "--pred", str(tmp_path / "pred")]) == 2
    assert (
        "expected the folder of one LiDAR with predictions, got the LiDARs lidar, other"
        in capsys.readouterr().err
    )


@pytest.fixture
def simulated(tmp_path: Path) -> Path:
    """Writes clouds of a simulated LiDAR that agree with the points of its objects."""
    frames = traffic(12)
    folder = write_lidar(tmp_path / "simulated", frames)
    fill_clouds(folder, frames)
    text = (folder / "lidar.yaml").read_text()
    (folder / "lidar.yaml").write_text(text.replace('"recorded"', '"paper"'))
    return folder


def errors_of(folder: Path) -> list[tuple[str, str]]:
    """Returns the names of errors and of warnings about the size of a cloud, with the file that
    each message names."""
    findings = [f for f in validate(folder) if f.level == "error" or f.name == "small-cloud"]
    return [(f.name, Path(f.text.split(": ")[0]).name) for f in findings]


def test_whole_clouds_have_the_points_of_their_objects(simulated: Path) -> None:
    assert errors_of(simulated) == []


def test_a_cloud_that_was_cut_is_an_error(simulated: Path) -> None:
    file = kitti.frame_file(simulated, "velodyne", 7)
    file.write_bytes(file.read_bytes()[: 16 * 25])
    assert ("cloud-objects", "000007.bin") in errors_of(simulated)
    assert ("small-cloud", "000007.bin") in errors_of(simulated)


def test_two_swapped_clouds_are_errors(simulated: Path) -> None:
    files = [kitti.frame_file(simulated, "velodyne", k) for k in (2, 9)]
    contents = [file.read_bytes() for file in files]
    for file, content in zip(files, reversed(contents), strict=True):
        file.write_bytes(content)
    assert [name for name, _ in errors_of(simulated)] == ["cloud-objects"] * 2


def test_a_point_beyond_the_range_is_an_error(simulated: Path) -> None:
    file = kitti.frame_file(simulated, "velodyne", 3)
    file.write_bytes(file.read_bytes() + np.array([900, 0, 0, 0.5], "<f4").tobytes())
    assert errors_of(simulated) == [("cloud-range", "000003.bin")]


def test_fields_of_another_length_are_an_error(simulated: Path) -> None:
    (simulated / "training/fields").mkdir()
    for k in kitti.frames(simulated):
        count = kitti.frame_file(simulated, "velodyne", k).stat().st_size // 16
        np.zeros(count - (k == 4), kitti.FIELDS).tofile(kitti.frame_file(simulated, "fields", k))
    assert errors_of(simulated) == [("cloud-size", "000004.bin")]
