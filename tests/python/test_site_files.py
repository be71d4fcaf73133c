"""Data sets of a scene from files: their region in the simulator and in the readers."""

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from conftest import ROOT, Infrasim
from evaluation_data import write_predictions
from message_pattern import pattern
from site_files import OUTLINE, SLOPE, slab, write_site

from pyinfra.core.errors import FormatError
from pyinfra.dataset.data_set import without_region
from pyinfra.dataset.ground import ground_of
from pyinfra.dataset.outlines import in_any, read_outlines
from pyinfra.dataset.regions import region_of, roads_region
from pyinfra.dataset.roads import Road, locate, read_roads
from pyinfra.dataset.surroundings import read_surroundings
from pyinfra.dataset.world_frame import to_world
from pyinfra.experiments.benchmark.inputs import named_files
from pyinfra.experiments.stress import limits
from pyinfra.experiments.stress.altered_scenes import read_base
from pyinfra.experiments.value import KEY, covered
from pyinfra.formats import kitti
from pyinfra.metrics.evaluate import evaluate
from pyinfra.metrics.evaluation_tables import LANES
from pyinfra.metrics.frame_checks import validate
from pyinfra.metrics.ground_truth import read_ground_truth
from pyinfra.metrics.settings import Settings
from pyinfra.viz.evaluation_plots import draw_all
from pyinfra.viz.scene_pictures import plan, read_scene

LIDAR = "helios_16"


def simulated(infrasim: Infrasim, folder: Path, **site: object) -> Path:
    """Simulates a frame of the site. Returns the LiDAR's folder."""
    scene = write_site(folder / "site", **site)  # type: ignore[arg-type]
    words = ["--lidar", f"configs/lidars/{LIDAR}.yaml", "--frames", "0:1", "--fields"]
    result = infrasim("run", scene, *words, "--out", folder / "data")
    assert result.returncode == 0, result.stderr
    return folder / "data" / LIDAR


def some_cars() -> np.ndarray:
    draw = np.random.default_rng(5)
    x, y = draw.uniform(-110, 110, 2000), draw.uniform(-8, 22, 2000)
    cars = np.column_stack([x, y, draw.uniform(-3, 3, 2000)])
    return cars[np.hypot(cars[:, 0] - 2, cars[:, 1] + 9) > 4]  # keeps cars away from the sensor


@pytest.mark.parametrize("narrowed", [False, True])
def test_simulator_and_readers_have_one_region(
    tmp_path: Path, infrasim: Infrasim, narrowed: bool
) -> None:
    folder = simulated(infrasim, tmp_path, narrowed=narrowed, cars=some_cars())
    truth = read_ground_truth(folder, [0])
    inside = truth.places(truth.vehicles.mid_frame).inside
    assert 100 < inside.sum() < 1500
    np.testing.assert_array_equal(inside, truth.vehicles.visibility >= 0)
    region = region_of(folder, kitti.read_lidar(folder).T_world_levelled)
    assert region is not None
    np.testing.assert_array_equal(region.holds(truth.vehicles.mid_frame, 0.0), inside)
    positions = truth.vehicles.mid_frame[inside, :2]
    assert (positions >= region.corners.min(0)).all()
    assert (positions <= region.corners.max(0)).all()


def test_roads_follow_each_lane_with_its_height(tmp_path: Path, infrasim: Infrasim) -> None:
    folder = simulated(infrasim, tmp_path)
    roads = {road.name: road for road in read_roads(folder.parent / "roads.csv")}
    assert list(roads) == ["east", "west", "bend"]
    for road in roads.values():
        np.testing.assert_allclose(road.z, SLOPE * road.xy[:, 0], atol=2e-3)
        assert np.hypot(*(road.xy - (2, -9)).T).max() < 100.001
        assert (np.diff(road.s) < 1.06).all()
    assert roads["east"].s[np.abs(roads["east"].xy[:, 0] - 2).argmin()] == 0
    assert roads["west"].xy[0, 0] > roads["west"].xy[-1, 0]
    np.testing.assert_allclose(np.abs(roads["west"].heading), np.pi, atol=1e-6)
    assert np.degrees(roads["bend"].heading[-1]) == pytest.approx(90, abs=5)


def test_the_ground_of_a_slope_is_as_high_as_its_lanes(tmp_path: Path, infrasim: Infrasim) -> None:
    folder = simulated(infrasim, tmp_path)
    pose = kitti.read_lidar(folder).T_world_levelled
    ground = ground_of(folder)
    assert ground is not None
    positions = np.random.default_rng(1).uniform(-60, 60, (400, 2))
    world = to_world(positions, pose)
    on_lanes = locate(world, read_roads(folder.parent / "roads.csv")).inside
    assert on_lanes.sum() > 10
    slope = SLOPE * world[on_lanes, 0] - pose.z
    np.testing.assert_allclose(ground.height(positions[on_lanes]), slope, atol=0.1)


def test_points_lie_on_the_surfaces_of_their_files(tmp_path: Path, infrasim: Infrasim) -> None:
    folder = simulated(infrasim, tmp_path)
    pose = kitti.read_lidar(folder).T_world_levelled
    points = kitti.read_points(kitti.frame_file(folder, "velodyne", 0)).astype(np.float64)
    material = kitti.read_fields(kitti.frame_file(folder, "fields", 0))["class"]
    world = to_world(points, pose)
    assert set(np.unique(material)) == {0, 2}
    np.testing.assert_array_equal(material == 2, world[:, 1] < -4)
    off = (points[:, 2] + pose.z - SLOPE * world[:, 0]) / np.hypot(1, SLOPE)
    assert np.abs(off).max() < 0.2  # the tolerance is the range noise
    assert abs(off.mean()) < 0.01


def test_what_lies_outside_the_outlines_counts_nowhere(tmp_path: Path, infrasim: Infrasim) -> None:
    cars = np.array([[40.0, -2, 0], [40.0, 2, 0], [-40.0, 2, 0], [90.0, -2, 0]])
    folder = simulated(infrasim, tmp_path, narrowed=True, cars=cars)
    truth = read_ground_truth(folder, [0])
    counted = truth.counted("all", truth.vehicles, truth.places(truth.vehicles.mid_frame), 1)
    assert dict(zip(truth.vehicles.ids.tolist(), counted.tolist(), strict=True)) == {
        **dict.fromkeys((1, 3), True),
        **dict.fromkeys((2, 4), False),
    }


def test_outlines_that_were_not_copied_are_named(tmp_path: Path, infrasim: Infrasim) -> None:
    folder = simulated(infrasim, tmp_path, narrowed=True)
    file = folder.parent / "regions.csv"
    assert without_region(folder) is None
    assert np.array(read_outlines(folder.parent)).tolist() == [OUTLINE]
    text = file.read_text()
    file.unlink()
    assert f"expected the file {file} with the outlines, got none" in str(without_region(folder))
    file.write_text(text[:-3])
    assert any("regions.csv:7: " in f.text for f in validate(folder))


@pytest.mark.parametrize(
    ("text", "error"),
    [
        ("region,x\n", ":1: expected the header 'region,x,y', got 'region,x'"),
        ("region,x,y\n", ":1: expected one or more rows with a region, got none"),
        ("region,x,y\na,0,0\na,1,1\n", "region a: expected 3 or more corners, got 2"),
        ("region,x,y\na,0,0\na,1,nan\na,1,0\n", ":3: y: expected ..., got nan"),
        ("region,x,y\na,0,0\na,1,b\na,1,0\n", ":3: y: expected ..., got 'b'"),
        (
            "region,x,y\na,0,0\na,1,0\na,0,1",
            ":4: expected a newline at the end of the last line, got none",
        ),
    ],
)
def test_a_wrong_table_of_outlines_is_named_with_its_line(
    tmp_path: Path, text: str, error: str
) -> None:
    (tmp_path / "regions.csv").write_text(text)
    with pytest.raises(FormatError, match=r"regions\.csv") as caught:
        read_outlines(tmp_path)
    assert re.search(pattern(error), str(caught.value))


def test_a_place_is_in_the_region_if_one_outline_holds_it() -> None:
    squares = [np.array([[0.0, 0], [2, 0], [2, 2], [0, 2]]), np.array([[9.0, 0], [9, 1], [8, 0]])]
    positions = np.array([[1.0, 1], [3, 1], [8.9, 0.5], [8.1, 0.9], [2.5, 1]])
    assert in_any(squares, positions, 0).tolist() == [True, False, True, False, False]
    assert in_any(squares, positions, 0.6).tolist() == [True, False, True, True, True]
    assert in_any([], positions, 0).all()


def test_a_place_is_of_the_nearest_of_many_short_lanes(tmp_path: Path) -> None:
    draw = np.random.default_rng(3)
    header, rows = "road,s,x,y,z,heading,half_width\n", []
    for i in range(60):
        x, y, turn = *draw.uniform(-50, 50, 2), draw.uniform(-3, 3)
        rows += [
            f"l{i},{s},{x + s * np.cos(turn):.4f},{y + s * np.sin(turn):.4f},0,{turn:.6f},1.6\n"
            for s in range(12)
        ]
    (tmp_path / "roads.csv").write_text(header + "".join(rows))
    roads = read_roads(tmp_path / "roads.csv")
    points = draw.uniform(-60, 60, (5000, 2))
    places = locate(points, roads, margin_m=1.0)
    lone = [locate(points, [road], margin_m=1.0).inside for road in roads]
    np.testing.assert_array_equal(places.inside, np.any(lone, axis=0))
    back = locate(points, roads[::-1], margin_m=1.0)
    np.testing.assert_array_equal(places.s, back.s)


def test_a_narrowed_region_takes_the_common_corners() -> None:
    s, flat = np.arange(-20.0, 21), np.zeros(41)
    road = Road("r", s, np.column_stack([s, flat]), flat, flat, flat + 2)
    outline = np.array([[0.0, -5], [10, -5], [10, 5], [0, 5]])
    region = roads_region([road], kitti.WorldPose(0, 0, 5, 0), [outline])
    np.testing.assert_allclose(region.corners, [[0, -2], [10, 2]])


def test_surroundings_and_plans_of_lanes(tmp_path: Path, infrasim: Infrasim) -> None:
    folder = simulated(infrasim, tmp_path)
    around = read_surroundings(folder.parent)
    assert [road.name for road in around.roads] == ["east", "west", "bend"]
    assert plan(read_scene([folder])).axes


def test_a_changed_surface_is_another_data_set(tmp_path: Path, infrasim: Infrasim) -> None:
    simulated(infrasim, tmp_path)
    (tmp_path / "site/meshes/road.ply").write_text(slab(-180, 180, -4, 41))
    words = ["--lidar", f"configs/lidars/{LIDAR}.yaml", "--frames", "0:2", "--fields"]
    result = infrasim("run", tmp_path / "site/site.yaml", *words, "--out", tmp_path / "data")
    assert result.returncode == 1
    assert "the folder holds another run: it has 'surfaces: " in result.stderr


def test_scenes_are_not_simulated_again_without_the_files(
    tmp_path: Path, infrasim: Infrasim
) -> None:
    folder = simulated(infrasim, tmp_path)
    base = read_base(folder, 5)
    assert re.search("lanes: expected stressors that only change clouds", limits.scene(base))
    assert named_files(base.scene)[1:] == ["lanes.csv", "meshes/road.ply", "meshes/verge.ply"]


def test_check_counts_triangles_without_an_area(tmp_path: Path, infrasim: Infrasim) -> None:
    scene = write_site(tmp_path / "site")
    assert "warning" not in infrasim("check", scene).stderr
    mesh = tmp_path / "site/meshes/verge.ply"
    mesh.write_text(mesh.read_text().replace("4 0 1 2 3", "4 0 1 2 2"))
    result = infrasim("check", scene)
    assert result.returncode == 0
    assert "warning: flat-triangles: " in result.stderr
    assert "verge.ply: 1 of 2 triangles without an area" in result.stderr


def test_it_is_checked_from_the_root(infrasim: Infrasim, tmp_path: Path) -> None:
    """Files are relative to the scene file, in any working directory."""
    scene = write_site(tmp_path / "site")
    assert infrasim("check", scene, cwd=ROOT / "docs").returncode == 0
    (tmp_path / "site/lanes.csv").unlink()
    result = infrasim("check", scene)
    assert result.returncode == 1
    assert "lanes.csv: can't be read" in result.stderr


def test_areas_of_lanes_are_cells_and_distance_is_theirs_together(
    tmp_path: Path, infrasim: Infrasim
) -> None:
    """Each car lies in one or two cells and is detected, except for one. Its cell has a low AP."""
    positions = [(-70, -2), (-50, -2), (-30, 2), (10, 2), (30, -2), (50, 2), (52, 2)]
    cars = np.array([(x, y, 0) for x, y in positions], np.float64)
    folder = simulated(infrasim, tmp_path, cars=cars)
    truth = read_ground_truth(folder, [0])
    boxes = [(box.tolist(), 0.9) for box in truth.vehicles.boxes[1:]]
    predictions = write_predictions(tmp_path / "predictions", [boxes])
    settings = Settings(ground_truths=("all",), min_objects=1, replicates=5)
    evaluation = evaluate(folder, predictions, settings)
    assert evaluation.cells is not None
    cells = evaluation.cells.set_index(["x", "y"])
    assert cells.objects.sum() == evaluation.ap.objects[0] == 7
    assert cells.loc[(-70, -10)].ap == 0
    assert cells.loc[(50, 10)].objects == 2
    assert cells.loc[(50, 10)].ap == 100
    assert cells.loc[(90, -10)].objects == 0
    assert (np.hypot(cells.reset_index().x - 2, cells.reset_index().y + 9) < 120).all()
    area = evaluation.areas.iloc[0]
    assert (len(evaluation.areas), area.road, area.n_tda, area.n_hqda) == (1, "all", 6, 5)
    distance = evaluation.distance_ap
    assert set(distance.road) == {"(lanes)"}
    assert (distance.s.min(), distance.s.max()) == (-95, 95)
    # before the foot, on lanes in both directions
    assert distance[distance.s == -50].objects.item() == 3
    assert distance[distance.s == 50].objects.item() == 0
    hqda = evaluation.replicates[evaluation.replicates.measure == "n_hqda"].value.item()
    assert hqda == 5
    out = tmp_path / "out"
    files = {file.name for file in [*evaluation.save(out), *draw_all(evaluation, out)]}
    assert {"cells.csv", "areas_plan.svg", "distance_ap.svg"} <= files


def test_metres_of_road_are_unknown_where_lanes_are_taken_at_once() -> None:
    cell = dict.fromkeys(KEY, "a")
    rows = [(LANES, s, 99.0) for s in (0.0, 5.0)]
    windows = pd.DataFrame([{**cell, "ground_truth": "all"}] * 2)
    windows[["road", "s", "ap_r1000"]] = rows
    both = pd.concat([windows, windows.assign(scene="b", road="main")])
    metres = covered(both).set_index("scene").covered_m
    assert np.isnan(metres["a"])
    assert metres["b"] == 5


def test_a_site_without_its_trajectories_yet_is_checked_but_for_them(
    infrasim: Infrasim, tmp_path: Path
) -> None:
    scene = write_site(tmp_path / "site")
    file = scene.parent / "trajectories.csv"
    file.unlink()
    result = infrasim("check", scene)
    assert result.returncode == 0
    assert f"warning: no-trajectories: {file}: file does not exist" in result.stderr
    for words in (
        ["check", scene, "--traffic"],
        ["run", scene, "--lidar", "livox_avia", "--frames", "0:1", "--out", tmp_path / "data"],
    ):
        result = infrasim(*words)
        assert result.returncode == 1
        assert (
            f"{file}: can't be read: the file does not exist; `pyinfra site traffic`"
            in result.stderr
        )
    (scene.parent / "lanes.csv").unlink()
    assert infrasim("check", scene).returncode == 1
