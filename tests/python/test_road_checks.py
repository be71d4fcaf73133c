"""roads.csv of a data set is that of its scene; missing rows at its ends are found."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

import pyinfra as pi
from pyinfra.dataset.road_checks import other_roads

SCENES = [name for name in pi.list_scenes() if name != "crossroad_poles"]
Change = Callable[[list[str]], list[str]]
CHANGES: dict[str, tuple[Change, str]] = {
    "the last row": (lambda rows: rows[:-1], "instead of"),
    "the last rows": (lambda rows: rows[:-9], "instead of"),
    "the first rows": (lambda rows: [rows[0], *rows[9:]], "instead of"),
    "every second row": (lambda rows: [rows[0], *rows[1::2]], "instead of"),
    "a road": (lambda rows: [row for row in rows if not row.startswith("side")], "no road side"),
    "moved": (
        lambda rows: [rows[0], *(shifted(row) for row in rows[1:])],
        "at a different position",
    ),
}


def shifted(row: str) -> str:
    name, s, x, *rest = row.split(",")
    return ",".join([name, s, f"{float(x) + 1}", *rest])


def data_set(folder: Path, scene: str, mount: str = "") -> Path:
    world = pi.load_scene(scene, seed=3, mount=mount)
    (folder / "pole").mkdir(parents=True)
    (folder / "roads.csv").write_text(world.roads_csv())
    (folder / "dataset.yaml").write_text(f'{world.dump()}preset: "datasheet"\nversion: "1"\n')
    return folder / "pole"


@pytest.mark.parametrize("scene", SCENES)
def test_roads_of_a_scene_are_accepted(scene: str, tmp_path: Path) -> None:
    assert other_roads(data_set(tmp_path / "data", scene)) is None


@pytest.mark.parametrize("mount", ["west", "north"])
def test_roads_of_each_mount_are_accepted(mount: str, tmp_path: Path) -> None:
    assert other_roads(data_set(tmp_path / "data", "crossroad_poles", mount)) is None


@pytest.mark.parametrize("change", CHANGES)
def test_other_roads_are_named(change: str, tmp_path: Path) -> None:
    lidar = data_set(tmp_path / "data", "crossroad")
    file = tmp_path / "data/roads.csv"
    changed, words = CHANGES[change]
    file.write_text("\n".join(changed(file.read_text().splitlines())) + "\n")
    message = other_roads(lidar)
    assert message
    assert message.startswith(f"{file}: expected the roads of the scene in dataset.yaml, got ")
    assert words in message


def test_validate_and_evaluate_warn_of_missing_rows(tmp_path: Path) -> None:
    scene = pi.load_scene("highway", set={"duration_s": 2, "traffic.warm_up_s": 5})
    frames = pi.simulate(scene, "helios_16", range(0, 20, 10))
    frames.save(tmp_path / "data")
    lidar, file = tmp_path / "data/helios_16", tmp_path / "data/roads.csv"
    assert "other-roads" not in set(pi.validate(lidar).name)
    file.write_text("".join(file.read_text().splitlines(keepends=True)[:-20]))
    assert "other-roads" in set(pi.validate(lidar).name)
    with pytest.warns(pi.FindingWarning, match=r"other-roads: .*roads.csv"):
        pi.evaluate(lidar, frames.labels.assign(score=0.5))
