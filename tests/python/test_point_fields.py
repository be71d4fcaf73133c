"""Times and rings of points in the spellings of drivers give the same fields."""

from typing import Any

import numpy as np
import pytest

from pyinfra.core.errors import FormatError
from pyinfra.exchange.point_fields import PointFields, intensity_field

N = 500
SINCE_START = np.linspace(0, 0.0999, N)
EPOCH_S = 1_700_000_000.0
RING = np.arange(N) % 32
# Type, unit and start of the count of several drivers.
SPELLINGS: dict[str, tuple[str, str, Any]] = {
    "plain": ("time", "<f4", SINCE_START),
    "velodyne, to the end": ("time", "<f4", SINCE_START - 0.1),
    "around the middle": ("time", "<f4", SINCE_START - 0.05),
    "ouster": ("t", "<u4", SINCE_START * 1e9),
    "nanoseconds in time": ("time", "<u4", SINCE_START * 1e9),
    "hesai, robosense": ("timestamp", "<f8", EPOCH_S + SINCE_START),
    "livox driver 2": ("timestamp", "<f8", (EPOCH_S + SINCE_START) * 1e9),
    "integers since 1970": ("timestamp", "<u8", np.uint64(17 * 10**17) + (SINCE_START * 1e9)),
    "since power-on": ("timestamp", "<f8", 5000 + SINCE_START),
    "microseconds": ("time", "<u4", SINCE_START * 1e6),
    "milliseconds": ("time", "<f4", SINCE_START * 1e3),
    "velodyne, per packet": ("time", "<f4", np.floor(SINCE_START * 750) / 750),
    "cloudcompare": ("Scalar_Time", "<f8", SINCE_START),
    "livox": ("offset_time", "<u4", SINCE_START * 1e9),
}


def records(name: str, kind: str, values: Any, ring: str = "ring") -> np.ndarray:
    out = np.zeros(N, dtype=[("x", "<f4"), (ring, "<u2"), (name, kind)])
    out[name], out[ring] = values.astype(kind), RING
    return out


@pytest.mark.parametrize("spelling", SPELLINGS)
def test_each_driver_gives_the_same_fields(spelling: str) -> None:
    cloud = records(*SPELLINGS[spelling])
    fields = PointFields([cloud]).read("a.pcd", cloud)
    assert fields is not None
    tolerance = 0.0014 if "packet" in spelling else 2e-6
    assert fields["time_s"] == pytest.approx(SINCE_START, abs=tolerance)
    assert np.array_equal(fields["ring"], RING)


@pytest.mark.parametrize("ring", ["line", "channel", "laser_id", "Ring"])
def test_each_name_of_the_ring(ring: str) -> None:
    cloud = records("time", "<f4", SINCE_START, ring)
    fields = PointFields([cloud]).read("a.pcd", cloud)
    assert fields is not None
    assert np.array_equal(fields["ring"], RING)


@pytest.mark.parametrize(
    ("kind", "values"),
    [
        ("<f4", EPOCH_S + SINCE_START),  # float32 rounds to 128 s
        ("<f4", np.zeros(N)),
        ("<f8", SINCE_START * 1e12),
        ("<f4", np.full(N, np.nan)),
    ],
)
def test_unusable_times_are_named(kind: str, values: Any) -> None:
    cloud = records("time", kind, values)
    found = PointFields([cloud])
    assert found.read("a.pcd", cloud) is None
    assert any("`time` is not used" in note for note in found.notes)


def test_a_ring_without_time_is_named() -> None:
    cloud = records("other", "<f4", SINCE_START)
    found = PointFields([cloud])
    assert found.read("a.pcd", cloud) is None
    assert any("ring is not used" in note for note in found.notes)


def test_a_time_of_0_is_a_ray_without_a_return() -> None:
    values = EPOCH_S + SINCE_START
    values[::7] = 0
    cloud = records("timestamp", "<f8", values)
    fields = PointFields([cloud]).read("a.pcd", cloud)
    assert fields is not None
    valid = np.arange(N) % 7 > 0
    assert fields["time_s"][valid] == pytest.approx(SINCE_START[valid] - SINCE_START[1], abs=1e-5)


def test_a_frame_that_jumps_is_an_error() -> None:
    cloud = records("timestamp", "<f8", EPOCH_S + SINCE_START)
    jump = cloud.copy()
    jump["timestamp"][-1] += 900
    with pytest.raises(FormatError, match=r"a\.pcd: point 499: timestamp: expected 0 to 3 s"):
        PointFields([cloud]).read("a.pcd", jump)


def test_the_reflectivity_is_preferred_unless_it_is_empty() -> None:
    cloud = np.zeros(3, dtype=[("intensity", "<f4"), ("reflectivity", "<u2")])
    cloud["intensity"] = 9
    assert intensity_field(cloud) == "intensity"
    cloud["reflectivity"] = 9
    assert intensity_field(cloud) == "reflectivity"
