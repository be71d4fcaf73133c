"""Generated sites: equal for equal seeds, accepted by the simulator, and streamed without files."""

import functools
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from conftest import BINARY

from pyinfra.cli.main import main
from pyinfra.core.errors import ConfigError
from pyinfra.dataset import simulation
from pyinfra.dataset.catalogue import configs, lidar_file
from pyinfra.formats.kitti import read_keys
from pyinfra.models.training import generated_sites as stream_module
from pyinfra.models.training.generated_sites import (
    SiteSamples,
    StreamPlan,
    read_stream,
    samples_of,
    site_stream,
)
from pyinfra.models.training.recipe import Recipe, read_recipe
from pyinfra.models.training.samples import SiteSample
from pyinfra.models.training.sources import Stream
from pyinfra.models.training.train import train
from pyinfra.scenes.generator import generate
from pyinfra.scenes.generator.generate import make_site
from pyinfra.scenes.generator.layout import Keys, PlannedRoad, crossing, varied
from pyinfra.scenes.generator.lidar_catalogue import Sensors, sensors
from pyinfra.scenes.generator.random_stream import RandomStream
from pyinfra.scenes.generator.ranges import CLUTTERED, RANGES
from pyinfra.scenes.generator.road_types import ROAD_TYPES, STREET

MANY = 100


@functools.cache
def sites() -> list[Keys]:
    """Generates the sites of the first seeds, when a test first needs them."""
    return [make_site(seed) for seed in range(MANY)]


def test_a_seed_gives_the_same_site_again_and_another_seed_another() -> None:
    assert make_site(7) == sites()[7]
    without_name = [
        yaml.safe_dump({k: v for k, v in s.items() if k not in ("name", "seed")}) for s in sites()
    ]
    assert len(set(without_name)) == MANY


def test_a_site_is_plain_data_that_a_scene_file_holds() -> None:
    assert yaml.safe_load(yaml.safe_dump(sites()[3])) == sites()[3]


def test_a_seed_below_zero_is_refused() -> None:
    with pytest.raises(ValueError, match="seed: expected 0 or more, got -1"):
        make_site(-1)


@pytest.mark.parametrize("seed", range(0, MANY, 4))
def test_a_site_can_be(seed: int, tmp_path: Path) -> None:
    file = tmp_path / "site.yaml"
    file.write_text(yaml.safe_dump(sites()[seed]))
    result = subprocess.run([BINARY, "check", file], capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr


@pytest.mark.nightly
@pytest.mark.slow
def test_vehicles_of_sites_share_no_place(tmp_path: Path) -> None:
    for seed in range(0, MANY, 5):
        file = tmp_path / f"{seed}.yaml"
        file.write_text(yaml.safe_dump(sites()[seed]))
        command = [BINARY, "check", file, "--traffic"]
        result = subprocess.run(command, capture_output=True, text=True, check=False)
        assert result.returncode == 0, result.stderr


def count(of: str) -> int:
    return sum(1 for site in sites() if site.get(of))


def test_sites_have_what_stands_beside_real_roads() -> None:
    assert count("vegetation") > 0.8 * MANY
    assert count("barriers") > 0.4 * MANY
    assert count("buildings") > 0.6 * MANY
    assert count("parked") > 0.15 * MANY
    assert count("junctions") > 0.15 * MANY
    assert count("gantries") > 0.02 * MANY
    assert sum("embankment" in site["roads"][0] for site in sites()) > 0.1 * MANY
    assert {site["label_time"] for site in sites()} == {"frame", "scan"}


def test_people_go_in_streets_more_than_along_rural_roads_and_on_no_motorway() -> None:
    rows = [row for site in sites() for row in site.get("people", [])]
    assert 0.3 * MANY < count("people") < 0.7 * MANY
    assert {row["class"] for row in rows} == {"Pedestrian", "Cyclist"}
    for row in rows:
        assert 15 <= row["to_m"] - row["from_m"] <= 250
        assert row["speed"]["std_km_h"] <= row["speed"]["mean_km_h"] / 3
    motorways = [site for site in sites() if site["traffic"]["speed"]["mean_km_h"] > 100]
    assert motorways
    assert not any(site.get("people") for site in motorways)


BARE = replace(RANGES, furniture=replace(RANGES.furniture, sites=0.0))


def test_people_change_nothing_else_of_a_site() -> None:
    deserted = replace(BARE, ways=replace(RANGES.ways, sites=0))
    for seed in range(12):
        site = make_site(seed, BARE)
        others = {key: value for key, value in site.items() if key != "people"}
        assert make_site(seed, deserted) == others


def test_furniture_changes_nothing_else_of_a_site() -> None:
    for seed in range(12):
        bare, site = make_site(seed, BARE), dict(sites()[seed])
        site.pop("standing_people", None)
        for key in ("buildings", "vegetation"):
            before = bare.pop(key, [])
            assert site.pop(key, [])[: len(before)] == before
        assert site == bare


@pytest.mark.nightly
def test_cluttered_streets_can_be_and_hold_every_kind_of_furniture(tmp_path: Path) -> None:
    sites = [make_site(seed, CLUTTERED) for seed in range(8)]
    bare = replace(CLUTTERED, furniture=replace(CLUTTERED.furniture, sites=0.0))
    trees = buildings = groups = 0
    for seed, site in enumerate(sites):
        simulation.make_world(site)
        plain = make_site(seed, bare)
        trees += len(site.get("vegetation", [])) - len(plain.get("vegetation", []))
        buildings += len(site["buildings"]) - len(plain.get("buildings", []))
        groups += len(site.get("standing_people", []))
    assert trees > 8
    assert buildings > 80
    assert groups > 4


def test_crossings_are_also_a_t_and_some_roads_across_are_one_way() -> None:
    drawn = [crossing(RandomStream(seed, "roads"), STREET, RANGES) for seed in range(300)]
    layouts = [
        varied(site, RandomStream(seed, "junction"), RANGES) for seed, site in enumerate(drawn)
    ]
    through, side = zip(*(layout.roads for layout in layouts), strict=True)
    t = np.array([b.length_m < 0.6 * a.length_m for a, b in zip(through, side, strict=True)])
    one_way = [road.keys["lanes"].get("one_way", False) for road in side]
    assert 0.2 < t.mean() < 0.45
    assert 0.05 < np.mean(one_way) < 0.15
    rings = ["roundabout" in layout.junctions[0] for layout in layouts]
    assert 0.2 < np.mean(rings) < 0.4
    ending = [road for road, ends in zip(side, t, strict=True) if ends]
    assert {road.keys["lanes"]["each_way"] for road in ending} <= {1, 2}
    starts = [np.hypot(*road.stations[0, 1:3]) < 1 for road in ending]
    assert 0.3 < np.mean(starts) < 0.7  # both ways to sample the start occur


def test_sensors_hang_within_their_range_and_look_at_the_road_mostly() -> None:
    mounts = [site["mounts"]["pole"] for site in sites()]
    heights = np.array([mount["z_m"] for mount in mounts])
    assert heights.min() >= 3.5
    assert heights.max() <= 9
    assert np.ptp(heights) > 4
    near = [PlannedRoad(s["roads"][0]).distance(np.array([[m["x_m"], m["y_m"]]])) for s, m in
            zip(sites(), mounts, strict=True)]  # fmt: skip
    assert np.max(near) < 40


@pytest.mark.nightly
def test_some_sites_have_many_motorcycles_and_some_many_buses() -> None:
    shares = [make_site(seed)["traffic"]["class_shares"] for seed in range(120)]
    assert all(0 <= weight <= 1 for of_site in shares for weight in of_site.values())
    many = [
        name
        for name in ("Motorcycle", "Bus")
        for site_shares in shares
        if site_shares.get(name, 0) >= 0.4
    ]
    assert 8 <= many.count("Motorcycle") <= 30
    assert 3 <= many.count("Bus") <= 20


def test_classes_fit_the_lanes_of_their_bends_as_the_simulator_has_it() -> None:
    for name, lane, radius in (("Bus", 3.5, 40.0), ("Truck", 3.0, 25.0), ("Car", 2.8, 12.0)):
        length, _ = generate.MEAN_SIZE_M[name]
        assert generate.fits(name, lane, 1e6) == generate.fits(name, lane, np.inf)
        assert not generate.fits(name, lane, length / 4)
        assert isinstance(generate.fits(name, lane, radius), bool)


def test_mean_sizes_are_those_of_the_simulator(tmp_path: Path) -> None:
    """In a scene with one class, the mean size of the vehicles is that of the class."""
    for name, (length, width) in generate.MEAN_SIZE_M.items():
        keys = parked_only(name)
        boxes = boxes_of(simulation.make_world(keys), keys)
        assert np.abs(boxes[:, 3].mean() - length) < 0.35
        assert np.abs(boxes[:, 4].mean() - width) < 0.1


def parked_only(name: str) -> Keys:
    """Returns a scene with rows of vehicles beside a road without traffic."""
    rows = [
        {"road": "main", "offset_m": off, "gap_m": 1, "occupied": 1, "class_shares": {name: 1}}
        for off in (-9, 9, 14, -14)
    ]
    road = {
        "name": "main",
        "start": {"x_m": -60, "y_m": 0},
        "centreline": [{"line_m": 120}],
        "lanes": {"each_way": 1},
    }
    return {
        "name": "parked",
        "duration_s": 1,
        "label_time": "frame",
        "mounts": {"pole": {"x_m": 0, "y_m": 0, "z_m": 9, "yaw_deg": 0}},
        "roads": [road],
        "traffic": {
            "vehicles_per_km_lane": 0,
            "speed": {"mean_km_h": 50},
            "class_shares": {"Car": 1},
        },
        "parked": rows,
    }


def boxes_of(world: simulation.World, keys: Keys) -> np.ndarray:
    lidar = simulation.load_lidar(lidar_file("ruby_plus"), "equal")
    (sample,) = samples_of(world, keys, lidar, [0])
    return sample.boxes


def test_parked_vehicles_are_labelled_as_others_and_stand_still() -> None:
    keys = parked_only("Car")
    world = simulation.make_world(keys)
    lidar = simulation.load_lidar(lidar_file("ruby_plus"), "equal")
    frames = [objects for _, (frame,) in simulation.simulate(world, [lidar], [0, 9])
              for objects in [frame.objects]]  # fmt: skip
    assert len(frames[0]) > 60
    assert (frames[0]["speed"] == 0).all()
    assert (frames[0]["id"] >= 1_000_000_000).all()
    assert (frames[0]["x"] == frames[1]["x"]).all()
    assert (frames[0]["points"] > 0).mean() > 0.8


# --- the stream -----------------------------------------------------------------------------------

FEW = Sensors((lidar_file("velodyne_vlp_16"), lidar_file("livox_mid_70")))
PLAN = StreamPlan(sites=3, lidars=2, frames=2, mixed=2)


def test_a_sample_is_a_function_of_plan_and_number_alone() -> None:
    forwards, alone = SiteSamples(PLAN, FEW), SiteSamples(PLAN, FEW)
    ahead = [forwards.sample(i) for i in range(10)]
    for i in (9, 2):
        again = alone.sample(i)
        np.testing.assert_array_equal(again.points, ahead[i].points)
        np.testing.assert_array_equal(again.boxes, ahead[i].boxes)
    assert len({len(sample.points) for sample in ahead}) > 5


@pytest.mark.nightly
def test_a_site_that_cannot_be_is_drawn_again() -> None:
    """If the simulator refuses all sites, the error gives the reason."""

    def with_a_house_on_the_road(seed: int) -> Keys:
        keys = make_site(seed)
        x, y, _ = PlannedRoad(keys["roads"][0]).pose_at(20.0, keys["roads"][0]["lanes"]["width_m"])
        house = {"x_m": x, "y_m": y, "length_m": 9, "width_m": 9, "height_m": 9}
        return keys | ({"buildings": [house]} if seed < refused else {})

    refused = 2_000_000_000
    usual = SiteSamples(replace(PLAN, first_site=refused), FEW)
    streamed = SiteSamples(PLAN, FEW, make_keys=with_a_house_on_the_road)
    np.testing.assert_array_equal(streamed.sample(0).points, usual.sample(0).points)
    refused = 10**12
    with pytest.raises(simulation.ConfigError, match="on a lane"):
        SiteSamples(PLAN, FEW, make_keys=with_a_house_on_the_road).sample(0)


def test_each_site_is_built_once_a_visit() -> None:
    built: list[int] = []

    def counted(seed: int) -> Keys:
        built.append(seed)
        return make_site(seed)

    samples = SiteSamples(PLAN, FEW, make_keys=counted)
    for i in range(8):
        samples.sample(i)
    assert len(built) == len(set(built)) == 2


def test_a_sample_knows_its_region_and_has_z_from_the_road() -> None:
    samples, on_road = SiteSamples(PLAN, FEW), 0
    for i in range(8):
        sample = samples.sample(i)
        inside = sample.boxes[sample.region.holds(sample.boxes, 0.0)]
        np.testing.assert_allclose(inside[:, 2], inside[:, 5] / 2, atol=2e-3)
        on_road += len(inside)
    assert on_road > 5


def test_another_sample_is_of_the_same_visit_and_lidar() -> None:
    samples = SiteSamples(PLAN, FEW)
    draw = np.random.default_rng(0)
    for i in range(4):
        sample = samples.sample(i)
        others = [samples.another(i, draw) for _ in range(12)]
        assert all(other.region is sample.region for other in others)
        assert any(other is not sample for other in others)


def test_a_stream_says_what_it_is_of() -> None:
    stream = site_stream(PLAN, FEW)
    assert stream.lidar == "livox_mid_70 velodyne_vlp_16"
    assert stream.label_time == "frame scan"
    assert len(stream.samples) == 12


def test_more_lidars_than_there_are_is_refused() -> None:
    with pytest.raises(ValueError, match="lidars: expected up to 2 LiDARs per visit, got 4"):
        site_stream(StreamPlan(), FEW)


def test_narrow_visits_have_narrow_lidars_alone_and_look_along_a_road(tmp_path: Path) -> None:
    file = tmp_path / "stream.yaml"
    names = "narrow: [livox_mid_40, livox_tele_15]\n"
    file.write_text(
        "plan: {sites: 9, lidars: 2, frames: 1, mixed: 1, narrow: 0.5}\n"
        f"{names}without: [ruby_plus]\npresets: {{equal: 1, paper: 0, datasheet: 0}}\n"
    )
    stream = read_stream(file)
    assert {"livox_mid_40", "livox_tele_15"} <= set(stream.lidar.split())
    samples = stream.samples
    assert isinstance(samples, SiteSamples)
    kinds = set()
    for visit in range(9):
        lidars = []

        def noted(
            world: object, keys: Keys, lidar: simulation.Lidar, *rest: object
        ) -> list[object]:
            lidars.append((lidar.name, keys))  # noqa: B023
            return []

        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(stream_module, "samples_of", noted)
            samples._visit(visit)
        narrow = {name in ("livox_mid_40", "livox_tele_15") for name, _ in lidars}
        assert len(narrow) == 1
        kinds |= narrow
        if narrow == {True}:
            keys = lidars[0][1]
            road = PlannedRoad(keys["roads"][0])
            mount = keys["mounts"]["pole"]
            away = np.hypot(*(road.stations[:, 1:3] - [mount["x_m"], mount["y_m"]]).T)
            along = np.degrees(road.stations[away.argmin(), 3]) - mount["yaw_deg"]
            assert abs((along + 90) % 180 - 90) < 9
    assert kinds == {True, False}
    file.write_text("plan: {lidars: 2, narrow: 0.5}\n")
    with pytest.raises(ConfigError, match=r"narrow: expected a list of LiDARs if plan"):
        read_stream(file)
    file.write_text(f"plan: {{lidars: 2}}\n{names}")
    with pytest.raises(ConfigError, match=r"narrow: expected a list of LiDARs if plan"):
        read_stream(file)


def test_lidars_can_be_held_out_by_name() -> None:
    names = [file.stem for file in sensors(without=["ruby_plus", "helios_16"]).files]
    assert "ruby_plus" not in names
    assert {"livox_avia", "bundle_5_livox_avia"} <= set(names)
    with pytest.raises(ValueError, match=r"without: expected .*, got 'no_such'"):
        sensors(without=["no_such"])


def test_free_motors_start_where_the_seed_says() -> None:
    lidar = simulation.load_lidar(lidar_file("ruby_plus"), "paper")
    free = lidar.with_free_motors()
    first = [free.pattern(0, 1, 1, seed)[0, 0] for seed in (1, 2)]
    locked = [lidar.pattern(0, 1, 1, seed)[0, 0] for seed in (1, 2)]
    assert first[0] != first[1]
    assert locked[0] == locked[1]


def test_a_file_says_what_is_streamed(tmp_path: Path) -> None:
    file = tmp_path / "stream.yaml"
    file.write_text("plan: {sites: 7, label_time: scan}\nwithout: [ruby_plus]\n")
    stream = read_stream(file)
    assert "ruby_plus" not in stream.lidar.split()
    assert (stream.label_time, stream.preset) == ("scan", "datasheet equal paper")
    assert len(stream.samples) == 7 * 4 * 2
    for text, expected in (
        ("plan: {lidars: 0}\n", r"stream.yaml:1: plan.lidars: expected 1 to 100, got 0"),
        ("without: [none]\n", r"stream.yaml: without: expected .*, got 'none'"),
        (
            "plan: {lidars: 99}\n",
            r"lidars: expected up to \d+ LiDARs per visit, got 99",
        ),
    ):
        file.write_text(text)
        with pytest.raises(ConfigError, match=expected):
            read_stream(file)


# --- the command ----------------------------------------------------------------------------------


def test_the_command_writes_scene_files_and_a_sheet(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["sites", "--seed", "5", "--count", "2", "--out", str(tmp_path)]) == 0
    assert yaml.safe_load((tmp_path / "site_000006.yaml").read_text()) == sites()[6]
    assert (tmp_path / "sheet.png").stat().st_size > 10_000
    assert capsys.readouterr().out.split()[-1].endswith("sheet.png")


def test_a_sheet_that_is_not_of_all_sites_is_noted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pyinfra.cli.sites.MOST_ON_A_SHEET", 1)
    assert main(["sites", "--count", "2", "--out", str(tmp_path)]) == 0
    assert "sheet.png shows the first 1 of 2 sites" in capsys.readouterr().err


def test_the_command_says_what_is_allowed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["sites", "--count", "0", "--out", str(tmp_path)]) == 2
    assert "--count: expected 1 or more, got 0" in capsys.readouterr().err


def test_every_range_rises() -> None:
    values = [
        value
        for part in (*ROAD_TYPES.values(), RANGES.mount, RANGES.things, RANGES.parking, RANGES.sky)
        for field in vars(part).values()
        for value in (field.values() if isinstance(field, dict) else [field])
    ]
    spans = [value for value in values if isinstance(value, tuple)]
    assert len(spans) > 50
    assert all(low <= high for low, high in spans)


# --- learning from a stream -----------------------------------------------------------------------


def small(steps: int) -> Recipe:
    recipe = read_recipe(configs() / "detectors/pointpillars.yaml", "smoke")
    return replace(recipe, learning=replace(recipe.learning, steps=steps, batch=2, window_m2=900))


def run_of(out: Path, steps: int, stop_at: int | None = None) -> bytes:
    """Trains a small network for some steps and returns its weights. With `stop_at`, the training
    is stopped and resumed."""
    recipe = small(steps)
    if stop_at is not None:
        with pytest.raises(KeyboardInterrupt):
            train(recipe, stream_until(PLAN, stop_at), out, quiet=True)
    return train(recipe, site_stream(PLAN, FEW), out, quiet=True).read_bytes()


class Interrupted(SiteSamples):
    """A stream that raises KeyboardInterrupt at a sample."""

    last = 0

    def sample(self, i: int) -> SiteSample:
        if i >= self.last:
            raise KeyboardInterrupt
        return super().sample(i)


def stream_until(plan: StreamPlan, sample: int) -> Stream:
    samples = Interrupted(plan, FEW)
    samples.last = sample
    return replace(site_stream(plan, FEW), samples=samples)


@pytest.mark.slow
def test_a_run_on_a_stream_goes_on_to_the_same_bytes(tmp_path: Path) -> None:
    whole = run_of(tmp_path / "whole", 6)
    assert run_of(tmp_path / "parts", 6, stop_at=7) == whole
    described = read_keys(tmp_path / "whole/run.yaml")
    assert described["lidar"] == "livox_mid_70 velodyne_vlp_16"
    assert described["label_time"] == "frame scan"
    other = site_stream(replace(PLAN, mixed=PLAN.mixed + 1), FEW)
    with pytest.raises(
        ConfigError, match=r"run.yaml: drawn: expected .* to resume the training, got .*"
    ):
        train(small(6), other, tmp_path / "whole", quiet=True)


def test_background_learns_from_no_stream(tmp_path: Path) -> None:
    recipe = read_recipe(configs() / "detectors/background.yaml", "smoke")
    with pytest.raises(ValueError, match="background: expected frames of one LiDAR, got a"):
        train(recipe, site_stream(PLAN, FEW), tmp_path / "run")


def test_nothing_is_kept_of_a_stream_to_validate_by(tmp_path: Path) -> None:
    recipe = read_recipe(configs() / "detectors/pointpillars.yaml", "smoke")
    recipe = replace(recipe, learning=replace(recipe.learning, validate_frames=3))
    with pytest.raises(
        ValueError, match="validate_frames: expected 0 for a stream of random sites, got 3"
    ):
        train(recipe, site_stream(PLAN, FEW), tmp_path / "run")
