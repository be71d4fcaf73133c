"""`pyinfra detect --skip-bad` leaves out clouds that cannot be read, and names them."""

from pathlib import Path

import numpy as np
import pytest
from recording_files import road

from pyinfra.cli import main
from pyinfra.formats import kitti
from pyinfra.formats.pcd_file import write_pcd

CUT = 2


def write_clouds(folder: Path, kind: str, count: int = 4) -> list[Path]:
    """Writes clouds; the cloud CUT is cut."""
    folder.mkdir(parents=True)
    files = [folder / f"{k:06d}.{kind}" for k in range(count)]
    for k, file in enumerate(files):
        if kind == "bin":
            road(k).tofile(file)
        else:
            fields = [(name, "<f4") for name in ("x", "y", "z", "intensity")]
            write_pcd(file, np.rec.fromarrays(road(k).T, dtype=fields))
    files[CUT].write_bytes(files[CUT].read_bytes()[:-7])
    return files


@pytest.mark.parametrize("kind", ["bin", "pcd"])
def test_a_cut_cloud_is_left_out(
    kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files = write_clouds(tmp_path / "clouds", kind)
    words = ["detect", *map(str, files), "--height-m", "6", "--out", str(tmp_path / "boxes")]
    assert main.main(words) == 2
    error = capsys.readouterr().err
    assert f"{files[CUT].name}: " in error
    assert "--skip-bad" in error
    assert main.main([*words, "--skip-bad"]) == 0
    output = capsys.readouterr()
    assert f"left out 1 clouds that cannot be read, such as {files[CUT]}" in output.err
    assert "3 frames" in output.out
    boxes = sorted(file.stem for file in (tmp_path / "boxes").glob("*.txt"))
    assert boxes == [file.stem for file in files if file != files[CUT]]


def test_a_cut_frame_of_a_folder_is_left_out(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data = tmp_path / "site/pole"
    write_clouds(data / "training/velodyne", "bin")
    words = ["detect", str(data), "--height-m", "6", "--out", str(tmp_path / "boxes")]
    assert main.main(words) == 2
    assert "--skip-bad" in capsys.readouterr().err
    assert main.main([*words, "--skip-bad"]) == 0
    assert "left out 1 clouds" in capsys.readouterr().err
    assert len(list((tmp_path / "boxes").glob("*.txt"))) == len(kitti.frames(data)) - 1
    for file in (data / "training/velodyne").iterdir():
        file.write_bytes(file.read_bytes()[:-7])
    assert main.main([*words, "--skip-bad"]) == 2
    assert "expected a point cloud that can be read" in capsys.readouterr().err
