"""Scanning statistics: tables with known answers, hand-made folders, and a small real run."""

import argparse
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from pyinfra.cli import statistics
from pyinfra.core.errors import FormatError
from pyinfra.dataset.data_set import Tilt, field_of_view_mask, read_data_set
from pyinfra.formats import kitti
from pyinfra.formats.csv_table import write_tables
from pyinfra.metrics import scan_patterns, scanning_statistics
from pyinfra.metrics import scanning_tables as statistics_tables
from pyinfra.metrics.intervals import Blocks, block_seconds, interval, ratio, time_blocks
from pyinfra.metrics.observations import Observations, accumulated, ends_of_runs, read_observations

Infrasim = Callable[..., Any]


def table_of(
    distance: list[float], points: list[list[int]], frame: list[int] | None = None, **columns: Any
) -> Observations:
    """Returns vehicles straight ahead that the LiDARs `a`, `b`, ... see, unless columns say
    otherwise."""
    n = len(distance)
    on_vehicle = np.array(points, dtype=np.int64).reshape(n, -1)
    known: dict[str, Any] = {
        "lidars": tuple("abcd"[: on_vehicle.shape[1]]),
        "frame": np.array(frame or [0] * n),
        "ids": np.arange(n),
        "centre": np.stack([distance, np.zeros(n), np.zeros(n)], axis=1),
        "distance": np.array(distance, dtype=np.float64),
        "speed": np.full(n, 10.0),
        "visibility": np.ones(n),
        "points": on_vehicle,
        "points_in_box": on_vehicle,
        "in_angles": np.ones(on_vehicle.shape, dtype=np.bool_),
        "in_range": np.ones(on_vehicle.shape, dtype=np.bool_),
    }
    return Observations(**{**known, **columns})


def blocks(count: int = 20, block_s: float = 1) -> Blocks:
    """Returns `count` frames, one per second. Each is a separate block."""
    return time_blocks(np.arange(count), 1, block_s=block_s)


def test_points_per_vehicle_counts_missed_vehicles_and_once_more_the_hit_ones_alone() -> None:
    vehicles = table_of([31, 34.9, 35, 120], [[10], [0], [6], [99]])
    table = statistics_tables.points_per_vehicle(vehicles, blocks())
    first, second = table.iloc[0], table.iloc[1]
    assert (first.vehicles, first.apv, first.vehicles_hit, first.apv_hit) == (2, 5, 1, 10)
    assert (second.from_m, second.to_m, second.vehicles, second.apv) == (35, 40, 1, 6)
    assert table.vehicles.sum() == 3
    assert len(table) == 18
    assert table.apv.iloc[2:].isna().all()


def test_quality_classes_end_at_0_4_and_20_points() -> None:
    points = [[0], [1], [4], [5], [20], [21], [400], [0]]
    table = statistics_tables.quality(table_of([30] * 7 + [50], points), blocks())
    first = table[(table.from_m == 30) & (table.to_m == 35)].set_index("quality")
    assert first.share_percent.mul(7 / 100).round(9).to_dict() == {
        "missed": 1,
        "low": 2,
        "medium": 2,
        "high": 2,
        "hit": 6,
    }
    whole = table[(table.to_m == 120) & (table.from_m == 30)].set_index("quality")
    assert whole.vehicles.unique() == [8]
    assert whole.share_percent["missed"] == 25


def test_only_one_looks_far_out_and_at_both_directions() -> None:
    points = [[3, 0, 0], [0, 1, 1], [2, 1, 1], [0, 0, 0], [0, 7, 0], [9, 0, 0]]
    table = statistics_tables.only_one(table_of([90, 95, 95, 99, 110, 60], points), blocks())
    assert table.vehicles.tolist() == [5, 5, 5]
    assert table.hit_alone.tolist() == [1, 1, 0]
    assert table.hit_by_another_only.tolist() == [2, 1, 2]
    assert table.share_percent.tolist() == [20, 20, 0]


def test_decay_of_an_inverse_square_is_2() -> None:
    middle = np.arange(32.5, 120, 5)
    distance = np.repeat(middle, 30)
    points = np.repeat((1e6 / middle**2).astype(int), 30)
    vehicles = table_of(distance.tolist(), points[:, None].tolist())
    row = statistics_tables.decay(vehicles, blocks()).iloc[0]
    assert row.exponent == pytest.approx(2, abs=0.01)
    assert (row.bins, row.vehicles, row.from_m, row.to_m) == (18, 540, 30, 120)


def test_a_decay_is_numpys_weighted_line_with_its_misfit() -> None:
    random = np.random.default_rng(1)
    middle = np.arange(32.5, 120, 5)
    vehicles = random.integers(20, 200, (18, 1)).astype(float)
    points = np.round(vehicles * 1e6 / middle[:, None] ** 1.7 * random.uniform(0.5, 2, (18, 1)))
    sums = np.stack([points, vehicles, vehicles, vehicles * middle[:, None]], axis=-1)
    exponent, r_squared = statistics_tables.decay_lines(sums)
    x, y = np.log(middle), np.log(points / vehicles)[:, 0]
    weight = vehicles[:, 0]
    line = np.polyfit(x, y, 1, w=np.sqrt(weight))
    around = np.average((y - np.average(y, weights=weight)) ** 2, weights=weight)
    left = np.average((y - np.polyval(line, x)) ** 2, weights=weight)
    assert exponent[0] == pytest.approx(-line[0], rel=1e-9)
    assert r_squared[0] == pytest.approx(1 - left / around, rel=1e-9)
    assert 0.2 < r_squared[0] < 0.99


def test_decay_needs_three_bins_of_twenty_vehicles() -> None:
    distance = [32.0] * 20 + [37.0] * 20 + [42.0] * 19
    row = statistics_tables.decay(table_of(distance, [[5]] * 59), blocks()).iloc[0]
    assert math.isnan(row.exponent)
    assert row.bins == 2


def test_speeds_beyond_the_axis_are_counted_in_the_last_row() -> None:
    speed = np.array([0.0, 1.0, 1.0, 30.0])
    table = statistics_tables.speed_distribution(np.array([7, 7, 8, 9]), speed)
    assert table.samples.sum() == 4
    assert (table.samples.iloc[-1], table.vehicles.iloc[-1]) == (1, 1)
    second = table[table.from_km_h == 2].iloc[0]
    assert (second.samples, second.vehicles, second.share_percent) == (2, 2, 50)


def test_aggregation_change_compares_moving_vehicles_of_both_tables() -> None:
    ids = {"ids": np.array([1, 2, 3])}
    before = table_of([40, 40, 40], [[10], [20], [5]], **ids)
    after = table_of(
        [40, 40], [[12], [20]], ids=np.array([1, 2]), points_in_box=np.array([[6], [9]])
    )
    table = statistics_tables.aggregation_change(before, after, blocks()).set_index("counted")
    assert table.vehicles.tolist() == [2, 2]
    assert table.change_percent["points"] == pytest.approx(100 * 2 / 30)
    assert table.change_percent["points_in_box"] == pytest.approx(-50)
    still = table_of([40, 40, 40], [[1], [1], [1]], speed=np.array([0.5, 0, 1.0]), **ids)
    assert statistics_tables.box_points(still, blocks()).vehicles.tolist() == [0]


def test_interval_holds_the_value_and_shrinks_with_the_number_of_blocks() -> None:
    random = np.random.default_rng(3)
    widths = []
    for count in (100, 1600):
        frame = np.arange(count)
        points = random.poisson(20, (count, 1)).tolist()
        table = statistics_tables.points_per_vehicle(
            table_of([32.0] * count, points, frame.tolist(), ids=frame), blocks(count)
        )
        row = table.iloc[0]
        assert row.ci_low < row.apv < row.ci_high
        widths.append(row.ci_high - row.ci_low)
        # The mean of Poisson numbers has an interval of 1.96 standard errors to either side.
        assert widths[-1] == pytest.approx(2 * 1.96 * math.sqrt(20 / count), rel=0.25)
    assert widths[1] < widths[0] / 3


def test_frames_of_one_second_are_resampled_together_and_runs_of_them_in_a_circle() -> None:
    together = time_blocks(np.arange(0, 1000, 5), 0.1, block_s=30, replicates=50)
    assert np.unique(together.slot, return_counts=True)[1].tolist() == [2] * 100
    assert (together.replicates.sum(axis=1) == 100).all()
    # Frame 10 starts at 1.000 s and belongs to the second slot.
    assert together.slot[2] == 1
    assert together.slot[1] == 0
    # Runs of 30, 30, 30 and 10 slots have at most eight starts and ends.
    changes = np.diff(np.pad(together.replicates, ((0, 0), (0, 1)), mode="wrap"), axis=1)
    assert (np.count_nonzero(changes, axis=1) <= 8).all()
    assert (together.replicates.max(axis=1) <= 4).all()
    assert together.count == pytest.approx(100 / 30)


def test_frames_far_apart_are_slots_of_their_own() -> None:
    apart = time_blocks(np.arange(0, 5000, 20), 0.1, block_s=30)
    assert (apart.replicates.shape[1], apart.length) == (250, 15)


def test_too_short_a_time_gives_no_interval() -> None:
    table = statistics_tables.points_per_vehicle(table_of([32], [[5]]), blocks(19, block_s=5))
    assert table.apv[0] == 5
    assert math.isnan(table.ci_low[0])


def test_frames_between_whole_seconds_make_blocks_as_long_as_others() -> None:
    # frames are 2 and 3 slots apart in turn
    apart = time_blocks(np.arange(0, 900, 25), 0.1, block_s=20)
    assert apart.length == 8
    assert len(apart.replicates) > 0


def test_points_add_up_over_frames_one_after_another() -> None:
    frames = [0, 1, 2, 5, 6, 7]
    rows = [(0, 1, 5), (1, 1, 6), (1, 2, 50), (2, 2, 60), (5, 1, 7), (6, 1, 8), (7, 1, 9)]
    frame, ids, points = (list(column) for column in zip(*rows, strict=True))
    every = table_of([10.0] * 7, [[n] for n in points], frame, ids=np.array(ids))
    observations = accumulated(every, frames, 2)
    got = zip(
        observations.frame.tolist(),
        observations.ids.tolist(),
        observations.points[:, 0].tolist(),
        strict=True,
    )
    assert list(got) == [(1, 1, 11), (1, 2, 50), (2, 2, 110), (6, 1, 15), (7, 1, 17)]
    assert ends_of_runs(frames, 3).tolist() == [2, 7]
    assert accumulated(every, frames, 1).points.tolist() == every.points.tolist()
    with pytest.raises(ValueError, match="accumulate: expected 4 consecutive frames, got none"):
        ends_of_runs(frames, 4)


def test_a_block_is_as_long_as_the_vehicle_that_a_look_meets_stays() -> None:
    # One vehicle is present in 30 frames, and three vehicles in 10. At a random time, the present
    # vehicle is the first one in half of the cases.
    ids = np.repeat([1, 2, 3, 4], [30, 10, 10, 10])
    frame = np.concatenate([np.arange(30), *[np.arange(10)] * 3])
    assert block_seconds(frame, ids, 1.5) == 30  # 20 frames take 30 s
    assert block_seconds(frame, ids, 1.55) == 35
    assert block_seconds(frame, ids, 0.5) == 20
    assert block_seconds(frame[:0], ids[:0], 0.5) == 20


def test_an_interval_of_few_blocks_is_wider_as_student_says() -> None:
    drawn = np.random.default_rng(1).normal(50, 1, size=(4000, 1))
    few, many = (
        float(np.diff(np.concatenate(interval(np.array([50.0]), drawn, blocks)))[0])
        for blocks in (5.0, 1e6)
    )
    assert many == pytest.approx(2 * 1.96, rel=0.03)
    assert few == pytest.approx(2 * 2.776 * math.sqrt(5 / 4), rel=0.03)


def test_same_seed_gives_the_same_replicates() -> None:
    assert np.array_equal(blocks().replicates, blocks().replicates)


def test_ratio_to_nothing_is_unknown() -> None:
    assert np.isnan(ratio(np.array([1.0, 4.0]), np.array([0.0, 2.0]))).tolist() == [True, False]


def test_hit_points_is_the_mean_of_the_frames() -> None:
    table = statistics_tables.hit_points({"a": np.arange(20)}, blocks(20))
    assert table.hit_points.tolist() == [9.5]
    assert table.ci_low[0] < 9.5 < table.ci_high[0]


def lidar(*units: kitti.FieldOfView) -> kitti.Lidar:
    pose = kitti.WorldPose(0, 0, 6, 0)
    return kitti.Lidar("a", "A", "paper", (1, 1), 0.1, pose, units)


def unit(yaw_deg: float = 0, half_width_deg: float = 35, reach_m: float = 100) -> kitti.FieldOfView:
    width, height = math.radians(half_width_deg), math.radians(20)
    yaw = math.radians(yaw_deg)
    return kitti.FieldOfView(yaw, 0, (-width, width), (-height, height), (1, reach_m))


def test_field_of_view_has_edges_in_azimuth_elevation_and_range() -> None:
    centres = np.array(
        [
            [50, 0, -5],
            [50, 34, -5],
            [50, 36, -5],
            [-50, 0, -5],
            [10, 0, -5],
            [101, 0, 0],
            [0.5, 0, 0],
        ]
    )
    angles, ranges = field_of_view_mask(lidar(unit()), Tilt(0, 0), centres.astype(np.float64))
    assert angles.tolist() == [True, True, False, False, False, True, True]
    assert ranges.tolist() == [True, True, False, False, False, False, False]


def test_field_of_view_of_a_bundle_is_the_union_and_wraps_behind() -> None:
    behind = np.array([[-50.0, 1.0, 0.0], [-50.0, -1.0, 0.0], [50.0, 0.0, 0.0], [0.0, 50.0, 0.0]])
    both = lidar(unit(), unit(yaw_deg=180))
    assert field_of_view_mask(both, Tilt(0, 0), behind)[1].tolist() == [True, True, True, False]
    around = lidar(unit(half_width_deg=179.9))
    assert field_of_view_mask(around, Tilt(0, 0), np.array([[-50.0, 0.0, 0.0]]))[1].all()


def test_a_sensor_that_looks_down_sees_what_is_below() -> None:
    below = np.array([[10.0, 0.0, -6.0]])  # 31 degrees below the horizon
    assert not field_of_view_mask(lidar(unit()), Tilt(0, 0), below)[1].any()
    assert field_of_view_mask(lidar(unit()), Tilt(math.radians(20), 0), below)[1].all()


def rays(azimuth: list[float], elevation: list[float], time: list[float]) -> scan_patterns.Rays:
    return scan_patterns.Rays(np.array(azimuth), np.array(elevation), np.array(time))


def test_lit_share_counts_cells_between_the_outermost_rays_and_fills_empty_rows() -> None:
    # Cells of 0.28 degrees: columns 0 and 3 in row 0, column 1 in row 2. Row 1 has the extent of
    # row 0.
    three = rays([0.1, 0.9, 0.3], [0.1, 0.1, 0.6], [0.0, 0.1, 0.2])
    table = scan_patterns.lit_share(three, (0.05, 0.15, 1.0))
    assert table.lit_percent.tolist() == pytest.approx([100 / 9, 200 / 9, 300 / 9])


def test_density_of_rays_spread_evenly_over_the_sphere_is_the_same_everywhere() -> None:
    random = np.random.default_rng(1)
    z, azimuth = random.uniform(-1, 1, 2_000_000), random.uniform(-180, 180, 2_000_000)
    even = scan_patterns.Rays(azimuth, np.degrees(np.arcsin(z)), np.zeros(len(z)))
    table = scan_patterns.angular_density(even, 1.0)
    expected = 2_000_000 / (4 * math.pi * math.degrees(1) ** 2)
    assert table.density[5:].mean() == pytest.approx(expected, rel=0.02)
    assert table[table.axis == "elevation"].density.mean() == pytest.approx(expected, rel=0.02)


# A folder as `infrasim run` writes it, with values that a test can compute.

LIDAR_YAML = """\
name: {name}
model: M
preset: paper
price_total_usd: {{low: 1, high: 2}}
label_time: frame
period_s: 0.1
T_world_levelled: {{x_m: 0, y_m: 0, z_m: 6, yaw_deg: 0}}
T_levelled_sensor: {{pitch_deg: 0, roll_deg: 0}}
field_of_view:
  - {{yaw_deg: 0, pitch_deg: 0, azimuth_deg: [-35, 35], elevation_deg: [-30, 15],
     range_m: [0, {reach}]}}
"""


def row(vehicle: int, x: float, points: int, visibility: float = 1) -> str:
    scan = f"{x},0,-5.2,0,0.05,{points}"
    return f"{vehicle},Car,{x},0,-5.2,4,2,1.5,0,15,{points},{points},{abs(x)},{visibility},{scan}"


def write_folder(folder: Path, objects: dict[str, dict[int, list[str]]], reach: int = 100) -> Path:
    """Writes a folder. objects: by LiDAR and frame. Each frame has one point on vehicle 1 and one
    on the road."""
    folder.mkdir()
    (folder / "dataset.yaml").write_text(
        "name: highway\nseed: 1\naggregation: exact\npreset: paper\nversion: 0.1.0\n"
    )
    (folder / "roads.csv").write_text(
        "road,s,x,y,z,heading,half_width\nm,0,0,0,0,0,21\nm,1,1,0,0,0,21\n"
    )
    (folder / "trajectories.csv").write_text(
        "t,id,class,x,y,z,heading,dx,dy,dz,speed\n0,1,Car,0,0,0,0,4,2,1,15\n9,1,Car,0,0,0,0,4,2,1,1\n"
    )
    for name, frames in objects.items():
        for part in ("velodyne", "objects", "fields"):
            (folder / name / "training" / part).mkdir(parents=True)
        (folder / name / "lidar.yaml").write_text(LIDAR_YAML.format(name=name, reach=reach))
        for frame, rows in frames.items():
            where = folder / name
            text = "\n".join([",".join(kitti.OBJECT_COLUMNS), *rows]) + "\n"
            kitti.frame_file(where, "objects", frame).write_text(text)
            points = np.array([[40, 0, -5, 1], [20, 0, -6, 1]], dtype="<f4")
            points.tofile(kitti.frame_file(where, "velodyne", frame))
            fields = np.array([(0, 0, 0, 0, 1), (0, 0, 0, 0, -1)], dtype=kitti.FIELDS)
            fields.tofile(kitti.frame_file(where, "fields", frame))
    return folder


def test_a_vehicle_beyond_one_lidars_reach_is_missed_by_it(tmp_path: Path) -> None:
    folder = write_folder(
        tmp_path / "data",
        {
            "a": {0: [row(1, 40, 9), row(2, 105, 4)], 3: [row(1, 45, 2, -1)]},
            "b": {0: [row(1, 40, 5)], 3: [row(1, 45, 1, -1), row(3, -40, 8)]},
        },
    )
    vehicles = read_observations(read_data_set(folder))
    assert list(zip(vehicles.frame, vehicles.ids, strict=True)) == [(0, 1), (0, 2), (3, 1), (3, 3)]
    assert vehicles.points.tolist() == [[9, 5], [4, 0], [2, 1], [0, 8]]
    assert vehicles.common().tolist() == [True, False, False, False]
    assert vehicles.view().tolist() == [True, True, False, False]


def test_points_at_road_level_can_be_left_out(tmp_path: Path) -> None:
    folder = write_folder(tmp_path / "data", {"a": {0: [row(1, 40, 1), row(2, 60, 0)]}})
    data = read_data_set(folder)
    assert read_observations(data, above_road=True).points.tolist() == [[1], [0]]
    for above_road, count in ((False, 2), (True, 1)):
        tables = scanning_statistics.statistics([folder], above_road=above_road, patterns=False)
        assert tables["hit_points"].hit_points.tolist() == [count]
    roads = folder / "roads.csv"
    roads.write_text(roads.read_text() + "m,2,2,0,0.5,0,21\n")
    with pytest.raises(ValueError, match=r"roads\.csv: expected .*got z from 0 to 0\.5 m"):
        read_observations(data, above_road=True)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("2,1,15", "2,1,fast", ": "),
        ("2,1,15", "2,1,nan", ":2: speed: expected 0 to 1000, got nan"),
        ("2,1,15", "2,1,1e30", r":2: speed: expected 0 to 1000, got 1e\+30"),
        ("2,1,1\n", "2,1,1", ": expected a newline at the end of the last line, got none"),
        ("t,id", "T,id", ": "),
        ("2,1,15", "2,1,15,7,7,7,7,7,7,7", ":2: expected 11 columns, got 18"),
    ],
)
def test_wrong_trajectories_are_named(tmp_path: Path, old: str, new: str, message: str) -> None:
    folder = write_folder(tmp_path / "data", {"a": {0: [row(1, 40, 1)]}})
    file = folder / "trajectories.csv"
    assert old in file.read_text()
    file.write_text(file.read_text().replace(old, new))
    with pytest.raises(FormatError, match=rf"trajectories\.csv{message}"):
        scanning_statistics.speed_table(read_data_set(folder))


def test_an_id_may_be_high(tmp_path: Path) -> None:
    folder = write_folder(tmp_path / "data", {"a": {0: [row(1, 40, 1), row(2**31 - 1, 60, 0)]}})
    assert read_observations(read_data_set(folder), above_road=True).points.tolist() == [[1], [0]]


def test_a_time_at_which_nobody_is_there_has_no_speed(tmp_path: Path) -> None:
    folder = write_folder(tmp_path / "data", {"a": {0: [row(1, 40, 1)]}})
    file = folder / "trajectories.csv"
    file.write_text(file.read_text() + f"9.1{',' * 10}\n")
    assert scanning_statistics.speed_table(read_data_set(folder)).samples.sum() == 1
    file.write_text(file.read_text() + f"9.2,1{',' * 9}-3\n")
    with pytest.raises(FormatError, match=r":5: speed: expected .*got -3"):
        scanning_statistics.speed_table(read_data_set(folder))


def test_speeds_are_those_at_the_frames(tmp_path: Path) -> None:
    folder = write_folder(tmp_path / "data", {"a": {0: [row(1, 40, 1)]}})
    table = scanning_statistics.speed_table(read_data_set(folder))
    assert table.samples.sum() == 1
    assert table[table.from_km_h == 54].samples.tolist() == [1]


def test_different_frames_are_an_error(tmp_path: Path) -> None:
    folder = write_folder(tmp_path / "data", {"a": {0: [], 1: []}, "b": {0: []}})
    with pytest.raises(ValueError, match="got 1 frames of b and 2 of a"):
        read_data_set(folder)


def test_an_empty_folder_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        read_data_set(tmp_path)
    folder = write_folder(tmp_path / "data", {})
    with pytest.raises(ValueError, match=r"data: expected folders with a lidar\.yaml, got none"):
        read_data_set(folder)


def test_frames_without_vehicles_give_tables_without_numbers(tmp_path: Path) -> None:
    folder = write_folder(tmp_path / "data", {"a": {0: [], 1: []}})
    tables = scanning_statistics.statistics([folder], patterns=False)
    assert tables["points_per_vehicle"].vehicles.sum() == 0
    assert tables["points_per_vehicle"].apv.isna().all()
    drawn = {name: tables[name] for name in ("points_per_vehicle", "quality")}
    assert len(write_tables(tmp_path / "out", drawn)) == 2


def test_a_recording_has_no_speeds_and_its_pedestrians_are_no_vehicles(tmp_path: Path) -> None:
    """It has no pattern either, so these tables are left out. The statistics of a run beside it
    have both."""
    rows = [row(1, 40, 9), row(2, 45, 4).replace("Car", "Pedestrian")]
    recording = write_folder(tmp_path / "recording", {"a": {0: rows}})
    (recording / "trajectories.csv").unlink()
    saved = scanning_statistics.statistics([recording], patterns=False)  # as frames.save writes it
    assert "speed" not in saved
    (recording / "summary.csv").write_text("")
    with pytest.raises(FileNotFoundError, match=r"trajectories\.csv"):  # a run must have this file
        scanning_statistics.statistics([recording], patterns=False)
    (recording / "summary.csv").unlink()
    for file in (recording / "dataset.yaml", recording / "a/lidar.yaml"):
        file.write_text(file.read_text().replace("preset: paper", "preset: recorded"))
    assert read_observations(read_data_set(recording)).ids.tolist() == [1]
    tables = scanning_statistics.statistics([recording])
    assert tables["points_per_vehicle"].vehicles.sum() == 2  # of the subsets common and view
    assert not {"speed", "lit_share", "angular_density"} & set(tables)
    run = write_folder(tmp_path / "run", {"a": {0: rows}})
    assert "speed" in scanning_statistics.statistics([recording, run], patterns=False)


@pytest.mark.nightly
@pytest.mark.slow
def test_a_real_run_gives_every_table_and_figure(infrasim: Infrasim, tmp_path: Path) -> None:
    files = [f"configs/lidars/{name}.yaml" for name in ("livox_avia", "helios_16")]
    folders = []
    for mode in ("exact", "instant"):
        folders.append(tmp_path / mode)
        result = infrasim(
            *("run", "configs/scenes/highway.yaml", "--preset", "paper", "--frames", "0:600:50"),
            *("--set", "duration_s=60", "--set", "traffic.warm_up_s=50", "--fields"),
            *("--lidar", *files, "--aggregation", mode, "--out", folders[-1]),
        )
        assert result.returncode == 0, result.stderr
    parser = argparse.ArgumentParser()
    statistics.add_arguments(parser)
    out = tmp_path / "out"
    args = parser.parse_args([*map(str, folders), "--out", str(out)])
    assert statistics.run(args) == 0
    for name in (
        *("hit_points", "points_per_vehicle", "quality", "only_one", "decay", "speed"),
        *("box_points", "aggregation", "lit_share", "angular_density"),
    ):
        for suffix in (".csv", ".svg", ".png"):
            assert (out / f"{name}{suffix}").stat().st_size > 0
    summary = pd.read_csv(folders[0] / "summary.csv").set_index("lidar").hits_per_frame
    hits = pd.read_csv(out / "hit_points.csv")
    mean = hits[hits.aggregation == "exact"].set_index("lidar").hit_points
    pd.testing.assert_series_equal(mean, summary[mean.index], check_names=False, rtol=1e-4)
    check_against_objects(folders[0], pd.read_csv(out / "points_per_vehicle.csv"))


def check_against_objects(folder: Path, table: pd.DataFrame) -> None:
    """Computes APV at 40 to 45 m directly from the files, and compares it."""
    rows = [
        pd.read_csv(file).assign(frame=file.stem)
        for file in sorted((folder / "helios_16/training/objects").glob("*.csv"))
    ]
    near = pd.concat(rows)
    azimuth = np.degrees(np.arctan2(near.y, near.x)).abs()
    near = near[(near.visibility >= 0.2) & (near.distance // 5 == 8) & (azimuth <= 35.31)]
    key = (table.aggregation == "exact") & (table["set"] == "common") & (table.from_m == 40)
    measured = table[key & (table.lidar == "helios_16")].iloc[0]
    assert measured.vehicles == len(near) > 0
    assert measured.apv == pytest.approx(near.points.mean(), rel=1e-5)


def test_the_avia_lights_its_field_as_others_computed_it() -> None:
    from pyinfra.dataset import simulation

    root = Path(__file__).resolve().parents[2]
    pattern = simulation.scan_pattern(root / "configs/lidars/livox_avia.yaml", range(40))
    avia = scan_patterns.Rays(np.degrees(pattern[:, 0]), np.degrees(pattern[:, 1]), pattern[:, 2])
    table = scan_patterns.lit_share(avia, (0.1, 0.2, 0.5, 1.0))
    # Others computed these values from the vendor's scan table. Their method of counting is not
    # published.
    np.testing.assert_allclose(table.lit_percent, [30, 51, 80, 95], atol=3.5)
    density = (
        scan_patterns.angular_density(avia).set_index(["axis", "from_deg"]).density["off_axis"]
    )
    np.testing.assert_allclose(density[[0, 10, 25, 34]], [864, 80, 40, 62], rtol=0.03)
