"""Writes the page from its sections, and the folder of CSV files beside it."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import jinja2

from pyinfra.core.files import write
from pyinfra.experiments.result_tables import TableFile
from pyinfra.viz.page_file import check_file
from pyinfra.viz.report.blocks import Section
from pyinfra.viz.report.style import themes
from pyinfra.viz.report.svg import identifier

HERE = Path(__file__).parent
CSV_DIGITS = "%.6g"


@dataclass(frozen=True, eq=False)
class Page:
    """A report before it is written; `tables` are written besides those of the sections."""

    title: str
    subtitle: str
    footer: str
    sections: Sequence[Section]
    tables: Sequence[TableFile] = ()


def write_page(page: Page, file: Path) -> Path:
    """Writes the tables into the folder NAME_data beside the page, then the page."""
    check_file(file)
    folder = file.with_name(f"{file.stem}_data")
    folder.mkdir(parents=True, exist_ok=True)
    for source in [*page.tables, *sources(page.sections)]:
        _write_source(source, folder / source.name)
    write(file, render(page, folder.name))
    return file


def render(page: Page, folder: str) -> str:
    """Returns the page as HTML; folder: path of the CSV files relative to the page."""
    environment = jinja2.Environment(
        autoescape=True,
        loader=jinja2.FileSystemLoader(HERE),
        undefined=jinja2.StrictUndefined,
    )
    environment.filters["identifier"] = identifier
    environment.filters["kind"] = lambda block: type(block).__name__
    environment.tests["startingwith"] = str.startswith
    light, dark = themes()
    return environment.get_template("page.html").render(
        **vars(page),
        anchors=anchors(page.sections),
        folder=folder,
        light=light,
        dark=dark,
        style=(HERE / "page.css").read_text(encoding="utf-8"),
        script=(HERE / "page.js").read_text(encoding="utf-8"),
    )


def anchors(sections: Iterable[Section]) -> dict[str, str]:
    """Returns every anchor of the page with the title of its section."""
    all_names: dict[str, str] = {}
    for section in sections:
        names = [section.name, *(getattr(block, "name", "") for block in section.blocks)]
        all_names |= {name: section.title for name in names if name}
    return all_names


def sources(sections: Sequence[Section]) -> Iterator[TableFile]:
    """Yields each table that the sections name, without duplicates."""
    seen = set()
    for block in (block for section in sections for block in section.blocks):
        source = getattr(block, "source", None)
        if source is not None and source.name not in seen:
            seen.add(source.name)
            yield source


def _write_source(source: TableFile, file: Path) -> None:
    if isinstance(source.content, Path):
        write(file, source.content.read_bytes())
    else:
        write(file, source.content.to_csv(index=False, float_format=CSV_DIGITS))
