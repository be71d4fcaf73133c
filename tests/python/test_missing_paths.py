"""Commands and functions report a missing path as missing, not as a path of the wrong kind."""

from __future__ import annotations

from pathlib import Path

import pytest
from tracking_data import PERIOD_S, boxes, straight

import pyinfra as pi
from pyinfra.cli import main
from pyinfra.tracking.table_file import write_tracks

COMMANDS = [
    "count nowhere lines.yaml --out out",
    "count tracks.csv nowhere --out out",
    "track nowhere --out out.csv",
    "track pole nowhere --out out.csv",
    "region nowhere --out out.yaml",
    "detect nowhere --out out",
    "import nowhere --out data/pole",
    "import boxes.csv --boxes-of nowhere --out out",
    "view nowhere --out out.html",
    "pictures nowhere --out out",
    "validate nowhere",
    "statistics nowhere --out out",
    "split nowhere",
    "evaluate nowhere nowhere --out out",
    "compare nowhere pole",
    "export nowhere --to pcd --out out",
    "report nowhere --out out.html",
    "site draw nowhere --out out.svg",
    "site traffic nowhere",
]


@pytest.mark.parametrize("words", COMMANDS)
def test_a_missing_path_is_reported_as_missing(
    words: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    write_tracks(Path("tracks.csv"), pi.track(boxes([straight(0, 0, 5)], 10), period_s=PERIOD_S))
    Path("lines.yaml").write_text("lines_m:\n  gate: [[2, 9], [2, -9]]\n")
    Path("pole/training/velodyne").mkdir(parents=True)
    Path("pole/training/velodyne/000000.bin").write_bytes(bytes(16))
    Path("boxes.csv").write_text("frame,type,x,y,z,dx,dy,dz,heading,score\n")
    assert main.main(words.split()) == 1
    last = capsys.readouterr().err.splitlines()[-1]
    assert "nowhere" in last
    assert last.endswith(": No such file or directory")


def test_functions_report_a_missing_folder_as_missing() -> None:
    for call in (pi.load_dataset, pi.Detections.from_kitti):
        with pytest.raises(pi.Error, match="folder: nowhere: No such file or directory"):
            call("nowhere")
