"""Background in a scene of flat ground and boxes, with exact rays."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from evaluation_data import write_lidar, write_roads

from pyinfra.cli import main
from pyinfra.core.arrays import FloatArray, Points
from pyinfra.core.boxes import bev_iou, pair_iou_3d
from pyinfra.core.vocabulary import PERSON_TYPES
from pyinfra.dataset.ground import ground_of_roads
from pyinfra.dataset.regions import Region, outline_region, roads_region
from pyinfra.dataset.roads import Road
from pyinfra.formats import kitti
from pyinfra.models.detectors import Detector
from pyinfra.models.detectors.background import DEFAULT, Background, _clusters, _road_cells

ROOT = Path(__file__).resolve().parents[2]
SENSOR_HEIGHT_M = 6.0
CAR = (4.5, 1.9, 1.6)
NO_BOXES = np.empty((0, 7))
HEDGE_Y_M = 12.0


def box(x: float, y: float, heading: float, size: tuple[float, float, float] = CAR) -> FloatArray:
    """Returns a box that stands on the ground: (1, 7)."""
    return np.array([[x, y, size[2] / 2 - SENSOR_HEIGHT_M, *size, heading]])


def cast(boxes: FloatArray, seed: int = 0, rows: int = 60, reach_m: float = 100.0) -> Points:
    """Returns the nearest returns of a spinning sensor from the ground and boxes (k, 7). The
    azimuths depend on the seed."""
    elevation = np.radians(np.linspace(-30, 0, rows, endpoint=False))
    azimuth = np.radians(np.arange(0, 360, 0.4)) + np.random.default_rng(seed).uniform(0, 0.007)
    e, a = (v.ravel() for v in np.meshgrid(elevation, azimuth, indexing="ij"))
    ray = np.stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)], axis=1)
    distance = SENSOR_HEIGHT_M / -ray[:, 2]
    for x, y, z, *size, heading in boxes:
        cos, sin = np.cos(heading), np.sin(heading)
        turn = np.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1]])
        start, step = turn @ [-x, -y, -z], ray @ turn.T
        with np.errstate(divide="ignore"):
            sides = (np.array([[-1], [1]]) * np.divide(size, 2) - start)[:, None] / step
        enters, leaves = sides.min(0).max(1), sides.max(0).min(1)
        hit = (enters < leaves) & (enters > 0)
        distance[hit] = np.minimum(distance[hit], enters[hit])
    points = np.column_stack([ray * distance[:, None], np.full(len(ray), 0.5)])
    return points[distance < reach_m].astype(np.float32)


@pytest.fixture(scope="module")
def empty_road() -> Background:
    return Background.learn([cast(NO_BOXES, seed) for seed in range(10)])


@pytest.fixture(scope="module")
def busy_road() -> Background:
    """Returns a detector that has learnt from cars along x, in lanes at y = 2 and y = 9."""
    rng = np.random.default_rng(1)
    positions = [(x, y) for x in np.arange(-95, 95, 19.0) for y in (2, 9)]
    frames = [
        cast(np.concatenate([box(x + rng.uniform(-6, 6), y, 0.0) for x, y in positions]), seed)
        for seed in range(20)
    ]
    return Background.learn(frames)


def test_background_is_a_detector(empty_road: Background) -> None:
    detector: Detector = empty_road
    assert len(detector.predict(cast(NO_BOXES))) == 0


def test_a_frame_without_objects_has_no_detection(empty_road: Background) -> None:
    assert len(empty_road.predict(cast(NO_BOXES, seed=99))) == 0


@pytest.mark.parametrize("degrees", [0, 30, 45, 90, 120, 179.9, -179.9, -135, -60])
@pytest.mark.parametrize("position", [(20, 3), (-15, 18), (4, -18)])
def test_a_car_is_detected_at_any_heading(
    empty_road: Background, position: tuple[float, float], degrees: float
) -> None:
    car = box(*position, np.radians(degrees))
    detections = empty_road.predict(cast(car, seed=99))
    assert detections.names.tolist() == ["Car"]
    assert bev_iou(detections.boxes, car)[0, 0] > 0.5
    assert pair_iou_3d(detections.boxes, car)[0] > 0.5
    assert -np.pi <= detections.boxes[0, 6] <= np.pi


@pytest.mark.parametrize(
    ("name", "size"),
    [("Motorcycle", (2.2, 0.8, 1.4)), ("Truck", (8.5, 2.5, 3.2)), ("Bus", (12.0, 2.55, 3.2))],
)
def test_the_size_names_the_class(
    busy_road: Background, name: str, size: tuple[float, float, float]
) -> None:
    vehicle = box(14, 9, 0.0, size)
    detections = busy_road.predict(cast(vehicle, seed=99))
    assert detections.names.tolist() == [name]
    assert bev_iou(detections.boxes, vehicle)[0, 0] > 0.5


@pytest.mark.parametrize(
    ("name", "size"), [("Pedestrian", (0.73, 0.67, 1.77)), ("Cyclist", (1.67, 0.7, 1.67))]
)
def test_small_clusters_are_people_if_that_is_asked_for(
    busy_road: Background, name: str, size: tuple[float, float, float], tmp_path: Path
) -> None:
    points = cast(box(14, 9, 0.0, size), seed=99)
    assert not set(busy_road.predict(points).names) & set(PERSON_TYPES)
    asked = replace(busy_road, settings=replace(busy_road.settings, people=True))
    detections = asked.predict(points)
    assert detections.names.tolist() == [name]
    assert bev_iou(detections.boxes, box(14, 9, 0.0, size))[0, 0] > 0.25
    asked.save(tmp_path / "asked")
    assert Background.load(tmp_path / "asked").settings.people
    cars = cast(box(14, 9, 0.0), seed=99)
    assert np.array_equal(asked.predict(cars).boxes, busy_road.predict(cars).boxes)


def test_cars_side_by_side_are_two_and_the_scores_fall(busy_road: Background) -> None:
    cars = np.concatenate([box(20, 2, 0.0), box(20, 5.5, 0.0), box(50, 9, 0.0)])
    detections = busy_road.predict(cast(cars, seed=99))
    assert len(detections) == 3
    assert (bev_iou(detections.boxes, cars).max(1) > 0.5).all()
    assert (np.diff(detections.scores) <= 0).all()
    assert (detections.scores > 0).all()
    assert (detections.scores <= 1).all()


def test_traffic_tells_the_heading_of_a_car_with_few_points(busy_road: Background) -> None:
    """At 80 m only the rear of a car is seen. Without the direction of the traffic it would look
    like a wall across the road."""
    car = box(80, 9, 0.0)
    detections = busy_road.predict(cast(car, seed=99))
    assert len(detections) == 1
    assert abs(np.sin(detections.boxes[0, 6])) < 0.1
    assert bev_iou(detections.boxes, car)[0, 0] > 0.5


@pytest.mark.parametrize(("across_m", "along_m"), [(2.0, 0.5), (0.5, 2.0)])
def test_points_are_of_one_cluster_up_to_the_gap_of_their_direction(
    across_m: float, along_m: float
) -> None:
    settings = replace(DEFAULT, gap_m=across_m, gap_along_m=along_m)
    cells = _road_cells(settings)
    along_x = np.zeros((cells, cells, 2), np.float32)
    along_x[..., 0] = 1
    for step, gap in (((0, 1.5), across_m), ((1.5, 0), along_m)):
        xy = np.array([(5, 5), (5 + step[0], 5 + step[1])], np.float32)
        labels = _clusters(xy, along_x, settings)
        assert (labels[0] == labels[1]) == (gap > 1.5)


def test_a_queue_that_stands_half_of_the_time_is_no_background() -> None:
    queue = np.concatenate([box(x, 6, 0.0) for x in (18.0, 26.0, 34.0)])
    frames = [cast(queue if seed % 2 else NO_BOXES, seed) for seed in range(20)]
    detections = Background.learn(frames).predict(cast(queue, seed=99))
    assert (bev_iou(queue, detections.boxes).max(1) > 0.5).all()


def test_what_always_stands_is_background_and_a_car_beside_it_is_not() -> None:
    wall, car = box(20, 12, 0.0, (30, 1, 3)), box(20, 5, 0.0)
    known = Background.learn([cast(wall, seed) for seed in range(10)])
    detections = known.predict(cast(np.concatenate([wall, car]), seed=99))
    assert bev_iou(detections.boxes[:1], car)[0, 0] > 0.5
    assert len(detections) == 1


def test_vehicles_do_not_raise_ground_that_no_ray_reaches() -> None:
    """Between two rows that are 4 degrees apart, rays hit only cars."""
    rng = np.random.default_rng(2)
    frames = [cast(box(rng.uniform(50, 90), 4, 0.0), seed, rows=8) for seed in range(30)]
    ground = Background.learn(frames).ground
    middle = len(ground) // 2
    assert np.abs(ground[middle : middle + 95, middle : middle + 8] + SENSOR_HEIGHT_M).max() < 0.2


def test_far_ground_of_a_road_that_rises_is_its_relief() -> None:
    """Beyond 60 m the road rises by 8 %. There, in four of five frames, no ray hits it."""
    rng = np.random.default_rng(3)

    def road_z(x: FloatArray) -> FloatArray:
        return np.asarray(0.08 * (x - 60).clip(0) - SENSOR_HEIGHT_M)

    def frame(seed: int) -> Points:
        points = cast(NO_BOXES, seed)
        far = points[:, 0] > 60
        points[:, 2] = road_z(points[:, 0])
        return points[~far | (rng.random(len(points)) < 0.05)]

    s = np.arange(-110.0, 111)
    road = Road("a", s, np.column_stack([s, 0 * s]), road_z(s) + 6, 0 * s, 0 * s + 6)
    known = ground_of_roads([road], kitti.WorldPose(0, 0, 6, 0))
    frames = [frame(seed) for seed in range(40)]
    middle = 120
    truth = road_z(np.arange(61.0, 109) + 0.5)
    for given, high in ((known, False), (None, True)):
        ground = Background.learn(frames, road=given).ground
        off = np.abs(ground[middle + 61 : middle + 109, middle - 3 : middle + 3] - truth[:, None])
        assert (off.max() > 1) == high


def hedge(seed: int) -> Points:
    """Returns points of leaves around y = 12 m, 6 m beside the road. Their positions differ between
    frames."""
    rng = np.random.default_rng(seed)
    middle = rng.uniform(10, 40, 4)
    xyz = rng.uniform(-1, 1, (4, 60, 3)) * [1.5, 0.5, 0.7] + [0, HEDGE_Y_M, 1 - SENSOR_HEIGHT_M]
    xyz[..., 0] += middle[:, None]
    return np.column_stack([xyz.reshape(-1, 3), np.full(240, 0.2)]).astype(np.float32)


def beside_a_hedge(boxes: FloatArray, seed: int) -> Points:
    return np.concatenate([cast(boxes, seed), hedge(seed)])


def straight_road() -> Region:
    """Returns a road that extends 6 m to either side of the sensor's x axis. Its world frame is
    rotated and shifted."""
    pose = kitti.WorldPose(x=10, y=20, z=SENSOR_HEIGHT_M, yaw=np.pi / 2)
    s = np.arange(-100.0, 101)
    same = np.ones_like(s)
    centre = np.column_stack([10 * same, 20 + s])
    return roads_region([Road("main", s, centre, 0 * s, np.pi / 2 * same, 6 * same)], pose)


def outline(folder: Path, corners: str = "[[-90, -6], [90, -6], [90, 6], [-90, 6]]") -> Region:
    file = folder / "region.yaml"
    file.write_text(f"outline_m: {corners}\n")
    return outline_region(file)


@pytest.mark.parametrize("kind", ["roads", "outline"])
def test_plants_on_a_slope_beside_the_road_do_not_lower_its_far_ground(
    tmp_path: Path, kind: str
) -> None:
    """The sensor sees the road only up to 50 m. The plants on both slopes are in every frame."""

    def frame(seed: int) -> Points:
        points = cast(NO_BOXES, seed, reach_m=50)
        points[:, 2] += np.random.default_rng(seed).normal(0, 0.02, len(points))
        beside = np.abs(points[:, 1]) > 6.5
        points[beside, 2] -= 0.3 + 0.1 * (np.abs(points[beside, 1]) - 6.5).clip(0, 10)
        seldom = np.random.default_rng(seed).random(len(points)) < 0.2
        return points[beside | seldom]

    region = straight_road() if kind == "roads" else outline(tmp_path)
    ground = Background.learn([frame(seed) for seed in range(10)], region=region).ground
    middle = len(ground) // 2
    for far in (slice(middle + 80, middle + 110), slice(middle - 110, middle - 80)):
        assert np.abs(ground[far, middle - 6 : middle + 6] + SENSOR_HEIGHT_M).max() < 0.1


@pytest.mark.parametrize("y", [9.0, 3.0])
def test_a_crown_beside_or_over_the_road_is_not_the_ground_below_it(y: float) -> None:
    """No ray hits the road beyond 50 m. The crown at 90 m is in every frame."""
    leaves = np.random.default_rng(5).uniform(-1.5, 1.5, (200, 4)).astype(np.float32)
    leaves[:, :3] += (90, y, 5.5 - SENSOR_HEIGHT_M)
    frames = [np.concatenate([cast(NO_BOXES, k, reach_m=50), leaves]) for k in range(10)]
    ground = Background.learn(frames, region=straight_road()).ground
    middle = len(ground) // 2
    road = ground[middle + 80 : middle + 99, middle - 6 : middle + 6]
    assert np.abs(road + SENSOR_HEIGHT_M).max() < 0.1


def test_far_cars_side_by_side_are_two_where_the_direction_of_the_road_is_known() -> None:
    """At 90 m only the rears of the cars are seen. Together they look like one vehicle across the
    road."""
    pair = np.concatenate([box(88, y, 0.0) for y in (-1.6, 1.6)])
    frames = [cast(pair if seed % 3 == 0 else NO_BOXES, seed) for seed in range(12)]
    region = straight_road()
    unknown = replace(region, axes=None)
    points = cast(pair, seed=99)
    for given, count in ((unknown, 0), (region, 2)):
        boxes = Background.learn(frames, region=given).predict(points).boxes
        assert np.count_nonzero(bev_iou(pair, boxes).max(1, initial=0) > 0.5) == count


@pytest.mark.parametrize("kind", ["roads", "outline"])
def test_a_hedge_beside_the_road_is_no_vehicle_and_a_car_on_it_is(
    tmp_path: Path, kind: str
) -> None:
    region = straight_road() if kind == "roads" else outline(tmp_path)
    frames = [beside_a_hedge(NO_BOXES, seed) for seed in range(10)]
    anywhere = Background.learn(frames)
    unmasked = Background.learn(frames, replace(DEFAULT, within_region=False), region)
    known = Background.learn(frames, region=region)
    car = box(20, 3, 0.0)
    points = beside_a_hedge(car, seed=99)
    for other in (anywhere, unmasked):
        boxes = other.predict(points).boxes
        assert np.count_nonzero(boxes[:, 1] > HEDGE_Y_M - 2) >= 2
    boxes = known.predict(points).boxes
    assert len(boxes) == 1
    assert bev_iou(boxes, car)[0, 0] > 0.5
    assert len(known.predict(hedge(99))) == 0


def test_a_car_is_detected_up_to_the_border_of_the_region() -> None:
    known = Background.learn([cast(NO_BOXES, seed) for seed in range(10)], region=straight_road())
    for y, count in ((5.9, 1), (-5.9, 1), (9.0, 0), (-9.0, 0)):
        assert len(known.predict(cast(box(20, y, 0.0), seed=99))) == count


@pytest.mark.parametrize("margin", [0.0, 2.0])
def test_an_outline_may_have_a_bay_and_a_margin_makes_it_wider(
    tmp_path: Path, margin: float
) -> None:
    region = outline(tmp_path, "[[0, 0], [30, 0], [30, 30], [15, 5], [0, 30]]")
    points = np.array([[5.0, 5], [25, 20], [15, 25], [15, 6], [-1, 10], [33, 10]])
    wider = margin > 0
    assert region.holds(points, margin).tolist() == [True, True, False, wider, wider, False]


@pytest.mark.parametrize(
    ("corners", "message"),
    [
        ("[[0, 0], [1, 0]]", "outline_m: expected 3 or more corners, got 2"),
        (
            "[[0, 0], [1, 1], [2, 2]]",
            "outline_m: expected an outline with an area above 0, got an area of 0",
        ),
        (
            "[[-5, -2], [5, 2], [5, -2], [-6, 3]]",
            "outline_m: expected .*, got side 1 across side 3",
        ),
        ("[[0, 0], [1, 0], [1]]", r"region.yaml:1: outline_m.2: expected 2 values, got 1"),
        ("[[0, 0], [1, 0], [.nan, 1]]", r"region.yaml:1: outline_m.2.0: expected .*, got nan"),
    ],
)
def test_a_wrong_outline_is_an_error(tmp_path: Path, corners: str, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        outline(tmp_path, corners)


def test_no_point_and_one_point_are_fine(empty_road: Background) -> None:
    nothing = np.empty((0, 4), np.float32)
    detections = empty_road.predict(nothing)
    assert (detections.boxes.shape, detections.scores.shape, detections.names.shape) == (
        (0, 7),
        (0,),
        (0,),
    )
    on_the_ground = np.array([[20, 3, -SENSOR_HEIGHT_M, 0]], np.float32)
    assert len(empty_road.predict(on_the_ground)) == 0
    above = np.array([[20, 3, 1 - SENSOR_HEIGHT_M, 0]], np.float32)
    assert len(empty_road.predict(above)) == 1


def test_points_not_finite_or_out_of_range_are_left_out(empty_road: Background) -> None:
    car = cast(box(20, 3, 0.5), seed=99)
    bad = np.array([np.nan, np.inf, -np.inf, 120, 1e6, -1e30], np.float32)
    extra = np.tile(car[:1], (18, 1))
    extra[np.arange(18), np.arange(18) % 3] = np.repeat(bad, 3)
    detections, alone = empty_road.predict(np.concatenate([extra, car])), empty_road.predict(car)
    assert np.array_equal(detections.boxes, alone.boxes)
    assert len(empty_road.predict(extra)) == 0


def test_duplicates_and_order_move_no_box(empty_road: Background) -> None:
    car = cast(box(20, 3, 0.5), seed=99)
    shuffled = np.random.default_rng(3).permutation(np.concatenate([car, car]))
    once, twice = empty_road.predict(car), empty_road.predict(shuffled)
    assert np.allclose(once.boxes, twice.boxes, atol=1e-4)


def test_points_at_one_place_are_a_box_of_the_size_of_a_class(empty_road: Background) -> None:
    same = np.tile(np.array([[20, 3, 1 - SENSOR_HEIGHT_M, 0]], np.float32), (1000, 1))
    detections = empty_road.predict(same)
    assert len(detections) == 1
    assert (detections.boxes[0, 3:6] >= [2.2, 0.8, 1.4]).all()


def test_points_are_never_changed(empty_road: Background) -> None:
    car = cast(box(20, 3, 0.5), seed=99)
    before = car.copy()
    car.flags.writeable = False
    empty_road.predict(car)
    Background.learn([car])
    assert np.array_equal(car, before)


def test_noise_everywhere_ends(empty_road: Background) -> None:
    noise = np.random.default_rng(4).uniform(-110, 110, (40_000, 4)).astype(np.float32)
    noise[:, 2] = np.random.default_rng(5).uniform(-6, -2, len(noise))
    detections = empty_road.predict(noise)
    assert np.isfinite(detections.boxes).all()


def test_points_of_another_shape_are_an_error(empty_road: Background) -> None:
    with pytest.raises(ValueError, match=r"points: expected \(n, 4\), got \(5, 3\)"):
        empty_road.predict(np.zeros((5, 3), np.float32))


@pytest.mark.parametrize("frames", [[], [np.empty((0, 4), np.float32)]])
def test_learning_from_nothing_is_an_error(frames: list[Points]) -> None:
    with pytest.raises(
        ValueError, match=r"frames: expected points within range_m, got none in \d frames"
    ):
        Background.learn(frames)


def test_learning_from_one_point_gives_level_ground_there() -> None:
    known = Background.learn([np.array([[20, 3, -5, 0]], np.float32)])
    assert np.allclose(known.ground, -5, atol=0.1)
    assert len(known.predict(np.array([[-30, 8, -4, 0]], np.float32))) == 1


def test_what_is_saved_is_loaded(tmp_path: Path) -> None:
    settings = replace(DEFAULT, range_m=60.0, cell_m=0.7)
    frames = [cast(box(x, 3, 0.0), x) for x in range(10, 40, 5)]
    known = Background.learn(frames, settings, straight_road())
    file = tmp_path / "background"
    known.save(file)
    again = Background.load(file)
    assert again.settings == settings
    for name in ("ground", "permanent", "region", "road", "expected"):
        assert np.array_equal(getattr(known, name), getattr(again, name))
    points = cast(box(20, 3, 0.5), seed=99)
    assert np.array_equal(known.predict(points).boxes, again.predict(points).boxes)


def arrays(file: Path) -> dict[str, np.ndarray]:
    with np.load(file) as data:
        return dict(data)


@pytest.mark.parametrize("wrong", ["text", "nothing", "cut", "npy", "missing", "shape", "nan", "0"])
def test_a_wrong_file_is_an_error_that_names_it(
    empty_road: Background, tmp_path: Path, wrong: str
) -> None:
    file = tmp_path / "wrong.npz"
    empty_road.save(file)
    good = arrays(file)
    if wrong == "text":
        file.write_text("not an archive")
    elif wrong == "nothing":
        file.write_bytes(b"")
    elif wrong == "cut":
        file.write_bytes(file.read_bytes()[:-100])
    elif wrong == "npy":
        with file.open("wb") as stream:
            np.save(stream, np.zeros(3))
    elif wrong == "missing":
        np.savez(file, ground=good["ground"])
    else:
        bad = {
            "shape": {"ground": good["ground"][1:]},
            "nan": {"ground": good["ground"] * np.nan},
            "0": {"settings": good["settings"] * 0},
        }
        np.savez(file, **(good | bad[wrong]))
    with pytest.raises(
        ValueError, match=r"wrong\.npz: expected a background model, got a file that cannot be read"
    ):
        Background.load(file)


def test_a_file_that_is_not_there_is_another_error(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        Background.load(tmp_path / "none.npz")


def test_neither_torch_nor_the_extension_is_imported() -> None:
    code = "import sys, pyinfra.models.detectors.background; print(*sys.modules)"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert {"torch", "pyinfra._core"}.isdisjoint(run.stdout.split())


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    """Writes a LiDAR's folder of 12 frames. Each frame has a car on the road and a hedge beside
    it."""
    folder = write_lidar(tmp_path / "data/pole", [[]] * 12)
    for k in range(12):
        cloud = beside_a_hedge(box(15 + 4 * k, 3, 0.0), seed=k)
        cloud.tofile(kitti.frame_file(folder, "velodyne", k))
    (folder / "ImageSets").mkdir()
    (folder / "ImageSets/train.txt").write_text("".join(f"{k:06d}\n" for k in range(12)))
    return folder


def centres_y(folder: Path, out: Path, *words: str) -> FloatArray:
    """Returns y of the boxes that `pyinfra train` and then `pyinfra detect` find in the folder's
    frames."""
    recipe = ROOT / "configs/detectors/background.yaml"
    assert main.main(["train", str(recipe), str(folder), "--out", str(out), *words]) == 0
    predictions = out / "predictions"
    assert main.main(["detect", str(folder), "--model", str(out), "--out", str(predictions)]) == 0
    files = sorted(predictions.glob("*.txt"))
    return np.concatenate([kitti.read_labels(file, scores=True).boxes[:, 1] for file in files])


@pytest.mark.parametrize("known_by", ["nothing", "roads.csv", "--region"])
def test_train_takes_the_region_from_the_roads_or_a_file_or_says_that_there_is_none(
    recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], known_by: str
) -> None:
    words = []
    if known_by == "roads.csv":
        write_roads(recording.parent, half_width=6.0)
    elif known_by == "--region":
        outline(tmp_path)
        words = ["--region", str(tmp_path / "region.yaml")]
    y = centres_y(recording, tmp_path / "run", *words)
    refused = "background: pole: no roads.csv and no --region" in capsys.readouterr().err
    assert refused == (known_by == "nothing")
    assert (np.abs(y - 3) < 1).sum() >= 10
    assert (y > HEDGE_Y_M - 2).any() == (known_by == "nothing")


def test_a_height_or_region_for_what_learnt_its_own_is_an_error(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    for name in ("background.npz", "cloud.bin"):
        (tmp_path / name).touch()
    words = ["detect", str(tmp_path / "cloud.bin"), "--model", str(tmp_path), "--height-m", "6"]
    assert main.main(words) == 2
    assert "--height-m: expected no value for a background model" in capsys.readouterr().err


def test_a_region_for_another_detector_is_an_error(
    recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    recipe, file = ROOT / "configs/detectors/pointpillars.yaml", tmp_path / "region.yaml"
    words = [str(recording), "--out", str(tmp_path / "run"), "--region", str(file)]
    assert main.main(["train", str(recipe), *words]) == 2
    assert "--region: expected no file for pointpillars" in capsys.readouterr().err
