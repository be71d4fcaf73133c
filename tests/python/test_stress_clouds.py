"""Stressors of clouds, compared with hand-computed cases and with the simulator."""

import itertools
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from pyinfra.core.arrays import Points
from pyinfra.dataset.world_frame import rotation
from pyinfra.experiments.stress import clouds
from pyinfra.experiments.stress.stressors import STRESSORS, Stressor
from pyinfra.formats import kitti
from pyinfra.models.training import sensor_faults

CLOUD_STRESSORS = [row for row in STRESSORS.values() if row.acts_on == "cloud"]


def cloud(*rows: tuple[float, float, float]) -> Points:
    """Returns points with intensity 0.5."""
    return np.array([(*row, 0.5) for row in rows], dtype=np.float32)


def random_cloud(count: int = 4000) -> Points:
    random = np.random.default_rng(5)
    points = random.uniform([-80, -40, -6, 0], [80, 40, 2, 1], (count, 4))
    points[0, 1] = -0.0
    return points.astype(np.float32)


def rng() -> clouds.Rng:
    return np.random.default_rng(3)


def remaining(before: Points, after: Points) -> set[bytes]:
    """Returns the positions of the points that did not move, as bytes."""
    return {row.tobytes() for row in after[:, :3]} & {row.tobytes() for row in before[:, :3]}


@pytest.mark.parametrize("stressor", CLOUD_STRESSORS, ids=lambda s: s.name)
def test_without_stress_the_bytes_are_the_same(stressor: Stressor) -> None:
    points = random_cloud()
    assert stressor.apply(points, stressor.severities[0], 1, 7).tobytes() == points.tobytes()


@pytest.mark.parametrize("stressor", CLOUD_STRESSORS, ids=lambda s: s.name)
def test_the_same_seed_gives_the_same_bytes_and_the_input_stays(stressor: Stressor) -> None:
    points = random_cloud()
    before = points.copy()
    first, again = (stressor.apply(points, float(stressor.severities[2]), 1, 7) for _ in range(2))
    assert first.tobytes() == again.tobytes()
    assert first.dtype == np.float32
    np.testing.assert_array_equal(points, before)


@pytest.mark.parametrize("name", ["drop_out", "rain", "fog", "lost_lines", "blocked_sector"])
def test_a_stronger_severity_keeps_no_point_that_a_weaker_one_lost(name: str) -> None:
    points = random_cloud()
    stressor = STRESSORS[name]
    kept = [remaining(points, stressor.apply(points, float(d), 1, 7)) for d in stressor.severities]
    for weaker, stronger in itertools.pairwise(kept):
        assert stronger < weaker


@pytest.mark.parametrize("stressor", CLOUD_STRESSORS, ids=lambda s: s.name)
def test_an_empty_cloud_stays_empty(stressor: Stressor) -> None:
    for severity in stressor.severities:
        assert stressor.apply(np.empty((0, 4), np.float32), float(severity), 1, 0).shape == (0, 4)


def test_other_frames_have_other_random_numbers_but_the_same_lost_lines() -> None:
    points = random_cloud()
    drop, lines = STRESSORS["drop_out"], STRESSORS["lost_lines"]
    assert drop.apply(points, 0.5, 1, 0).tobytes() != drop.apply(points, 0.5, 1, 1).tobytes()
    assert drop.apply(points, 0.5, 1, 0).tobytes() != drop.apply(points, 0.5, 2, 0).tobytes()
    assert lines.apply(points, 0.5, 1, 0).tobytes() == lines.apply(points, 0.5, 1, 1).tobytes()


def test_the_share_that_drops_out_is_the_severity() -> None:
    kept = sensor_faults.drop_out(random_cloud(40_000), 0.75, rng())
    assert len(kept) == pytest.approx(10_000, abs=400)


def test_noise_is_along_the_ray_and_as_wide_as_the_severity() -> None:
    points = cloud(*[(30.0, 40.0, 0.0)] * 20_000)
    out = sensor_faults.range_noise(points, 0.2, rng()).astype(np.float64)
    ranges = np.linalg.norm(out[:, :3], axis=1)
    assert ranges.std() == pytest.approx(0.2, rel=0.03)
    assert ranges.mean() == pytest.approx(50, abs=0.01)
    np.testing.assert_allclose(out[:, 1] / out[:, 0], 40 / 30, rtol=1e-5)
    np.testing.assert_array_equal(out[:, 3], 0.5)


def test_noise_leaves_a_point_at_the_sensor_and_none_passes_it() -> None:
    points = cloud((0, 0, 0), *[(0.1, 0, 0)] * 100)
    out = sensor_faults.range_noise(points, 5, rng())
    assert np.isfinite(out).all()
    np.testing.assert_array_equal(out[0], points[0])
    assert out[:, 0].min() == 0


def test_fog_lets_through_what_the_air_transmits() -> None:
    """At 50 m and an extinction of 10 per km, exp(-1) = 36.8 % remain after both ways. A tenth of
    the lost points become drops."""
    points = cloud(*[(50.0, 0.0, 0.0)] * 40_000)
    out = clouds.fog(points, 10, rng())
    through = out[out[:, 0] == 50]
    drops = out[out[:, 0] < 50]
    assert len(through) == pytest.approx(40_000 * np.exp(-1), rel=0.02)
    np.testing.assert_allclose(through[:, 3], 0.5 * np.exp(-1), rtol=1e-6)
    assert len(drops) == pytest.approx(4_000 * (1 - np.exp(-1)), rel=0.1)
    # Drops have the density 1/z^2 from 1 to 50 m. Half of them lie below 1 / (1 - 0.49) m.
    assert np.median(drops[:, 0]) == pytest.approx(1 / 0.51, rel=0.05)
    assert drops[:, 0].min() >= 1


def test_rain_has_the_extinction_of_its_rate() -> None:
    """50 mm/h is an extinction of 3.65e-4 50^0.63 = 4.29e-3 per m, so 42.4 % return from 100 m."""
    points = cloud(*[(0.0, 100.0, 0.0)] * 40_000)
    out = clouds.rain(points, 50, rng())
    assert np.count_nonzero(out[:, 1] == 100) == pytest.approx(40_000 * 0.4238, rel=0.02)


def test_a_lost_line_takes_all_of_its_points_and_no_other() -> None:
    rows = np.radians(-25 + 40 / 127 * np.arange(128))
    ring = [(20 * np.cos(a), 0, 20 * np.sin(a)) for a in rows]
    points = np.concatenate([cloud(*ring), cloud(*[(-x, y, z) for x, y, z in ring])])
    out = sensor_faults.lost_lines(points, 0.5, rng())
    ahead, behind = out[out[:, 0] > 0], out[out[:, 0] < 0]
    np.testing.assert_array_equal(ahead[:, 2], behind[:, 2])
    assert 40 < len(ahead) < 90


def test_a_sector_is_blocked_to_both_sides_of_the_view() -> None:
    azimuths = np.radians([-11, -9, 0, 9, 11, 180])
    points = cloud(*[(20 * np.cos(a), 20 * np.sin(a), 0) for a in azimuths])
    np.testing.assert_array_equal(clouds.blocked_sector(points, 20, rng()), points[[0, 4, 5]])


@pytest.mark.parametrize(
    ("name", "severity", "point", "seen"),
    [
        # The sensor is 2 m too high, so the road at 6 m below it is 8 m below.
        ("height_error", 2, (10, 3, -6), (10, 3, -8)),
        # The sensor looks 30 degrees down, so points ahead lie above its axis.
        ("pitch_error", 30, (10, 0, 0), (8.660254, 0, 5)),
        ("pitch_error", 30, (0, 10, 0), (0, 10, 0)),
        # The sensor leans to the right, so points on the left lie below its left axis.
        ("roll_error", 30, (0, 10, 0), (0, 8.660254, -5)),
        ("roll_error", 30, (10, 0, 0), (10, 0, 0)),
        # The sensor is turned left, so points ahead lie to its right.
        ("yaw_error", 30, (10, 0, 0), (8.660254, -5, 0)),
        ("yaw_error", 90, (0, 10, -6), (10, 0, -6)),
    ],
)
def test_a_pose_error_moves_points_as_worked_by_hand(
    name: str,
    severity: float,
    point: tuple[float, float, float],
    seen: tuple[float, float, float],
) -> None:
    out = STRESSORS[name].apply(cloud(point), severity, seed=1, frame=0)
    np.testing.assert_allclose(out[0, :3], seen, atol=1e-5)
    assert out[0, 3] == 0.5


@pytest.mark.parametrize(("key", "name"), [("pitch", "pitch_error"), ("roll", "roll_error")])
def test_a_tilt_that_nobody_knows_of_is_the_pose_error(
    infrasim: Callable[..., object],
    run_command: Callable[..., list[str]],
    tmp_path: Path,
    key: str,
    name: str,
) -> None:
    """The simulator levels the points of a tilted sensor. The error transforms them back to the
    sensor's frame, in which no ray is outside of the sensor's elevations."""
    words = [*run_command(frames="0:1", out=tmp_path), "--set", f"mounts.pole.{key}_deg=8"]
    infrasim(*words, check=True)
    folder = tmp_path / "helios_16"
    points = kitti.read_points(kitti.frame_file(folder, "velodyne", 0))
    (view,) = kitti.read_lidar(folder).field_of_view
    low, high = np.degrees(view.elevation)

    def outside(seen: Points) -> int:
        flat = np.hypot(seen[:, 0], seen[:, 1])
        elevation = np.degrees(np.arctan2(seen[:, 2], flat))
        return int(np.count_nonzero((elevation < low - 0.01) | (elevation > high + 0.01)))

    assert outside(points) > 50
    assert outside(STRESSORS[name].apply(points, 8, 1, 0)) == 0
    back = clouds.moved(points, rotation(**{key: np.radians(-8)}))
    assert outside(back) > 50
