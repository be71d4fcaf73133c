"""Makes the report's section on the cost and accuracy of scene models of different detail."""

import pandas as pd

from pyinfra.experiments.result_tables import TableFile
from pyinfra.viz.report import svg
from pyinfra.viz.report.blocks import (
    Block,
    Columns,
    Figure,
    Panel,
    Section,
    Table,
    number_in,
    table_of,
)
from pyinfra.viz.report.names import in_order
from pyinfra.viz.report.report_data import Material
from pyinfra.viz.report.sections.distance import legend
from pyinfra.viz.report.style import FAINT, drawing, log_ticks, panel
from reproduction.report import ladder as models

DETAILS = ("box", "low", "mid", "fine")
REFERENCE = "fine"
ALLOWED_PERCENT = 1.0  # allowed change of points per vehicle at any distance


def section(material: Material) -> Section | None:
    """Returns a section on cost and change of points by vehicle detail and by aggregation."""
    detail, aggregation = (material.results.table(n) for n in ("fidelity", "aggregation"))
    blocks: list[Block] = []
    lead = ""
    if len(detail) > 0:
        ladder = _ladder(detail)
        source = TableFile("report_fidelity.csv", ladder)
        lead = recommendation(ladder)
        blocks += [_figure(material, ladder, source), _ladder_table(material, ladder, source)]
    if len(aggregation) > 0:
        lead = f"{lead} {_cost_of_slices(aggregation)}".strip()
        blocks.append(_aggregation(material, aggregation))
    words, made = models.blocks(material)
    lead = f"{lead} {words}".strip()
    blocks += made
    beam = material.results.table("beam")
    if len(beam) > 0:
        blocks.append(_beam(material, beam))
    return Section("fidelity", "Fidelity of the simulation", lead, blocks) if blocks else None


def _ladder(detail: pd.DataFrame) -> pd.DataFrame:
    """Returns the mean and largest change of points, and the relative time, by detail and LiDAR."""
    rows = detail.assign(change=detail.change_percent.abs())
    groups = rows.groupby(["detail", "lidar"], sort=False)
    table = groups.agg(
        mean_change_percent=("change", "mean"),
        largest_change_percent=("change", "max"),
        relative_time=("relative_time", "mean"),
        distances=("distance_m", "nunique"),
    ).reset_index()
    order = in_order(table.detail, DETAILS)
    return table.assign(rank=table.detail.map(order.index)).sort_values(
        ["rank", "lidar"], ignore_index=True
    )


def recommendation(ladder: pd.DataFrame) -> str:
    """Names the cheapest detail that changes points by at most ALLOWED_PERCENT."""
    worst = ladder.groupby("detail", sort=False).largest_change_percent.max()
    time = ladder.groupby("detail", sort=False).relative_time.mean()
    good = [d for d in worst.index if worst[d] <= ALLOWED_PERCENT and d != REFERENCE]
    rule = (
        f"the number of points on a vehicle differs by at most {ALLOWED_PERCENT:g} % from that of "
        "the finest meshes, at every distance and for every LiDAR"
    )
    if not good:
        return f"No coarser vehicle model is recommended, because with none of them {rule}."
    best = good[0]
    return (
        f"Recommended: detail {best}, the coarsest vehicle model with which {rule}. The largest "
        f"difference is {worst[best]:.2f} %, and a run takes {time[best]:.2f} times as long."
    )


def _cost_of_slices(table: pd.DataFrame) -> str:
    """Describes the cost and the effect of each aggregation."""
    means = table.groupby("aggregation", sort=False)[["ms_per_frame_set", "outside_box_percent"]]
    rows = means.mean()
    if "exact" not in rows.index:
        return ""
    exact = rows.loc["exact"]
    others = [
        f"{name} takes {row.ms_per_frame_set:.1f} ms and has {row.outside_box_percent:.1f} %"
        for name, row in rows.drop(index="exact").iterrows()
    ]
    text = (
        f"Aggregation exact takes {exact.ms_per_frame_set:.1f} ms for a frame of all LiDARs and "
        f"has {exact.outside_box_percent:.1f} % of the points on moving vehicles outside their "
        "boxes"
    )
    return f"{text}; {'; '.join(others)}." if others else f"{text}."


def _figure(material: Material, ladder: pd.DataFrame, source: TableFile) -> Figure:
    with drawing():
        figure, ax = panel(4.6, 2.9)
        rows = ladder[ladder.detail != REFERENCE]
        for lidar in material.names.sorted(rows.lidar):
            curve = rows[rows.lidar == lidar]
            style = material.names.look(lidar).style() | {"linestyle": "-"}
            ax.plot(curve.relative_time, curve.mean_change_percent, linewidth=0.8, **style)
            for row in curve.itertuples():
                position = (float(row.relative_time), float(row.mean_change_percent))
                ax.annotate(
                    str(row.detail), position, (4, 4), textcoords="offset points", fontsize=7
                )
        ax.axhline(ALLOWED_PERCENT, color=FAINT, linewidth=0.8, linestyle=(0, (6, 3)))
        ax.set(yscale="log", xlabel=f"time, detail {REFERENCE} = 1")
        ax.set(ylabel="change of points (%)")
        log_ticks(ax.yaxis)
        label = "Change of the points on vehicles against time, by detail of the meshes"
        shown = Panel("", svg.inline(figure, "fidelity", label))
    caption = (
        "Error against run time: mean change of the number of points on a vehicle, compared with "
        f"the finest meshes. The dashed line is the allowed change of {ALLOWED_PERCENT:g} %."
    )
    lidars = material.names.sorted(ladder.lidar)
    return Figure("figure-fidelity", caption, [shown], source, legend(material.names, lidars))


def _ladder_table(material: Material, ladder: pd.DataFrame, source: TableFile) -> Table:
    caption = "Change of the number of points on a vehicle over the distance bins of fidelity.csv."
    columns: Columns = {
        "Detail": lambda row: str(row.detail),
        "LiDAR": lambda row: material.names.label(str(row.lidar)),
        "Mean change, %": number_in("mean_change_percent", ".2f"),
        "Largest change, %": number_in("largest_change_percent", ".2f"),
        "Relative time": number_in("relative_time", ".3f"),
    }
    return table_of(caption, ladder, columns, source, closed=True)


def _aggregation(material: Material, table: pd.DataFrame) -> Table:
    caption = (
        "Aggregation of the points of a frame: each ray at its own firing time (exact), in slices "
        "within which nothing moves, or all rays at one instant."
    )
    columns: Columns = {
        "Aggregation": lambda row: str(row.aggregation),
        "LiDAR": lambda row: material.names.label(str(row.lidar)),
        "Points per vehicle": number_in("points_per_vehicle"),
        "Points outside the box, %": number_in("outside_box_percent"),
        "Time of a frame set, ms": number_in("ms_per_frame_set"),
    }
    return table_of(caption, table, columns, material.results.source("aggregation"))


def _beam(material: Material, table: pd.DataFrame) -> Table:
    caption = "The Avia's beam, simulated as one ray or as several rays side by side."
    columns: Columns = {
        "Rays of a beam": lambda row: str(row.lidar).replace("_", " "),
        "Distance, m": lambda row: str(row.distance),
        "Vehicles": number_in("vehicles", ".0f"),
        "Points per vehicle": number_in("points_per_vehicle"),
        "Points in the box": number_in("in_box"),
    }
    return table_of(caption, table, columns, material.results.source("beam"), closed=True)
