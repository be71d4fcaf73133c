"""Makes the report's section on methods, with an index of the paper's figures."""

from dataclasses import replace

from pyinfra.dataset.catalogue import SCENES
from pyinfra.viz.report.blocks import Entry, Index, Section
from pyinfra.viz.report.report_data import Material
from pyinfra.viz.report.sections import methods

LEAD = (
    "The definitions and rules are in docs/conventions.md of the project. All data are simulated, "
    "with one pole per scene."
)
# Each entry has the paper's figure or table, the start of its anchor in the report, and the input
# that it requires.
ENTRIES = (
    Entry("Figure: scanning patterns", "figure-patterns", "a data set and the compiled extension"),
    Entry("Figure: framework", "methods", ""),
    Entry("Figure: speeds in the scenes", "figure-speeds", "a data set"),
    Entry("Figure: position and orientation", "figure-plans", "a data set"),
    Entry("Figure: clouds of the LiDARs in the scenes", "figure-sheet", "a data set"),
    Entry(
        "Figure: aggregation, one vehicle",
        "figure-aggregation",
        "data sets of one scene under several aggregations",
    ),
    Entry("Table: LiDARs and prices", "value", "lidars.csv"),
    Entry("Table: hit points", "hits", "the table of hits, or a data set"),
    Entry("Figure: boxes by number of points", "figure-sheet", "a data set"),
    Entry("Figure: points per vehicle", "points", "the table of points per vehicle, or a data set"),
    Entry("Figure: cut-outs of vehicles", "figure-cutouts", "a data set"),
    Entry("Table: features of the detectors", "methods", ""),
    Entry(
        "Figure: detection areas on the road",
        "figure-plan-",
        "a data set and the table of distance",
    ),
    Entry("Tables: AP in the three scenes", "accuracy", "the table of experiments"),
    Entry("Figure: predicted boxes", "figure-boxes", "a data set and runs"),
    Entry("Figure: AP by distance", "distance", "the table of distance"),
    Entry("Figures: high-quality areas", "areas", "the table of areas"),
)


def section(material: Material) -> Section:
    """Adds the index of the paper's figures to pyinfra's section, before the provenance.

    The index is left out if the results name scenes, and none of them is in the paper.
    """
    base = methods.section(material)
    names = material.scenes()
    if names and not any(scene in SCENES for scene in names):
        return base
    *blocks, provenance = base.blocks
    index = Index(("In the paper", "On this page"), ENTRIES)
    return replace(base, lead=LEAD, blocks=[*blocks, index, provenance])
