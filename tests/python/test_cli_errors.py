"""Wrong input: the exit code is 2, nothing is written, and one line has the position, the expected
and the given value."""

import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]

Infrasim = Callable[..., Any]

SCENE = """\
name: small
duration_s: 2
mounts:
  pole: {x_m: 0, y_m: 0, z_m: 6}
roads:
  - name: main
    start: {x_m: -100, y_m: 0}
    centreline:
      - {line_m: 200}
    lanes: {each_way: 2, width_m: 3.5}
traffic:
  vehicles_per_km_lane: 10
  speed: {mean_km_h: 50, std_km_h: 2}
  warm_up_s: 1
  class_shares: {Car: 1}
"""
LIDAR = """\
name: tiny
model: Tiny
price_usd: {low: 1, high: 2, source: test, date: "2026-11"}
pattern:
  spinning: {rate_hz: 10, azimuth_step_deg: 2, channels: {count: 4, upper_deg: 0, lower_deg: -20}}
presets:
  equal:
    returns: {max_range_m: 100}
  datasheet:
    returns: {max_range_m: 80, range_accuracy_m: 0.02, detection: {range_at_10_percent_m: 40}}
"""
CHANNELS = """\
channel,elevation_deg,azimuth_offset_deg,fire_time_us
0,1,0,0
1,0,0,1
2,-1,,
"""
TRAJECTORIES = """\
t,id,class,x,y,z,heading,dx,dy,dz,speed
0,1,Car,10,2,0.8,0,4,2,1.6,10
0,2,Car,30,2,0.8,0,4,2,1.6,10
0.1,1,Car,11,2,0.8,0,4,2,1.6,10
0.1,2,Car,31,2,0.8,0,4,2,1.6,10
0.2,1,Car,12,2,0.8,0,4,2,1.6,10
"""


class Site:
    """A folder with a scene, a LiDAR and the output of a run."""

    def __init__(self, folder: Path, infrasim: Infrasim) -> None:
        self.folder, self.infrasim = folder, infrasim
        self.scene, self.lidar, self.out = (folder / n for n in ("scene.yaml", "lidar.yaml", "out"))
        self.scene.write_text(SCENE)
        self.lidar.write_text(LIDAR)

    def run(self, *options: object, frames: str = "0:2") -> Any:
        words = ["run", self.scene, "--lidar", self.lidar, f"--frames={frames}", "--out", self.out]
        return self.infrasim(*words, *options)


@pytest.fixture
def site(tmp_path: Path, infrasim: Infrasim) -> Site:
    return Site(tmp_path, infrasim)


def assert_one_line(result: Any, site: Site, *words: str, codes: tuple[int, ...] = (2,)) -> None:
    assert result.returncode in codes, (result.returncode, result.stderr)
    assert result.stdout == ""
    assert len(result.stderr.splitlines()) == 1, result.stderr
    assert result.stderr.endswith("\n")
    for word in words:
        assert word in result.stderr, result.stderr
    assert not site.out.exists()
    hidden = [path for path in site.folder.rglob(".*") if path.is_file()]
    assert hidden == []


def replaced(text: str, old: str, new: str) -> tuple[str, int]:
    """Replaces a part of a text. Returns the new text and the number of the changed line, counted
    from 1."""
    assert text.count(old) == 1, old
    return text.replace(old, new), text[: text.index(old)].count("\n") + 1


def test_the_site_itself_is_right(site: Site) -> None:
    result = site.run()
    assert result.returncode == 0, result.stderr
    assert (site.out / "tiny/training/velodyne/000001.bin").is_file()


# The replaced text of the scene, the new text, the column of the error, the key, and words of the
# message.
WRONG_SCENES = {
    "unknown key": ("each_way: 2", "each_way: 2, colour: 3",
        "roads.0.lanes.colour", ["unknown key", "expected each_way"]),
    "name that a spreadsheet runs": ("name: small", "name: =1+1",
        "name", ["'=1+1'", "begins with a letter, a digit or _"]),
    "road that is a formula": ("name: main", "name: '@main'",
        "roads.0.name", ["'@main'", "begins with a letter, a digit or _"]),
    "unknown key at the top": ("duration_s: 2", "duration: 2",
        "duration", ["unknown key", "duration_s"]),
    "key twice": ("duration_s: 2", "duration_s: 2\nduration_s: 3",
        "duration_s", ["twice", "expected the key once"]),
    "key missing": (", z_m: 6", "",
        "mounts.pole.z_m", ["expected a value, got none"]),
    "word for a number": ("line_m: 200", "line_m: long",
        "roads.0.centreline.0.line_m", ["'long'", "expected a number"]),
    "unit after a number": ("line_m: 200", "line_m: 200 m",
        "roads.0.centreline.0.line_m", ["'200 m'", "expected a number"]),
    "list for a number": ("line_m: 200", "line_m: [200]",
        "roads.0.centreline.0.line_m", ["a list", "expected a number"]),
    "nothing for a number": ("line_m: 200", "line_m:",
        "roads.0.centreline.0.line_m", ["got nothing", "expected a number"]),
    "map for a list": ("      - {line_m: 200}", "      {line_m: 200}",
        "roads.0.centreline", ["a map", "expected a list"]),
    "number for a map": ("{Car: 1}", "1",
        "traffic.class_shares", ["'1'", "expected a map"]),
    "number for a map of keys": ("{mean_km_h: 50, std_km_h: 2}", "50",
        "traffic.speed", ["'50'", "expected a map"]),
    "NaN": ("line_m: 200", "line_m: .nan",
        "roads.0.centreline.0.line_m", ["'.nan'", "expected a number"]),
    "nan": ("x_m: -100", "x_m: nan",
        "roads.0.start.x_m", ["'nan'", "expected a number"]),
    "infinity": ("x_m: -100", "x_m: .inf",
        "roads.0.start.x_m", ["expected", ", got '.inf'"]),
    "huge number": ("x_m: -100", "x_m: 1e400",
        "roads.0.start.x_m", ["expected", ", got '1e400'"]),
    "fraction of a lane": ("each_way: 2", "each_way: 1.5",
        "roads.0.lanes.each_way", ["'1.5'", "whole number"]),
    "lane of no width": ("width_m: 3.5", "width_m: 0",
        "roads.0.lanes.width_m", ["'0'", "expected 2.5 to 6"]),
    "lane of negative width": ("width_m: 3.5", "width_m: -3.5",
        "roads.0.lanes.width_m", ["'-3.5'", "expected 2.5 to 6"]),
    "no lanes": ("each_way: 2", "each_way: 0",
        "roads.0.lanes.each_way", ["'0'", "expected 1 to 8"]),
    "empty centreline": ("      - {line_m: 200}", "      []",
        "roads.0.centreline", ["expected entries, got none"]),
    "piece that is no line and no arc": ("line_m: 200", "radius_m: 20",
        "roads.0.centreline.0.line_m", ["expected line_m, or"]),
    "no duration": ("duration_s: 2", "duration_s: 0",
        "duration_s", ["'0'", "expected 0.1 to 36000"]),
    "duration of half a frame": ("duration_s: 2", "duration_s: 0.14",
        "duration_s", ["0.14", "expected whole tenths"]),
    "check beside an unknown key": ("duration_s: 2", "junctions: [{roads: [main], left: 1}]",
        "junctions.0.left", ["unknown key", "left_share"]),
    "negative seed": ("duration_s: 2", "seed: -1",
        "seed", ["'-1'", "whole number"]),
    "unknown class": ("{Car: 1}", "{Car: 1, Ship: 1}",
        "traffic.class_shares", ["'Ship'", "expected Car"]),
    "shares that are all 0": ("{Car: 1}", "{Car: 0}",
        "traffic.class_shares", ["a sum of 0"]),
    "share above 1": ("{Car: 1}", "{Car: 2}",
        "traffic.class_shares.Car", ["'2'", "expected 0 to 1"]),
    "density below 0": ("vehicles_per_km_lane: 10", "vehicles_per_km_lane: -1",
        "traffic.vehicles_per_km_lane", ["'-1'", "expected 0 to 100"]),
    "a mount named as what is fused": ("z_m: 6}", "z_m: 6}\n  fused: {x_m: 1, y_m: 1, z_m: 6}",
        "mounts", ["'fused'", "letters, digits, _ and -"]),
    "unknown aggregation": ("duration_s: 2", "aggregation: slices:0",
        "aggregation", ["'slices:0'", "exact"]),
    "unknown detail": ("duration_s: 2", "detail: high",
        "detail", ["'high'", "expected box, low, mid, fine"]),
    "labels": ("duration_s: 2", "labels: some",
        "labels", ["'some'", "expected hit, all"]),
    "yes for true": ("duration_s: 2", "fields: yes",
        "fields", ["'yes'", "true or false"]),
    "fog that is black": ("duration_s: 2", "weather: {visibility_m: 0}",
        "weather.visibility_m", ["'0'", "above 0"]),
    "rain that falls up": ("duration_s: 2", "weather: {rain_mm_per_h: -1}",
        "weather.rain_mm_per_h", ["'-1'", "expected 0 to 300"]),
    "building on a lane": ("duration_s: 2",
        "buildings:\n  - {x_m: 0, y_m: 4, length_m: 5, width_m: 5, height_m: 9}",
        "x_m", ["on a lane", "expected a position beside"]),
    "flat building": ("duration_s: 2",
        "buildings: [{x_m: 0, y_m: 40, length_m: 5, width_m: 5, height_m: 0}]",
        "buildings.0.height_m", ["'0'", "above 0"]),
    "barrier on a lane": ("duration_s: 2", "barriers: [{road: main, offset_m: 2}]",
        "offset_m", ["on a lane"]),
    "barrier of another road": ("duration_s: 2", "barriers: [{road: other, offset_m: 12}]",
        "road", ["other"]),
    "gantry beyond the road": ("duration_s: 2", "gantries: [{road: main, s_m: 300}]",
        "s_m", ["at most the length of the road", "got 300"]),
    "trees beyond the road": ("duration_s: 2",
        "vegetation: [trees_along: {road: main, offset_m: 12, every_m: 9, from_m: 300}]",
        "from_m", ["at most the smaller of to_m and the length of the road", "got 300"]),
    "clockwise ground": ("duration_s: 2",
        "ground: [{elevation_m: 0, outline_m: [[0, 0], [0, 9], [9, 9], [9, 0]]}]",
        "ground.0.outline_m", ["do not turn left", "counter-clockwise"]),
    "junction of one road": ("duration_s: 2", "junctions: [{roads: [main]}]",
        "junctions.0.roads", ["expected 2 names, got 1"]),
    "traffic and trajectories": ("duration_s: 2", "trajectories: t.csv",
        "traffic", ["both or neither", "expected either"]),
    "plane that stands upright": ("duration_s: 2", "filters: [{ground_plane: {max_tilt_deg: 90}}]",
        "filters.0.ground_plane.max_tilt_deg", ["'90'", "expected above 0 to 89.9"]),
    "window below a cell": ("duration_s: 2",
        "filters: [{ground_morphological: {window_m: 1, cell_m: 2}}]",
        "filters.0.ground_morphological.window_m", ["expected cell_m or more, got less"]),
    "grid without end": ("duration_s: 2", "filters: [{ground_morphological: {cell_m: 0.1}}]",
        "filters.0.ground_morphological.max_range_m", ["expected at most 2000 cells", "got more"]),
    "outline without area": ("duration_s: 2",
        "filters: [{crop_polygon: {outline_m: [[0, 0], [1, 1], [2, 2]]}}]",
        "filters.0.crop_polygon.outline_m", ["expected an outline with an area, got none"]),
    "name of two lines": ("name: small", "name: \"a\\nb\"",
        "name", ["control character", "one line"]),
}  # fmt: skip


@pytest.mark.parametrize("case", WRONG_SCENES)
def test_wrong_scene(case: str, site: Site) -> None:
    old, new, key, words = WRONG_SCENES[case]
    text, line = replaced(SCENE, old, new)
    site.scene.write_text(text)
    result = site.run()
    assert_one_line(result, site, f": {key}: ", *words)
    file, number, column, _ = result.stderr.split(":", 3)
    assert file == str(site.scene)
    added = text.count("\n") - SCENE.count("\n")
    # these errors have the position of the map that lacks the key
    whole = "key missing", "traffic and trajectories"
    assert case in whole or line - 1 <= int(number) <= line + added + 1
    assert 1 <= int(column) <= 200
    check = site.infrasim("check", site.scene)
    assert (check.returncode, check.stderr) == (2, result.stderr)


def test_wrong_scene_is_named_at_line_and_column(site: Site) -> None:
    text, line = replaced(SCENE, "width_m: 3.5", "width_m: 0")
    site.scene.write_text(text)
    column = text.splitlines()[line - 1].index("width_m: 0") + len("width_m: ") + 1
    expected = f"{site.scene}:{line}:{column}: roads.0.lanes.width_m: expected 2.5 to 6, got '0'\n"
    assert site.run().stderr == expected


WRONG_LIDARS = {
    "unknown key": ("rate_hz: 10", "rate_hz: 10, colour: red",
        "pattern.spinning.colour", ["unknown key", "expected rate_hz"]),
    "key twice": ("model: Tiny", "model: Tiny\nmodel: Small",
        "model", ["twice"]),
    "key missing": ("rate_hz: 10, ", "",
        "pattern.spinning.rate_hz", ["expected a value, got none"]),
    "no name": ("name: tiny", "name:",
        "name", ["got nothing", "expected a text"]),
    "name that is a path": ("name: tiny", "name: ../tiny",
        "name", ["'../tiny'", "a name without /"]),
    "name of two columns": ("name: tiny", "name: a,b",
        "name", ["'a,b'", "a name without /, "]),
    "name that a spreadsheet runs": ("name: tiny", "name: =1+1",
        "name", ["'=1+1'", "begins with a letter, a digit or _"]),
    "name that is an option": ("name: tiny", "name: -rf",
        "name", ["'-rf'", "begins with a letter, a digit or _"]),
    "price that falls": ("low: 1, high: 2", "low: 3, high: 2",
        "price_usd.high", ["expected low or more, got less"]),
    "price without a source": ("source: test, ", "",
        "price_usd.source", ["expected a value, got none"]),
    "step of 0": ("azimuth_step_deg: 2", "azimuth_step_deg: 0",
        "pattern.spinning.azimuth_step_deg", ["'0'", "above 0"]),
    "rate NaN": ("rate_hz: 10", "rate_hz: .nan",
        "pattern.spinning.rate_hz", [".nan", "a number"]),
    "no channels": ("count: 4", "count: 0",
        "pattern.spinning.channels.count", ["none or several"]),
    "channels upside down": ("upper_deg: 0", "upper_deg: -30",
        "pattern.spinning.channels.upper_deg", ["expected above lower_deg"]),
    "two patterns": ("  spinning:", "  table: {file: a.npy, rays_per_s: 20}\n  spinning:",
        "pattern.spinning", ["none or several"]),
    "blind everywhere": ("{max_range_m: 80,", "{max_range_m: 80, min_range_m: 80,",
        "returns.max_range_m", ["expected above min_range_m"]),
    "no range": ("max_range_m: 80", "max_range_m: 0",
        "returns.max_range_m", ["'0'", "above 0"]),
    "sigma below 0": ("range_accuracy_m: 0.02", "range_accuracy_m: -0.02",
        "returns.range_accuracy_m", ["'-0.02'", "expected 0 to 10"]),
    "step of nothing": ("azimuth_step_deg: 2", "azimuth_step_deg: 1e-9",
        "pattern.spinning.azimuth_step_deg", ["columns a second", "expected 20 to 100000000"]),
    "step below every number": ("azimuth_step_deg: 2", "azimuth_step_deg: 1e-300",
        "pattern.spinning.azimuth_step_deg", ["'1e-300'", "expected 1.0e-09 or more"]),
    "turn of years": ("rate_hz: 10", "rate_hz: 1e-9",
        "pattern.spinning.rate_hz", ["expected 5 to 20"]),
    "step and columns": ("azimuth_step_deg: 2", "azimuth_step_deg: 2, columns_per_turn: 180",
        "pattern.spinning.columns_per_turn", ["none or several"]),
    "columns by zero": ("azimuth_step_deg: 2", "columns_per_turn: 180/0",
        "pattern.spinning.columns_per_turn", ["'180/0'", "a fraction such as 8125/4"]),
    "rays too few": ("  spinning: ", "  table: {file: a.csv, rays_per_s: 9}\n  #",
        "pattern.table.rays_per_s", ["'9'", "expected 20 to 100000000"]),
    "preset that is a number": ("  equal:\n    returns: {max_range_m: 100}", "  equal: 5\n",
        "presets.equal", ["'5'", "expected a map"]),
    "presets within a preset": ("  equal:\n", "  equal:\n    presets: {a: 1}\n",
        "presets", ["unknown key"]),
    "phase that is no choice": ("rate_hz: 10", "rate_hz: 10, phase: random",
        "pattern.spinning.phase", ["'random'", "expected locked, free"]),
    "range that falls with reflectance": ("range_at_10_percent_m: 40",
        "range_at_10_percent_m: 40, further_ranges: [{range_m: 30, reflectance: 0.5}]",
        "returns.detection.further_ranges",
        ["expected ranges that grow with reflectance and shrink with sunlight",
         "got 30 m at 50 % in 100 klx beside 40 m at 10 % in 100 klx"]),
    "range that grows with sunlight": ("range_at_10_percent_m: 40",
        "range_at_10_percent_m: 40, "
        "further_ranges: [{range_m: 30, reflectance: 0.1, sunlight_klux: 0}]",
        "returns.detection.further_ranges",
        ["got 30 m at 10 % in 0 klx beside 40 m at 10 % in 100 klx"]),
    "two ranges of one target": ("range_at_10_percent_m: 40",
        "range_at_10_percent_m: 40, further_ranges: [{range_m: 50, reflectance: 0.1}]",
        "returns.detection.further_ranges",
        ["got 40 m at 10 % in 100 klx beside 50 m at 10 % in 100 klx"]),
}  # fmt: skip


@pytest.mark.parametrize("case", WRONG_LIDARS)
def test_wrong_lidar(case: str, site: Site) -> None:
    old, new, key, words = WRONG_LIDARS[case]
    site.lidar.write_text(replaced(LIDAR, old, new)[0])
    preset = ["--preset", "equal"] if "preset" in case else []
    result = site.run(*preset)
    assert_one_line(result, site, f"{site.lidar}:", f": {key}: ", *words)
    assert result.stderr.split(":")[1].isdigit()
    check = site.infrasim("check", site.lidar)
    assert (check.returncode, check.stderr) == (2, result.stderr)


def test_presets_that_are_no_map(site: Site) -> None:
    site.lidar.write_text(LIDAR[: LIDAR.index("presets:")] + "presets: 5\n")
    assert_one_line(site.run(), site, f"{site.lidar}:6:10: presets: expected a map, got '5'")


def test_check_reads_the_presets_that_were_not_asked_for_too(site: Site) -> None:
    site.lidar.write_text(LIDAR.replace("{max_range_m: 100}", "{max_range_m: 0}"))
    result = site.infrasim("check", site.lidar)
    assert_one_line(result, site, f"{site.lidar}:8:", "returns.max_range_m: expected", ", got '0'")
    assert site.infrasim("check", site.lidar, "--preset", "datasheet").returncode == 0
    site.lidar.write_text(LIDAR.replace("{max_range_m: 100}", "{max_range_m: 100, reach: 1}"))
    result = site.infrasim("check", site.lidar)
    assert_one_line(result, site, f"{site.lidar}:8:", "returns.reach: ", "unknown key")


def test_check_says_how_well_the_detection_law_meets_the_ranges(site: Site) -> None:
    def checked(range_m: float) -> Any:
        ranges = f"100, further_ranges: [{{range_m: {range_m}, reflectance: 0.8}}]"
        text = LIDAR.replace("range_at_10_percent_m: 40", f"range_at_10_percent_m: {ranges}")
        site.lidar.write_text(text.replace("max_range_m: 80", "max_range_m: 900"))
        return site.infrasim("check", site.lidar)

    good = checked(210)
    assert good.stderr == (
        "infrasim: tiny: detection law: off by at most 0 %, "
        "210 m by the fitted law for the published range of 210 m at 80 % in 100 klx\n"
    )
    assert good.stdout.startswith('name: "tiny"')
    words = (
        "returns.detection.further_ranges: ",
        "expected ranges that one detection law predicts",
    )
    assert_one_line(checked(600), site, f"{site.lidar}: ", *words, "by the fitted law for")


NUMBER = re.compile(r"(?<=[ \[])-?\d+(\.\d+)?(?=[\n,\]])")


@pytest.mark.parametrize("step", [pytest.param(1, marks=pytest.mark.nightly), 10])
@pytest.mark.parametrize("kind", ["scene", "lidar"])
def test_no_number_may_be_infinite_or_none(kind: str, step: int, site: Site) -> None:
    """The exception is weather.visibility_m, which is .inf in clear air. Here it is not a number
    either."""
    whole = site.infrasim("check", site.scene if kind == "scene" else site.lidar).stdout
    file = site.folder / "whole.yaml"
    file.write_text(whole)
    assert site.infrasim("check", file).returncode == 0
    for match in list(NUMBER.finditer(whole))[::step]:
        line = whole[: match.start()].count("\n") + 1
        for value in (".nan", ".inf", "-.inf", "nan", "inf", "1e999"):
            file.write_text(whole[: match.start()] + value + whole[match.end() :])
            assert_one_line(site.infrasim("check", file), site, f"{file}:{line}:", f"'{value}'")


def test_unknown_preset_lists_those_there_are(site: Site) -> None:
    result = site.run("--preset", "best")
    assert_one_line(result, site, f"{site.lidar}:", "presets: ", "'best'", "equal, datasheet")


def test_a_preset_that_is_no_word(site: Site) -> None:
    text = LIDAR[: LIDAR.index("presets:")] + "returns: {max_range_m: 100}\n"
    site.lidar.write_text(text)
    assert_one_line(site.run("--preset", 'no"such'), site, "preset: ", "a name without comma")


def test_light_that_does_not_leave_a_prism(site: Site) -> None:
    prism = "{rpm: 7294, angle_deg: 34, refractive_index: 1.8144, faces: flat_first}"
    pattern = (
        f"prisms: {{steps_per_s: 40000, focal_length: 30, laser_offsets: [0], prisms: [{prism}]}}"
    )
    start, end = LIDAR.index("  spinning:"), LIDAR.index("presets:")
    site.lidar.write_text(f"{LIDAR[:start]}  {pattern}\n{LIDAR[end:]}")
    words = ("tiny: pattern.prisms.prisms: ", "total reflection", "smaller angle_deg")
    assert_one_line(site.run(), site, *words)
    check = site.infrasim("check", site.lidar)
    assert check.returncode == 2
    assert all(word in check.stderr for word in words)
    site.lidar.write_text(site.lidar.read_text().replace("angle_deg: 34", "angle_deg: 33"))
    assert site.infrasim("check", site.lidar).returncode == 0


def test_lidar_given_twice(site: Site) -> None:
    assert_one_line(site.run("--lidar", site.lidar), site, "--lidar: ", "'tiny' twice", "once")


def test_two_lidars_of_one_name(site: Site) -> None:
    other = shutil.copy(site.lidar, site.folder / "other.yaml")
    assert_one_line(site.run("--lidar", other), site, "--lidar: ", "'tiny' twice")


def test_bundle_of_a_bundle(site: Site) -> None:
    inner = site.folder / "inner.yaml"
    inner.write_text("name: inner\nbundle: [{lidar: lidar.yaml}]\n")
    site.lidar.rename(site.folder / "single.yaml")
    inner.write_text("name: inner\nbundle: [{lidar: single.yaml}]\n")
    site.lidar.write_text("name: outer\nbundle: [{lidar: inner.yaml}, {lidar: single.yaml}]\n")
    assert_one_line(site.run(), site, "bundle: ", "got the file of another bundle")


def test_bundle_of_itself_ends(site: Site) -> None:
    site.lidar.write_text("name: outer\nbundle: [{lidar: lidar.yaml}]\n")
    assert_one_line(site.run(), site, "bundle: ", "got the file of another bundle")


# Tables


def with_channels(site: Site, table: str) -> Path:
    file = site.folder / "channels.csv"
    file.write_text(table)
    text, _ = replaced(LIDAR, "{count: 4, upper_deg: 0, lower_deg: -20}", "{file: channels.csv}")
    site.lidar.write_text(text)
    return file


def test_the_channel_table_itself_is_right(site: Site) -> None:
    with_channels(site, CHANNELS)
    assert site.run().returncode == 0


@pytest.mark.parametrize(
    ("old", "new", "line", "key", "words"),
    [
        ("1,0,0,1", "1,nan,0,1", 3, "elevation_deg", ["'nan'", "-90"]),
        ("1,0,0,1", "1,,0,1", 3, "elevation_deg", ["''"]),
        ("1,0,0,1", "1,91,0,1", 3, "elevation_deg", ["'91'"]),
        ("1,0,0,1", "1,0,inf,1", 3, "azimuth_offset_deg", ["'inf'"]),
        ("1,0,0,1", "1,0,0,-1", 3, "fire_time_us", ["'-1'"]),
        ("1,0,0,1", "1,0,0", 3, "(row)", ["'1,0,0'", "4 columns"]),
        ("1,0,0,1", "1,0,0,1,5", 3, "(row)", ["4 columns"]),
        ("1,0,0,1", "1,x,0,1", 3, "elevation_deg", ["'x'"]),
        ("channel,elevation", "channel,angle", 1, "(header)", ["expected 'channel,elevation_deg"]),
    ],
)
def test_wrong_channel_table(
    old: str, new: str, line: int, key: str, words: list[str], site: Site
) -> None:
    file = with_channels(site, replaced(CHANNELS, old, new)[0])
    assert_one_line(site.run(), site, f"{file}:{line}:", f": {key}: expected", ", got ", *words)


def test_channel_table_without_rows(site: Site) -> None:
    file = with_channels(site, CHANNELS.splitlines()[0] + "\n")
    assert_one_line(site.run(), site, f"{file}:", "got none")


def test_fire_time_longer_than_its_column(site: Site) -> None:
    with_channels(site, CHANNELS.replace("1,0,0,1", "1,0,0,600"))  # a column takes 555.6 us
    assert_one_line(site.run(), site, "fire_time_us: ", "600", "expected below 555.5")


@pytest.mark.parametrize(
    ("array", "words"),
    [
        (np.zeros((4, 4)), ["(4, 4)"]),
        (np.zeros((4, 2), np.int32), ["<i4"]),
        (np.asfortranarray(np.zeros((4, 2))), ["Fortran"]),
        (np.zeros((0, 2)), ["none"]),
        (np.array([[0, 0], [np.nan, 0]]), ["row 1"]),
        (np.array([[0, 0], [0, 2.0]]), ["row 1"]),
    ],
)
def test_wrong_table_pattern(array: Any, words: list[str], site: Site) -> None:
    np.save(site.folder / "table.npy", array)
    old = LIDAR.splitlines()[4]
    new = "  table: {file: table.npy, rays_per_s: 1000}"
    site.lidar.write_text(replaced(LIDAR, old, new)[0])
    assert_one_line(site.run(), site, "table.npy", *words)


@pytest.mark.parametrize(
    "content", [b"", b"\x93NUMPY", b"not numpy at all", b"\x93NUMPY\x01\x00\xff\xff{}"]
)
def test_file_that_is_no_table(content: bytes, site: Site) -> None:
    (site.folder / "table.npy").write_bytes(content)
    new = "  table: {file: table.npy, rays_per_s: 1000}"
    site.lidar.write_text(replaced(LIDAR, LIDAR.splitlines()[4], new)[0])
    assert_one_line(site.run(), site, "table.npy", "expected")


# Trajectory files


def with_trajectories(site: Site, table: str) -> Path:
    file = site.folder / "recorded.csv"
    file.write_text(table)
    text = SCENE[: SCENE.index("traffic:")] + "trajectories: recorded.csv\n"
    site.scene.write_text(text.replace("duration_s: 2", "duration_s: 0.2"))
    return file


def test_the_trajectory_file_itself_is_right(site: Site) -> None:
    with_trajectories(site, TRAJECTORIES)
    result = site.run()
    assert result.returncode == 0, result.stderr


@pytest.mark.parametrize(
    ("old", "new", "line", "key", "words"),
    [
        ("0.1,2,Car,31", "0,2,Car,31", 5, "t", ["a time before that of the row above"]),
        ("0.2,1,Car,12", "0.3,1,Car,12", 6, "id", ["after a gap", "0.1 s"]),
        ("0.2,1,Car,12", "0.15,1,Car,12", 6, "t", ["multiple of 0.1 s"]),
        ("0.1,1,Car,11", "0.1,3,Car,11", 5, "id", ["expected ascending ids"]),
        ("0.1,1,Car,11", "0.1,1,Car,21", 4, "x", ["expected at most 10 m in 0.1 s, got a jump"]),
        ("0.1,1,Car,11,2,0.8,0", "0.1,1,Car,11,2,0.8,2", 4, "heading", ["60 degrees"]),
        (
            "0.1,1,Car,11,2,0.8,0,4",
            "0.1,1,Car,11,2,0.8,0,5",
            4,
            "dx",
            ["expected one size", "got a different size"],
        ),
        (
            "0.1,1,Car,11",
            "0.1,1,Van,11",
            4,
            "dx",
            ["expected one size and class", "got a different size"],
        ),
        ("0.1,1,Car,11", "0.1,1,Ship,11", 4, "class", ["'Ship'", "expected Car"]),
        ("0.1,1,Car,11", "0.1,1,Car,nan", 4, "x", ["'nan'", "expected a number"]),
        ("0.1,1,Car,11", "0.1,1.5,Car,11", 4, "id", ["1.5", "whole"]),
        ("0.1,1,Car,11,", "0.1,1,Car,", 4, "(row)", ["expected 11 columns"]),
        ("12,2,0.8,0,4,2,1.6,10", "12,2,0.8,0,4,2,1.6,10,5", 6, "(row)", ["expected 11 columns"]),
        ("t,id,class", "t,name,class", 1, "(header)", ["expected 't,id,class"]),
    ],
)
def test_wrong_trajectory_file(
    old: str, new: str, line: int, key: str, words: list[str], site: Site
) -> None:
    file = with_trajectories(site, replaced(TRAJECTORIES, old, new)[0])
    result = site.run()
    assert_one_line(result, site, f"{file}:{line}:", f": {key}: expected", ", got ", *words)


def test_trajectory_file_that_is_too_short(site: Site) -> None:
    with_trajectories(site, TRAJECTORIES)
    site.scene.write_text(site.scene.read_text().replace("0.2", "3"))
    assert_one_line(site.run(), site, "recorded.csv", "got times up to 0.2 s", "duration_s of 3 s")


def test_vehicle_that_comes_again_after_a_gap(site: Site) -> None:
    file = with_trajectories(site, TRAJECTORIES + "0.3,2,Car,33,2,0.8,0,4,2,1.6,10\n")
    assert_one_line(site.run(), site, f"{file}:7:", "id: ", "again after a gap")


# Options


@pytest.mark.parametrize(
    "frames",
    ["5", "a:b", "0:0", "3:1", "-1:2", "0:2:0", "0:2:-1", "0:2:1:1", "0:2x", "0.5:2", "0:1e3",
     "0:21", "0:99999999999", "0:68719476736", "0:2\n"],
)  # fmt: skip
def test_wrong_frames(frames: str, site: Site) -> None:
    words = ("--frames: expected A:B", "B <= 20 (duration_s is 2 s)", ", got ")
    assert_one_line(site.run(frames=frames), site, *words)


def test_step_of_frames_beyond_the_scene(site: Site) -> None:
    result = site.run(frames="1:3:2147483647")
    assert result.returncode == 0, result.stderr
    assert [p.name for p in site.out.glob("tiny/training/velodyne/*")] == ["000001.bin"]


def test_pattern_larger_than_memory(site: Site) -> None:
    words = ["pattern", site.lidar, "--out", site.out, "--frames"]
    assert_one_line(site.infrasim(*words, "0:360001"), site, "--frames: expected", "B <= 360000")
    site.lidar.write_text(LIDAR.replace("azimuth_step_deg: 2", "columns_per_turn: 2000000"))
    assert_one_line(site.infrasim(*words, "0:360000:10"), site, "got about", "rays in 36000 frames")


@pytest.mark.parametrize(
    ("assignment", "words"),
    [
        ("nonsense", ["'nonsense'", "KEY=VALUE"]),
        ("=3", ["KEY=VALUE"]),
        ("nonsense=3", ["nonsense: ", "unknown key"]),
        ("traffic.nonsense=3", ["traffic.nonsense: ", "unknown key"]),
        ("duration_s=long", ["duration_s: ", "'long'", "expected a number"]),
        ("duration_s=-1", ["duration_s: ", "'-1'", "expected 0.1"]),
        ("duration_s=", ["duration_s: ", "got nothing", "expected a number"]),
        ("roads.7.name=x", ["7: ", "no such list entry"]),
        ("roads.x.name=x", ["x: ", "no such list entry"]),
        ("duration_s.x=1", ["x: ", "plain value"]),
        ("traffic=[1", ["expected YAML, got malformed text"]),
        ("roads.0.lanes.width_m=0", ["roads.0.lanes.width_m: ", "'0'"]),
        ("traffic..warm_up_s=3", ["KEY=VALUE"]),
        ("traffic.warm_up_s.=3", ["KEY=VALUE"]),
        ("nonsense.deep=3", ["nonsense: ", "unknown key"]),
        ("mounts.pole.z_m=8,5", ["z_m: ", "'8,5'; numbers have a decimal point"]),
    ],
)
def test_wrong_assignment(assignment: str, words: list[str], site: Site) -> None:
    assert_one_line(site.run("--set", assignment), site, f"--set {assignment}", *words)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--colour", "red"], ["--colour"]),
        (["--threads", "0"], ["--threads", "1", "1024"]),
        (["--threads", "many"], ["--threads", "many"]),
        (["--seed", "-1"], ["seed", "'-1'", "whole number"]),
        (["--seed", "1.5"], ["seed", "'1.5'", "whole number"]),
        (["--seed", "99999999999999999999"], ["seed", "whole number"]),
        (["--aggregation", "slices"], ["aggregation", "'slices'", "exact"]),
        (["--aggregation", "slices:0"], ["aggregation", "'slices:0'"]),
        (["--aggregation", "slices:-3"], ["aggregation", "'slices:-3'"]),
        (["--detail", "high"], ["detail", "'high'", "expected box, low, mid, fine"]),
        (["--labels", "none"], ["labels", "'none'", "expected hit, all"]),
        (["--preset"], ["--preset"]),
    ],
)
def test_wrong_option(options: list[str], words: list[str], site: Site) -> None:
    assert_one_line(site.run(*options), site, *words)


@pytest.mark.parametrize(
    "words",
    [[], ["fly"], ["run"], ["run", "configs/scenes/highway.yaml"], ["check"], ["pattern"],
     ["pattern", "configs/lidars/livox_avia.yaml"], ["trajectories", "configs/scenes/curve.yaml"]],
    ids=" ".join,
)  # fmt: skip
def test_incomplete_command(words: list[str], site: Site) -> None:
    assert_one_line(site.infrasim(*words), site, "infrasim: ", "--help")


@pytest.mark.parametrize("option", ["--out", "--summary", "--seed", "--aggregation", "--frames"])
def test_empty_option_is_not_as_good_as_none(option: str, site: Site) -> None:
    """A shell passes an empty argument if a variable is not set: `--out "$DIR"`."""
    words = ["run", site.scene, "--lidar", site.lidar, "--set", "duration_s=10"]
    assert_one_line(site.infrasim(*words, option, ""), site, option.lstrip("-"))


def test_options_that_do_not_apply_are_not_ignored(site: Site) -> None:
    result = site.infrasim("check", site.lidar, "--set", "model=Other")
    assert_one_line(result, site, "--set")


# Files that are not YAML


@pytest.mark.parametrize("option", ["scene", "lidar"])
@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", ["(document): ", "got nothing", "expected a map"]),
        (b"# only a comment\n", ["(document): ", "got nothing"]),
        (b"just words", ["(document): ", "expected a map"]),
        (b"- a\n- b\n", ["(document): ", "a list", "expected a map"]),
        (b"name: [1, 2\nroads: {", ["expected YAML, got malformed text"]),
        (b"name: 'a\n", []),
        (b"a:\n\tb: 1\n", ["expected YAML, got malformed text"]),
        (b"name: *nobody\n", ["expected YAML, got malformed text"]),
        (bytes(range(256)) * 16, []),
        (b"\x00" * 4096, []),
        (b"\x7fELF\x02\x01\x01" + b"\x00" * 100, []),
        (b"\xff\xfe\x00n", []),
        (b"[" * 100_000, []),
        (b"{a: " * 100_000, []),
        (b"- " * 100_000, []),
        (b"name: x\n---\nname: y\n", []),
    ],
    ids=["empty", "comment", "words", "list", "open", "quote", "tab", "alias", "bytes", "zeros",
         "elf", "utf16", "brackets", "braces", "dashes", "two documents"],
)  # fmt: skip
def test_file_that_is_no_configuration(
    option: str, content: bytes, words: list[str], site: Site
) -> None:
    file = site.scene if option == "scene" else site.lidar
    file.write_bytes(content)
    assert_one_line(site.run(), site, str(file), *words)


@pytest.mark.parametrize("kind", ["scene", "lidar"])
@pytest.mark.parametrize("byte", [b"\x00", b"\x04", b"\x1b", b"\x7f", b"\xff"])
def test_byte_that_is_no_text(byte: bytes, kind: str, site: Site) -> None:
    """YAML's own reader stops at a byte with the value 4, and replaces bytes that are not UTF-8."""
    file = site.scene if kind == "scene" else site.lidar
    for mark in (b"name: ", b"\n", b"{"):
        old = file.read_bytes()
        before, _, after = old.partition(mark)
        file.write_bytes(before + mark + byte + after)
        lines = (before + mark).split(b"\n")
        line, column = len(lines), len(lines[-1]) + 1
        escaped = f"expected printable text in UTF-8, got the byte \\x{byte.hex()}"
        assert_one_line(site.run(), site, f"{file}:{line}:{column}: (document): {escaped}")
        file.write_bytes(old)


@pytest.mark.nightly
@pytest.mark.parametrize("kind", ["scene", "lidar"])
def test_hundred_thousand_keys(kind: str, site: Site) -> None:
    file = site.scene if kind == "scene" else site.lidar
    text = file.read_text()
    keys = "".join(f"key{i}: {i}\n" for i in range(100_000))
    file.write_text(text + keys)
    line = text.count("\n") + 1
    assert_one_line(site.run(), site, f"{file}:{line}:", "key0: expected", "got an unknown key")
    file.write_text(text + keys + "key77: 1\n")
    assert_one_line(
        site.run(), site, f"{file}:{line + 100_000}:1: key77: expected the key once, got it twice"
    )
    if kind == "lidar":
        nested = "".join(f"    key{i}: {i}\n" for i in range(100_000))
        file.write_text(text.replace("  equal:\n", "  equal:\n" + nested) + keys)
        assert_one_line(site.run("--preset", "equal"), site, "key0: expected", "got an unknown key")


@pytest.mark.parametrize("option", ["scene", "lidar"])
def test_second_document_in_a_file_is_not_left_out_silently(option: str, site: Site) -> None:
    file = site.scene if option == "scene" else site.lidar
    file.write_text(f"{file.read_text()}---\n{file.read_text()}")
    assert_one_line(site.run(), site, f"{file}:")


@pytest.mark.parametrize(
    "value",
    ["\x1b[31mred", "ä" * 40 + "a" * 40, "a" + "ä" * 80, "a\rb"],
    ids=["escape", "even", "odd", "return"],
)
def test_message_is_printable_whatever_was_given(value: str, site: Site) -> None:
    """Messages are printed in terminals and logs. They have no control characters and no incomplete
    UTF-8 characters."""
    quoted = value.replace("\x1b", r"\e").replace("\r", r"\r")
    site.scene.write_text(SCENE.replace("line_m: 200", f'line_m: "{quoted}"'))
    result = site.run()
    assert_one_line(result, site, "roads.0.centreline.0.line_m: expected a number, got ")
    assert result.stderr.rstrip("\n").isprintable()
    assert "?" not in result.stderr
    if value.startswith("\x1b"):
        assert r"got '\x1b[31mred'" in result.stderr


def test_aliases_that_grow_without_end(site: Site) -> None:
    lines = ["a0: &a0 [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]"]
    lines += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]" for i in range(1, 12)]
    site.scene.write_text("\n".join(lines))
    assert_one_line(site.run(), site, f"{site.scene}:")


@pytest.mark.parametrize("option", ["scene", "lidar"])
def test_directory_for_a_file(option: str, site: Site) -> None:
    file = site.scene if option == "scene" else site.lidar
    file.unlink()
    file.mkdir()
    assert_one_line(site.run(), site, str(file), "can't be read", codes=(1, 2))


@pytest.mark.parametrize("option", ["scene", "lidar"])
def test_file_that_is_not_there(option: str, site: Site) -> None:
    file = site.scene if option == "scene" else site.lidar
    file.unlink()
    assert_one_line(site.run(), site, str(file), "can't be read", codes=(1, 2))


@pytest.mark.parametrize("kind", ["channels", "trajectories"])
def test_directory_for_a_table(kind: str, site: Site) -> None:
    file = (with_channels if kind == "channels" else with_trajectories)(site, "")
    file.unlink()
    file.mkdir()
    assert_one_line(site.run(), site, str(file), "can't be read", codes=(1, 2))


NO_ROADS = SCENE[: SCENE.index("roads:")]
# The file that names a file that is not there, its text, and the key.
MISSING_FILES = {
    "lanes": ("scene", NO_ROADS + "lanes: no.csv\ntrajectories: no.csv\n", "lanes"),
    "trajectories": ("scene", SCENE[: SCENE.index("traffic:")] + "trajectories: no.csv\n",
        "trajectories"),
    "mesh": ("scene", SCENE + "meshes:\n  - {file: no.ply, material: road}\n", "meshes.0.file"),
    "static layer": ("scene", SCENE + "static_layers: {tiny: no.layer}\n", "static_layers.tiny"),
    "channels": ("lidar", LIDAR.replace("{count: 4, upper_deg: 0, lower_deg: -20}",
        "{file: no.csv}"), "pattern.spinning.channels.file"),
    "directions": ("lidar", LIDAR.replace(LIDAR.splitlines()[4],
        "  table: {file: no.npy, rays_per_s: 1000}"), "pattern.table.file"),
    "bundle": ("lidar", "name: two\nbundle:\n  - {lidar: no.yaml}\n", "bundle.0.lidar"),
}  # fmt: skip


@pytest.mark.parametrize("case", MISSING_FILES)
def test_a_missing_file_is_named_with_its_key(case: str, site: Site) -> None:
    kind, text, key = MISSING_FILES[case]
    file = site.scene if kind == "scene" else site.lidar
    file.write_text(text)
    line = text[: text.index("no.")].count("\n") + 1
    result = site.run()
    reason = "the file does not exist" if case == "trajectories" else "No such file or directory"
    words = (f"{file}:{line}:", f": {key}: {site.folder / 'no.'}", f": can't be read: {reason}")
    assert_one_line(result, site, *words, codes=(1,))


def test_a_file_for_the_folder_of_a_run(site: Site) -> None:
    words = ["run", site.scene, "--lidar", site.lidar, "--frames", "0:2", "--out"]
    for out in (site.scene, f"{site.scene}/"):
        result = site.infrasim(*words, out)
        assert_one_line(result, site, f"{site.scene}: expected a folder, got a file", codes=(1,))


def test_lidar_for_a_scene_and_scene_for_a_lidar(site: Site) -> None:
    site.scene.write_text(LIDAR)
    site.lidar.write_text(SCENE)
    assert_one_line(
        site.run(), site, str(site.scene), "model: expected name, ", "got an unknown key"
    )
    site.scene.write_text(SCENE)
    assert_one_line(
        site.run(), site, str(site.lidar), "expected name, model, ", "got an unknown key"
    )


def test_a_misspelt_required_key_is_named_where_it_stands(site: Site) -> None:
    site.scene.write_text(SCENE.replace("mounts:", "mount:"))
    assert_one_line(
        site.run(), site, str(site.scene), "mount: expected name, ", "got an unknown key"
    )


def test_messages_of_pattern_and_trajectories_are_one_line_too(site: Site) -> None:
    out = ["--out", site.out]
    site.scene.write_text(SCENE.replace("width_m: 3.5", "width_m: 0"))
    site.lidar.write_text(LIDAR.replace("rate_hz: 10", "rate_hz: 0"))
    assert_one_line(
        site.infrasim("trajectories", site.scene, *out), site, "width_m: expected", "got '0'"
    )
    assert_one_line(
        site.infrasim("pattern", site.lidar, *out), site, "rate_hz: expected", "got '0'"
    )
    site.lidar.write_text(LIDAR)
    result = site.infrasim("pattern", site.lidar, "--frames", "9", *out)
    assert_one_line(result, site, "--frames: expected", "got '9'")


# Names of the catalogue


def test_names_stand_for_the_files_of_the_catalogue(site: Site) -> None:
    for kind, name in (("lidars", "livox_avia"), ("scenes", "curve")):
        by_name = site.infrasim("check", name)
        assert by_name.returncode == 0, by_name.stderr
        assert by_name.stdout == site.infrasim("check", f"configs/{kind}/{name}.yaml").stdout
    words = ["--set", "duration_s=1", "--set", "traffic.warm_up_s=1", "--frames", "0:1"]
    out = site.folder / "by_name"
    result = site.infrasim(
        "run", "curve", "--lidar", "livox_avia", site.lidar, *words, "--out", out
    )
    assert result.returncode == 0, result.stderr
    assert sorted(p.name for p in out.iterdir() if p.is_dir()) == ["livox_avia", "tiny"]
    assert site.infrasim("pattern", "livox_avia", "--out", site.folder / "a.npy").returncode == 0


def test_unknown_name_lists_the_catalogue(site: Site) -> None:
    run = ["run", site.scene, "--lidar"]
    assert_one_line(site.infrasim(*run, "avia"), site, "got 'avia'", "livox_avia", "ruby_plus")
    result = site.infrasim("run", "motorway", "--lidar", site.lidar)
    assert_one_line(
        result, site, "got 'motorway'", "crest, crossroad, crossroad_poles, curve, flat, highway"
    )
    assert "livox" not in result.stderr
    result = site.infrasim("check", "motorway")
    assert_one_line(result, site, "got 'motorway'", "a path", "a LiDAR (", "livox_avia, ")
    assert "a scene (crest, crossroad, crossroad_poles, curve, flat, highway" in result.stderr


def test_a_word_that_is_nearly_a_path_is_answered_with_the_path(site: Site) -> None:
    here = {"cwd": site.folder}
    result = site.infrasim("check", "lidar", **here)
    assert_one_line(result, site, "got 'lidar'; did you mean 'lidar.yaml'?")
    (site.folder / "town").mkdir()
    assert_one_line(site.infrasim("check", "town", **here), site, "got the folder 'town'\n")
    site.scene.rename(site.folder / "town/scene.yaml")
    result = site.infrasim("check", "town", **here)
    assert_one_line(result, site, "got the folder 'town'; did you mean 'town/scene.yaml'?")


def test_a_file_is_named_with_a_slash_or_an_ending(site: Site) -> None:
    site.lidar.rename(site.folder / "livox_avia")
    here = {"cwd": site.folder}
    assert 'name: "tiny"' in site.infrasim("check", "./livox_avia", **here).stdout
    assert 'name: "livox_avia"' in site.infrasim("check", "livox_avia", **here).stdout
    assert site.infrasim("check", "scene.yaml", **here).returncode == 0


def test_a_pole_in_centimetres_is_refused(site: Site) -> None:
    site.scene.write_text(SCENE.replace("z_m: 6", "z_m: 600"))
    words = ("mounts.pole.z_m: expected metres", "got 600", "600 centimetres are 6")
    assert_one_line(site.run(), site, f"{site.scene}:", *words)
    check = site.infrasim("check", site.scene)
    assert check.returncode == 2
    site.scene.write_text(SCENE.replace("z_m: 6", "z_m: 60"))
    assert site.infrasim("check", site.scene).returncode == 0


@pytest.mark.parametrize(
    ("yaw_deg", "looks"),
    [(0, "90 degrees (east)"), (90, "0 degrees (north)"), (45, "(north-east)")],
)
def test_check_says_where_a_mount_looks(yaw_deg: int, looks: str, site: Site) -> None:
    site.scene.write_text(SCENE.replace("z_m: 6", f"z_m: 6, yaw_deg: {yaw_deg}"))
    check = site.infrasim("check", site.scene, "--lidar", site.lidar)
    pose, view = check.stderr.splitlines()
    assert "mount pole: 6 m above the road, looks to " in pose
    assert looks in pose
    # 6 m / tan(20 degrees) = 16.5 m
    assert "mount pole, tiny: sees all round; the lowest ray meets the ground at 16 m" in view
    assert view.endswith("the highest above the horizon")


def test_a_pitched_mount_sees_nearer_ground(site: Site) -> None:
    site.scene.write_text(SCENE.replace("z_m: 6", "z_m: 6, pitch_deg: 10"))
    view = site.infrasim("check", site.scene, "--lidar", site.lidar).stderr.splitlines()[1]
    # 6 m / tan(30 degrees) = 10.4 m, 6 m / tan(10 degrees) = 34.0 m
    assert "lowest ray meets the ground at 10 m, the highest at 34 m" in view


def test_a_unit_that_looks_back_from_a_pitched_mount_sees_farther_ground(site: Site) -> None:
    site.scene.write_text(SCENE.replace("z_m: 6", "z_m: 6, pitch_deg: 10"))
    bundle = site.lidar.with_name("back.yaml")
    bundle.write_text(f"name: back\nbundle: [{{lidar: {site.lidar.name}, yaw_deg: 180}}]\n")
    view = site.infrasim("check", site.scene, "--lidar", bundle).stderr.splitlines()[1]
    # 6 m / tan(10 degrees) = 34.0 m
    assert "lowest ray meets the ground at 34 m, the highest above the horizon" in view


def test_the_example_of_filter_works(site: Site) -> None:
    (site.folder / "000000.bin").write_bytes(np.ones((5, 4), np.float32).tobytes())
    text = site.infrasim("filter", "--help").stdout.replace("\n", " ")
    words = text.split("Example: infrasim ")[1].split(" Usage: ")[0].split()
    result = site.infrasim(*words, cwd=site.folder)
    assert result.returncode == 0, result.stderr


def test_similar_names_and_renamed_options_are_suggested(site: Site) -> None:
    assert "did you mean 'highway'?" in site.infrasim("check", "higway").stderr
    old = site.infrasim("filter", "a.bin", "b.bin", "--range", "2,60")
    assert old.returncode == 2
    assert "--crop-range" in old.stderr


@pytest.mark.parametrize(
    ("option", "value"),
    [
        ("--crop-polygon", "0,0,1,0,1,1"),
        ("--ground-plane", "0.2"),
        ("--crop-box", "0,0,0,1,1,1"),
        ("--crop-range", "1,2"),
        ("--below-z", "1"),
        ("--pcd", "ascii"),
    ],
)
def test_a_filter_option_twice_is_refused(option: str, value: str, site: Site) -> None:
    (site.folder / "a.bin").write_bytes(np.ones((5, 4), np.float32).tobytes())
    words = ["filter", "a.bin", "--out", "b.pcd", option, value, f"{option}={value}"]
    result = site.infrasim(*words, cwd=site.folder)
    assert_one_line(result, site, f"{option}: expected the option once, got it twice")


def test_an_option_of_a_run_twice_is_refused_unless_it_takes_several_values(site: Site) -> None:
    twice = site.run("--frames", "0:1", "--preset", "equal", "--preset", "equal")
    assert_one_line(twice, site, "expected the option once, got it twice")
    words = ["run", site.scene, "--frames", "0:1", "--lidar", site.lidar]
    words += ["--set", "seed=1", "--set", "duration_s=1"]
    result = site.infrasim(*words)
    assert result.returncode == 0, result.stderr
