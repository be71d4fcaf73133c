"""The plan of a scene, and pictures of the same vehicles as seen by each LiDAR."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import to_hex
from matplotlib.lines import Line2D
from PIL import Image

from pyinfra.cli import main
from pyinfra.core.errors import FormatError
from pyinfra.dataset import catalogue, frames, runs
from pyinfra.dataset.roads import offset_curve
from pyinfra.formats import kitti
from pyinfra.viz import clouds, frame_pictures
from pyinfra.viz import cutouts as cutout_figures
from pyinfra.viz import scene_pictures as scene_figures
from pyinfra.viz.clouds import read_snapshot
from pyinfra.viz.cutouts import DISTANCES_M
from pyinfra.viz.scene_pictures import Scene

LIDARS = ("livox_avia", "helios_16")


@pytest.fixture(scope="module")
def data_sets(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("data")
    lidars = [catalogue.lidar_file(name) for name in LIDARS]
    for scene in ("highway", "crossroad"):
        words = ["--lidar", *lidars, "--preset", "paper", "--frames", "0:4", "--fields"]
        runs.infrasim("run", catalogue.scene_file(scene), *words, "--out", folder / scene)
    return {name: folder / name for name in ("highway", "crossroad")}


def read(data_set: Path) -> Scene:
    return scene_figures.read_scene(frames.lidar_folders(data_set))


def lines(scene: Scene) -> list[Line2D]:
    return scene_figures.plan(scene).axes[0].lines


@pytest.mark.parametrize("scene", ["highway", "crossroad"])
def test_pictures_of_a_data_set(data_sets: dict[str, Path], scene: str, tmp_path: Path) -> None:
    files = frame_pictures.draw_scenes([frames.lidar_folders(data_sets[scene])], 1, tmp_path)
    assert [file.name for file in files] == [f"plan_{scene}.png", f"cutouts_{scene}.png"]
    for file in files:
        with Image.open(file) as image:
            colours = image.convert("RGB").getcolors() or []
            assert min(image.size) > 200
        assert len(colours) > 10
        assert (0, 0x72, 0xB2) in {colour for _, colour in colours}, "no box, no field of view"


def test_lane_lines_lie_where_the_configuration_says(data_sets: dict[str, Path]) -> None:
    # Four lanes of 3.5 m each way, a median of 7 m and shoulders of 3.5 m, along y = 0.
    lane_lines = [
        line for line in lines(read(data_sets["highway"])) if len(line.get_xdata()) == 201
    ]
    offsets = {
        float(np.unique(line.get_ydata()).item()): line.get_linestyle() for line in lane_lines
    }
    solid = [3.5, 17.5, 21.0]
    dashed = [7.0, 10.5, 14.0]
    assert sorted(offsets) == sorted(sign * y for y in solid + dashed for sign in (-1, 1))
    assert {abs(y) for y, style in offsets.items() if style == "-"} == set(solid)


def test_no_line_crosses_a_junction(data_sets: dict[str, Path]) -> None:
    for line in lines(read(data_sets["crossroad"])):
        if len(line.get_xdata()) == 201:  # the carriageways are 15 m wide
            x, y = np.asarray(line.get_xdata()), np.asarray(line.get_ydata())
            assert not ((np.abs(x) < 7) & (np.abs(y) < 7)).any()


def test_buildings_stand_on_the_plan_where_the_configuration_says(
    data_sets: dict[str, Path], tmp_path: Path
) -> None:
    shutil.copytree(data_sets["highway"], tmp_path / "own")
    file = tmp_path / "own/dataset.yaml"
    building = (
        "{x_m: 10, y_m: 30, length_m: 20, width_m: 8, height_m: 5, heading_deg: 90, base_m: 1}"
    )
    file.write_text(file.read_text().replace("buildings: []", f"buildings: [{building}]"))
    scene = read(tmp_path / "own")
    np.testing.assert_allclose(scene.around.buildings, [[10, 30, 3.5, 20, 8, 5, np.pi / 2]])
    plan = scene_figures.plan(scene)
    drawn = [p for p in plan.axes[0].patches if to_hex(p.get_facecolor()) == "#d0d0d0"]
    corners = np.vstack([patch.get_xy()[:-1] for patch in drawn])
    expected = [[6, 20], [6, 40], [14, 20], [14, 40]]
    np.testing.assert_allclose(corners[np.lexsort(corners.T[::-1])], expected, atol=1e-9)
    assert "building" in [text.get_text() for text in plan.legends[0].get_texts()]


@pytest.mark.parametrize("count", [1, 2, 15])
def test_a_legend_is_no_wider_than_its_picture(data_sets: dict[str, Path], count: int) -> None:
    scene = read(data_sets["highway"])
    lidars = tuple(replace(scene.lidars[1], model=f"A LiDAR of number {i}") for i in range(count))
    figure = scene_figures.plan(replace(scene, lidars=lidars))
    figure.draw_without_rendering()
    extent = figure.legends[0].get_window_extent()
    assert extent.x0 >= 0
    assert extent.x1 <= figure.bbox.width
    assert extent.y0 >= 0


def test_the_legend_of_one_narrow_picture_has_rows(data_sets: dict[str, Path]) -> None:
    folder = frames.lidar_folders(data_sets["highway"])[0]
    figure = clouds.sheet([[read_snapshot(folder, 0)]])
    figure.draw_without_rendering()
    extent = figure.legends[0].get_window_extent()
    assert extent.x0 >= 0
    assert extent.x1 <= figure.bbox.width


def test_offset_curve_is_to_the_left() -> None:
    centre, heading = np.array([[0.0, 0.0], [0.0, 1.0]]), np.full(2, np.pi / 2)
    curve = offset_curve(centre, heading, 2.0)
    np.testing.assert_allclose(curve, [[-2, 0], [-2, 1]], atol=1e-12)


def test_fields_of_view_differ_in_colour_and_line(data_sets: dict[str, Path]) -> None:
    legend = scene_figures.plan(read(data_sets["highway"])).legends[0]
    views = [line for line in legend.get_lines() if str(line.get_label()).endswith("0 m")]
    assert {line.get_label() for line in views} == {
        "Livox Avia: to 260 m",
        "RoboSense Helios 16P: to 100 m",
    }
    assert len({line.get_linestyle() for line in views}) == 2
    assert len({to_hex(line.get_color()) for line in views}) == 2


@pytest.mark.parametrize("is_imported", [True, False])
def test_the_plan_of_an_imported_scene_has_a_north_arrow(
    is_imported: bool, data_sets: dict[str, Path]
) -> None:
    scene = replace(read(data_sets["highway"]), is_imported=is_imported)
    (axes,) = scene_figures.plan(scene).axes
    texts = [text.get_text() for text in axes.texts]
    assert ("N" in texts) == ("north" in axes.get_ylabel()) == is_imported
    assert any(text.strip() == "20 m" for text in texts)


@pytest.mark.nightly
def test_every_lidar_shows_the_same_car_of_a_column(data_sets: dict[str, Path]) -> None:
    scene = read(data_sets["highway"])
    vehicles = cutout_figures.choose_vehicles(scene, 1)
    figure = cutout_figures.cutouts(scene, 1)
    captions = np.array([axes.get_xlabel() for axes in figure.axes]).reshape(2, -1)
    assert sum(vehicle is not None for vehicle in vehicles) >= 3
    for column, (vehicle, distance) in enumerate(zip(vehicles, DISTANCES_M, strict=True)):
        for row, folder in enumerate(scene.folders):
            if vehicle is None:
                assert captions[row, column] == ""
                continue
            objects = kitti.read_objects(kitti.frame_file(folder, "objects", vehicle.frame))
            at = objects.ids.tolist().index(vehicle.id)
            assert objects.names[at] == "Car"
            assert objects.visibility[at] >= 0.8
            assert abs(objects.distance[at] - distance) <= 8
            expected = f"{objects.points[at]:,} points, {objects.distance[at]:.0f} m"
            assert captions[row, column].startswith(expected)


def test_column_without_a_vehicle_says_so(
    data_sets: dict[str, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cutout_figures, "CLASS", "Tram")
    figure = cutout_figures.cutouts(read(data_sets["highway"]), 0)
    titles = [axes.get_title() for axes in figure.axes[: len(DISTANCES_M)]]
    assert titles == [f"about {distance:g} m:\nno tram" for distance in DISTANCES_M]


def test_without_fields_the_points_are_those_of_the_box(
    data_sets: dict[str, Path], tmp_path: Path
) -> None:
    data_set = shutil.copytree(data_sets["crossroad"], tmp_path / "crossroad")
    scene = read(data_set)
    vehicle = next(v for v in cutout_figures.choose_vehicles(scene, 1) if v is not None)
    exact = [cutout_figures.vehicle_points(folder, vehicle) for folder in scene.folders]
    for folder in scene.folders:
        shutil.rmtree(folder / "training/fields")
    without_fields = [cutout_figures.vehicle_points(folder, vehicle) for folder in scene.folders]
    for with_fields, without in zip(exact, without_fields, strict=True):
        assert len(without) == pytest.approx(len(with_fields), rel=0.3, abs=3)
        assert (np.abs(without) <= vehicle.box[3:6] / 2 + 0.3).all()
    files = frame_pictures.draw_scenes([scene.folders], 1, tmp_path / "out")
    assert all(file.is_file() for file in files)


@pytest.mark.parametrize("missing", ["dataset.yaml", "roads.csv", "helios_16/lidar.yaml"])
def test_missing_file_is_named(
    data_sets: dict[str, Path], tmp_path: Path, missing: str, capsys: pytest.CaptureFixture[str]
) -> None:
    data_set = shutil.copytree(data_sets["highway"], tmp_path / "highway")
    folders = frames.lidar_folders(data_set)
    (data_set / missing).unlink()
    with pytest.raises(FileNotFoundError, match=missing):
        frame_pictures.draw_scenes([folders], 1, tmp_path / "out")
    if "/" not in missing:
        assert main.main(["pictures", str(data_set), "--out", str(tmp_path / "out")]) == 1
        assert missing in capsys.readouterr().err


def test_scene_without_lanes_is_an_error_with_its_line(
    data_sets: dict[str, Path], tmp_path: Path
) -> None:
    data_set = shutil.copytree(data_sets["highway"], tmp_path / "highway")
    file = data_set / "dataset.yaml"
    file.write_text(file.read_text().replace("each_way: 4", "each_way: four"))
    with pytest.raises(FormatError, match=r"dataset\.yaml:\d+: .*each_way: expected .*got 'four'"):
        read(data_set)
