"""If the input files of a benchmark change, no old result is used for the new inputs."""

import dataclasses
import shutil
from pathlib import Path

import pandas as pd
import pytest
import yaml
from evaluation_data import LIDAR

from pyinfra.cli import main
from pyinfra.core.errors import ConfigError
from pyinfra.dataset.catalogue import configs
from pyinfra.experiments.benchmark import frames, inputs
from pyinfra.experiments.benchmark.matrix import read_plan
from pyinfra.experiments.benchmark.provenance import claim_run, recipe_digest
from pyinfra.experiments.benchmark.runner import check_costs
from pyinfra.experiments.benchmark.workspace import Workspace
from pyinfra.experiments.value import Costs
from pyinfra.formats.csv_table import write_csv
from pyinfra.models.training.recipe import read_recipe

MATRIX = """
frames: 0:20:5
split: {train_until_s: 1, val_from_s: 1.5}
matrix:
  - scenes: [site.yaml]
    lidars: [own.yaml]
    presets: [paper]
    detectors: [background]
"""


HIGH = 2399  # price of helios_16, USD


@pytest.fixture
def config(tmp_path: Path) -> Path:
    """Writes a benchmark of four frames, and a scene and a LiDAR beside it."""
    scene = (configs() / "scenes/highway.yaml").read_text()
    (tmp_path / "site.yaml").write_text(scene.replace("name: highway", "name: site"))
    lidar = (configs() / "lidars/helios_16.yaml").read_text()
    (tmp_path / "own.yaml").write_text(lidar.replace("name: helios_16", "name: own"))
    file = tmp_path / "small.yaml"
    file.write_text(MATRIX)
    return file


def run(config: Path, *more: str) -> int:
    folder = config.parent
    words = [str(config), "--tier", "smoke", "--out", str(folder / "out"), "--jobs", "1"]
    return main.main(["benchmark", *words, "--work", str(folder / "work"), *more])


def changed(file: Path, old: str, new: str) -> None:
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new))


def test_an_imported_site_has_its_folder_as_its_name(config: Path) -> None:
    site = config.parent / "sites/corner"
    site.mkdir(parents=True)
    shutil.copy(config.parent / "site.yaml", site)
    (site / "map.yaml").write_text("source: corner.osm\n")
    changed(config, "[site.yaml]", "[sites/corner/site.yaml]")
    plan = read_plan(config, "smoke")
    assert [experiment.scene for experiment in plan.experiments] == ["corner"]
    inputs.check_names(plan)
    assert inputs.name_of_scene(site / "site.yaml") == ["--set", "name=corner"]


def test_a_changed_price_counts_at_once_and_a_changed_pole_is_refused(
    config: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(config) == 0
    table = config.parent / "out/smoke_value.csv"
    before = pd.read_csv(table)
    changed(config.parent / "own.yaml", "{low: 2399", "{low: 1000")
    changed(config, "[background]", "[background, own_background.yaml]")
    shutil.copy(configs() / "detectors/background.yaml", config.parent / "own_background.yaml")
    assert run(config) == 0  # the frames are used again
    after = pd.read_csv(table)
    assert before.price_usd.to_list() == [pytest.approx((2399 + HIGH) / 2)]
    assert after.price_usd.to_list() == [pytest.approx((1000 + HIGH) / 2)] * 2
    written = (config.parent / "work/data/site_paper/own/lidar.yaml").read_text()
    assert f"price_total_usd: {{low: 1000, high: {HIGH}}}" in written

    capsys.readouterr()
    changed(config.parent / "site.yaml", "z_m: 6", "z_m: 12")
    assert run(config) == 2
    error = capsys.readouterr().err
    assert "site paper own: expected rows of this benchmark, " in error
    assert ", got rows of a different scene, " in error


def test_other_costs_of_the_site_do_not_change_prices_in_silence(
    config: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(config) == 0
    config.write_text(f"{MATRIX}costs: {{pole_usd: 1500}}\n")
    assert run(config) == 2
    assert (
        "site_usd: expected 1500 as in this benchmark, got 0; choose a different --out"
        in capsys.readouterr().err
    )


def test_costs_with_more_digits_than_a_table_are_the_same(config: Path) -> None:
    costs = Costs(power_w=63, usd_per_kwh=0.317, years=7)  # 1225.460502 USD
    plan = dataclasses.replace(read_plan(config, "smoke"), costs=costs)
    workspace = Workspace(config.parent, config.parent, "smoke")
    write_csv(workspace.table("value"), pd.DataFrame({"site_usd": [costs.site_usd]}))
    check_costs(workspace, plan)


def test_a_changed_price_counts_in_a_bundle(config: Path) -> None:
    (config.parent / "two.yaml").write_text(
        "name: two\nmodel: 2 x own\nbundle: [{lidar: own.yaml}, {lidar: own.yaml, yaw_deg: 180}]\n"
    )
    changed(config, "[own.yaml]", "[two.yaml]")
    assert run(config) == 0
    changed(config.parent / "own.yaml", "{low: 2399", "{low: 1000")
    assert run(config) == 0
    row = pd.read_csv(config.parent / "out/lidars.csv").iloc[0]
    assert [row.price_low_usd, row.price_high_usd] == [2000, 2 * HIGH]
    changed(config, "[background]", "[background, own_background.yaml]")
    shutil.copy(configs() / "detectors/background.yaml", config.parent / "own_background.yaml")
    assert run(config) == 0  # the frames are used again
    written = (config.parent / "work/data/site_paper/two/lidar.yaml").read_text()
    assert f"price_total_usd: {{low: 2000, high: {2 * HIGH}}}" in written


@pytest.mark.nightly
def test_another_lidar_changes_what_all_see(
    config: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(config) == 0
    shutil.copy(configs() / "lidars/livox_avia.yaml", config.parent / "avia.yaml")
    changed(config.parent / "avia.yaml", "name: livox_avia", "name: avia")
    changed(config, "[own.yaml]", "[avia.yaml]")
    assert run(config) == 2
    error = capsys.readouterr().err
    assert "site paper: expected rows of the LiDARs avia, own, got rows measured with own" in error
    assert run(config, "--out", str(config.parent / "other")) == 0
    # both LiDARs were measured, and now only a part of the matrix remains
    changed(config, "[avia.yaml]", "[own.yaml]")
    assert run(config, "--out", str(config.parent / "other")) == 0


@pytest.mark.parametrize("asked", ["0:20:15", "0:20", "0:40:5"])
def test_frames_of_another_benchmark_are_neither_measured_nor_extended(
    asked: str, config: Path
) -> None:
    lidar = config.parent / "data/own"
    (lidar / "training/velodyne").mkdir(parents=True)
    (lidar / "ImageSets").mkdir()
    text = LIDAR.format(name="own", period=0.1, label_time="scan", half=180, reach=100)
    (lidar / "lidar.yaml").write_text(text)
    for k in (0, 5, 15):  # a simulation that was stopped before frame 10
        (lidar / f"training/velodyne/{k:06d}.bin").touch()
    frames.check_data_set(lidar.parent, read_plan(config, "smoke"))
    (lidar / "training/velodyne/000010.bin").touch()
    (lidar / "ImageSets/train.txt").write_text("000000\n000005\n")
    (lidar / "ImageSets/val.txt").write_text("000015\n")
    frames.check_data_set(lidar.parent, read_plan(config, "smoke"))
    changed(config, "0:20:5", asked)
    text = f"{lidar}: expected the frames {asked} and the split of this benchmark, got 4 frames"
    with pytest.raises(ConfigError, match=text):
        frames.check_data_set(lidar.parent, read_plan(config, "smoke"))


def test_a_digest_knows_the_split_and_the_recorded_vehicles(config: Path) -> None:
    def digest() -> str:
        inputs.resolved.cache_clear()
        return str(inputs.digests(read_plan(config, "smoke")).inputs.item())

    digests = [digest()]
    changed(config, "val_from_s: 1.5", "val_from_s: 1.4")
    digests.append(digest())
    scene = yaml.safe_load((config.parent / "site.yaml").read_text())
    del scene["traffic"]
    keys = {"trajectories": "t.csv", "duration_s": 0.1}
    (config.parent / "site.yaml").write_text(yaml.safe_dump(scene | keys))
    for x in (1, 2):
        (config.parent / "t.csv").write_text(
            "t,id,class,x,y,z,heading,dx,dy,dz,speed\n"
            f"0,1,Car,{x},0,1,0,4,2,2,0\n0.1,1,Car,{x},0,1,0,4,2,2,0\n"
        )
        digests.append(digest())
    assert len(set(digests)) == 4


def test_a_step_that_shows_a_part_of_a_pattern_is_reported_before_it_is_simulated(
    config: Path,
) -> None:
    avia = (configs() / "lidars/livox_avia.yaml").read_text()
    (config.parent / "avia.yaml").write_text(avia.replace("name: livox_avia", "name: avia"))
    changed(config, "[own.yaml]", "[own.yaml, avia.yaml]")
    assert frames.warnings(read_plan(config, "smoke")) == []
    changed(config, "0:20:5", "0:5000:25")
    (line,) = frames.warnings(read_plan(config, "smoke"))
    assert "avia: " in line
    assert "shows 8 of the pattern's 200 frames" in line


@pytest.mark.nightly
def test_names_with_dots_have_locks_of_their_own(config: Path) -> None:
    names = ["pillars_0.1.yaml", "pillars_0.2.yaml"]
    for name in names:
        shutil.copy(configs() / "detectors/background.yaml", config.parent / name)
    changed(config, "[background]", f"[{', '.join(names)}]")
    assert run(config, "--jobs", "2") == 0
    table = pd.read_csv(config.parent / "out/smoke.csv")
    assert sorted(table.detector) == ["pillars_0.1", "pillars_0.2"]


def test_rows_of_an_edited_recipe_are_named_and_not_kept(
    config: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    recipe = config.parent / "mine.yaml"
    shutil.copy(configs() / "detectors/background.yaml", recipe)
    changed(config, "[background]", "[mine.yaml]")
    assert run(config) == 0
    table = config.parent / "out/smoke.csv"
    before = table.read_bytes()
    changed(recipe, "smoke: {}", "smoke: {network: {range_m: 50}}")
    capsys.readouterr()
    assert run(config, "--dry-run") == 0
    assert "site own paper mine smoke 1: out of date" in capsys.readouterr().out
    assert run(config) == 2
    error = capsys.readouterr().err
    assert "smoke.csv: site own paper mine smoke 1: expected rows of this benchmark, " in error
    assert "computed with other settings" in error
    assert table.read_bytes() == before
    assert run(config, "--out", str(config.parent / "other")) == 0


def test_a_row_of_an_earlier_version_is_kept_with_a_warning(
    config: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(config) == 0
    table = config.parent / "out/smoke.csv"
    old = pd.read_csv(table).drop(columns=["inputs", "recipe", "findings"])
    old.to_csv(table, index=False)
    before = table.read_bytes()
    capsys.readouterr()
    assert run(config) == 0
    assert "1 rows of an earlier version have no recipe" in capsys.readouterr().err
    assert table.read_bytes() == before


def test_a_training_of_another_recipe_does_not_go_on(tmp_path: Path) -> None:
    claim_run(tmp_path / "run", {"inputs": "a", "recipe": "b"})
    claim_run(tmp_path / "run", {"inputs": "a", "recipe": "c"})  # nothing has been learnt yet
    (tmp_path / "run/last.safetensors").touch()
    claim_run(tmp_path / "run", {"inputs": "a", "recipe": "c"})
    with pytest.raises(
        ConfigError, match=r"run: expected a detector trained with this recipe .*got a different"
    ):
        claim_run(tmp_path / "run", {"inputs": "a", "recipe": "b"})


def test_every_number_of_a_recipe_is_in_its_digest() -> None:
    recipe = read_recipe(configs() / "detectors/pointpillars.yaml", "quick")
    learning = dataclasses.replace(recipe.learning, rate=0.004)
    network = dataclasses.replace(recipe.network, pillar_m=0.5)
    others = [dataclasses.replace(recipe, learning=learning)]
    others += [dataclasses.replace(recipe, network=network)]
    assert len({recipe_digest(r) for r in (recipe, *others)}) == 3


def test_the_mask_of_background_is_in_its_digest() -> None:
    recipe = read_recipe(configs() / "detectors/background.yaml", "quick")
    assert recipe.network.within_region
    anywhere = dataclasses.replace(recipe.network, within_region=False)
    wider = dataclasses.replace(recipe.network, region_margin_m=2.0)
    others = [dataclasses.replace(recipe, network=network) for network in (anywhere, wider)]
    assert len({recipe_digest(r) for r in (recipe, *others)}) == 3


@pytest.mark.parametrize("name", ["007", "NA", "1e5", "null"])
def test_a_lidar_may_have_a_name_that_looks_like_no_text(name: str, config: Path) -> None:
    text = (config.parent / "own.yaml").read_text()
    (config.parent / f"{name}.yaml").write_text(text.replace("name: own", f'name: "{name}"'))
    changed(config, "[own.yaml]", f"[{name}.yaml]")
    assert run(config) == 0
    assert run(config, "--dry-run") == 0
    lines = (config.parent / "out/smoke.csv").read_text().splitlines()
    assert [line.split(",")[1] for line in lines[1:]] == [name]


def test_two_experiments_do_not_share_a_folder(config: Path) -> None:
    shutil.copy(config.parent / "site.yaml", config.parent / "site_wide.yaml")
    shutil.copy(config.parent / "own.yaml", config.parent / "wide_own.yaml")
    changed(config, "[site.yaml]", "[site.yaml, site_wide.yaml]")
    changed(config, "[own.yaml]", "[own.yaml, wide_own.yaml]")
    text = "site_wide_own_paper_background_smoke_1 for 'site wide_own .*' and 'site_wide own .*'"
    with pytest.raises(ConfigError, match=text):
        read_plan(config, "smoke")


@pytest.mark.parametrize("name", ["=1+1", "-rf", "+1", "@sum", ".hidden"])
def test_a_name_that_is_an_order_to_a_shell_or_a_spreadsheet_is_refused(
    name: str, config: Path
) -> None:
    (config.parent / "own.yaml").rename(config.parent / f"{name}.yaml")
    changed(config, "[own.yaml]", f"['{name}.yaml']")
    with pytest.raises(ConfigError, match="begins with a letter, a digit or _"):
        read_plan(config, "smoke")


def test_an_experiment_without_a_counted_vehicle_is_reported_and_others_go_on(
    config: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    empty = (config.parent / "site.yaml").read_text().replace("name: site", "name: empty")
    scene = yaml.safe_load(empty)
    del scene["traffic"]
    (config.parent / "empty.yaml").write_text(
        yaml.safe_dump(scene | {"trajectories": "t.csv", "duration_s": 2.0})
    )
    rows = "".join(f"{k / 10:g},1,Car,900,0,1,0,4,2,2,0\n" for k in range(21))
    (config.parent / "t.csv").write_text(f"t,id,class,x,y,z,heading,dx,dy,dz,speed\n{rows}")
    changed(config, "[site.yaml]", "[empty.yaml, site.yaml]")
    assert run(config) == 1
    table = pd.read_csv(config.parent / "out/smoke.csv").set_index("scene")
    assert table.ap.notna()["site"]
    assert "expected a vehicle with a point in the 1 test frames, got none" in table.reason["empty"]
    assert "empty own paper background smoke 1: failed: " in capsys.readouterr().err


def test_a_lidar_is_named_as_its_file(config: Path, capsys: pytest.CaptureFixture[str]) -> None:
    changed(config.parent / "own.yaml", "name: own", "name: mine")
    assert run(config) == 2
    assert "own.yaml: name: expected the file's name 'own', got 'mine'" in capsys.readouterr().err
    assert not (config.parent / "work").exists()


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "[background]",
            "[background, background.yaml]",
            "detectors: expected one file for each name, got two files with the name 'background'",
        ),
        (
            "0:20:5",
            "0:10:5",
            "frames, split: expected frames before 1 s .*, got frames from 0 to 0.5 s",
        ),
        (
            "val_from_s: 1.5",
            "val_from_s: 0.5",
            r"frames, split: val_from_s: expected train_until_s \(1\) or more, got 0.5",
        ),
        ("0:20:5", "'20:0'", "frames: expected A:B.*, got '20:0'"),
    ],
)
def test_what_can_not_be_is_reported_before_anything_runs(
    old: str, new: str, message: str, config: Path
) -> None:
    shutil.copy(configs() / "detectors/background.yaml", config.parent / "background.yaml")
    changed(config, old, new)
    with pytest.raises(ConfigError, match=message):
        read_plan(config, "smoke")


def test_a_copied_scene_gets_the_name_of_its_file(config: Path) -> None:
    """`infrasim check` and `run` accept the copy, so a benchmark accepts it too."""
    changed(config.parent / "site.yaml", "name: site", "name: main street")
    assert run(config) == 0
    (description,) = (config.parent / "work").rglob("dataset.yaml")
    assert yaml.safe_load(description.read_text())["name"] == "site"
    assert set(pd.read_csv(config.parent / "out/smoke.csv").scene) == {"site"}
