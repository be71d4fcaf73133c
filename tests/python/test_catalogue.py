"""The files of configs/: each can be read under every preset, and has the expected values."""

import shutil
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

ROOT = Path(__file__).resolve().parents[2]
LIDARS = ROOT / "configs/lidars"
SCENES = sorted((ROOT / "configs/scenes").glob("*.yaml"))
WITHOUT_ITS_TABLE = LIDARS / "own_table/livox_mid_360.yaml"

# Points per second with a single return per pulse, as published by the vendors. For three Velodyne
# LiDARs they are those of the published firing cycle, because vendors round points per second.
POINTS_PER_S = {
    "helios_16": 288_000,
    "pandar_64": 1_152_000,
    "ruby_plus": 2_304_000,
    "velodyne_vlp_16": 289_352,
    "velodyne_vlp_32c": 578_704,
    "velodyne_hdl_64e": 1_111_111,
    "velodyne_vls_128": 2_400_000,
    "hesai_xt32": 640_000,
    "hesai_ot128": 3_456_000,
    "livox_avia": 240_000,
    "livox_mid_40": 100_000,
    "livox_mid_70": 100_000,
    "livox_tele_15": 240_000,
    "livox_horizon": 240_000,
    "bundle_5_livox_avia": 1_200_000,
}
RANGES_M = {  # max_range_m under the preset datasheet
    "velodyne_vlp_16": 100,
    "velodyne_vlp_32c": 200,
    "velodyne_hdl_64e": 120,
    "velodyne_vls_128": 245,
    "hesai_xt32": 120,
    "livox_horizon": 260,
}
RANGES_AT_10_PERCENT_M = {
    "livox_avia": 190,
    "livox_mid_70": 90,
    "livox_tele_15": 320,
    "hesai_ot128": 200,
}
PRICES_USD = {
    "helios_16": 2399,
    "pandar_64": 6425,
    "ruby_plus": 24000,
    "livox_avia": 2079,
}

Infrasim = Callable[..., Any]


def presets(name: str) -> list[str]:
    """Returns the presets of a LiDAR's file. A bundle has the presets of its parts."""
    keys = yaml.safe_load((LIDARS / f"{name}.yaml").read_text())
    if "presets" not in keys:
        return presets(Path(keys["bundle"][0]["lidar"]).stem)
    return list(keys["presets"])


NAMES = sorted(path.stem for path in LIDARS.glob("*.yaml"))
SINGLES = [name for name in NAMES if not name.startswith("bundle")]
NAMES_AND_PRESETS = [(name, preset) for name in NAMES for preset in presets(name)]


@pytest.fixture(scope="module")
def catalogue(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Returns a copy of configs/lidars."""
    return Path(shutil.copytree(LIDARS, tmp_path_factory.mktemp("configs") / "lidars"))


@pytest.fixture(scope="module")
def resolved(infrasim: Infrasim) -> Callable[..., dict[str, Any]]:
    """Returns a function that reads the keys, including defaults, that `infrasim check` prints for
    a LiDAR."""

    def keys(name: str, preset: str = "datasheet") -> dict[str, Any]:
        result = infrasim("check", LIDARS / f"{name}.yaml", "--preset", preset)
        assert result.returncode == 0, result.stderr
        law = f"infrasim: {name}: detection law: off by at most "
        assert all(line.startswith(law) for line in result.stderr.splitlines()), result.stderr
        return yaml.safe_load(result.stdout)

    return keys


def units(keys: dict[str, Any]) -> list[dict[str, Any]]:
    return keys["bundle"] or [keys]


def test_the_catalogue_has_what_this_test_knows() -> None:
    assert set(NAMES) == set(POINTS_PER_S)


@pytest.mark.parametrize(("name", "preset"), NAMES_AND_PRESETS)
def test_every_preset_of_every_lidar_passes_check(
    name: str, preset: str, resolved: Callable[..., dict[str, Any]]
) -> None:
    keys = resolved(name, preset)
    # the file, the key `name` and the folder of frames have the same name
    assert keys["name"] == name
    assert keys["model"]
    for unit in units(keys):
        returns = unit["returns"]
        if preset == "equal":
            assert returns == {"min_range_m": 0, "max_range_m": 260, "range_accuracy_m": 0}
        if preset == "datasheet":
            assert returns["range_accuracy_m"] > 0
            assert returns["detection"]["range_at_10_percent_m"] > returns["min_range_m"]


@pytest.mark.parametrize("name", NAMES)
def test_every_lidar_has_the_presets_equal_and_datasheet(name: str) -> None:
    assert {"equal", "datasheet"} <= set(presets(name))


@pytest.mark.parametrize("name", SINGLES)  # the parts of a resolved bundle have no files
def test_resolved_lidar_reads_back_to_the_same_text(
    name: str, infrasim: Infrasim, catalogue: Path
) -> None:
    first = infrasim("check", LIDARS / f"{name}.yaml").stdout
    copy = catalogue / f"{name}_resolved.yaml"
    copy.write_text(first)
    assert infrasim("check", copy).stdout == first


@pytest.mark.parametrize("name", NAMES)
def test_points_per_second_are_the_vendors(
    name: str, infrasim: Infrasim, catalogue: Path, tmp_path: Path
) -> None:
    out = tmp_path / "rays.npy"
    result = infrasim("pattern", catalogue / f"{name}.yaml", "--frames", "0:10", "--out", out)
    assert result.returncode == 0, result.stderr
    assert len(np.load(out)) == pytest.approx(POINTS_PER_S[name], rel=1e-3)


@pytest.mark.parametrize(("name", "points_per_s"), POINTS_PER_S.items())
def test_rate_times_columns_times_channels_is_the_points_per_second(
    name: str, points_per_s: int, resolved: Callable[..., dict[str, Any]]
) -> None:
    total = 0.0
    for unit in units(resolved(name)):
        pattern = unit["pattern"]
        if "spinning" in pattern:
            s = pattern["spinning"]
            if "cycle_us" in s:
                columns_per_s = 1e6 / s["cycle_us"]
            else:
                columns_per_s = s["rate_hz"] * float(Fraction(s["columns_per_turn"]))
            total += sum(columns_per_s / c["column_step"] for c in s["channels"]["table"])
        elif "prisms" in pattern:
            total += len(pattern["prisms"]["laser_offsets"]) * pattern["prisms"]["steps_per_s"]
        else:
            total += pattern["table"]["rays_per_s"]
    assert total == pytest.approx(points_per_s, rel=1e-3)


# the price of a bundle is the sum of the prices of its parts
@pytest.mark.parametrize("name", SINGLES)
def test_price_has_a_source_and_a_date(name: str) -> None:
    keys = yaml.safe_load((LIDARS / f"{name}.yaml").read_text())
    price = keys["price_usd"]
    assert set(price) == {"low", "high", "source", "date"}
    assert 0 < price["low"] <= price["high"]
    assert price["source"]
    assert price["date"]
    if name in PRICES_USD:
        assert price["low"] == price["high"] == PRICES_USD[name]
    else:
        assert price["source"] == "nominal, unconfirmed"


def numbers_as_text(value: Any) -> list[str]:
    """Returns the texts in a tree that look like numbers, except dates and digests."""
    if isinstance(value, dict):
        return [
            t for k, v in value.items() if k not in {"date", "digest"} for t in numbers_as_text(v)
        ]
    if isinstance(value, list):
        return [text for item in value for text in numbers_as_text(item)]
    try:
        return [value] if isinstance(value, str) and float(value) is not None else []
    except ValueError:
        return []


@pytest.mark.parametrize("name", NAMES)
def test_numbers_of_a_resolved_lidar_are_numbers_to_python(
    name: str, resolved: Callable[..., dict[str, Any]]
) -> None:
    assert numbers_as_text(resolved(name)) == []


@pytest.mark.parametrize(("name", "max_range_m"), RANGES_M.items())
def test_datasheet_range_is_the_vendors(
    name: str, max_range_m: float, resolved: Callable[..., dict[str, Any]]
) -> None:
    assert resolved(name)["returns"]["max_range_m"] == max_range_m


@pytest.mark.parametrize(("name", "range_m"), RANGES_AT_10_PERCENT_M.items())
def test_datasheet_range_at_10_percent_is_the_vendors(
    name: str, range_m: float, resolved: Callable[..., dict[str, Any]]
) -> None:
    assert resolved(name)["returns"]["detection"]["range_at_10_percent_m"] == range_m


@pytest.mark.parametrize("file", sorted((LIDARS / "channels").glob("*.csv")), ids=lambda p: p.stem)
def test_channel_table_is_used_and_has_a_row_for_each_line(file: Path) -> None:
    header, *rows = file.read_text().splitlines()
    assert header.startswith("channel,elevation_deg,azimuth_offset_deg,fire_time_us")
    lines = {"hdl64e": 64, "pandar_64": 64, "helios_16": 16, "vlp16": 16, "vlp32c": 32, "xt32": 32}
    expected = next((n for word, n in lines.items() if word in file.stem), 128)
    assert len(rows) == expected
    cells = [row.split(",") for row in rows]
    numbers = [int(row[0]) for row in cells]
    assert numbers == list(range(numbers[0], numbers[0] + expected))
    assert len({row[1] for row in cells}) > expected / 2
    assert any(f"channels/{file.name}" in lidar.read_text() for lidar in LIDARS.glob("*.yaml"))


def test_price_of_a_bundle_is_the_sum_of_its_parts(
    infrasim: Infrasim, run_command: Callable[..., list[str]], tmp_path: Path
) -> None:
    out = tmp_path / "out"
    assert infrasim(*run_command("bundle_5_livox_avia", frames="0:1"), "--out", out).returncode == 0
    keys = yaml.safe_load((out / "bundle_5_livox_avia/lidar.yaml").read_text())
    assert keys["price_total_usd"] == {"low": 5 * 2079, "high": 5 * 2079}
    assert [fov["yaw_deg"] for fov in keys["field_of_view"]] == [0, 72, 144, 216, 288]


@pytest.mark.parametrize("command", ["check", "pattern", "run"])
def test_a_table_that_is_not_there_is_one_line_with_its_path(
    command: str, infrasim: Infrasim, tmp_path: Path
) -> None:
    file = WITHOUT_ITS_TABLE
    out = tmp_path / "out"
    words = {
        "check": ["check", file],
        "pattern": ["pattern", file, "--out", out],
        "run": ["run", "configs/scenes/highway.yaml", "--lidar", file, "--out", out],
    }
    result = infrasim(*words[command])
    assert result.returncode in (1, 2)
    assert result.stdout == ""
    assert len(result.stderr.splitlines()) == 1
    assert str(file.with_name("mid360.npy")) in result.stderr
    assert not out.exists()


@pytest.mark.parametrize("scene", SCENES, ids=lambda p: p.stem)
def test_every_scene_passes_check_and_its_resolved_text_reads_back(
    scene: Path, infrasim: Infrasim, tmp_path: Path
) -> None:
    first = infrasim("check", scene)
    assert first.returncode == 0, first.stderr
    keys = yaml.safe_load(first.stdout)
    assert keys["name"] == scene.stem
    assert len(keys["mounts"]) == (4 if scene.stem == "crossroad_poles" else 1)
    assert keys["weather"]["visibility_m"] == float("inf")
    copy = tmp_path / "scene.yaml"
    copy.write_text(first.stdout)
    assert infrasim("check", copy).stdout == first.stdout
