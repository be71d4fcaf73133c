"""The section on points per vehicle by distance."""

from typing import Any

import pandas as pd

from pyinfra.dataset.data_set import DataSet
from pyinfra.experiments.result_tables import TableFile
from pyinfra.metrics import scanning_tables
from pyinfra.metrics.observations import blocks_of, read_observations
from pyinfra.metrics.scanning_statistics import sets_of
from pyinfra.viz.picture_style import in_chart
from pyinfra.viz.report import svg
from pyinfra.viz.report.blocks import Figure, Panel, Section
from pyinfra.viz.report.names import in_order, ordered
from pyinfra.viz.report.report_data import Material
from pyinfra.viz.report.sections.distance import legend
from pyinfra.viz.report.style import drawing, log_ticks, panel

SETS = ("common", "view")


def section(material: Material) -> Section | None:
    """Returns a figure per preset, with a panel per scene and vehicle subset."""
    table, source = _measured(material)
    table = table[table.apv > 0]
    if table.empty:
        return None
    presets = ordered(table.preset)
    figures = [_figure(material, table, source, preset, presets) for preset in presets]
    lead = (
        "Mean number of points on a vehicle in distance bins of 5 m. Bands are 95 % intervals, "
        "where there are enough frames and the interval does not reach 0. Vehicles without points "
        "count as 0. Common: vehicles in the field of view and within the range of every LiDAR. "
        "View: vehicles in the field of view of every LiDAR, at any range."
    )
    return Section("points", "Points per vehicle", lead, figures)


def _measured(material: Material) -> tuple[pd.DataFrame, TableFile]:
    """Returns points per vehicle from the results or, if they have none, from the data sets."""
    table = material.results.table("points")
    exact = [data for data in material.data if data.aggregation == "exact"]
    if len(table) > 0 or not exact:
        return table, material.results.source("points")
    table = pd.concat([_counted(data) for data in exact], ignore_index=True)
    return table, TableFile("report_points_per_vehicle.csv", table)


def _counted(data: DataSet) -> pd.DataFrame:
    """Counts points per vehicle over all frames of a data set."""
    vehicles = read_observations(data)
    chosen, blocks = sets_of(vehicles), blocks_of(data, vehicles)
    parts = [
        scanning_tables.points_per_vehicle(chosen[name], blocks).assign(set=name) for name in SETS
    ]
    return pd.concat(parts).assign(scene=data.scene, preset=data.preset)


def _figure(
    material: Material, table: pd.DataFrame, source: TableFile, preset: str, presets: list[str]
) -> Figure:
    rows = table[table.preset == preset]
    panels = [
        _panel(material, rows[(rows.scene == scene) & (rows["set"] == name)])
        for scene in ordered(rows.scene)
        for name in in_order(rows[rows.scene == scene]["set"], SETS)
    ]
    lidars = legend(material.names, material.names.sorted(rows.lidar))
    caption = f"Points per vehicle by distance, preset {preset}."
    closed = preset != presets[0]
    return Figure(f"figure-points-{preset}", caption, panels, source, lidars, closed=closed)


def _panel(material: Material, rows: pd.DataFrame) -> Panel:
    first = rows.iloc[0]
    title = f"{first.scene}: {first['set']}"
    with drawing():
        figure, ax = panel()
        for lidar in material.names.sorted(rows.lidar):
            curve = rows[rows.lidar == lidar].sort_values("from_m")
            middle, look = (curve.from_m + curve.to_m) / 2, material.names.look(lidar)
            ax.plot(middle, curve.apv, markersize=3, linewidth=1.2, **look.style())
            style: dict[str, Any] = {"color": look.colour, "alpha": 0.18, "linewidth": 0}
            shown = in_chart(curve.ci_low, rows.apv)
            ax.fill_between(middle, curve.ci_low, curve.ci_high, shown, **style)
        ax.set(yscale="log", xlabel="horizontal distance (m)", ylabel="points per vehicle")
        log_ticks(ax.yaxis)
        label = f"Points per vehicle by distance, {title}, preset {first.preset}"
        name = svg.identifier("points", title, first.preset)
        return Panel(title, svg.inline(figure, name, label))
