"""The section on hit points per frame."""

import numpy as np
import pandas as pd

from pyinfra.experiments.result_tables import TableFile
from pyinfra.formats.csv_table import read_csv
from pyinfra.viz.report.blocks import Column, Section, Table, TableCell, number
from pyinfra.viz.report.names import ordered
from pyinfra.viz.report.report_data import Material

KEY = ["scene", "lidar"]
SUMMARY = ("lidar", "frames", "hits_per_frame")  # columns of a summary.csv
LEAD = "Number of points in a frame, averaged over all frames."


def section(material: Material) -> Section | None:
    """Returns a table of the mean number of points per frame under each preset."""
    rows, remark = measured(material)
    if rows.empty:
        return None
    presets = ordered(rows.preset)
    heads = [
        Column("LiDAR"),
        Column("Scene"),
        *(Column(f"Preset {p}", number=True) for p in presets),
    ]
    cells = []
    for (scene, lidar), group in by_lidar(material, rows):
        by_preset = group.drop_duplicates("preset").set_index("preset")
        names = [TableCell(material.names.label(lidar)), TableCell(scene)]
        cells.append([*names, *(_hits(by_preset, preset) for preset in presets)])
    source = TableFile("report_hits.csv", rows)
    caption = f"Mean number of points per frame. {remark}"
    return Section("hits", "Points per frame", LEAD, [Table(caption, heads, cells, source)])


def by_lidar(material: Material, rows: pd.DataFrame) -> list[tuple[tuple[str, str], pd.DataFrame]]:
    """Returns the rows of each scene and LiDAR, in the report's order."""
    pairs = [
        (scene, lidar)
        for scene in ordered(rows.scene)
        for lidar in material.names.sorted(rows[rows.scene == scene].lidar)
    ]
    return [(pair, rows[(rows.scene == pair[0]) & (rows.lidar == pair[1])]) for pair in pairs]


def measured(material: Material) -> tuple[pd.DataFrame, str]:
    """Returns a table of points per frame, and a remark on its source.

    The remark is empty if the table is a file of the results.

    Columns: scene, lidar, preset, frames, hits_per_frame, origin.
    """
    table = material.results.table("hits")
    if len(table) > 0:
        return table[[*KEY, "preset", "frames", "hits_per_frame", "origin"]], ""
    parts = [
        read_csv(data.folder / "summary.csv", required=SUMMARY).assign(
            scene=data.scene, preset=data.preset
        )
        for data in material.data
        if (data.folder / "summary.csv").is_file() and data.aggregation == "exact"
    ]
    if not parts:
        return table, ""
    rows = pd.concat(parts, ignore_index=True)[[*KEY, "preset", "frames", "hits_per_frame"]]
    remark = "The numbers are from the files summary.csv of the data sets."
    return rows.assign(origin="summary.csv of the data set"), remark


def _hits(by_preset: pd.DataFrame, preset: str) -> TableCell:
    if preset not in by_preset.index:
        return number(np.nan)
    row = by_preset.loc[preset]
    return number(float(row.hits_per_frame), ",.0f", str(row.origin))
