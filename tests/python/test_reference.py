"""docs/reference.md has every key, as the code defines it."""

import re
from collections.abc import Callable
from pathlib import Path

import pytest
import yaml

pytest.importorskip("torch", reason="the extra `train` is not installed")

from scripts import reference

ROOT = Path(__file__).resolve().parents[2]
NAMED = ("mounts.NAME", "traffic.class_shares.")  # names that a user chooses
FILES = sorted(
    file for kind in ("scenes", "lidars") for file in ROOT.glob(f"configs/{kind}/*.yaml")
)


def paths(value: object, path: str = "") -> set[str]:
    """Returns the dotted paths of a resolved configuration, with N for list indices."""
    if isinstance(value, dict):
        names = {f"{path}.{key}".strip(".") for key in value}
        return names.union(*(paths(v, f"{path}.{k}".strip(".")) for k, v in value.items()))
    if isinstance(value, list):
        return set().union(*(paths(item, f"{path}.N") for item in value))
    return set()


def test_the_page_is_what_make_reference_writes() -> None:
    assert reference.PAGE.read_text() == reference.page()


def test_every_key_of_the_page_has_a_meaning() -> None:
    rows = re.findall(r"^\| `(.*?)` \|.*\| (.*?) \|$", reference.PAGE.read_text(), re.MULTILINE)
    assert len(rows) > 200
    assert [key for key, meaning in rows if not meaning.strip()] == []


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_every_key_that_check_prints_is_listed(file: Path, infrasim: Callable[..., object]) -> None:
    kind = file.parent.name.removesuffix("s")
    listed = {key.path for key in reference.simulator_keys(kind)}
    printed = yaml.safe_load(infrasim("check", file, check=True).stdout)
    named = {re.sub(r"^mounts\.\w+", "mounts.NAME", path) for path in paths(printed)}
    # A bundle prints the complete configuration of each of its LiDARs.
    plain = {re.sub(r"^bundle\.N\.(?=pattern|returns)", "", path) for path in named}
    assert {path for path in plain if path != NAMED[0] and not path.startswith(NAMED[1])} <= listed


def test_the_ranges_are_those_of_the_messages(infrasim: Callable[..., object]) -> None:
    keys = {key.path: key for key in reference.simulator_keys("scene")}
    for path, wrong, limits in (
        ("duration_s", 0, "from 0.1 up to 36000"),
        ("weather.visibility_m", 0, "above 0"),
        ("traffic.speed.std_km_h", 51, "from 0 up to 50"),
        ("detail", "tiny", "box, low, mid, fine"),
    ):
        words = ["check", "configs/scenes/flat.yaml", "--set", f"{path}={wrong}"]
        result = infrasim(*words)
        assert result.returncode == 2
        assert keys[path].allowed == limits
        assert limits.replace("from ", "").replace("up ", "").split(" to ")[0] in result.stderr


def test_the_default_of_a_key_left_out_is_the_listed_one(infrasim: Callable[..., object]) -> None:
    printed = yaml.safe_load(infrasim("check", "configs/scenes/flat.yaml", check=True).stdout)
    keys = {key.path: key.default for key in reference.simulator_keys("scene")}
    for path in ("duration_s", "aggregation", "region_half_length_m", "weather.visibility_m"):
        value = printed
        for name in path.split("."):
            value = value[name]
        assert yaml.safe_load(keys[path]) == value


def test_comments_are_read_behind_and_above_a_field() -> None:
    meanings = reference.comments(reference.Learning)
    assert meanings["clip"] == "gradients with a larger norm are scaled to this norm"
    assert reference.above(["x = 1", "# First sentence. Second", "# one."]) == "First sentence"
