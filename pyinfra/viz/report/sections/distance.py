"""The section on AP along the road."""

from collections.abc import Callable

import pandas as pd

from pyinfra.dataset.windows import WINDOW_M
from pyinfra.metrics.evaluation_tables import HIGH_QUALITY
from pyinfra.metrics.row_selection import AP_R1000, first_seed
from pyinfra.viz.report import svg
from pyinfra.viz.report.blocks import Figure, LegendEntry, Panel, Section
from pyinfra.viz.report.names import Names, detector, in_order, ordered
from pyinfra.viz.report.report_data import Material
from pyinfra.viz.report.style import FAINT, drawing, panel

MEANING = {
    "captured": "vehicles on which the LiDAR has at least one point; these vehicles differ between "
    "LiDARs and mounts, so this AP must not be used to compare positions of a sensor",
    "common": "vehicles in the field of view of all LiDARs",
    "all": "all vehicles of the region that are visible from the mount; these are the same for "
    "every LiDAR of a mount, but differ between mounts",
}


def section(material: Material) -> Section | None:
    """Returns a figure per preset and ground truth, with a panel per road and detector."""
    table = material.results.table("distance")
    if table.empty:
        return None
    table = first_seed(table)
    figures = [
        _figure(material, table, preset, truth)
        for preset in ordered(table.preset)
        for truth in in_order(table[table.preset == preset].ground_truth, ("captured", "all"))
        if truth in ("captured", "all")
    ]
    lead = (
        f"{AP_R1000} in windows of {WINDOW_M:g} m along the road, with 95 % intervals. The "
        "position s is 0 at the LiDAR and increases in its viewing direction. The thin line is at "
        f"an AP of {HIGH_QUALITY:g}."
    )
    opened = [Figure(**vars(f) | {"closed": i > 0}) for i, f in enumerate(figures)]
    return Section("distance", "Distance", lead, opened)


def legend(names: Names, lidars: list[str]) -> list[LegendEntry]:
    """Returns legend entries of the LiDARs with their lines."""
    styles = [(names.label(name), names.look(name)) for name in lidars]
    return [LegendEntry(x, svg.line_swatch(k.colour, k.line, k.marker)) for x, k in styles]


def legend_of_both(
    names: Names, table: pd.DataFrame, swatch: Callable[[str], str]
) -> list[LegendEntry]:
    """Returns legend entries of the LiDARs with their colours, and of the detectors of a table.

    swatch: a function that returns the markup of a detector's line or marker.
    """
    lidars = [(names.label(x), names.look(x).colour) for x in names.sorted(table.lidar)]
    entries = [LegendEntry(label, svg.patch_swatch(colour, "")) for label, colour in lidars]
    return entries + [LegendEntry(detector(d), swatch(d)) for d in ordered(table.detector)]


def _figure(material: Material, table: pd.DataFrame, preset: str, truth: str) -> Figure:
    rows = table[(table.preset == preset) & (table.ground_truth == truth)]
    panels = []
    for scene in ordered(rows.scene):
        of_scene = rows[rows.scene == scene]
        for road in of_scene.road.unique():
            for name in ordered(of_scene.detector):
                curve = of_scene[(of_scene.road == road) & (of_scene.detector == name)]
                if curve.ap_r1000.notna().any():
                    panels.append(_panel(material, curve))
    return Figure(
        f"figure-distance-{preset}-{truth}",
        f"AP along the road, preset {preset}: {MEANING[truth]}.",
        panels,
        material.results.source("distance"),
        legend(material.names, material.names.sorted(rows.lidar)),
    )


def _panel(material: Material, rows: pd.DataFrame) -> Panel:
    first = rows.iloc[0]
    roads = material.results.table("distance")
    several = roads[roads.scene == first.scene].road.nunique() > 1
    road_name = f"{first.scene}, {first.road}" if several else str(first.scene)
    title = f"{road_name}: {detector(first.detector)}"
    with drawing():
        figure, ax = panel()
        ax.axhline(HIGH_QUALITY, color=FAINT, linewidth=0.8, linestyle=(0, (6, 3)))
        for lidar in material.names.sorted(rows.lidar):
            curve = rows[rows.lidar == lidar].sort_values("s")
            look = material.names.look(lidar)
            ax.plot(
                curve.s, curve.ap_r1000, markersize=2.8, markevery=4, linewidth=1.2, **look.style()
            )
            ends = curve.ap_r1000_low, curve.ap_r1000_high
            ax.fill_between(curve.s, *ends, color=look.colour, alpha=0.18, linewidth=0)
        ax.set(ylim=(0, 102), xlim=(rows.s.min(), rows.s.max()), xlabel="s (m)")
        ax.set_ylabel(AP_R1000)
        label = f"AP along the road, {title}, preset {first.preset}, {first.ground_truth}"
        keys = (first.scene, first.road, first.detector, first.preset, first.ground_truth)
        return Panel(title, svg.inline(figure, svg.identifier("distance", *keys), label))
