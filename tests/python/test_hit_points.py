"""The table of hit points, compared with that of the paper."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pyinfra.dataset import catalogue
from reproduction import hit_points, paper_tables

PAPER = pd.DataFrame(
    {
        "lidar": ["livox_avia", "helios_16", "livox_avia"],
        "scene": ["highway", "highway", "curve"],
        "hits": [1000, 200, 500],
    }
)


def simulated(*rows: tuple[str, str, float]) -> pd.DataFrame:
    return pd.DataFrame(rows, columns=["lidar", "scene", "hits"])


def test_errors_are_relative_to_the_paper() -> None:
    table = hit_points.compare(
        simulated(("livox_avia", "highway", 900), ("helios_16", "highway", 220)), PAPER
    )
    assert table["lidar"].tolist() == ["livox_avia", "helios_16"]
    assert table["paper"].tolist() == [1000, 200]
    np.testing.assert_allclose(table["error"], [-0.1, 0.1])


def test_scene_that_the_paper_does_not_have_has_no_error() -> None:
    table = hit_points.compare(simulated(("livox_avia", "tunnel", 900)), PAPER)
    assert table[["paper", "error"]].isna().all(axis=None)
    assert table["simulated"].tolist() == [900]
    text = hit_points.table_text(table)
    assert "mean error" not in text
    assert "nan" not in text


def test_printed_table_has_the_mean_and_the_largest_error() -> None:
    table = hit_points.compare(
        simulated(
            ("livox_avia", "highway", 900),
            ("helios_16", "highway", 204),
            ("livox_avia", "curve", 500),
        ),
        PAPER,
    )
    text = hit_points.table_text(table)
    assert "simulated: mean error 4.0%, largest 10.0% (highway, livox_avia)" in text
    assert "+2.0%" in text


def test_written_table_reads_back(tmp_path: Path) -> None:
    table = hit_points.compare(simulated(("livox_avia", "highway", 912.34)), PAPER)
    file = tmp_path / "deep/hit_points.csv"
    hit_points.write_table(table, file)
    (row,) = pd.read_csv(file).to_dict("records")
    assert row["simulated"] == 912.3
    assert row["error"] == -0.0877
    assert [path.name for path in file.parent.iterdir()] == ["hit_points.csv"]


def test_paper_has_a_figure_for_every_scene_and_lidar() -> None:
    paper = paper_tables.paper_hits()
    pairs = set(zip(paper["scene"], paper["lidar"], strict=True))
    assert pairs == {(scene, lidar) for scene in catalogue.SCENES for lidar in catalogue.LIDARS}


def test_short_run_is_near_the_paper() -> None:
    scenes = [catalogue.scene_file("crossroad")]
    lidars = [catalogue.lidar_file(name) for name in ("livox_avia", "pandar_64")]
    steps: list[str] = []
    table = hit_points.hit_table(scenes, lidars, "0:75:25", progress=steps.append)
    assert len(steps) == 1
    assert table["lidar"].tolist() == ["livox_avia", "pandar_64"]
    assert (table["error"].abs() < 0.05).all()


def test_flat_ground_is_the_level_ground_of_the_arithmetic() -> None:
    """A channel with elevation e at a height of 6 m hits flat ground at a range of 6 / sin(-e). The
    maximum range is 100 m."""
    hits = hit_points.hits_per_frame(
        catalogue.scene_file("flat"), [catalogue.lidar_file("pandar_64")], "0:20"
    )
    elevations = np.radians(np.linspace(-25, 15, 64))
    ranges = 6 / np.sin(-elevations[elevations < 0])
    ranges = ranges[ranges < 100]
    # CARLA drops 45 % of the points. Of the others with an intensity I below 0.8, it drops a share
    # of 0.4 - 0.5 I.
    intensity = np.exp(-0.004 * ranges)
    kept = 0.55 * np.where(intensity > 0.8, 1, 1 - (0.4 - 0.5 * intensity))
    assert hits["pandar_64"] == pytest.approx(1800 * kept.sum(), rel=0.01)
