"""The documentation site lists every page, and every gallery script makes a picture."""

import ast
import re
from pathlib import Path

import pytest

import pyinfra as pi

DOCS = Path(__file__).resolve().parents[2] / "docs"
SCRIPTS = sorted((DOCS / "gallery").glob("*.py"))
GALLERY = "examples/index"  # sphinx-gallery writes this page
RESULTS = "results/index"  # a page with its own table of contents, which has one page per question
MOST_PAGES = 31  # maximum number of pages, without the pages of single results
DRAWS = r"\bplt\.(subplots|figure)\(|\bsns\.\w+plot\(|\bpi\.plot_\w+\("


def listed(index: Path = DOCS / "index.md") -> list[str]:
    """Returns the pages in the tables of contents of a page."""
    text = index.read_text()
    trees = re.findall(r"^:::\{toctree\}\n(.*?)^:::$", text, re.DOTALL | re.MULTILINE)
    lines = "\n".join(trees).splitlines()
    entries = [line for line in lines if line and not line.startswith(":")]
    return [re.sub(r"^.* <(.*)>$", r"\1", entry) for entry in entries]


def test_each_page_is_listed_once() -> None:
    pages = {page.stem for page in DOCS.glob("*.md")} - {"index"}
    assert sorted(listed()) == sorted([*pages, GALLERY, RESULTS])
    assert len(listed()) + 1 <= MOST_PAGES


def test_each_page_of_results_is_listed_once() -> None:
    pages = {page.stem for page in (DOCS / "results").glob("*.md")} - {"index"}
    assert sorted(listed(DOCS / f"{RESULTS}.md")) == sorted(pages)


@pytest.mark.parametrize("page", sorted(DOCS.rglob("*.md")), ids=lambda page: page.stem)
def test_each_column_of_a_table_has_a_name(page: Path) -> None:
    heads = re.findall(r"^\|(.*)\|\n\|[ :|-]+\|$", page.read_text(), re.MULTILINE)
    assert all(cell.strip() for head in heads for cell in head.split("|"))


def test_the_api_page_has_each_public_name() -> None:
    text = (DOCS / "api.md").read_text()
    names = re.findall(r"^\.\. (?:auto\w+|py:data):: (\w+)$", text, re.MULTILINE)
    assert sorted(names) == sorted(pi.__all__)


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.stem)
def test_a_gallery_script_has_a_title_a_text_and_a_picture(script: Path) -> None:
    """`make docs` runs the scripts."""
    tree = ast.parse(script.read_text())
    title, underline, _, *text = (ast.get_docstring(tree) or "").splitlines()
    assert underline == "=" * len(title)
    assert text
    assert re.search(DRAWS, script.read_text())


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.stem)
def test_a_gallery_script_uses_the_public_api_alone(script: Path) -> None:
    tree = ast.walk(ast.parse(script.read_text()))
    modules = [
        name
        for node in tree
        if isinstance(node, (ast.Import, ast.ImportFrom))
        for name in (
            [node.module]
            if isinstance(node, ast.ImportFrom)
            else [alias.name for alias in node.names]
        )
    ]
    ours = {name for name in modules if name and name.split(".")[0] in ("pyinfra", "reproduction")}
    assert ours <= {"pyinfra"}
    assert len(SCRIPTS) == 16
