"""Impossible sites are refused with line, key and reason. The most similar possible sites are
accepted."""

from pathlib import Path

import pytest
from conftest import BINARY, Infrasim
from impossible_sites import IMPOSSIBLE, POLE, POSSIBLE, TOWN, Site, verdict_of

RECORDED = TOWN[: TOWN.index("traffic:")] + "trajectories: recorded.csv\n"
COLUMNS = "t,id,class,x,y,z,heading,dx,dy,dz,speed\n"


def test_there_are_many_of_both() -> None:
    assert len({site.text for site in IMPOSSIBLE}) >= 40
    assert len({site.text for site in POSSIBLE}) >= 10


@pytest.mark.parametrize("site", IMPOSSIBLE, ids=lambda site: site.name)
def test_a_site_that_cannot_be_is_refused(site: Site) -> None:
    verdict = verdict_of(BINARY, site)
    assert verdict.is_right_for(site), (site.line, site.key, site.words, verdict)


@pytest.mark.parametrize("site", POSSIBLE, ids=lambda site: site.name)
def test_the_nearest_site_that_can_be_is_allowed_and_vehicles_stay_apart(
    site: Site,
) -> None:
    verdict = verdict_of(BINARY, site)
    assert verdict.is_right_for(site), verdict


def recorded(folder: Path, rows: list[str], text: str = RECORDED) -> Path:
    """Returns a scene in which the given vehicles exist at every instant of its second."""
    times = [f"{k / 10:g}" for k in range(11)]
    lines = [f"{t},{row}\n" for t in times for row in rows]
    (folder / "recorded.csv").write_text(COLUMNS + "".join(lines))
    file = folder / "scene.yaml"
    file.write_text(text)
    return file


def standing(number: int, x: float, name: str = "Car") -> str:
    return f"{number},{name},{x:g},-5.25,0.8,0,4.5,2,1.6,0"


def test_recorded_vehicles_in_one_place_are_named(tmp_path: Path, infrasim: Infrasim) -> None:
    file = recorded(tmp_path, [standing(3, 40), standing(8, 44), standing(9, 60)])
    assert infrasim("check", file).returncode == 0
    result = infrasim("check", file, "--traffic")
    assert result.returncode == 2
    assert result.stderr == (
        f"{tmp_path / 'recorded.csv'}: (vehicles): expected vehicles apart, got 3 and 8 in one "
        "place at 0 s, x 42, y -5.25\n"
    )


def test_recorded_vehicles_may_touch_and_may_be_cyclists(
    tmp_path: Path, infrasim: Infrasim
) -> None:
    file = recorded(tmp_path, [standing(3, 40), standing(8, 44.5), standing(9, 49, "Cyclist")])
    result = infrasim("check", file, "--traffic")
    assert result.returncode == 0, result.stderr
    assert [line for line in result.stderr.splitlines() if ": mount " not in line] == []


def test_a_sensor_in_a_vehicles_way_is_refused(tmp_path: Path, infrasim: Infrasim) -> None:
    text = RECORDED.replace(POLE, "pole: {x_m: -60, y_m: -12, z_m: 1}")
    file = recorded(tmp_path, ["5,Car,-61,-12,0.8,0,4.5,2,1.6,0"], text)
    result = infrasim("check", file)
    assert result.returncode == 2
    assert f"{file}:4:9: mounts.pole.x_m: expected" in result.stderr
    assert ", got one inside vehicle 5 at 0 s" in result.stderr


def test_traffic_is_of_a_scene(infrasim: Infrasim) -> None:
    result = infrasim("check", "livox_avia", "--traffic")
    assert (result.returncode, result.stderr[:11]) == (2, "--traffic: ")


@pytest.mark.parametrize(("yaw_deg", "lines"), [(0, 0), (180, 1)])
def test_a_run_that_sees_no_vehicle_says_so(
    yaw_deg: int, lines: int, tmp_path: Path, infrasim: Infrasim
) -> None:
    text = RECORDED.replace(POLE, f"pole: {{x_m: -25, y_m: -12, z_m: 6, yaw_deg: {yaw_deg}}}")
    file = recorded(tmp_path, [standing(3, 10)], text)
    result = infrasim("run", file, "--lidar", "livox_avia", "--preset", "equal", "--frames", "0:10")
    assert result.returncode == 0, result.stderr
    assert result.stderr.count("warning: no-vehicle-points: livox_avia: expected") == lines
    assert result.stderr.count(", got none in the first") == lines
    assert len(result.stderr.splitlines()) == lines


@pytest.mark.parametrize(("height_m", "warned"), [(6, 0), (3, 1)])
def test_a_run_whose_filter_finds_no_plane_says_so(
    height_m: int, warned: int, infrasim: Infrasim
) -> None:
    words = ["--preset", "paper", "--frames", "0:2"]
    words += ["--set", f"filters=[{{ground_plane: {{sensor_height_m: {height_m}}}}}]"]
    result = infrasim("run", "flat", "--lidar", "helios_16", *words)
    assert result.returncode == 0
    for words in ("warning: no-ground-plane: helios_16: ", "no plane in 2 of 2 frames"):
        assert result.stderr.count(words) == warned, result.stderr


def test_a_road_without_traffic_needs_no_warning(infrasim: Infrasim) -> None:
    result = infrasim("run", "flat", "--lidar", "helios_16", "--preset", "paper", "--frames", "0:1")
    assert (result.returncode, result.stderr) == (0, "")


def test_light_through_more_prisms_than_can_be_traced_is_refused(
    tmp_path: Path, infrasim: Infrasim
) -> None:
    avia = (Path(__file__).parents[2] / "configs/lidars/livox_avia.yaml").read_text()
    offsets = ", ".join(f"{i / 60000:g}" for i in range(60000))
    start, end = (
        avia.index("laser_offsets: [") + 16,
        avia.index("]", avia.index("laser_offsets: [")),
    )
    file = tmp_path / "many.yaml"
    file.write_text(avia[:start] + offsets + avia[end:])
    result = infrasim("check", file, timeout=20)
    assert result.returncode == 2
    assert "steps_per_s: expected" in result.stderr
    assert ", got 4800000000 passages of light through prisms" in result.stderr
