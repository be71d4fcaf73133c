"""Folders of clouds without labels are imported and detected; problems are reported or refused. The
clouds are simulated."""

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml
from scipy.spatial.transform import Rotation

import pyinfra as pi
from pyinfra.cli import main
from pyinfra.core.errors import FormatError
from pyinfra.dataset.ground import ground_of, shape_heights
from pyinfra.dataset.object_rows import BOX
from pyinfra.dataset.road_plane import find_plane
from pyinfra.exchange.data_set import LidarFacts
from pyinfra.exchange.imports import import_recording, warnings
from pyinfra.exchange.name_times import times_in
from pyinfra.exchange.pose_estimation import UPS
from pyinfra.exchange.recording import Options, sorted_files, stem
from pyinfra.formats import kitti
from pyinfra.formats.pcd_file import write_pcd

FACTS = LidarFacts("pole", "junction")
HEIGHT_M = 6.0
HALF_ROAD_M = 16.0
LIDARS = ("livox_avia", "helios_16", "ruby_plus")
Clouds = list[np.ndarray]


@pytest.fixture(scope="module")
def site(
    infrasim: Callable[..., object],
    run_command: Callable[..., list[str]],
    tmp_path_factory: pytest.TempPathFactory,
) -> Path:
    """Simulates 20 frames in 20 s on a motorway. The road lies 6 m below the three LiDARs."""
    out = tmp_path_factory.mktemp("site") / "data"
    words = run_command(*LIDARS, frames="0:200:10", preset="datasheet", out=out)
    infrasim(*words, check=True)
    return out


def clouds_of(site: Path, lidar: str) -> Clouds:
    folder = site / lidar
    files = [kitti.frame_file(folder, "velodyne", k) for k in kitti.frames(folder)]
    return [kitti.read_points(file) for file in files]


def with_positions(clouds: Clouds, change: Callable[[np.ndarray], np.ndarray]) -> Clouds:
    return [np.column_stack([change(c[:, :3].astype(np.float64)), c[:, 3]]) for c in clouds]


def write(folder: Path, clouds: Clouds, names: list[str] | None = None) -> Path:
    """Writes the clouds as .bin files."""
    folder.mkdir()
    for i, cloud in enumerate(clouds):
        name = names[i] if names else f"cloud_{i}"
        cloud.astype("<f4").tofile(folder / f"{name}.bin")
    return folder


def taken(source: Path, **options: object) -> tuple[Path, str]:
    """Imports .bin files. Returns the folder, and the text of all assumptions and warnings."""
    out = source.parent / f"in_{source.name}/pole"
    summary, labelled = import_recording(source, "bin", out, FACTS, Options(), **options)
    return out, "\n".join([*summary.assumed, *warnings(summary, labelled)])


def road_at(folder: Path) -> float:
    """Returns z of the road in the levelled frame, estimated from the written frames."""
    plane = find_plane([kitti.read_points(f) for f in (folder / "training/velodyne").iterdir()])
    assert plane is not None
    assert np.degrees(plane.tilt) == pytest.approx((0, 0), abs=0.15)
    return -plane.height_m


# --- the road


@pytest.mark.parametrize("lidar", LIDARS)
def test_the_road_of_a_leaning_sensor_is_detected(site: Path, lidar: str, tmp_path: Path) -> None:
    lean = Rotation.from_euler("ZYX", [0, math.radians(12), math.radians(-4)]).as_matrix()
    # rotation T_sensor_levelled
    clouds = with_positions(clouds_of(site, lidar), lambda p: p @ lean)
    folder, text = taken(write(tmp_path / "source", clouds))
    assert road_at(folder) == pytest.approx(-HEIGHT_M, abs=0.03)
    tilt = kitti.read_tilt(folder)
    assert np.degrees([tilt.pitch, tilt.roll]) == pytest.approx([12, -4], abs=0.1)
    assert kitti.read_lidar(folder).T_world_levelled.z == pytest.approx(HEIGHT_M, abs=0.03)
    assert "the road is 6.0" in text or "the road is 5.9" in text
    assert yaml.safe_load((folder / "lidar.yaml").read_text())["assumed"] == text.splitlines()[:3]
    assert (
        text.splitlines()[2] == "no times are known, so the time between frames is set to 0.1 s; "
        "`period_s` sets another time"
    )


def test_a_viewpoint_turns_clouds_and_the_sensor_stays_the_origin(
    site: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The VIEWPOINT contains the tilt, the direction and the position of the sensor, which is 6 m
    above the road."""
    turn = Rotation.from_euler("ZYX", [40, 12, -4], degrees=True)
    shift = np.array([120.0, -50, HEIGHT_M])
    level = with_positions(
        clouds_of(site, "ruby_plus")[::4], Rotation.from_euler("z", 40, True).apply
    )
    clouds = with_positions(level, turn.inv().apply)
    clouds[0][5, :3] = 0  # 0 0 0 means no return
    source = tmp_path / "source"
    source.mkdir()
    x, y, z, w = turn.as_quat()
    viewpoint = "VIEWPOINT " + " ".join(f"{v:.9f}" for v in (*shift, w, x, y, z))
    for i, cloud in enumerate(clouds):
        kind = [(field, "<f4") for field in ("x", "y", "z", "intensity")]
        write_pcd(source / f"{i}.pcd", np.rec.fromarrays(cloud.T, dtype=kind))
        data = (source / f"{i}.pcd").read_bytes()
        (source / f"{i}.pcd").write_bytes(
            data.replace(b"VIEWPOINT 0 0 0 1 0 0 0", viewpoint.encode())
        )
    summary, _ = import_recording(source, "pcd", tmp_path / "in/pole", FACTS, Options())
    text = "\n".join(summary.assumed)
    assert "VIEWPOINT of 5 of 5 clouds: points are turned by 42.27 degrees" in text
    assert "the sensor becomes the origin: points are moved back by (120, -50, 6) m" in text
    assert summary.without_return == 1
    assert road_at(tmp_path / "in/pole") == pytest.approx(-HEIGHT_M, abs=0.03)
    last = kitti.read_points(kitti.frame_file(tmp_path / "in/pole", "velodyne", 4))
    # the tolerance is the noise of the road
    assert np.abs(last[:, :3] - level[4][:, :3]).max() < 0.2
    summary, _ = import_recording(
        source, "pcd", tmp_path / "as_is/pole", FACTS, Options(), upright="as-is"
    )
    placed = kitti.read_points(kitti.frame_file(tmp_path / "as_is/pole", "velodyne", 4))
    assert placed[:, :3] == pytest.approx(level[4][:, :3] + shift, abs=1e-3)
    assert summary.without_return == 1
    capsys.readouterr()
    words = ["detect", "--model", "generalist", str(source / "4.pcd"), "--height-m", "6"]
    assert main.main(words) == 0
    warned = capsys.readouterr().err
    assert "is ignored because the sensor is the origin" in warned
    assert "the road in the clouds is" not in warned


@pytest.mark.parametrize(
    ("lidar", "up"),
    [*(("helios_16", up) for up in UPS), ("livox_avia", "y down"), ("ruby_plus", "z down")],
)
def test_any_axis_may_be_up(site: Path, lidar: str, up: str, tmp_path: Path) -> None:
    clouds = with_positions(
        clouds_of(site, lidar), lambda p: p @ np.array(UPS[up], dtype=np.float64)
    )
    folder, text = taken(write(tmp_path / "source", clouds))
    assert road_at(folder) == pytest.approx(-HEIGHT_M, abs=0.03)
    assert (f"{up}: points are turned so that z is up" in text) == (up != "z up")
    first = kitti.read_points(kitti.frame_file(folder, "velodyne", 0))
    truth = clouds_of(site, lidar)[0]
    # the rotation is undone, except for a tilt that the noise of the road hides
    assert np.abs(first - truth).max() < 0.6


@pytest.mark.parametrize("turn", list(UPS.values()))
def test_turns_to_upright_axes_mirror_nothing(turn: list[list[int]]) -> None:
    assert np.linalg.det(np.array(turn)) == 1


@pytest.mark.parametrize(
    ("lidar", "lower_m"),
    [
        ("livox_avia", 0.5),
        ("livox_avia", 1),
        ("helios_16", 0.5),
        ("helios_16", 2),
        ("ruby_plus", 1),
    ],
)
def test_a_field_beside_the_road_is_not_taken_for_it(
    site: Path, lidar: str, lower_m: float
) -> None:
    """The field is larger than the road and also flat."""

    def sunk(xyz: np.ndarray) -> np.ndarray:
        field = np.abs(xyz[:, 1]) > HALF_ROAD_M
        return xyz - np.outer(field * lower_m, [0, 0, 1])

    plane = find_plane(with_positions(clouds_of(site, lidar), sunk))
    assert plane is not None
    assert plane.height_m == pytest.approx(HEIGHT_M, abs=0.03)
    assert np.degrees(plane.tilt) == pytest.approx((0, 0), abs=0.15)


@pytest.mark.parametrize("slope", [0.014, 0.02, 0.028])
def test_a_crowned_road_is_levelled_evenly(site: Path, slope: float) -> None:
    """The sensor is four metres to the right of the crown, where the road falls to the right."""

    def crowned(xyz: np.ndarray) -> np.ndarray:
        aside = np.minimum(np.abs(xyz[:, 1] - 4), HALF_ROAD_M)
        return xyz - np.outer(slope * aside, [0, 0, 1])

    plane = find_plane(with_positions(clouds_of(site, "livox_avia"), crowned))
    assert plane is not None
    assert plane.crown == pytest.approx(slope, abs=0.003)
    # one side of the road alone would give 0.8 to 1.6 degrees
    assert np.degrees(plane.tilt) == pytest.approx((0, 0), abs=0.25)
    assert plane.residual_m < 0.03


@pytest.mark.parametrize("lidar", ["livox_avia", "ruby_plus"])
def test_the_road_over_a_crest_is_followed(site: Path, lidar: str, tmp_path: Path) -> None:
    """The crest has a radius of 1,500 m, so the road is 1.2 m lower at a distance of 60 m."""

    def bent(xyz: np.ndarray) -> np.ndarray:
        return xyz - np.outer(xyz[:, 0] ** 2 / 3000, [0, 0, 1])

    folder, text = taken(write(tmp_path / "source", with_positions(clouds_of(site, lidar), bent)))
    assert "the road is not a plane: its height profile is used up to 60 m" in text
    # tilt of a sensor that looks in one direction, relative to the mean slope there
    tilt = kitti.read_tilt(folder)
    positions = np.array([[10.0, -6], [30, -6], [55, -6], [55, 6]])
    road = -HEIGHT_M - positions[:, 0] ** 2 / 3000 + np.tan(tilt.pitch) * -positions[:, 0]
    ground = ground_of(folder)
    assert ground is not None
    np.testing.assert_allclose(ground.height(positions), road, atol=0.15)


def test_a_level_road_stays_a_plane(site: Path, tmp_path: Path) -> None:
    folder, text = taken(write(tmp_path / "source", clouds_of(site, "ruby_plus")))
    assert "no plane" not in text
    assert kitti.read_road_shape(folder) is None


def test_a_shape_that_is_no_number_is_named(site: Path, tmp_path: Path) -> None:
    folder, _ = taken(write(tmp_path / "source", clouds_of(site, "helios_16")))
    file = folder / "lidar.yaml"
    file.write_text(file.read_text() + "road_shape: {level_m: -6, slope_x: steep}\n")
    with pytest.raises(
        FormatError, match=r"lidar\.yaml:\d+: road_shape\.slope_x: expected a number, got 'steep'"
    ):
        ground_of(folder)


def test_a_road_is_straight_on_where_nobody_looked() -> None:
    shape = kitti.RoadShape(-6, 0.01, -0.02, -3e-4, 1e-4, 2e-4)
    x, y = 30.0, -40.0
    expected = -6 + 0.01 * x - 0.02 * y - 3e-4 * x**2 + 1e-4 * x * y + 2e-4 * y**2
    assert shape_heights(shape, np.array([[x, y]])) == pytest.approx(expected)
    near, mid, far = shape_heights(shape, np.outer([1.2, 1.7, 2.2], [48.0, 36.0]))
    assert far - mid == pytest.approx(mid - near)


def test_the_plane_near_the_height_that_is_given(site: Path, tmp_path: Path) -> None:
    source = write(tmp_path / "source", clouds_of(site, "helios_16"))
    facts = LidarFacts("pole", "junction", height_m=6.3)
    import_recording(source, "bin", tmp_path / "in/pole", facts, Options())
    pose = kitti.read_lidar(tmp_path / "in/pole").T_world_levelled
    assert pose.z == pytest.approx(HEIGHT_M, abs=0.03)


# --- what is wrong, and what is made of it


def test_a_wrong_height_is_refused(site: Path, tmp_path: Path) -> None:
    source = write(tmp_path / "source", clouds_of(site, "helios_16"))
    facts = LidarFacts("pole", "junction", height_m=9)
    with pytest.raises(
        ValueError,
        match=r"source: height_m: expected a height .* (6\.0|5\.9)\d m, got 9 m; ",
    ):
        import_recording(source, "bin", tmp_path / "in/pole", facts, Options())
    assert not (tmp_path / "in/pole").exists()


def test_a_wrong_height_of_a_lone_cloud_is_reported(
    site: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    clouds, lean = clouds_of(site, "ruby_plus")[:1], Rotation.from_euler("y", math.radians(2))
    words = [
        "detect",
        "--model",
        "generalist",
        str(write(tmp_path / "as_is", clouds) / "cloud_0.bin"),
    ]
    assert main.main([*words, "--height-m", "6.1"]) == 0
    assert "the road in the clouds" not in capsys.readouterr().err
    assert main.main([*words, "--height-m", "5.5"]) == 0
    assert (
        "--height-m is 5.5 m, but the road in the clouds is 6.00 m below" in capsys.readouterr().err
    )
    leaning = with_positions(clouds, lean.apply)
    words[-1] = str(write(tmp_path / "leaning", leaning) / "cloud_0.bin")
    assert main.main([*words, "--height-m", "6"]) == 0
    assert "the sensor is tilted by 2.0 degrees relative to the road" in capsys.readouterr().err


@pytest.mark.parametrize("up", ["z up", "z down"])
def test_clouds_at_road_level_need_the_height(site: Path, up: str, tmp_path: Path) -> None:
    turn = np.array(UPS[up], dtype=np.float64)
    clouds = with_positions(
        clouds_of(site, "helios_16"), lambda p: np.add(p, (0, 0, HEIGHT_M)) @ turn
    )
    source = write(tmp_path / "source", clouds)
    with pytest.raises(ValueError, match=r"expected the road .*, got -?0\.0\d m; "):
        taken(source)
    facts = LidarFacts("pole", "junction", height_m=HEIGHT_M)
    summary, _ = import_recording(source, "bin", tmp_path / "in/pole", facts, Options())
    assert road_at(tmp_path / "in/pole") == pytest.approx(-HEIGHT_M, abs=0.03)
    assert any("moved down by" in line for line in summary.assumed)


def test_millimetres_are_metres_afterwards(site: Path, tmp_path: Path) -> None:
    clouds = with_positions(clouds_of(site, "livox_avia"), lambda p: p * 1000)
    folder, text = taken(write(tmp_path / "source", clouds))
    assert "coordinates are millimetres: divided by 1000" in text
    assert road_at(folder) == pytest.approx(-HEIGHT_M, abs=0.03)


def test_other_units_are_refused_and_can_be_given(site: Path, tmp_path: Path) -> None:
    clouds = with_positions(clouds_of(site, "helios_16"), lambda p: p * 30)
    source = write(tmp_path / "source", clouds)
    with pytest.raises(ValueError, match=r"expected a median range .* `unit_m`"):
        taken(source)
    import_recording(source, "bin", tmp_path / "in/pole", FACTS, Options(unit_m=1 / 30))
    assert road_at(tmp_path / "in/pole") == pytest.approx(-HEIGHT_M, abs=0.03)


@pytest.mark.parametrize(("most", "divisor"), [(1, None), (255, "255"), (65535, "65535")])
def test_intensities_become_shares(
    site: Path, most: int, divisor: str | None, tmp_path: Path
) -> None:
    clouds = clouds_of(site, "helios_16")
    scaled = [np.column_stack([c[:, :3], c[:, 3] / c[:, 3].max() * most]) for c in clouds]
    folder, text = taken(write(tmp_path / "source", scaled))
    first = kitti.read_points(kitti.frame_file(folder, "velodyne", 0))
    assert first[:, 3].max() == pytest.approx(1)
    assert (f"divided by {divisor}" in text) == (divisor is not None)


def test_points_without_a_place_or_intensity(site: Path, tmp_path: Path) -> None:
    clouds = clouds_of(site, "helios_16")
    clouds[0][:7, 1] = np.nan
    clouds[1][:5, 3] = np.nan
    clouds[2] = np.zeros((9, 4), dtype=np.float32)
    folder, text = taken(write(tmp_path / "source", clouds))
    assert "removed 16 points without a return" in text
    assert "set 5 intensities to 0, which were not finite" in text
    assert "1 frame (cloud_2) without a return" in text
    assert len(kitti.read_points(kitti.frame_file(folder, "velodyne", 2))) == 0


def test_doubled_frames_are_left_out(site: Path, tmp_path: Path) -> None:
    clouds = clouds_of(site, "helios_16")[:6]
    folder, text = taken(write(tmp_path / "source", [*clouds[:4], clouds[3], *clouds[4:]]))
    assert "1 frame (cloud_4) with the same points as another frame: left out" in text
    assert kitti.frames(folder) == [0, 1, 2, 3, 5, 6]


def test_no_road_is_reported(tmp_path: Path) -> None:
    draw = np.random.default_rng(1)
    clouds = [draw.uniform(-30, 30, (4000, 4)) % 30 + [0, 0, 1, 0] for _ in range(3)]
    _, text = taken(write(tmp_path / "source", clouds))
    assert "no road was found: points are not turned" in text


# --- regions


def outline(tmp_path: Path, corners: str) -> Path:
    file = tmp_path / "outline.yaml"
    file.write_text(f"outline_m: {corners}\n")
    return file


def test_an_outline_goes_with_the_frames(site: Path, tmp_path: Path) -> None:
    from pyinfra.models.training.sources import read_source

    source = write(tmp_path / "source", clouds_of(site, "helios_16"))
    file = outline(tmp_path, "[[-60, -16], [60, -16], [60, 16], [-60, 16]]")
    folder, _ = taken(source, region=file)
    region = read_source(folder, "quick").region
    assert region is not None
    assert region.holds(np.array([[50.0, 15, 0], [50, 18, 0]]), 0.0).tolist() == [True, False]


def test_an_empty_region_is_refused(site: Path, tmp_path: Path) -> None:
    source = write(tmp_path / "source", clouds_of(site, "helios_16"))
    far = outline(tmp_path, "[[900, 900], [960, 900], [960, 960]]")
    with pytest.raises(ValueError, match=r"outline_m: expected .*, got none in"):
        taken(source, region=far)
    assert not (tmp_path / "in_source/pole").exists()


# --- clocks

START = 1_651_673_050.0


def names_at(times: list[float]) -> list[str]:
    return [f"{START + t:.6f}" for t in times]


@pytest.mark.parametrize(
    ("name", "seconds"),
    [
        ("1651673050.454284", 1651673050.454284),
        ("1651673050_454284855_south", 1651673050.454284855),
        ("1651673050_454", 1651673050.454),
        ("1651673050454", 1651673050.454),
        ("lidar_1651673050454284855", 1651673050.454284855),
        ("1651673050", 1651673050.0),
        ("000123", None),
        ("frame_16516730501", None),
        ("0000000007", None),  # a frame of KITTI's raw data
        ("0000000000123", None),
    ],
)
def test_names_that_are_times(name: str, seconds: float | None) -> None:
    times = times_in([name])
    assert (None if times is None else times[0]) == (pytest.approx(seconds) if seconds else None)


@pytest.mark.parametrize("separator", [".", "_", "-", ""])
@pytest.mark.parametrize("padded", [True, False])
def test_fractions_may_lack_their_zeros(separator: str, padded: bool, tmp_path: Path) -> None:
    expected = START + 0.1 * np.arange(25) + 0.003
    whole = np.floor(expected).astype(int)
    nanoseconds = np.round((expected - whole) * 1e9).astype(int) + 1  # no zero at the end
    names = [
        f"{s}{separator}{n:09d}" if padded else f"{s}{separator}{n}"
        for s, n in zip(whole, nanoseconds, strict=True)
    ]
    times = times_in(names)
    assert times is not None
    np.testing.assert_allclose(times - START, expected - START, atol=1e-6)
    for name in names[::-1]:
        (tmp_path / f"{name}.bin").touch()
    assert [stem(file) for file in sorted_files(tmp_path, [".bin"])] == names


def test_times_without_trailing_zeros_are_decimals() -> None:
    times = [START + t for t in (0.1, 0.15, 0.2, 0.25, 0.3, 0.354284)]
    np.testing.assert_allclose(times_in([str(time) for time in times]), times)


def test_the_period_is_that_of_the_clock(site: Path, tmp_path: Path) -> None:
    clouds = clouds_of(site, "helios_16")
    folder, _ = taken(write(tmp_path / "source", clouds, names_at([0.05 * i for i in range(20)])))
    assert kitti.read_lidar(folder).period_s == pytest.approx(0.05)
    assert kitti.frames(folder) == list(range(20))


def test_a_jump_of_the_clock_leaves_numbers_out(site: Path, tmp_path: Path) -> None:
    clouds = clouds_of(site, "helios_16")[:6]
    times = [0, 0.1, 0.2, 3.2, 3.3, 3.4]
    folder, text = taken(write(tmp_path / "source", clouds, names_at(times)))
    assert "missing at 1 places, and the longest gap is 3 s after 1651673050.200000" in text
    assert kitti.frames(folder) == [0, 1, 2, 32, 33, 34]


@pytest.mark.parametrize(
    "names",
    [
        ["0.05", "0.1", "0.15", "0.2", "1.0", "1.05"],
        ["7.98_left", "8_left", "8.02_left"],
        ["a.1.9.1", "a.1.9.2", "a.1.10.1"],
        ["1.9", "1.10", "1.11"],
        ["2", "10", "10b"],
    ],
)
def test_files_are_in_the_order_of_their_numbers(names: list[str], tmp_path: Path) -> None:
    for name in reversed(names):
        (tmp_path / f"{name}.bin").touch()
    assert [stem(file) for file in sorted_files(tmp_path, [".bin"])] == names


def test_times_without_trailing_zeros_may_have_a_gap(site: Path, tmp_path: Path) -> None:
    clouds = clouds_of(site, "helios_16")[:5]
    names = [str(START + t) for t in (0.1, 0.15, 0.2, 0.35, 0.4)]
    folder, text = taken(write(tmp_path / "source", clouds, names))
    assert kitti.read_lidar(folder).period_s == 0.05
    assert kitti.frames(folder) == [0, 1, 2, 5, 6]
    assert "steps back" not in text


def test_frame_numbers_with_many_zeros_are_no_times(site: Path, tmp_path: Path) -> None:
    clouds = clouds_of(site, "helios_16")[:4]
    names = [f"{number:010d}" for number in (3, 4, 5, 9)]
    folder, _ = taken(write(tmp_path / "source", clouds, names))
    assert kitti.read_lidar(folder).period_s == 0.1
    assert kitti.frames(folder) == [3, 4, 5, 9]


def test_a_period_without_a_usable_clock_is_reported(site: Path, tmp_path: Path) -> None:
    clouds = clouds_of(site, "helios_16")[:4]
    folder, text = taken(write(tmp_path / "source", clouds, names_at([0, 120, 240, 360])))
    assert "the median step of the clock is 120 s" in text
    assert "the time between frames is set to 0.1 s" in text
    assert kitti.read_lidar(folder).period_s == 0.1


def test_a_gap_between_numbered_names_is_reported(site: Path, tmp_path: Path) -> None:
    clouds = clouds_of(site, "helios_16")[:4]
    names = ["cloud_8", "cloud_9", "cloud_13", "cloud_14"]
    folder, text = taken(write(tmp_path / "source", clouds, names))
    assert "frames are missing at 1 places, such as after cloud_9" in text
    assert kitti.frames(folder) == [0, 1, 2, 3]


def write_stamped(folder: Path, clouds: Clouds, times: list[float]) -> Path:
    """Writes .pcd files whose points have the time of their frame."""
    folder.mkdir()
    kind = [(name, "<f4") for name in ("x", "y", "z", "intensity")] + [("timestamp", "<f8")]
    for i, (cloud, time) in enumerate(zip(clouds, times, strict=True)):
        records = np.zeros(len(cloud), dtype=kind)
        for column, name in enumerate(("x", "y", "z", "intensity")):
            records[name] = cloud[:, column]
        records["timestamp"] = START + time
        write_pcd(folder / f"{i:06d}.pcd", records)
    return folder


def test_frames_out_of_order_are_sorted(site: Path, tmp_path: Path) -> None:
    clouds = clouds_of(site, "helios_16")[:5]
    source = write_stamped(tmp_path / "source", clouds, [0, 0.1, 0.3, 0.2, 0.4])
    summary, _ = import_recording(source, "pcd", tmp_path / "in/pole", FACTS, Options())
    assert any("out of order (1 frames" in line for line in summary.assumed)
    rows = (tmp_path / "in/pole/sources.csv").read_text().splitlines()[1:]
    assert rows == ["0,000000", "1,000001", "2,000003", "3,000002", "4,000004"]


def test_a_clock_that_steps_back_is_not_used(site: Path, tmp_path: Path) -> None:
    clouds = clouds_of(site, "helios_16")[:5]
    source = write_stamped(tmp_path / "source", clouds, [90, 90.1, 0.2, 0.3, 0.4])
    summary, _ = import_recording(source, "pcd", tmp_path / "in/pole", FACTS, Options())
    assert any("the clock steps back by 89.9 s after 000001" in line for line in summary.assumed)
    assert kitti.read_lidar(tmp_path / "in/pole").period_s == 0.1
    assert kitti.frames(tmp_path / "in/pole") == [0, 1, 2, 3, 4]


def test_times_are_those_of_the_names_where_clouds_have_none(site: Path, tmp_path: Path) -> None:
    source, clouds = tmp_path / "source", clouds_of(site, "helios_16")[:4]
    source.mkdir()
    for name, cloud in zip(names_at([0, 0.5, 1, 1.5]), clouds, strict=True):
        kind = [(field, "<f4") for field in ("x", "y", "z", "intensity")]
        write_pcd(source / f"{name}.PCD", np.rec.fromarrays(cloud.T, dtype=kind))
    summary, _ = import_recording(source, "pcd", tmp_path / "in/pole", FACTS, Options())
    assert kitti.read_lidar(tmp_path / "in/pole").period_s == 0.5
    assert not any("no times are known" in line for line in summary.assumed)


def test_one_cloud_without_a_time_is_reported(site: Path, tmp_path: Path) -> None:
    clouds = clouds_of(site, "helios_16")[:5]
    source = write_stamped(tmp_path / "source", [clouds[0][:0], *clouds[1:]], [0, 1, 2, 3, 4])
    summary, _ = import_recording(source, "pcd", tmp_path / "in/pole", FACTS, Options())
    text = "1 of 5 frames, such as 000000, have no time: the times of the other frames are not used"
    assert text in summary.assumed
    assert kitti.read_lidar(tmp_path / "in/pole").period_s == 0.1


def test_a_few_unknown_times_are_interpolated(site: Path, tmp_path: Path) -> None:
    clouds = clouds_of(site, "helios_16")[:11]
    clouds[4] = clouds[4][:0]
    times = [0.5 * i for i in range(11)]
    source = write_stamped(tmp_path / "source", clouds, times)
    summary, _ = import_recording(source, "pcd", tmp_path / "in/pole", FACTS, Options())
    assert any("such as 000004, have no time: it is interpolated" in t for t in summary.assumed)
    assert kitti.read_lidar(tmp_path / "in/pole").period_s == 0.5
    assert kitti.frames(tmp_path / "in/pole") == list(range(11))


@pytest.mark.parametrize("columns", [4, 5])
def test_a_cut_cloud_changes_nothing_for_the_others(
    site: Path, columns: int, tmp_path: Path
) -> None:
    clouds = clouds_of(site, "helios_16")[:11]
    wide = [np.column_stack([c, *[np.arange(len(c)) % 16] * (columns - 4)]) for c in clouds]
    source = write(tmp_path / "source", wide, names_at([0.1 * i for i in range(11)]))
    cut = sorted(source.iterdir())[5]
    cut.write_bytes(cut.read_bytes()[:-7])
    region = outline(tmp_path, "[[-90, -16], [90, -16], [90, 16], [-90, 16]]")
    with pytest.raises(FormatError, match=f"{cut.name}: expected a multiple of {4 * columns} b"):
        taken(source, region=region)
    folder, text = taken(source, region=region, skip_bad=True)
    assert "left out 1 frames that cannot be read" in text
    assert kitti.frames(folder) == [0, 1, 2, 3, 4, 6, 7, 8, 9, 10]


@pytest.mark.parametrize(("unit_m", "away_m"), [(0.01, 0.0), (1.0, 4e6)])
def test_what_is_no_millimetre_either_is_refused(
    site: Path, unit_m: float, away_m: float, tmp_path: Path
) -> None:
    clouds = with_positions(
        clouds_of(site, "helios_16"), lambda p: np.add(p, (away_m, 0, 0)) / unit_m
    )
    source = write(tmp_path / "source", clouds)
    facts = LidarFacts("pole", "junction", height_m=HEIGHT_M)
    with pytest.raises(
        ValueError, match=r"source: expected the road .*millimetres.* `unit_m` sets"
    ):
        import_recording(source, "bin", tmp_path / "in/pole", facts, Options())
    if unit_m != 1:
        summary, _ = import_recording(
            source, "bin", tmp_path / "in/pole", facts, Options(unit_m=unit_m)
        )
        assert summary.assumed[0].startswith("the road is 6.0")


# --- at once


def test_boxes_and_a_view_follow_at_once(
    site: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = write(tmp_path / "source", clouds_of(site, "ruby_plus"))
    data, run = tmp_path / "data/site/pole", tmp_path / "run"
    recipe = Path("configs/detectors/background.yaml").resolve()
    for words in (
        ["import", source, "--from", "bin", "--out", data],
        ["train", recipe, data, "--out", run],
        ["detect", data, "--model", run, "--out", run / "predictions"],
        ["pictures", data.parent, "--out", tmp_path / "pictures"],
        ["view", data, "--pred", run / "predictions", "--out", tmp_path / "view.html"],
    ):
        assert main.main([str(word) for word in words]) == 0, words
    # a picture of the LiDAR, and the sheet
    assert len(list((tmp_path / "pictures").iterdir())) == 2
    printed = capsys.readouterr()
    assert "assumed: the road is" in printed.out
    assert "not split" not in printed.err
    labels = [kitti.read_labels(f, scores=True) for f in (run / "predictions").glob("*.txt")]
    assert sum(map(len, labels)) > 100


# --- clouds outside any data set, as `pyinfra detect` takes them


def detected(capsys: pytest.CaptureFixture[str], cloud: Path) -> tuple[list[str], np.ndarray, str]:
    """Detects objects in a single cloud. Returns classes, boxes with scores (n, 8) and the printed
    remarks."""
    capsys.readouterr()
    words = ["detect", "--model", "generalist", str(cloud), "--height-m", f"{HEIGHT_M:g}"]
    assert main.main(words) == 0
    printed = capsys.readouterr()
    rows = [line.split(",") for line in printed.out.splitlines()[1:]]
    return [row[1] for row in rows], np.array([row[2:] for row in rows], float), printed.err


def records(cloud: np.ndarray, names: str) -> np.ndarray:
    return np.rec.fromarrays(cloud.T, dtype=[(name, "<f4") for name in names.split()])


@pytest.fixture(scope="module")
def lone(site: Path) -> np.ndarray:
    return clouds_of(site, "ruby_plus")[3].astype("<f4")


def test_boxes_of_a_lone_pcd_are_those_of_its_turned_and_scaled_points(
    lone: np.ndarray, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """VIEWPOINT rotates the points. Its shift is ignored, because boxes are relative to the
    sensor."""
    lone.tofile(tmp_path / "plain.bin")
    names, boxes, said = detected(capsys, tmp_path / "plain.bin")
    assert len(boxes) > 3
    assert "VIEWPOINT" not in said
    turn = Rotation.from_euler("ZYX", [40, 12, -4], degrees=True)
    stored = with_positions([lone], turn.inv().apply)[0]
    stored[:, 3] = np.round(lone[:, 3] * 255)
    stored[7, :3] = 0  # 0 0 0 means no return, like NaN
    stored[8, :3] = np.nan
    x, y, z, w = turn.as_quat()
    for shift in ((0, 0, 0), (120, -50, HEIGHT_M)):
        viewpoint = "VIEWPOINT " + " ".join(f"{v:.9f}" for v in (*shift, w, x, y, z))
        file = tmp_path / "lone.pcd"
        write_pcd(file, records(stored, "x y z Intensity"))
        head = b"VIEWPOINT 0 0 0 1 0 0 0"
        file.write_bytes(file.read_bytes().replace(head, viewpoint.encode()))
        its_names, its_boxes, said = detected(capsys, file)
        assert its_names == names
        assert its_boxes == pytest.approx(boxes, abs=0.05)
        assert "VIEWPOINT of 1 of 1 clouds: points are turned by 42.27 degrees" in said
        assert "the shift ({:g}, {:g}, {:g}) is ignored".format(*shift) in said
        assert "intensities are divided by 255" in said


@pytest.mark.nightly
def test_boxes_of_a_lone_bin_do_not_depend_on_its_columns(
    lone: np.ndarray, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lone.tofile(tmp_path / "four.bin")
    names, boxes, _ = detected(capsys, tmp_path / "four.bin")
    ring = (np.arange(len(lone)) % 128).astype("<f4")
    np.column_stack([lone, ring]).tofile(tmp_path / "five.bin")
    its_names, its_boxes, said = detected(capsys, tmp_path / "five.bin")
    assert (its_names, its_boxes.tolist()) == (names, boxes.tolist())
    assert "a point of a .bin file has 5 float32" in said

    (lone * (1, 1, 1, 0)).astype("<f4").tofile(tmp_path / "dark.bin")
    names, boxes, _ = detected(capsys, tmp_path / "dark.bin")
    np.ascontiguousarray(lone[:, :3]).tofile(tmp_path / "three.bin")
    its_names, its_boxes, said = detected(capsys, tmp_path / "three.bin")
    assert (its_names, its_boxes.tolist()) == (names, boxes.tolist())
    assert "a point of a .bin file has 3 float32" in said
    assert "intensities are set to 0" in said


# --- no region


@pytest.mark.nightly
def test_frames_without_a_region_are_warned_of_once(
    site: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Frames with roads or an outline are not; nor are detectors that know their region."""
    folder, _ = taken(write(tmp_path / "source", clouds_of(site, "helios_16")))
    outline = tmp_path / "outline.yaml"
    outline.write_text("outline_m: [[-90, -16], [90, -16], [90, 16], [-90, 16]]\n")
    words = ["--model", "generalist", "--max-frames", "2", "--out"]
    capsys.readouterr()
    assert main.main(["detect", str(folder), *words, str(tmp_path / "boxes")]) == 0
    lines = [line for line in capsys.readouterr().err.splitlines() if "region" in line]
    assert len(lines) == 1
    assert "boxes off the road are kept" in lines[0]
    assert f"pyinfra region {folder} --out" in lines[0]
    for data, more in ((folder, ["--region", str(outline)]), (site / "helios_16", [])):
        boxes = str(tmp_path / f"boxes_{data.name}")
        assert main.main(["detect", str(data), *words, boxes, *more]) == 0
        assert "region" not in capsys.readouterr().err
    cloud = str(kitti.frame_file(folder, "velodyne", 0))
    for more, lines_of_region in (([], 1), (["--region", str(outline)], 0)):
        lone = ["detect", cloud, "--model", "generalist", "--height-m", "6", *more]
        assert main.main(lone) == 0
        assert capsys.readouterr().err.count("region") == 2 * lines_of_region
    frames = pi.load_dataset(folder)[:2]
    with pytest.warns(UserWarning, match="no region is known") as warned:
        pi.detect("generalist", frames)
    assert len(warned) == 1
    pi.detect("generalist", frames, region=outline)
    pi.detect("generalist", pi.load_dataset(site / "helios_16")[:2])
    pi.detect(lambda _: pd.DataFrame(columns=BOX), frames)
    pi.detect(pi.train("background", folder, work=tmp_path / "model"), frames)


def test_the_function_warns_like_the_command(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    x, y = np.meshgrid(np.arange(-30.0, 30), np.arange(-30.0, 30))
    cloud = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, -6.0), np.full(x.size, 0.5)])
    source = write(tmp_path / "source", [np.add(cloud, [k / 100, 0, 0, 0]) for k in range(3)])
    with pytest.warns(UserWarning, match="no labels") as caught:
        pi.import_recording(source, "bin", tmp_path / "a/pole", height_m=6)
    assert {one.filename for one in caught} == {__file__}
    out = str(tmp_path / "b/pole")
    words = ["import", str(source), "--from", "bin", "--out", out, "--height-m", "6"]
    assert main.main(words) == 0
    printed = capsys.readouterr().err.splitlines()
    assert [f"pyinfra: warning: {one.message}" for one in caught] == printed
