"""`pyinfra import` guesses the format of a folder from its files, and prints it."""

from pathlib import Path

import numpy as np
import pytest
from sample_recording import FRAMES, TILT_DEG, records_of

import pyinfra as pi
from pyinfra.cli import main
from pyinfra.core.errors import Error
from pyinfra.dataset.data_set import read_data_set
from pyinfra.dataset.frames import lidar_folder
from pyinfra.exchange import imports, rcooper
from pyinfra.exchange.guess import guess_format
from pyinfra.exchange.imports import SAMPLE
from pyinfra.exchange.recording import Options
from pyinfra.formats import kitti
from pyinfra.formats.pcd_file import read_pcd

FILES = {
    "kitti": "training/velodyne/000000.bin",
    "openpcdet": "points/000000.npy",
    "pcd": "000000.pcd",
    "nuscenes": "v1.0-mini/sample.json",
    "bin": "000000.bin",
    "dair-v2x": "infrastructure-side/velodyne/000000.pcd",
    "tumtraf": "point_clouds/s110_lidar_ouster_south/1.pcd",
}


def with_files(folder: Path, *names: str) -> Path:
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).touch()
    return folder


@pytest.mark.parametrize("name", FILES)
def test_the_files_of_a_format_are_recognised(name: str, tmp_path: Path) -> None:
    assert guess_format(with_files(tmp_path, FILES[name]))[0] == name


def test_other_spellings_are_recognised(tmp_path: Path) -> None:
    tracking = with_files(tmp_path / "a", "training/velodyne/0000/000000.bin")
    assert guess_format(tracking)[0] == "kitti"
    assert guess_format(with_files(tmp_path / "b", "points/1.pcd"))[0] == "pcd"
    assert guess_format(with_files(tmp_path / "c", "velodyne/1.pcd"))[0] == "dair-v2x"


@pytest.mark.parametrize(
    ("path", "name"),
    [
        ("data/106-105/105/seq-0", "rcooper"),
        ("seq-0", "pcd"),
        ("data/106-105/105/monday", "pcd"),
        ("rec", "pcd"),
    ],
)
def test_clouds_in_a_folder_lidar_are_those_of_rcooper_only_in_its_layout(
    path: str, name: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    source = with_files(tmp_path / path, "lidar/1.pcd")
    # A path of any length: the folder of the test is the top of the file system.
    monkeypatch.setattr(rcooper, "resolved", lambda p: Path("/") / p.relative_to(tmp_path))
    assert guess_format(source)[0] == name
    if len(Path(path).parts) < 4:
        with pytest.raises(Error, match="expected a folder data/SCENE/POLE/seq-N, got /"):
            rcooper.read(source, Options())


@pytest.mark.parametrize(
    ("names", "words"),
    [
        (["1.pcd", "1.bin"], ["pcd (*.pcd)", "bin (*.bin)"]),
        (["points/1.pcd", "points/1.npy"], ["openpcdet", "pcd"]),
        (["notes.txt"], ["expected the files of one of the formats kitti", "got notes.txt"]),
        (["monday/1.pcd", "tuesday/1.pcd"], ["a folder of", "monday", "tuesday"]),
    ],
)
def test_an_ambiguous_or_unknown_folder_lists_candidates_and_exits_with_2(
    names: list[str], words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = with_files(tmp_path / "source", *names)
    with pytest.raises(Error):
        guess_format(source)
    assert main.main(["import", str(source), "--out", str(tmp_path / "data/pole")]) == 2
    message = capsys.readouterr().err
    assert all(word in message for word in words), message
    assert not (tmp_path / "data").exists()


def test_import_says_what_it_guessed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source = tmp_path / "source"
    source.mkdir()
    points = np.random.default_rng(1).uniform(-20, 20, (500, 4)).astype(np.float32)
    for k in range(2):
        (points + np.float32(k)).tofile(source / f"{k}.bin")
    words = ["import", str(source), "--out", str(tmp_path / "data/pole"), "--upright", "as-is"]
    assert main.main([*words, "--height-m", "6"]) == 0
    assert "guessed: format bin, because of *.bin" in capsys.readouterr().out


def test_the_sample_recording_is_imported_by_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """It is of a tilted sensor 6 m above the road. A folder of this name comes first."""
    monkeypatch.chdir(tmp_path)
    assert sum(file.stat().st_size for file in SAMPLE.iterdir()) <= 1e6
    assert main.main(["import", "sample", "--out", "rec/pole"]) == 0
    folder = Path("rec/pole")
    lidar = kitti.read_lidar(folder)
    assert lidar.T_world_levelled.z == pytest.approx(6, abs=0.03)
    assert lidar.period_s == 0.5
    assert len(kitti.frames(folder)) == 20
    tilt = kitti.read_tilt(folder)
    assert np.degrees([tilt.pitch, tilt.roll]) == pytest.approx(TILT_DEG, abs=0.1)
    Path("sample").mkdir()
    capsys.readouterr()
    assert main.main(["import", "sample", "--out", "other"]) == 2
    assert "sample: expected the files of" in capsys.readouterr().err


@pytest.mark.parametrize("out", ["rec", "../rec", "rec/lidar", "notes/rec/lidar"])
def test_an_import_writes_only_to_its_folder(
    out: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    work = tmp_path / "work"
    with_files(work, "notes/a.txt")
    monkeypatch.chdir(work)
    before = sorted(tmp_path.rglob("*"))
    assert main.main(["import", "sample", "--out", out]) == 0
    folder = (work / out.removesuffix("/lidar")).resolve()
    others = [path for path in tmp_path.rglob("*") if not path.is_relative_to(folder)]
    assert sorted(others) == before
    assert read_data_set(folder).frames == tuple(range(20))
    assert read_data_set(folder).scene == folder.name
    assert lidar_folder(folder) == folder / "lidar"


def test_an_import_keeps_out_of_a_folder_with_other_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with_files(tmp_path, "notes/a.txt")
    monkeypatch.chdir(tmp_path)
    before = sorted(tmp_path.rglob("*"))
    assert main.main(["import", "sample", "--out", "notes/rec"]) == 2
    assert "use for example " in capsys.readouterr().err
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize("leftover", [".rec.host.1.0.tmp", ".lid.host.1.0.tmp", ".other"])
def test_the_layout_of_an_import_follows_from_its_argument(
    leftover: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Files of a killed import, or of another one that runs, do not change it."""
    with_files(tmp_path / "work", f"data/{leftover}/lidar.yaml")
    monkeypatch.chdir(tmp_path / "work")
    assert imports.output_folder(Path("data/lid")) == Path("data/lid")
    assert main.main(["import", "sample", "--out", "data/lid"]) == 0
    assert main.main(["import", "sample", "--out", "data/other"]) == 2  # has other object ids
    found = sorted(file.parent.name for file in Path("data").rglob("lidar.yaml"))
    assert [name for name in found if name != leftover] == ["lid"]
    assert Path("data/dataset.yaml").is_file()


def test_the_sample_recording_is_what_its_command_writes() -> None:
    """But for the rounding of another processor."""
    (frame,) = pi.simulate("highway", "helios_16", FRAMES[:1])
    simulated, written = records_of(frame.points), read_pcd(min(SAMPLE.iterdir()))
    assert len(written) == pytest.approx(len(simulated), rel=0.01)
    for name in written.dtype.names or ():
        assert written[name].mean() == pytest.approx(simulated[name].mean(), rel=0.01, abs=0.1)
