"""The report of a folder of results: `pyinfra report RESULTS --out report.html`."""

from __future__ import annotations

from collections.abc import Callable

from pyinfra.core.version import __version__
from pyinfra.experiments.result_tables import hardly_learnt
from pyinfra.viz.report.blocks import Section
from pyinfra.viz.report.page import Page
from pyinfra.viz.report.report_data import Material
from pyinfra.viz.report.sections import (
    accuracy,
    answer,
    areas,
    claims,
    distance,
    fidelity,
    hits,
    methods,
    pictures,
    points,
    speed,
    stability,
    value,
    view,
)

SECTIONS: tuple[Callable[[Material], Section | None], ...] = (
    answer.section,
    claims.section,
    hits.section,
    points.section,
    accuracy.section,
    distance.section,
    areas.section,
    value.section,
    speed.section,
    stability.section,
    fidelity.section,
    pictures.section,
    view.section,
)
TITLE = "Roadside LiDAR: which sensor, which detector"


def page(material: Material) -> Page:
    """All sections for which there is something."""
    made = [section(material) for section in SECTIONS]
    present = [s for s in made if s is not None]
    present.append(methods.section(material, present))
    tables = material.results.sources()
    return Page(TITLE, _subtitle(material), _footer(material), present, tables)


def _subtitle(material: Material) -> str:
    """What was compared, in a line."""
    cells = material.results.table("cells")
    if cells.empty:
        return "No cell of a benchmark is among these results."
    counts = [
        (cells.scene.nunique(), "scene"),
        (cells.lidar.nunique(), "LiDAR"),
        (cells.detector.nunique(), "detector"),
        (cells.preset.nunique(), "preset"),
    ]
    parts = [f"{n} {what}{'s' if n != 1 else ''}" for n, what in counts]
    tier = material.results.tier
    names = ", ".join(sorted(set(cells.detector[hardly_learnt(cells)])))
    short = f" Networks of this tier have hardly learnt: nothing follows from the AP of {names}."
    return f"{', '.join(parts)}; tier {tier}, simulated.{short if names else ''}"


def _footer(material: Material) -> str:
    cells = material.results.table("cells")
    versions = "" if cells.empty else ", ".join(sorted(cells.version.astype(str).unique()))
    measured = f", whose cells are of {versions}" if versions else ""
    return (
        f"Written by infrasim {__version__} from tier {material.results.tier}{measured}. Each "
        "number is in a row of a CSV file in the folder beside this page; a number says which row "
        "when you point at it."
    )
