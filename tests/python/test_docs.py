"""The commands in README and docs are correct: each command is run, or is parsed by its own
parser."""

import re
import tomllib
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import doc_pages
import numpy as np
import pandas as pd
import pytest
import site_maps
import yaml

from pyinfra.cli import main
from pyinfra.formats import kitti
from pyinfra.formats.pcd_file import write_pcd
from pyinfra.scenes.maps.map_file import FORMATS as MAPS
from reproduction.commands import tables
from reproduction.tables import figures, formats

pytest.importorskip("torch", reason="the extra `train` is not installed")

WITH_COMMANDS = [
    page
    for page in doc_pages.PAGES
    if any(block.kind in ("sh", "python") for block in doc_pages.blocks(page))
]


def make_recording(infrasim: Callable[..., object], run_command: Callable[..., list[str]]) -> None:
    """Exports 30 simulated frames as a recording of another tool."""
    infrasim(*run_command("helios_16", frames="0:30", out=Path("site").resolve()), check=True)
    words = ["--to", "pcd", "--out", "recordings/junction"]
    assert main.main(["export", "site/helios_16", *words]) == 0


def make_clouds(infrasim: Callable[..., object], run_command: Callable[..., list[str]]) -> None:
    """Writes clouds as a LiDAR's own software does: intensities up to 255, no labels.

    There are 30 clouds over 18 s, and 152 clouds over 30 s.
    """
    for name, frames in (("street", "0:180:6"), ("street_long", "0:304:2")):
        site = Path(f"site_{name}").resolve()
        words = run_command("helios_16", frames=frames, preset="datasheet", out=site)
        infrasim(*words, "--set", "duration_s=32", check=True)
        Path(f"recordings/{name}").mkdir(parents=True)
        kind = [(column, "<f4") for column in "xyz"] + [("intensity", "u1")]
        for file in sorted((site / "helios_16/training/velodyne").iterdir()):
            points = kitti.read_points(file)
            records = np.empty(len(points), kind)
            for column, values in zip("xyz", points[:, :3].T, strict=True):
                records[column] = values
            records["intensity"] = np.rint(255 * points[:, 3])
            time_s = 1651673050 + int(file.stem) / 10
            write_pcd(Path(f"recordings/{name}/{time_s:.6f}.pcd"), records)


def make_site(infrasim: Callable[..., object], run_command: Callable[..., list[str]]) -> None:
    """Simulates ten frames of a site, and writes a single cloud."""
    blocks = doc_pages.blocks(doc_pages.ROOT / "docs/tutorial.md")
    (scene,) = (block.text for block in blocks if block.file == "site.yaml")
    Path("site.yaml").write_text(doc_pages.small_text(scene, "site.yaml"))
    out = Path("data/site").resolve()
    words = run_command("livox_avia", frames="0:5000:500", preset="datasheet", out=out)
    infrasim(*words, "--set", "duration_s=500", check=True)
    points = kitti.read_points(out / "livox_avia/training/velodyne/000000.bin")
    kind = [(name, "<f4") for name in ("x", "y", "z", "intensity")]
    write_pcd(Path("cloud.pcd"), points.view(kind)[:, 0])


def make_map(infrasim: Callable[..., object], run_command: Callable[..., list[str]]) -> None:
    """Writes a district as an OpenStreetMap file."""
    pytest.importorskip("sumo", reason="Eclipse SUMO is not installed: extra `site`")
    Path("crossing.osm").write_text(site_maps.district_text(crossings=True))


MOST_COMMANDS = 21  # from a site to a recommendation
MOST_OF_A_PLAN = 15  # from a map to a signed answer
MOST_WORDS, MOST_NUMBERS = 150, 3  # words of README's first screen; numbers in a sentence
GIVEN = {
    "generalist": make_site,
    "own_data": make_recording,
    "own_recording": make_clouds,
    "plan": make_map,
    "tutorial": make_map,
}
# Their commands take 10 to 60 s and seldom fail, so only `make nightly` runs them.
LONG_PAGES = (
    "cluster",
    "generalist",
    "generated_sites",
    "gpu",
    "own_data",
    "own_detector",
    "own_recording",
    "plan",
    "points",
    "several_poles",
    "traffic",
    "tutorial",
)
LEAST_AP = {"own_detector": ("out/blocks_ap/ap.csv", 20), "tutorial": ("out/background/ap.csv", 20)}


@pytest.mark.slow
@pytest.mark.parametrize(
    "page",
    [
        pytest.param(page, marks=pytest.mark.nightly if page.stem in LONG_PAGES else [])
        for page in WITH_COMMANDS
    ],
    ids=lambda page: page.stem,
)
def test_every_command_of_the_page_runs(
    page: Path,
    infrasim: Callable[..., object],
    run_command: Callable[..., list[str]],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(
        "pyinfra.experiments.benchmark.matrix.configs", lambda: tmp_path / "configs"
    )
    if page.stem in GIVEN:
        GIVEN[page.stem](infrasim, run_command)
    doc_pages.run_page(page, infrasim)
    if page.stem in LEAST_AP:
        file, least = LEAST_AP[page.stem]
        assert pd.read_csv(file).ap[0] > least


def test_a_map_becomes_a_recommendation_in_few_commands() -> None:
    shell = [b.text for b in doc_pages.blocks(page("tutorial")) if b.kind == "sh"]
    commands = [command for text in shell for command in doc_pages.commands(text)]
    assert any(command.startswith("pyinfra site import crossing.osm ") for command in commands)
    assert any(command.startswith("pyinfra recommend ") for command in commands)
    assert len(commands) <= MOST_COMMANDS


def test_a_map_becomes_a_signed_answer_in_few_commands() -> None:
    shell = [b.text for b in doc_pages.blocks(page("plan")) if b.kind == "sh"]
    commands = [command for text in shell for command in doc_pages.commands(text)]
    assert any(command.startswith("pyinfra site import crossing.osm ") for command in commands)
    assert any(command.startswith("pyinfra plan sites/crossing ") for command in commands)
    assert len(commands) <= MOST_OF_A_PLAN


@pytest.mark.parametrize("page", doc_pages.PAGES, ids=lambda page: page.stem)
def test_commands_inside_sentences_exist(page: Path, infrasim: Callable[..., object]) -> None:
    known = set(main.COMMANDS)
    for program, *words in doc_pages.spoken(page):
        if program == "make":
            doc_pages.check_make(words)
        elif program == "pyinfra" and not words[0].startswith("-"):
            assert words[0] in known, words
            text = help_of(words[0])
            assert [w for w in words if w.startswith("--") and w not in text] == [], words
        elif program == "infrasim" and not words[0].startswith("-"):
            result = infrasim(words[0], "--help")
            assert result.returncode == 0, words
            assert [w for w in words if w.startswith("--") and w not in result.stdout] == [], words


def help_of(command: str) -> str:
    parser = main.make_parser([command])
    (commands,) = (a for a in parser._actions if a.dest != "help" and a.nargs == "A...")
    return str(commands.choices[command].format_help())


@pytest.mark.parametrize(
    "command", ["curl http://example.org", "pyinfra view data | less", "make nothing", "ray go"]
)
def test_what_is_neither_run_nor_parsed_fails(
    command: str, infrasim: Callable[..., object]
) -> None:
    with pytest.raises(AssertionError):
        doc_pages.run(command, infrasim)


def test_a_wrong_option_fails_though_it_is_only_parsed(infrasim: Callable[..., object]) -> None:
    for command in ("pyinfra", "torchrun --nproc-per-node 2 -m pyinfra"):
        with pytest.raises(SystemExit):
            doc_pages.run(f"{command} train a.yaml --device cuda --precison half", infrasim)


def test_the_pages_name_each_other() -> None:
    """Every link has a target. test_documentation_site.py checks that every page is listed."""
    for page in doc_pages.PAGES:
        for link in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", page.read_text()):
            written = link.removeprefix("../").startswith("examples/")  # by sphinx-gallery
            assert written or (page.parent / link).exists(), f"{page.name}: {link}"


def test_tables_of_the_pages_are_what_make_docs_writes() -> None:
    found = [block for p in tables.PAGES for block in tables.BLOCK.findall(p.read_text())]
    blocks = [(kind, name) for _, kind, name, *_ in found]
    made = {"table": [*tables.TABLES, *tables.FRAMES], "text": tables.TEXTS}
    assert sorted(blocks) == sorted((kind, name) for kind, names in made.items() for name in names)
    assert [p.name for p in tables.PAGES if tables.rewritten(p) != p.read_text()] == []


def test_figures_of_the_pages_show_the_present_results() -> None:
    names = set(figures.FIGURES)
    assert [name for name in sorted(names) if not figures.is_current(name, tables.PICTURES)] == []
    assert {file.stem for file in tables.PICTURES.iterdir()} == names
    pages = "".join(page.read_text() for page in tables.PAGES)
    assert set(re.findall(r"pictures/results/(\w+)\.svg", pages)) == names


def test_a_figure_with_another_label_is_out_of_date(monkeypatch: pytest.MonkeyPatch) -> None:
    picture = figures.FIGURES["comparable"]
    draw = partial(figures.draw_intervals, label="another label", holds=(-3.0, 3.0))
    monkeypatch.setitem(figures.FIGURES, "comparable", replace(picture, draw=draw))
    assert not figures.is_current("comparable", tables.PICTURES)


def test_the_first_screen_of_the_readme_is_short() -> None:
    """The part before "Where next" has few words outside commands, and few numbers in a
    sentence."""
    first = page("README").read_text().split("## Where next")[0]
    hidden = r"^```.*?^```|<!--.*?-->|!\[.*?\)|\]\([^)]*\)|[|#`\[\]*]|---"
    text = re.sub(hidden, " ", first, flags=re.DOTALL | re.MULTILINE)
    assert len(text.split()) <= MOST_WORDS
    sentences = re.split(r"[.:;](?=\s)|\n", text)
    numbers = [len(re.findall(r"(?<![\w.])\d[\d.]*", sentence)) for sentence in sentences]
    assert max(numbers) <= MOST_NUMBERS


def test_the_citation_has_the_version_of_the_package() -> None:
    citation = yaml.safe_load((doc_pages.ROOT / "CITATION.cff").read_text())
    project = tomllib.loads((doc_pages.ROOT / "pyproject.toml").read_text())["project"]
    assert [citation["version"], citation["license"]] == [project["version"], project["license"]]


def test_the_formats_name_packages_that_the_project_installs() -> None:
    project = tomllib.loads((doc_pages.ROOT / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"].values()
    known = " ".join([*project["dependencies"], *(word for extra in extras for word in extra)])
    for format in formats.FORMATS.values():
        for package in filter(None, format.packages.split(", ")):
            assert package in known


def test_the_other_formats_have_all_maps() -> None:
    rows = [line[2:-2].split(" | ") for line in formats.other_formats().splitlines()]
    named = {ending for row in rows if row[0] == "maps" for ending in row[2].split(", ")}
    assert set(MAPS) <= named


def test_the_detector_of_the_page_is_short() -> None:
    (detector,) = (b for b in doc_pages.blocks(page("own_detector")) if b.file == "blocks.py")
    assert len(detector.text.splitlines()) <= 60


def test_the_configuration_of_the_page_is_one(tmp_path: Path) -> None:
    from pyinfra.models.training.recipe import read_recipe

    (text,) = (b.text for b in doc_pages.blocks(page("own_detector")) if b.kind == "yaml")
    (tmp_path / "own.yaml").write_text(text)
    recipe = read_recipe(tmp_path / "own.yaml", "smoke")
    assert recipe.network.pillar_m == yaml.safe_load(text)["tiers"]["smoke"]["network"]["pillar_m"]
    assert recipe.augmentation.pasted == 10


def page(name: str) -> Path:
    return next(p for p in doc_pages.PAGES if p.stem == name)
