"""Data sets with missing or wrong parts give an error or a named warning, but never another result
without notice."""

import re
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from evaluation_data import (
    car,
    fill_clouds,
    perfect,
    traffic,
    write_lidar,
    write_predictions,
    write_roads,
)
from exchange_data import write_recording
from message_pattern import pattern

from pyinfra.cli import main
from pyinfra.core.errors import FormatError
from pyinfra.dataset.data_set import read_data_set, read_lidars
from pyinfra.dataset.frame_readers import read_vehicles
from pyinfra.dataset.frames import frame_numbers, lidar_folders
from pyinfra.exchange.data_set import LidarFacts
from pyinfra.exchange.imports import import_recording
from pyinfra.exchange.recording import Options
from pyinfra.formats import kitti
from pyinfra.metrics.evaluate import evaluate
from pyinfra.metrics.frame_checks import validate
from pyinfra.metrics.ground_truth import read_ground_truth
from pyinfra.metrics.settings import Settings
from pyinfra.models.training.sources import read_source

DATASET = "name: a\nseed: 1\naggregation: exact\npreset: paper\nversion: 0.1.0\n"


@pytest.fixture
def data_set(tmp_path: Path) -> Path:
    """Writes an artificial data set of one LiDAR, with predictions beside it."""
    # the last vehicle is beyond the region
    frames = [[*vehicles, car(150)] for vehicles in traffic(12)]
    folder = tmp_path / "data"
    write_lidar(folder / "near", frames)
    fill_clouds(folder / "near", frames)
    write_roads(folder)
    (folder / "dataset.yaml").write_text(DATASET)
    replace(folder / "near/lidar.yaml", 'preset: "recorded"', 'preset: "paper"')
    write_predictions(tmp_path / "pred", perfect([vehicles[:-1] for vehicles in frames]))
    return folder


def replace(file: Path, old: str, new: str, count: int = -1) -> None:
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new, count))


def names_of(folder: Path, pred: Path) -> tuple[float, set[str]]:
    """Returns AP and the names of the findings except notes. Evaluate and validate must have the
    same findings."""
    result = evaluate(folder, pred, Settings(ground_truths=("captured",)))
    names = {f.name for f in result.findings if f.level != "note"}
    checked = {f.name for f in validate(folder, pred) if f.level != "note"}
    assert checked - {"labels-off-points"} == names - {"few-blocks"}
    return float(result.ap.ap.iloc[0]), names - {"few-blocks"}


# --- the region


def test_a_lidar_copied_without_its_roads_is_named(data_set: Path, tmp_path: Path) -> None:
    pred = tmp_path / "pred"
    assert names_of(data_set / "near", pred) == (100, set())
    copy = Path(shutil.copytree(data_set / "near", tmp_path / "copy/near"))
    ap, names = names_of(copy, pred)
    assert ap < 95
    assert names == {"no-roads"}
    (warning,) = [f for f in evaluate(copy, pred).findings if f.name == "no-roads"]
    assert warning.text.startswith(f"{copy / 'lidar.yaml'}:3: preset: expected ")
    assert "/copy/roads.csv for simulated frames, got none" in warning.text


def test_a_lidar_without_its_description_is_named(data_set: Path, tmp_path: Path) -> None:
    shutil.copytree(data_set / "near", data_set / "far")
    replace(data_set / "far/lidar.yaml", 'name: "near"', 'name: "far"')
    (data_set / "near/lidar.yaml").unlink()
    assert names_of(data_set / "near", tmp_path / "pred")[1] == {"no-roads"}
    for read in (read_data_set, lambda data: read_ground_truth(data / "far")):
        with pytest.raises(FormatError, match=r"near/lidar\.yaml: expected .*, got none"):
            read(data_set)


def test_a_recording_has_no_roads(tmp_path: Path) -> None:
    gt = write_lidar(tmp_path / "data/pole", traffic(12))
    assert names_of(gt, write_predictions(tmp_path / "pred", perfect(traffic(12)))) == (100, set())


def test_a_folder_named_by_a_dot_has_its_roads(
    data_set: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(data_set / "near")
    truth = read_ground_truth(Path())
    assert len(truth.roads) == len(truth.neighbours) == 1


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("main,-100,", "main,", ":2: expected 7 columns ..., got 6"),
        ("main,-100,", "main,-99,", "road main: s: expected ascending values"),
        (
            ",10.0\nmain,-99",
            ",0\nmain,-99",
            ":2: half_width: expected more than 0, at most 1000, got 0",
        ),
        (",10.0\nmain,-99", ",nan\nmain,-99", ":2: half_width: expected a finite number, got nan"),
    ],
)
def test_wrong_roads_are_errors(data_set: Path, old: str, new: str, message: str) -> None:
    replace(data_set / "roads.csv", old, new, 1)
    with pytest.raises(FormatError, match=pattern(message)):
        read_ground_truth(data_set / "near")
    (error,) = [f for f in validate(data_set / "near") if f.level == "error"]
    assert re.search(pattern(message), error.text)


@pytest.mark.parametrize("keep", [1, 40, 5000])
def test_roads_cut_short_are_an_error(data_set: Path, keep: int) -> None:
    file = data_set / "roads.csv"
    text = file.read_text()
    file.write_text(text.splitlines(keepends=True)[0] if keep == 1 else text[:keep])
    with pytest.raises(FormatError, match=r"roads\.csv:"):
        read_ground_truth(data_set / "near")


# --- names of classes


@pytest.mark.parametrize("objects", [True, False])
def test_names_that_count_nowhere_are_named(tmp_path: Path, objects: bool) -> None:
    gt = write_lidar(tmp_path / "data/pole", traffic(12), objects=objects)
    pred = write_predictions(tmp_path / "pred", perfect(traffic(12)))
    for k in kitti.frames(gt)[3:]:
        part: kitti.Part = "objects" if objects else "label_2"
        replace(kitti.frame_file(gt, part, k), "Car", "car")
    replace(kitti.frame_file(gt, part, 0), "Car", "Pedestrian", 1)
    ap, names = names_of(gt, pred)
    assert ap < 60
    assert names == {"other-types"}
    (text,) = [f.text for f in evaluate(gt, pred).findings if f.name == "other-types"]
    line = 2 if objects else 1
    file = kitti.frame_file(gt, part, 3)
    assert text.startswith(
        f"{file}:{line}: objects of unknown classes are ignored: car (72); expected Car, Van, "
    )
    assert names_of(gt, pred)[1] == {"other-types"}
    custom = evaluate(gt, pred, Settings({"vehicle": ("Car", "car")}, ("captured",)))
    assert custom.ap.ap.iloc[0] > 95


def test_labels_are_looked_at_beside_objects(tmp_path: Path) -> None:
    gt = write_lidar(tmp_path / "data/pole", traffic(12))
    replace(kitti.frame_file(gt, "label_2", 4), "Car", "car")
    (text,) = [f.text for f in validate(gt) if f.name == "other-types"]
    assert text.startswith(
        f"{kitti.frame_file(gt, 'label_2', 4)}:1: objects of unknown classes are ignored: car (8)"
    )


def test_training_says_which_names_are_no_vehicle(tmp_path: Path) -> None:
    gt = write_lidar(tmp_path / "data/pole", traffic(12))
    (gt / "ImageSets").mkdir()
    (gt / "ImageSets/train.txt").write_text("000003\n000004\n")
    assert read_source(gt, "smoke").read_warning() is None
    replace(kitti.frame_file(gt, "objects", 4), "Car", "car")
    warning = read_source(gt, "smoke").read_warning()
    assert warning is not None
    assert "000004.csv:2: objects of unknown classes are ignored: car (8)" in warning


# --- which folders are LiDARs


def test_a_hidden_folder_is_no_lidar(data_set: Path) -> None:
    shutil.copytree(data_set / "near", data_set / ".far.4711")
    assert lidar_folders(data_set) == [data_set / "near"]
    assert read_data_set(data_set).names == ("near",)
    assert len(read_ground_truth(data_set / "near").neighbours) == 1
    assert main.main(["validate", str(data_set)]) == 0


def test_a_killed_import_leaves_nothing_that_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source = write_recording(tmp_path / "made_up")

    rename = Path.replace

    def killed(path: Path, target: Path) -> Path:
        if path.is_dir():
            raise SystemExit(137)
        return rename(path, target)

    with monkeypatch.context() as patch:
        patch.setattr("pathlib.Path.replace", killed)
        patch.setattr("shutil.rmtree", lambda *_, **__: None)
        with pytest.raises(SystemExit):
            import_recording(
                source, "kitti", tmp_path / "in/pole", LidarFacts("pole", "a"), Options()
            )
    left = tmp_path / "in" / next(p.name for p in (tmp_path / "in").iterdir() if p.is_dir())
    assert (left / "lidar.yaml").is_file()
    left.rename(left.with_name(".pole.of-another-process"))
    import_recording(source, "kitti", tmp_path / "in/pole", LidarFacts("pole", "a"), Options())
    assert read_data_set(tmp_path / "in").names == ("pole",)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('preset: "paper"', 'preset: "equal"', "3: preset: expected paper, as in ..., got equal"),
        ("period_s: 0.1", "period_s: 0.2", "5: period_s: expected 0.1, as in ..., got 0.2"),
        (
            "label_time: frame",
            "label_time: scan",
            "8: label_time: expected frame, as in ..., got scan",
        ),
        (
            'name: "near"',
            'name: "other"',
            "1: name: expected near, the name of the folder, got other",
        ),
    ],
)
def test_lidars_of_one_data_set_are_of_one_run(
    data_set: Path, old: str, new: str, message: str
) -> None:
    shutil.copytree(data_set / "near", data_set / "far")
    replace(data_set / "far/lidar.yaml", 'name: "near"', 'name: "far"')
    assert [lidar.name for lidar, _ in read_lidars(data_set)] == ["far", "near"]
    replace(data_set / "near/lidar.yaml", old, new)
    for read in (read_lidars, read_data_set, lambda _: read_ground_truth(data_set / "far")):
        with pytest.raises(FormatError, match=pattern(f"near/lidar.yaml:{message}")):
            read(data_set)
    assert any(
        re.search(pattern(message), f.text)
        for f in validate(data_set / "far")
        if f.level == "error"
    )
    assert main.main(["validate", str(data_set)]) == 1


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("seed: 1", "seed: one", "2: seed: expected a whole number from 0 ..., got 'one'"),
        ("seed: 1", "seed: -1", "2: seed: expected a whole number from 0 ..., got '-1'"),
        (
            "preset: paper",
            "preset: equal",
            "4: preset: expected 'paper' as in the LiDARs, got 'equal'",
        ),
        ("seed: 1", "seed: 1\nseed: 2", "3: seed: expected the key once, got it twice"),
        (
            "seed: 1",
            "seed: 1\nlabel_time: scan",
            "3: label_time: expected 'frame' as in the LiDARs, got 'scan'",
        ),
        ("name: a", "name: a\0", " cannot be read as YAML"),
    ],
)
def test_wrong_descriptions_are_errors(data_set: Path, old: str, new: str, message: str) -> None:
    replace(data_set / "dataset.yaml", old, new)
    with pytest.raises(FormatError, match=pattern(f"dataset.yaml:{message}")):
        read_data_set(data_set)


# --- tables and lists


def column(name: str, value: str) -> Callable[[list[str]], list[str]]:
    def edit(lines: list[str]) -> list[str]:
        cells = lines[2].split(",")
        cells[kitti.OBJECT_COLUMNS.index(name)] = value
        return [*lines[:2], ",".join(cells), *lines[3:]]

    return edit


@pytest.mark.parametrize(
    "edit",
    [
        lambda lines: [*lines, lines[1]],
        column("id", "0"),
        column("id", "1.5"),
        column("id", "1e30"),
        column("visibility", "100"),
        column("visibility", "-0.5"),
        column("points", "0.9"),
        column("points", "1e30"),
        column("points_in_box", "21"),
        column("heading", "90"),
        column("x", "1e30"),
        column("dx", "1e30"),
        column("speed", "-1"),
        column("distance", "1e30"),
        column("class", ""),
    ],
)
def test_many_objects_are_read_as_one_file(
    edit: Callable[[list[str]], list[str]], tmp_path: Path
) -> None:
    folder = write_lidar(tmp_path / "data/pole", traffic(12))
    assert len(read_vehicles(folder, range(12))) == 96
    file = kitti.frame_file(folder, "objects", 7)
    file.write_text("\n".join(edit(file.read_text().splitlines())) + "\n")
    with pytest.raises(FormatError) as alone:
        kitti.read_objects(file)
    with pytest.raises(FormatError) as together:
        read_vehicles(folder, range(12))
    assert str(together.value) == str(alone.value)
    assert str(alone.value).startswith(f"{file}:")


def test_objects_cut_within_their_last_number_are_an_error(tmp_path: Path) -> None:
    folder = write_lidar(tmp_path / "data/pole", traffic(12))
    file = kitti.frame_file(folder, "objects", 7)
    file.write_text(file.read_text()[:-2])
    with pytest.raises(
        FormatError,
        match=r"000007\.csv:9: expected a newline at the end of the last line, got none",
    ):
        read_vehicles(folder, range(12))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (b"000001\n000001\n", ":2: expected ..., got 000001 twice"),
        (b"000001\n" + b"9" * 5000, ":2: expected ..., got '999"),
        (b"000001\n\xff", ": expected UTF-8, got an invalid byte at offset 7"),
        ("000001\n²\n".encode(), ":2: expected ..., got '²'"),
    ],
)
def test_wrong_lists_of_frames_are_errors(text: bytes, message: str, tmp_path: Path) -> None:
    folder = write_lidar(tmp_path / "data/pole", traffic(12))
    (folder / "ImageSets").mkdir()
    (folder / "ImageSets/val.txt").write_bytes(text)
    with pytest.raises(FormatError, match=pattern(f"val.txt{message}")):
        frame_numbers(folder)


def test_a_point_beyond_any_range_is_an_error(tmp_path: Path) -> None:
    file = tmp_path / "000000.bin"
    np.array([[1, 2, 3, 0.5], [3e38, 0, 0, 0.5]], dtype="<f4").tofile(file)
    with pytest.raises(FormatError, match=r"000000\.bin: point 1: expected .*got \["):
        kitti.read_points(file)
