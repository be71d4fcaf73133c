"""`pyinfra split` selects the frames for training and for tests."""

import argparse
from dataclasses import replace
from pathlib import Path

import pytest

from pyinfra.cli import split as command
from pyinfra.dataset import split
from pyinfra.dataset.data_set import DataSet, Tilt
from pyinfra.formats import kitti


def data_set(folder: Path, seed: int = 1, frames: range = range(0, 5000, 5)) -> DataSet:
    pose = kitti.WorldPose(0, 0, 6, 0)
    lidars = tuple(kitti.Lidar(name, name, "paper", (1, 1), 0.1, pose, ()) for name in ("a", "b"))
    for lidar in lidars:
        (folder / lidar.name).mkdir(parents=True)
    tilts = (Tilt(0, 0), Tilt(0, 0))
    return DataSet(folder, "highway", "paper", "exact", seed, "0.1.0", lidars, tilts, tuple(frames))


def test_by_time_leaves_ten_seconds_between_train_and_val() -> None:
    parts = split.by_time(range(5000), 0.1)
    assert (parts.train[0], parts.train[-1], len(parts.train)) == (0, 3999, 4000)
    assert (parts.val[0], parts.val[-1], len(parts.val)) == (4100, 4999, 900)


@pytest.mark.parametrize(("step", "train", "val"), [(20, 200, 45), (5, 800, 180)])
def test_by_time_gives_the_tiers(step: int, train: int, val: int) -> None:
    parts = split.by_time(range(0, 5000, step), 0.1)
    assert (len(parts.train), len(parts.val)) == (train, val)


def test_by_time_of_a_short_run_is_an_error_that_names_its_span() -> None:
    with pytest.raises(ValueError, match=r"got frames from 0 to 9\.9 s"):
        split.by_time(range(100), 0.1)
    with pytest.raises(ValueError, match=r"val_from_s: expected train_until_s \(400\) or more"):
        split.by_time(range(5000), 0.1, 400, 390)


def test_by_random_is_seeded_and_takes_a_fifth() -> None:
    parts = split.by_random(range(0, 1000, 10), seed=3)
    assert (len(parts.train), len(parts.val)) == (80, 20)
    assert sorted(parts.train + parts.val) == list(range(0, 1000, 10))
    assert list(parts.val) == sorted(parts.val)
    assert parts == split.by_random(range(0, 1000, 10), seed=3)
    assert parts != split.by_random(range(0, 1000, 10), seed=4)
    with pytest.raises(ValueError, match="got 1 frames"):
        split.by_random([0], seed=1)


def test_by_seed_takes_all_of_both_and_refuses_the_same_seed(tmp_path: Path) -> None:
    train = data_set(tmp_path / "one")
    val = data_set(tmp_path / "two", seed=2, frames=range(10))
    first, second = split.by_seed(train, val)
    assert first == split.Split(train.frames, ())
    assert second == split.Split((), tuple(range(10)))
    with pytest.raises(ValueError, match="got seed 1 in both"):
        split.by_seed(train, train)
    with pytest.raises(ValueError, match=r"preset: expected paper as in .*, got equal"):
        split.by_seed(train, replace(val, preset="equal"))
    lidars = tuple(replace(lidar, label_time="scan") for lidar in val.lidars)
    with pytest.raises(ValueError, match=r"label_time: expected frame as in .*, got scan"):
        split.by_seed(train, replace(val, lidars=lidars))


def test_write_makes_both_lists_for_every_lidar(tmp_path: Path) -> None:
    data = data_set(tmp_path / "data")
    files = split.write(data, split.Split((0, 5), (12,)))
    assert len(files) == 4
    for lidar in ("a", "b"):
        folder = tmp_path / "data" / lidar / "ImageSets"
        assert (folder / "train.txt").read_text() == "000000\n000005\n"
        assert (folder / "val.txt").read_text() == "000012\n"
        assert sorted(p.name for p in folder.iterdir()) == ["train.txt", "val.txt"]


def test_write_replaces_another_split_only_when_forced(tmp_path: Path) -> None:
    data = data_set(tmp_path / "data")
    split.write(data, split.Split((0,), (1,)))
    split.write(data, split.Split((0,), (1,)))
    with pytest.raises(FileExistsError, match="got a different split"):
        split.write(data, split.Split((0,), (2,)))
    val = tmp_path / "data/a/ImageSets/val.txt"
    assert val.read_text() == "000001\n"
    split.write(data, split.Split((0,), (2,)), force=True)
    assert val.read_text() == "000002\n"


def test_val_data_goes_with_seed_alone(tmp_path: Path) -> None:
    parser = argparse.ArgumentParser()
    command.add_arguments(parser)
    for words in (["--by", "seed"], ["--val-data", str(tmp_path)]):
        with pytest.raises(ValueError, match=r"val_data: expected (a|no) data set if .* got "):
            command.run(parser.parse_args([str(tmp_path), *words]))


def test_a_short_recording_is_split_at_borders_of_its_own(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    data = data_set(tmp_path / "data", frames=range(100))
    monkeypatch.setattr("pyinfra.dataset.data_set.read_data_set", lambda folder: data)
    parser = argparse.ArgumentParser()
    command.add_arguments(parser)
    words = [str(tmp_path / "data"), "--train-until-s", "5", "--val-from-s", "7"]
    assert command.run(parser.parse_args(words)) == 0
    lists = tmp_path / "data/a/ImageSets"
    assert lists.joinpath("train.txt").read_text().split()[-1] == "000049"
    assert lists.joinpath("val.txt").read_text().split()[0] == "000070"


def test_a_split_that_grew_takes_the_place_of_its_part_and_of_no_other(tmp_path: Path) -> None:
    data = data_set(tmp_path)
    split.write(data, split.by_time(range(0, 5000, 100), 0.1))
    whole = split.by_time(data.frames, 0.1)
    files = split.write(data, whole, grown=True)
    assert len(files[0].read_text().splitlines()) == len(whole.train)
    before = [file.read_text() for file in files]
    with pytest.raises(FileExistsError, match="got a different split"):
        split.write(data, split.by_random(data.frames, seed=1), grown=True)
    assert [file.read_text() for file in files] == before
