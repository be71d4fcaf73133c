"""`infrasim pattern`: directions and times of the rays, compared with the vendors' tables."""

import shutil
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pyinfra.core.arrays import FloatArray

ROOT = Path(__file__).resolve().parents[2]
LIDARS = ROOT / "configs/lidars"

Pattern = Callable[..., FloatArray]

# Model, its table in mujoco-lidar, and the number of lasers that fire together. A table is 4 s
# long.
CLOSED_FORMS = [
    ("livox_avia", "avia", 6),
    ("livox_mid_40", "mid40", 1),
    ("livox_mid_70", "mid70", 1),
    ("livox_tele_15", "tele", 6),
    ("livox_horizon", "horizon", 6),
]
SPINNING = [
    ("helios_16", "robosense_helios_16"),
    ("pandar_64", "hesai_pandar_64"),
    ("ruby_plus", "robosense_ruby_128"),
    ("velodyne_vlp_16", "velodyne_vlp16"),
    ("velodyne_vlp_32c", "velodyne_vlp32c"),
    ("velodyne_hdl_64e", "velodyne_hdl64e"),
    ("velodyne_vls_128", "velodyne_vls128"),
    ("hesai_xt32", "hesai_xt32"),
    ("hesai_ot128", "hesai_ot128"),
]


def vendor_table(name: str) -> Path:
    """Returns the file of a scan table: azimuth and elevation in radians, float32. It is found
    without importing the package."""
    spec = find_spec("mujoco_lidar")
    assert spec is not None
    assert spec.submodule_search_locations is not None
    return Path(spec.submodule_search_locations[0]) / f"scan_mode/{name}.npy"


def directions(azimuth: FloatArray, elevation: FloatArray) -> FloatArray:
    """Returns unit vectors: (n, 3)."""
    across = np.cos(elevation)
    return np.stack([across * np.cos(azimuth), across * np.sin(azimuth), np.sin(elevation)], axis=1)


def angles_deg(a: FloatArray, b: FloatArray) -> FloatArray:
    """Returns the angle between the unit vectors of each row. It is computed from the chord,
    because arccos loses half of the digits."""
    return np.degrees(2 * np.arcsin(np.linalg.norm(a - b, axis=1) / 2))


@pytest.mark.parametrize(("model", "table", "lasers"), CLOSED_FORMS)
def test_closed_form_is_the_vendors_table(
    model: str, table: str, lasers: int, pattern: Pattern, record_property: Callable[..., None]
) -> None:
    ours = pattern(model, "--frames", "0:40")
    vendors = np.load(vendor_table(table)).astype(np.float64)
    assert len(ours) == len(vendors)
    off = angles_deg(directions(ours[:, 0], ours[:, 1]), directions(*vendors.T))
    record_property("max_deg", float(off.max()))
    print(f"{model}: rms {np.sqrt(np.mean(off**2)):.2e}, max {off.max():.2e} deg")
    assert off.max() < 5e-5
    steps = np.arange(len(ours)) // lasers
    np.testing.assert_allclose(ours[:, 2], steps * 4 / (len(ours) / lasers), atol=1e-9)


def test_closed_form_does_not_repeat_after_the_table_ends(pattern: Pattern) -> None:
    first, second = pattern("livox_avia"), pattern("livox_avia", "--frames", "40:41")
    assert first.shape == second.shape
    off = angles_deg(directions(first[:, 0], first[:, 1]), directions(second[:, 0], second[:, 1]))
    assert np.median(off) > 1


@pytest.mark.parametrize("model", ["livox_avia", "hesai_xt32", "bundle_5_livox_avia"])
def test_array_has_three_columns_of_doubles(model: str, pattern: Pattern) -> None:
    rays = pattern(model)
    assert rays.dtype == np.dtype("<f8")
    assert rays.ndim == 2
    assert rays.shape[1] == 3
    assert np.all(np.isfinite(rays))
    assert np.abs(rays[:, 0]).max() <= np.pi
    assert np.abs(rays[:, 1]).max() <= np.pi / 2
    assert rays[:, 2].min() >= 0
    assert rays[:, 2].max() < 0.1


@pytest.mark.parametrize("model", ["livox_tele_15", "velodyne_hdl_64e"])
def test_frames_join_without_a_gap_or_a_double(model: str, pattern: Pattern) -> None:
    whole = pattern(model, "--frames", "0:5")
    parts = [pattern(model, "--frames", f"{k}:{k + 1}") for k in range(5)]
    np.testing.assert_array_equal(whole, np.concatenate(parts))
    stepped = pattern(model, "--frames", "0:5:2")
    np.testing.assert_array_equal(stepped, np.concatenate(parts[::2]))


@pytest.mark.parametrize(("model", "channels"), SPINNING)
def test_spinning_rays_are_the_channel_table_turned_column_by_column(
    model: str, channels: str, pattern: Pattern
) -> None:
    table = pd.read_csv(LIDARS / f"channels/{channels}.csv")
    if "column_step" in table:  # two columns make a group, in which some channels fire once
        column_us = 1e5 / 3600
        odd = table.assign(fire_time_us=table.fire_time_us + column_us)
        table = pd.concat(
            shots[column % shots.column_step == shots.first_column]
            for column, shots in enumerate((table, odd))
        )
    table = table.fillna(0)
    rays = pattern(model)
    n = len(table)
    columns = rays.reshape(-1, n, 3)
    elevation = np.degrees(columns[..., 1])
    np.testing.assert_allclose(
        elevation, np.tile(table.elevation_deg, (len(columns), 1)), atol=1e-9
    )

    # A turn takes 0.1 s. A channel fires some time after the start of its columns.
    step_s = columns[1, 0, 2] - columns[0, 0, 2]
    fire_s = table.fire_time_us.to_numpy() * 1e-6
    times = np.arange(len(columns))[:, None] * step_s + fire_s
    np.testing.assert_allclose(columns[..., 2], times, atol=1e-9)

    # The sensor turns clockwise seen from above and begins behind the view. The azimuth falls by
    # 360 degrees in 0.1 s, also during the fire time.
    clockwise = 3600 * times + table.azimuth_offset_deg.to_numpy() - 180
    off = np.remainder(np.degrees(columns[..., 0]) + clockwise + 180, 360) - 180
    assert np.abs(off).max() < 1e-6


def test_evenly_spaced_channels_reach_from_the_upper_to_the_lower(pattern: Pattern) -> None:
    rays = pattern("pandar_64", "--preset", "paper")
    elevations = np.unique(np.round(np.degrees(rays[:, 1]), 9))
    np.testing.assert_allclose(elevations, np.linspace(-25, 15, 64), atol=1e-8)


@pytest.mark.parametrize("model", ["livox_horizon", "bundle_5_livox_avia"])
def test_seed_changes_the_start_and_nothing_else(model: str, pattern: Pattern) -> None:
    still, one, again, two = (
        pattern(model, *seed) for seed in ([], ["--seed", 1], ["--seed", 1], ["--seed", 2])
    )
    np.testing.assert_array_equal(one, again)
    assert one.shape == still.shape == two.shape
    for a, b in ((still, one), (one, two)):
        np.testing.assert_allclose(a[:, 2], b[:, 2], atol=1e-12)
        off = angles_deg(directions(a[:, 0], a[:, 1]), directions(b[:, 0], b[:, 1]))
        assert np.median(off) > 0.5


def test_seed_leaves_a_locked_motor_where_it_is(pattern: Pattern) -> None:
    still, moved = pattern("velodyne_vlp_16"), pattern("velodyne_vlp_16", "--seed", 1)
    np.testing.assert_array_equal(still, moved)


def test_bundle_is_its_parts_turned_and_covers_the_circle(pattern: Pattern) -> None:
    bundle = pattern("bundle_5_livox_avia", "--frames", "0:10")
    single = pattern("livox_avia", "--frames", "0:10")
    assert len(bundle) == 5 * len(single)
    for i, part in enumerate(bundle.reshape(5, -1, 3)):
        turned = directions(single[:, 0] + np.radians(72 * i), single[:, 1])
        assert angles_deg(directions(part[:, 0], part[:, 1]), turned).max() < 1e-6
    azimuths = np.sort(np.degrees(bundle[:, 0]))
    gaps = np.diff(np.append(azimuths, azimuths[0] + 360))
    assert gaps.max() < 72 - 70.4 + 0.1  # the width of the Avia's field of view is 70.4 degrees


def test_bundles_parts_start_at_phases_of_their_own(pattern: Pattern) -> None:
    parts = pattern("bundle_5_livox_avia", "--seed", 3).reshape(5, -1, 3)
    elevations = [tuple(np.round(part[:6, 1], 6)) for part in parts]
    assert len(set(elevations)) == 5


@pytest.fixture
def mid_360(tmp_path: Path) -> Path:
    """Copies the file of the Mid-360 and its table."""
    shutil.copy(vendor_table("mid360"), tmp_path / "mid360.npy")
    return Path(shutil.copy(LIDARS / "own_table/livox_mid_360.yaml", tmp_path))


def test_table_pattern_is_the_table_and_starts_again_at_its_end(
    mid_360: Path, pattern: Pattern
) -> None:
    rays = pattern(mid_360, "--frames", "0:41")
    table = np.load(vendor_table("mid360")).astype(np.float64)
    assert len(table) == 4 * 200_000
    assert len(rays) == 820_000
    expected = directions(*table.T)
    got = directions(rays[:, 0], rays[:, 1])
    assert angles_deg(got[: len(table)], expected).max() < 1e-6
    assert angles_deg(got[len(table) :], expected[:20_000]).max() < 1e-6
    np.testing.assert_allclose(rays[:, 2], np.arange(len(rays)) / 200_000, atol=1e-9)


def test_csv_table_gives_the_rays_of_the_npy_table(mid_360: Path, pattern: Pattern) -> None:
    from_npy = pattern(mid_360)
    table = np.load(mid_360.with_name("mid360.npy"))[:20_000].astype(np.float64)
    rows = pd.DataFrame(table, columns=["azimuth_rad", "elevation_rad"])
    rows.to_csv(mid_360.with_name("mid360.csv"), index=False, float_format="%.17g")
    text = mid_360.read_text().replace("file: mid360.npy", "file: mid360.csv")
    mid_360.write_text(text)
    np.testing.assert_array_equal(pattern(mid_360), from_npy)
