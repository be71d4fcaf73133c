"""Writes the page of a plan, and the file of the page's data beside the plan's tables."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import jinja2

from pyinfra.core.errors import FormatError
from pyinfra.core.files import write
from pyinfra.experiments.planner.plan import Plan
from pyinfra.viz.page_file import check_file, write_page_file
from pyinfra.viz.plan_page.files import DATA_FILE, PAGE_FILE
from pyinfra.viz.plan_page.plan_data import FORMAT, plan_data
from pyinfra.viz.plan_page.view import VIEW_FILE, write_view
from pyinfra.viz.report.style import themes

HERE = Path(__file__).parent
LARGEST_MB = 8.0


def write_plan_page(plan: Plan, folder: Path) -> Path:
    """Writes the page and its data into the folder of a plan. Returns the file of the page."""
    data = plan_data(plan)
    write(folder / DATA_FILE, json.dumps(data, allow_nan=False))
    write_view(plan, folder)
    return write_page(data, folder / PAGE_FILE)


def rewrite_plan_page(folder: Path, out: Path) -> Path:
    """Writes the page of a plan again, from its data. Raises FormatError."""
    file = folder / DATA_FILE
    try:
        data = json.loads(file.read_text(encoding="utf-8"))
        version = data["format"]
    except (ValueError, TypeError, KeyError) as error:
        raise FormatError(
            f"{file}: expected the data of a plan's page, got a file without the key 'format'"
        ) from error
    if version != FORMAT:
        raise FormatError(
            f"{file}: format: expected {FORMAT}, got {version}; run `pyinfra plan` again to write "
            "the file"
        )
    return write_page(data, out)


def write_page(data: dict[str, Any], out: Path) -> Path:
    """Writes the page. Raises Error if it would exceed LARGEST_MB or `out` is a folder."""
    check_file(out)
    view = VIEW_FILE if (out.parent / VIEW_FILE).is_file() else ""
    write_page_file(render(data, view), out, LARGEST_MB, "fewer `lidars` make the page smaller")
    return out


def render(data: dict[str, Any], view: str = "") -> str:
    """Returns the page as HTML. Names in the data are shown as text and never as markup.

    view: file of the 3-D view of option 1 beside the page; empty if there is none.
    """
    environment = jinja2.Environment(
        autoescape=True, loader=jinja2.FileSystemLoader(HERE), undefined=jinja2.StrictUndefined
    )
    environment.filters |= {"shown": shown, "join_interval": join_interval}
    embedded = {name: value for name, value in data.items() if name not in ("map", "lines")}
    plain = json.dumps(embedded, separators=(",", ":"), allow_nan=False)
    light, dark = themes()
    return environment.get_template("page.html").render(
        data=data,
        view=view,
        embedded=plain.replace("<", "\\u003c"),
        light=light,
        dark=dark,
        style=(HERE / "page.css").read_text(encoding="utf-8"),
        script=(HERE / "page.js").read_text(encoding="utf-8"),
    )


def shown(value: float | None, digits: int = 0) -> str:
    """Returns a number as text, or a dash if the number is unknown."""
    return "\N{EN DASH}" if value is None else f"{value:.{digits}f}"


def join_interval(values: Sequence[float | None], digits: int = 0) -> str:
    """Returns a value as text, with its interval if the interval is known."""
    value, low, high = values
    if low is None or high is None:
        return shown(value, digits)
    return f"{shown(value, digits)} [{shown(low, digits)} to {shown(high, digits)}]"
