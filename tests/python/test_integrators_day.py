"""An integrator's day: two topics of a bag, a bad frame, a tilted half; boxes and a view."""

from pathlib import Path

import numpy as np
import pytest
from recording_files import PERIOD_S, START_S, BagWriter, driver_records, road

from pyinfra.cli import main
from pyinfra.formats import kitti
from pyinfra.viz.clouds import picture, read_snapshot
from pyinfra.viz.viewer.frames import read_view_frames

FRAMES, TILTED_FROM = 24, 12


def write_day(path: Path) -> Path:
    """Writes two LiDARs; the south one has a cut frame, and is tilted from the middle."""
    lean = np.radians(5.0)
    turn = np.array([[np.cos(lean), 0, np.sin(lean)], [0, 1, 0], [-np.sin(lean), 0, np.cos(lean)]])
    with BagWriter(path, "bag") as bag:
        for k in range(FRAMES):
            time_s = START_S + PERIOD_S * k
            records = driver_records(k, "hesai")
            if k >= TILTED_FROM:
                xyz = road(k)[:, :3] @ turn.T
                for i, axis in enumerate("xyz"):
                    records[axis] = xyz[:, i]
            south = bag.cloud(np.tile(records, 2), time_s)
            if k == 5:
                south.data = south.data[:-7]
            bag.write("/south/points", time_s, south)
            bag.write("/north/points", time_s, bag.cloud(driver_records(k, "velodyne"), time_s))
    return path


def test_from_a_bag_to_boxes_and_a_view(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bag = str(write_day(tmp_path / "day.bag"))
    pole = str(tmp_path / "data/south")
    importing = ["import", bag, "--out", pole]
    assert main.main(importing) == 2
    assert "--channel selects a topic" in capsys.readouterr().err
    importing += ["--channel", "/south/points"]
    assert main.main(importing) == 2
    assert "--skip-bad" in capsys.readouterr().err
    assert main.main([*importing, "--skip-bad"]) == 0
    output = capsys.readouterr()
    assert "left out 1 frames" in output.err
    assert output.err.count("first minute") == 1
    assert f"tilted (frames {TILTED_FROM} to {FRAMES - 1})" in output.err
    numbers = kitti.frames(Path(pole))
    assert len(numbers) == FRAMES - 1
    assert (Path(pole) / "health.csv").is_file()
    boxes = str(tmp_path / "boxes")
    assert main.main(["detect", pole, "--out", boxes, "--split", "all", "--max-frames", "6"]) == 0
    capsys.readouterr()
    view = ["view", pole, "--pred", boxes, "--out", str(tmp_path / "view.html")]
    assert main.main(view) == 0
    text = capsys.readouterr()
    assert "nan" not in text.out + text.err
    assert (tmp_path / "view.html").stat().st_size > 10_000
    assert read_view_frames(Path(pole), numbers[:1])[0].road_z == pytest.approx(0, abs=0.2)
    snapshot = read_snapshot(Path(pole), numbers[0])
    title = picture(snapshot).axes[0].get_title(loc="left")
    assert "nan" not in title
    assert "vehicles" not in title
