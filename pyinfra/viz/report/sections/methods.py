"""How the figures were made, what they came from, and where the paper's own are."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import pandas as pd

from pyinfra.experiments.result_tables import TableFile
from pyinfra.viz.report.blocks import (
    Block,
    Column,
    Index,
    Link,
    Section,
    Steps,
    Table,
    TableCell,
    number,
)
from pyinfra.viz.report.names import DETECTORS, detector, in_order
from pyinfra.viz.report.report_data import Material

STEPS = (
    ("Scene", "Roads, traffic and one pole; every vehicle moves, also within a frame."),
    ("LiDARs", "All at the pole at the same time; each ray is cast at its own firing time."),
    ("Frames", "KITTI layout: points, boxes, and how many points each vehicle got."),
    ("Scanning", "Hits, points per vehicle and their fall-off with distance."),
    ("Detectors", "Each is trained on the first 400 s of a LiDAR, tested on the last 90 s."),
    ("Judgement", "AP with intervals, along the road, by area; latency and price."),
)
KINDS = {
    "pointpillars": ("pillars, one stage", "columns of points become a picture from above"),
    "pv-rcnn": ("voxels and points, two stages", "sparse voxels propose, key points refine"),
    "dsvt": ("pillars, transformer", "attention within sets of sparse pillars"),
    "pointrcnn": ("points, two stages", "every foreground point proposes a box"),
    "pointrcnn-remedied": ("points, two stages", "PointRCNN with its faults at roadside mended"),
    "centerpoint-pillar": ("pillars, one stage", "finds centres of vehicles, no anchors"),
    "background": ("no training", "a model of the empty site, clusters, fitted boxes"),
}
# What the paper shows, where it is here (the start of an anchor), and what it needs.
PAPER = (
    ("Figure: scanning patterns", "figure-patterns", "a data set and the compiled extension"),
    ("Figure: framework", "methods", ""),
    ("Figure: speeds in the scenes", "figure-speeds", "a data set"),
    ("Figure: position and orientation", "figure-plans", "a data set"),
    ("Figure: clouds of the LiDARs in the scenes", "figure-sheet", "a data set"),
    (
        "Figure: aggregation, one vehicle",
        "figure-aggregation",
        "data sets of one scene under several aggregations",
    ),
    ("Table: LiDARs and prices", "value", "lidars.csv"),
    ("Table: hit points", "hits", "the table of hits, or a data set"),
    ("Figure: boxes by number of points", "figure-sheet", "a data set"),
    ("Figure: points per vehicle", "points", "the table of points per vehicle, or a data set"),
    ("Figure: its cut-outs of vehicles", "figure-cutouts", "a data set"),
    ("Table: features of the detectors", "methods", ""),
    ("Figure: detection areas on the road", "figure-plan-", "a data set and the table of distance"),
    ("Tables: AP in the three scenes", "accuracy", "the table of cells"),
    ("Figure: predicted boxes", "figure-boxes", "a data set and runs"),
    ("Figure: AP by distance", "distance", "the table of distance"),
    ("Figures: high-quality areas", "areas", "the table of areas"),
)


def section(material: Material, sections: Sequence[Section]) -> Section:
    """The way of the data, the detectors, the index of the paper's figures, the provenance."""
    blocks: list[Block] = [Steps("The way of the data", STEPS)]
    names = in_order(material.results.table("cells").detector, DETECTORS)
    if names:
        blocks.append(_detectors(names))
    blocks += [_index(sections)] if material.is_of_the_paper() else []
    blocks.append(_provenance(material))
    lead = (
        "Definitions and rules are in docs/conventions.md of the project; those of the claims "
        "about scanning were written before the run, those about detection before all cells were "
        "measured. Everything is simulated: no vegetation, one pole for each scene."
    )
    return Section("methods", "Methods and provenance", lead, blocks)


def _detectors(names: list[str]) -> Table:
    rows = [
        [TableCell(detector(n)), *(TableCell(t) for t in KINDS.get(n, ("own", "")))] for n in names
    ]
    heads = [Column("Detector"), Column("Kind"), Column("How it works")]
    table = pd.DataFrame([[c.text for c in row] for row in rows], columns=["name", "kind", "how"])
    return Table("The detectors.", heads, rows, TableFile("report_detectors.csv", table))


def anchors(sections: Iterable[Section]) -> list[str]:
    """Everything on the page that can be linked to."""
    all_names = []
    for one in sections:
        all_names += [one.name, *(getattr(block, "name", "") for block in one.blocks)]
    return [name for name in all_names if name]


def _index(sections: Sequence[Section]) -> Index:
    here = [*anchors(sections), "methods"]
    titles = {one.name: one.title for one in sections} | {"methods": "Methods and provenance"}
    of = {block: one.title for one in sections for block in anchors([one])} | titles
    links = []
    for label, start, needs in PAPER:
        target = next((name for name in here if name.startswith(start)), "")
        remark = of[target] if target else f"not here: needs {needs}"
        links.append(Link(label, target, remark))
    return Index(("In the paper", "On this page"), links)


def _provenance(material: Material) -> Table:
    """Of each table of results: rows, versions, seeds, machines, commands."""
    rows = []
    for name, table in material.results.tables.items():
        if len(table) > 0:
            origin = [_different(table, c) for c in ("version", "seed", "machine", "command")]
            rows.append([material.results.file(name), len(table), *origin])
    columns = ["file", "rows", "versions", "seeds", "machines", "commands"]
    listed = pd.DataFrame(rows, columns=columns)
    cells = [
        [
            TableCell(str(row.file)),
            number(float(str(row.rows)), ".0f"),
            *(TableCell(str(t)) for t in row[3:]),
        ]
        for row in listed.itertuples()
    ]
    heads = [Column(c.capitalize(), number=c == "rows") for c in columns]
    caption = "Where the numbers come from."
    return Table(caption, heads, cells, TableFile("report_provenance.csv", listed))


def _different(table: pd.DataFrame, column: str) -> str:
    """The different values of a column, if it is there."""
    if column not in table:
        return ""
    return ", ".join(sorted({str(value) for value in table[column]} - {""}))
