"""`pyinfra export` writes all files or none, and reports an error in one line."""

import re
import resource
import subprocess
import sys
from pathlib import Path

import pytest
from exchange_data import write_recording

from pyinfra.cli import main
from pyinfra.exchange import formats
from pyinfra.formats import kitti


@pytest.fixture
def pole(tmp_path: Path) -> Path:
    return write_recording(tmp_path / "made_up")


def words(pole: Path, out: Path, name: str = "pcd") -> list[str]:
    return ["export", str(pole), "--to", name, "--out", str(out)]


@pytest.mark.parametrize("name", formats.EXPORTS)
def test_every_format_is_written_whole(
    name: str, pole: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main.main(words(pole, tmp_path / "out", name)) == 0
    out, err = capsys.readouterr()
    assert out.startswith(f"{tmp_path / 'out'}: 3 frames, ")
    assert out.endswith(" MB/s\n")
    assert ("not split" in err) == (name in ("openpcdet", "mmdet3d", "nuscenes"))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["made_up", "out"]


@pytest.mark.parametrize(
    ("name", "how"),
    [
        ("openpcdet", "train has the first 2 frames, val the last 1"),
        ("mmdet3d", "train has the first 2 frames, val the last 1"),
        ("nuscenes", "the split infrasim_all has all 3 frames"),
    ],
)
def test_an_export_of_unsplit_frames_says_how_it_splits(
    name: str, how: str, pole: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main.main(words(pole, tmp_path / "out", name)) == 0
    assert how in capsys.readouterr().err
    (pole / "ImageSets").mkdir()
    (pole / "ImageSets/train.txt").write_text("000005\n")
    (pole / "ImageSets/val.txt").write_text("000007\n")
    assert main.main(words(pole, tmp_path / "split", name)) == 0
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("name", ["openpcdet", "mmdet3d"])
def test_half_a_split_is_refused(
    name: str, pole: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (pole / "ImageSets").mkdir()
    (pole / "ImageSets/train.txt").write_text("000000\n")
    assert main.main(words(pole, tmp_path / "out", name)) == 2
    assert "expected train.txt and val.txt, got no val.txt" in capsys.readouterr().err


def test_frames_and_splits_are_chosen(pole: Path, tmp_path: Path) -> None:
    def written(out: str, *more: str) -> list[str]:
        assert main.main([*words(pole, tmp_path / out), *more]) == 0
        return sorted(path.stem for path in (tmp_path / out / "points").iterdir())

    assert written("a", "--frames", "5:7") == ["000005", "000006"]
    assert written("b", "--frames", "5:9:2") == ["000005", "000007"]
    (pole / "ImageSets").mkdir()
    (pole / "ImageSets/val.txt").write_text("000007\n")
    assert written("c", "--split", "val") == ["000007"]
    assert written("d") == ["000005", "000006", "000007"]


@pytest.mark.parametrize(
    ("more", "code", "part"),
    [
        (
            ["--frames", "0:3"],
            2,
            "--frames: expected a range that contains frames of .*, got '0:3'",
        ),
        (["--frames", "5"], 2, r"--frames: expected A:B\[:STEP\], got '5'"),
        (["--frames", "0:9:0"], 2, r"expected A:B\[:STEP\] with STEP above 0, got '0:9:0'"),
        (["--frames", "0:9:00"], 2, r"expected A:B\[:STEP\] with STEP above 0, got '0:9:00'"),
        (["--split", "train"], 1, "ImageSets/train.txt: No such file"),
    ],
)
def test_wrong_frames(
    more: list[str],
    code: int,
    part: str,
    pole: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main.main([*words(pole, tmp_path / "out"), *more]) == code
    err = capsys.readouterr().err
    assert re.search(part, err)
    assert err.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_an_unknown_format_lists_those_there_are(
    pole: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as end:
        main.main(words(pole, tmp_path / "out", "las"))
    assert end.value.code == 2
    err = capsys.readouterr().err
    assert "got 'las'" in err
    assert all(name in err for name in formats.EXPORTS)


@pytest.mark.parametrize("name", ["openpcdet", "mmdet3d", "pcd"])
@pytest.mark.parametrize("part", ["velodyne", "label_2"])
def test_a_missing_or_cut_file_leaves_nothing(
    name: str, part: kitti.Part, pole: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = kitti.frame_file(pole, part, 6)
    file.write_bytes(b"12345")
    assert main.main(words(pole, tmp_path / "out", name)) == 2
    assert str(file) in capsys.readouterr().err
    if part == "label_2":
        file.unlink()
        assert main.main(words(pole, tmp_path / "out", name)) == 1
        assert f"{file}: No such file" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["made_up"]


def test_a_folder_that_is_there_stays_unless_empty(
    pole: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    out.mkdir()
    assert main.main(words(pole, out)) == 0
    capsys.readouterr()
    assert main.main(words(pole, out)) == 1
    assert "out: expected a new or empty folder, got a folder with files" in capsys.readouterr().err
    (tmp_path / "file").touch()
    assert main.main(words(pole, tmp_path / "file")) == 1


def test_a_missing_package_is_one_line_that_names_the_extra(
    pole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.delitem(sys.modules, "pyinfra.exchange.mcap", raising=False)
    monkeypatch.setitem(sys.modules, "mcap_ros2", None)
    monkeypatch.setitem(sys.modules, "mcap_ros2.writer", None)
    assert main.main(words(pole, tmp_path / "out", "mcap")) == 2
    assert "pip install 'infrasim[exchange]'" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("name", ["mmdet3d", "mcap", "nuscenes", "openpcdet", "pcd"])
def test_a_full_disk_leaves_nothing(name: str, pole: Path, tmp_path: Path) -> None:
    """A file that is larger than the limit fails as on a full disk."""
    limit = 100  # bytes; a cloud is larger
    result = subprocess.run(
        [sys.executable, "-m", "pyinfra", *words(pole, tmp_path / "out", name)],
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit)),
        capture_output=True,
        text=True,
        cwd=Path(__file__).resolve().parents[2],
    )
    assert result.returncode == 1
    assert result.stdout == ""
    assert len(result.stderr.splitlines()) == 1
    assert "Traceback" not in result.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["made_up"]
