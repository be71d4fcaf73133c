"""The section on high-quality detection areas: their number and their positions on the road."""

from typing import Any

import numpy as np
import pandas as pd
from matplotlib.patches import Patch

from pyinfra.dataset.data_set import DataSet
from pyinfra.dataset.roads import read_roads
from pyinfra.metrics.evaluation_tables import LANES
from pyinfra.metrics.row_selection import AP_R1000, first_seed
from pyinfra.viz.evaluation_plots import LABELS, STYLES, areas_plan
from pyinfra.viz.report import svg
from pyinfra.viz.report.blocks import (
    Block,
    Columns,
    Figure,
    LegendEntry,
    Panel,
    Section,
    Table,
    TableCell,
    number_in,
    shown,
    span,
    table_of,
)
from pyinfra.viz.report.names import detector, ordered
from pyinfra.viz.report.report_data import Material
from pyinfra.viz.report.sections.distance import MEANING
from pyinfra.viz.report.style import INK, drawing, panel

TRUTHS = ("captured", "all")


def section(material: Material) -> Section | None:
    """Returns stacked bars of the areas, their positions on plans of the roads, and their table."""
    areas = material.results.table("areas")
    distance = material.results.table("distance")
    if areas.empty:
        return None
    blocks: list[Block] = []
    if len(distance) > 0:
        distance = first_seed(distance)
        blocks += _bars(material, distance)
        blocks += [plan for data in material.data for plan in _plans(material, distance, data)]
    lead = (
        "An area is 20 m of road, and an area begins every 5 m. It is of high quality if its "
        f"{AP_R1000} is above 85, and undecided if the 95 % interval includes 85. The tables use "
        "two subsets of the vehicles: the vehicles that the LiDAR captured, and all vehicles "
        "visible from the mount. With the second subset, every LiDAR has the same areas. The first "
        "subset must not be used to compare positions of a sensor."
    )
    return Section(
        "areas", "High-quality areas", lead, [*blocks, _table(material, first_seed(areas))]
    )


def _bars(material: Material, distance: pd.DataFrame) -> list[Block]:
    """Returns figures of stacked bars, with a panel for each scene and detector."""
    blocks: list[Block] = []
    for preset in ordered(distance.preset):
        for truth in TRUTHS:
            rows = distance[(distance.preset == preset) & (distance.ground_truth == truth)]
            panels = [
                _bar_panel(material, rows[(rows.scene == scene) & (rows.detector == name)])
                for scene in ordered(rows.scene)
                for name in ordered(rows[rows.scene == scene].detector)
            ]
            caption = f"Areas by quality, preset {preset}: {MEANING[truth]}."
            source = material.results.source("distance")
            name = f"figure-areas-{preset}-{truth}"
            closed = len(blocks) > 0
            if panels:
                blocks.append(Figure(name, caption, panels, source, _legend(), closed=closed))
    return blocks


def _legend() -> list[LegendEntry]:
    return [
        LegendEntry(LABELS[q], svg.patch_swatch(look["facecolor"], _hatch(look["hatch"])))
        for q, look in STYLES.items()
    ]


def _bar_panel(material: Material, rows: pd.DataFrame) -> Panel:
    first = rows.iloc[0]
    lidars = material.names.sorted(rows.lidar)
    counts = rows.groupby(["lidar", "quality"]).size()
    with drawing():
        figure, ax = panel(3.7, 0.36 * len(lidars) + 0.6)
        left = np.zeros(len(lidars))
        for quality, look in STYLES.items():
            width = np.array([counts.get((lidar, quality), 0) for lidar in lidars])
            style = {"facecolor": look["facecolor"], "hatch": _hatch(look["hatch"])}
            ax.barh(
                range(len(lidars)), width, left=left, height=0.66, edgecolor=INK, lw=0.5, **style
            )
            left += width
        ax.set_yticks(range(len(lidars)), [material.names.model(x) for x in lidars])
        ax.invert_yaxis()
        ax.grid(visible=False, axis="y")
        ax.set_xlabel("areas")
        title = f"{first.scene}: {detector(first.detector)}"
        label = f"Areas by quality, {title}, preset {first.preset}, {first.ground_truth}"
        keys = (first.scene, first.detector, first.preset, first.ground_truth)
        return Panel(title, svg.inline(figure, svg.identifier("areas", *keys), label))


def _plans(material: Material, distance: pd.DataFrame, data: DataSet) -> list[Block]:
    """Draws the areas of every LiDAR on the plan of the road, with the scene's best detector."""
    done = material.results.done()
    done = done[(done.scene == data.scene) & (done.preset == data.preset)]
    rows = distance[
        (distance.scene == data.scene)
        & (distance.preset == data.preset)
        & (distance.ground_truth == "all")
        & (distance.road != LANES)  # lanes are evaluated in squares, not in windows
    ]
    if done.empty or rows.empty:
        return []
    best = str(done.loc[done.ap_r1000.idxmax()].detector)
    rows = rows[rows.detector == best]
    panels = [
        _plan(material, data, rows[rows.lidar == lidar])
        for lidar in material.names.sorted(rows.lidar)
        if lidar in data.names
    ]
    caption = (
        f"Positions of the high-quality areas, {data.scene}, preset {data.preset}, "
        f"{detector(best)}: {MEANING['all']}. The triangle marks the LiDAR."
    )
    source = material.results.source("distance")
    name = f"figure-plan-{data.scene}-{data.preset}"
    return [Figure(name, caption, panels, source, _legend())]


def _plan(material: Material, data: DataSet, rows: pd.DataFrame) -> Panel:
    lidar = str(rows.lidar.iloc[0])
    pose = next(x for x in data.lidars if x.name == lidar).T_world_levelled
    roads = read_roads(data.folder / "roads.csv")
    figure = areas_plan(rows, roads, (pose.x, pose.y))
    title = material.names.label(lidar)
    high = int((rows.quality == "high").sum())
    for ax in figure.axes:
        ax.set_title("")
    for legend in figure.legends:
        legend.remove()
    for patch in figure.findobj(Patch):
        patch.set_hatch(_hatch(patch.get_hatch()))
    label = f"Plan of {data.scene} with {high} high-quality areas of {title}"
    keys = (data.scene, data.preset, lidar)
    return Panel(
        f"{title}: {high} of {len(rows)} of high quality",
        svg.inline(figure, svg.identifier("plan", *keys), label),
    )


def _hatch(hatch: str | None) -> str:
    """Returns the hatch, or no hatch if it has dots: each dot would be a circle in the SVG."""
    return "" if hatch is None or "." in hatch else hatch


def _table(material: Material, areas: pd.DataFrame) -> Table:
    caption = (
        "Numbers of detection areas with enough vehicles, and of high-quality areas among them. "
        "The subset captured must not be used to compare positions of a sensor."
    )
    columns: Columns = {
        "Scene, road": lambda row: f"{row.scene}, {row.road}",
        "LiDAR": lambda row: material.names.model(row.lidar),
        "Preset": lambda row: str(row.preset),
        "Detector": lambda row: detector(row.detector),
        "Ground truth": lambda row: str(row.ground_truth),
        "Areas": number_in("n_tda", ".0f"),
        "High": number_in("n_hqda", ".0f"),
        "Undecided": number_in("undecided", ".0f"),
        "Share of high, %": _share,
    }
    source = material.results.source("areas")
    return table_of(caption, areas, columns, source, closed=len(areas) > 24)


def _share(row: Any) -> TableCell:
    below = span(row.p_low, row.p_high, ".0f")
    return TableCell(shown(row.p_hqda), row.p_hqda, str(row.origin), below=below)
