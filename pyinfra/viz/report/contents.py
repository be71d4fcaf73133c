"""The default sections of the report of a folder of results.

The argument `sections` names another module, whose list SECTIONS replaces the list of this module.
A dict TABLES in that module declares more tables, in the form of KINDS in
experiments/result_tables.py.
"""

import importlib
from collections.abc import Callable, Mapping, Sequence

from pyinfra.core.errors import Error
from pyinfra.core.version import __version__
from pyinfra.experiments.result_tables import Kind, hardly_learnt
from pyinfra.viz.report.blocks import Section
from pyinfra.viz.report.page import Page
from pyinfra.viz.report.report_data import Material
from pyinfra.viz.report.sections import (
    accuracy,
    answer,
    areas,
    distance,
    hits,
    methods,
    pictures,
    points,
    speed,
    stability,
    value,
    view,
)

Maker = Callable[[Material], Section | None]
SECTIONS: list[Maker] = [
    answer.section,
    pictures.section,
    view.section,
    hits.section,
    points.section,
    accuracy.section,
    distance.section,
    areas.section,
    value.section,
    speed.section,
    stability.section,
    methods.section,
]
TITLE = "Roadside LiDAR: which sensor, which detector"


def read_sections(module: str) -> tuple[Sequence[Maker], Mapping[str, Kind]]:
    """Returns SECTIONS and TABLES of a module.

    Raises Error if the module does not exist or has no SECTIONS.
    """
    try:
        imported = importlib.import_module(module)
    except ModuleNotFoundError as error:
        if error.name is None or not module.startswith(error.name):
            raise  # the module exists, but one of its own imports is missing
        raise Error(
            f"sections: expected a Python module that can be imported, got '{module}'"
        ) from None
    sections = getattr(imported, "SECTIONS", None)
    if not isinstance(sections, Sequence):
        raise Error(f"sections: expected a module with a list SECTIONS, got '{module}' without it")
    return sections, getattr(imported, "TABLES", {})


def page(material: Material, sections: Sequence[Maker] = SECTIONS) -> Page:
    """Returns the page with all sections that have content."""
    made = [section for maker in sections if (section := maker(material)) is not None]
    return Page(TITLE, _subtitle(material), _footer(material), made, material.results.sources())


def _subtitle(material: Material) -> str:
    """Returns one line about what was compared."""
    experiments = material.results.table("experiments")
    if experiments.empty:
        return "These results have no benchmark experiments."
    counts = [
        (experiments.scene.nunique(), "scene"),
        (experiments.lidar.nunique(), "LiDAR"),
        (experiments.detector.nunique(), "detector"),
        (experiments.preset.nunique(), "preset"),
    ]
    parts = [f"{n} {what}{'s' if n != 1 else ''}" for n, what in counts]
    tier = material.results.tier
    names = ", ".join(sorted(set(experiments.detector[hardly_learnt(experiments)])))
    short = f" This tier trains networks too little; do not use the AP of {names}."
    return f"{', '.join(parts)}; tier {tier}, simulated.{short if names else ''}"


def _footer(material: Material) -> str:
    experiments = material.results.table("experiments")
    versions = (
        "" if experiments.empty else ", ".join(sorted(experiments.version.astype(str).unique()))
    )
    measured = f", measured with version {versions}" if versions else ""
    return (
        f"Written by infrasim {__version__} from tier {material.results.tier}{measured}. Each "
        "number is from a row of a CSV file in the folder next to this page. Hover over a number "
        "to see the row."
    )
