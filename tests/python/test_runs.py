"""Runs of the simulator: their summaries and their errors."""

from pathlib import Path

import pytest

from pyinfra.dataset import catalogue, runs

SUMMARY = """\
lidar,preset,frames,rays_per_frame,hits_per_frame,vehicles_per_frame,vehicle_points_per_frame,rays_cast_per_frame,seconds,mrays_per_s
livox_avia,paper,2,24000,900.5,1,10,120,0.1,1
helios_16,paper,2,28800,220,1,10,120,0.1,1
"""


def test_hits_are_read_from_a_summary(tmp_path: Path) -> None:
    file = tmp_path / "summary.csv"
    file.write_text(SUMMARY)
    assert runs.read_hits(file).to_dict() == {"livox_avia": 900.5, "helios_16": 220}


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("hits_per_frame", "hits", "found no column hits_per_frame"),
        ("paper,2", "paper,0", "without frames"),
        (SUMMARY[SUMMARY.index("livox") :], "", "without frames"),
    ],
)
def test_summary_without_hits_is_an_error(tmp_path: Path, old: str, new: str, message: str) -> None:
    file = tmp_path / "summary.csv"
    file.write_text(SUMMARY.replace(old, new))
    with pytest.raises(ValueError, match=message):
        runs.read_hits(file)


def test_wrong_configuration_keeps_the_message_of_the_binary(tmp_path: Path) -> None:
    scene = tmp_path / "scene.yaml"
    scene.write_text("name: [1\n")
    with pytest.raises(runs.SimulatorError, match=r"infrasim check: .*scene\.yaml:") as error:
        runs.hits_per_frame(scene, [catalogue.lidar_file("pandar_64")], "0:1")
    assert error.value.exit_code == 2
