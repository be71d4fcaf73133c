"""The section on methods and on the provenance of the numbers."""

import pandas as pd

from pyinfra.experiments.result_tables import TableFile
from pyinfra.viz.report.blocks import Block, Column, Section, Steps, Table, TableCell, number
from pyinfra.viz.report.names import detector, ordered
from pyinfra.viz.report.report_data import Material

LEAD = (
    "The definitions and rules are in docs/conventions.md of the project. The data of the "
    "benchmark are simulated."
)
STEPS = (
    ("Scene", "Roads, traffic and poles; vehicles also move within a frame."),
    (
        "LiDARs",
        "All LiDARs are simulated at the same poles and times; each ray is cast at its firing "
        "time.",
    ),
    ("Frames", "KITTI layout: points, boxes and the number of points on each vehicle."),
    ("Scanning", "Points per frame, and points per vehicle by distance."),
    (
        "Detectors",
        "By default, a detector is trained on the first 400 s of a LiDAR's frames and tested on "
        "the last 90 s.",
    ),
    ("Evaluation", "AP with intervals, along the road and by area; latency and price."),
)
KINDS = {
    "pointpillars": ("pillars, one stage", "a bird's-eye-view image of columns of points"),
    "pv-rcnn": (
        "voxels and points, two stages",
        "sparse voxels propose boxes, key points refine them",
    ),
    "dsvt": ("pillars, transformer", "attention within sets of sparse pillars"),
    "pointrcnn": ("points, two stages", "every foreground point proposes a box"),
    "pointrcnn-remedied": ("points, two stages", "PointRCNN with changes for roadside frames"),
    "centerpoint-pillar": (
        "pillars, one stage",
        "predicts the centres of vehicles, without anchors",
    ),
    "generalist": (
        "pillars, one stage",
        "the pretrained detector of the package, trained further at the site",
    ),
    "generalist-as-is": ("pillars, one stage", "the pretrained detector of the package"),
    "background": ("no training", "a model of the empty site, clusters, fitted boxes"),
}


def section(material: Material) -> Section:
    """Returns the processing steps, the detectors and the provenance."""
    blocks: list[Block] = [Steps("Processing steps", STEPS)]
    names = ordered(material.results.table("experiments").detector)
    if names:
        blocks.append(_detectors(names))
    blocks.append(_provenance(material))
    return Section("methods", "Methods and provenance", LEAD, blocks)


def _detectors(names: list[str]) -> Table:
    rows = [
        [TableCell(detector(n)), *(TableCell(t) for t in KINDS.get(n, ("user's detector", "")))]
        for n in names
    ]
    heads = [Column("Detector"), Column("Kind"), Column("How it works")]
    table = pd.DataFrame([[c.text for c in row] for row in rows], columns=["name", "kind", "how"])
    return Table("The detectors.", heads, rows, TableFile("report_detectors.csv", table))


def _provenance(material: Material) -> Table:
    """Returns a table with rows, versions, seeds, machines and commands of each result table."""
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
    caption = "Provenance of each results table."
    return Table(caption, heads, cells, TableFile("report_provenance.csv", listed))


def _different(table: pd.DataFrame, column: str) -> str:
    """Returns the distinct values of a column, or an empty text if the column does not exist."""
    if column not in table:
        return ""
    return ", ".join(sorted({str(value) for value in table[column]} - {""}))
