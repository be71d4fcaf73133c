"""The section on stress tests: AP against the severity of each stressor."""

import math
from typing import Any

import numpy as np
import pandas as pd

from pyinfra.experiments.result_tables import TableFile
from pyinfra.experiments.stress.stressors import NONE
from pyinfra.metrics.row_selection import AP_R1000, first_stress
from pyinfra.viz.report import svg
from pyinfra.viz.report.blocks import (
    Block,
    Column,
    Figure,
    Panel,
    Section,
    Table,
    TableCell,
)
from pyinfra.viz.report.names import DETECTORS, Names, ordered
from pyinfra.viz.report.report_data import Material
from pyinfra.viz.report.sections.distance import legend_of_both
from pyinfra.viz.report.style import FAINT, drawing, panel
from pyinfra.viz.scanning_plots import LINES, MARKERS
from pyinfra.viz.stress_plots import UNITS

CURVE = ["detector", "lidar", "preset", "scene"]


def section(material: Material) -> Section | None:
    """Returns a panel per stressor, with a line per detector and LiDAR, and the stress tables."""
    table = first_stress(material.results.table("stress"))
    blocks: list[Block] = []
    for scene in ordered(table.scene):
        of_scene = table[table.scene == scene]
        for preset in ordered(of_scene.preset):
            blocks += _figure(material, of_scene[of_scene.preset == preset], scene, preset)
    for name in ("stress_ranking", "stress_summary"):
        rows = material.results.table(name)
        if len(rows) > 0:
            blocks.append(_plain(material, rows, material.results.source(name), TITLES[name]))
    if not blocks:
        return None
    lead = (
        "AP by the severity of each stressor, from no stress to failure. No detector was tuned for "
        "the stressors. The AP of a robust detector decreases only at a high severity."
    )
    return Section("stability", "Stability", lead, blocks)


TITLES = {
    "stress_ranking": "Detectors by mean share of the AP without stress, over all severities.",
    "stress_summary": (
        "For each curve: the severities at which AP has fallen by 10 points and to half, and the "
        "kind of error that increases first."
    ),
}


def _figure(material: Material, table: pd.DataFrame, scene: str, preset: str) -> list[Block]:
    stressors = [name for name in table.stressor.unique() if name != NONE.name]
    made = [_panel(material.names, table, name) for name in stressors]
    panels = [p for p in made if p is not None]
    if not panels:
        return []
    caption = (
        f"{AP_R1000} under stress, {scene}, preset {preset}, with 95 % intervals; colours "
        "distinguish LiDARs, line styles distinguish detectors."
    )
    source = material.results.source("stress")
    legend = legend_of_both(
        material.names, table, lambda name: svg.line_swatch(FAINT, *_style(name))
    )
    return [Figure(f"figure-stress-{scene}-{preset}", caption, panels, source, legend)]


def _style(name: str) -> tuple[Any, str]:
    at = list(DETECTORS).index(name) if name in DETECTORS else len(DETECTORS)
    return LINES[at % len(LINES)], MARKERS[at % len(MARKERS)]


def curve(table: pd.DataFrame, stressor: str) -> pd.DataFrame:
    """Returns the rows of a stressor and the row without stress, with an x position `at`.

    The position is the severity. If severities are names, their positions are 1, 2, ..., and the
    position without stress is 0.
    """
    stressed, base = table[table.stressor == stressor], table[table.stressor == NONE.name]
    base = base[base[CURVE].apply(tuple, axis=1).isin(stressed[CURVE].apply(tuple, axis=1))]
    at = pd.to_numeric(stressed.severity, errors="coerce")
    if at.isna().any():
        order = list(dict.fromkeys(stressed.severity))
        rows = pd.concat(
            [base.assign(at=0.0), stressed.assign(at=stressed.severity.map(order.index) + 1.0)]
        )
    else:
        start = _start(base, stressed)
        rows = pd.concat([base.assign(at=start), stressed.assign(at=at)])
        rows = rows[rows["at"].notna()]
    return rows.sort_values([*CURVE, "at"])


def _start(base: pd.DataFrame, stressed: pd.DataFrame) -> Any:
    """Returns the severity without stress: all training frames, 1 for unit `times`, else 0."""
    if stressed.stressor.iloc[0] == "training_frames" and "trained_frames" in base:
        return pd.to_numeric(base["trained_frames"], errors="coerce")
    return 1.0 if stressed.unit.iloc[0] == "times" else 0.0


def _panel(names: Names, table: pd.DataFrame, stressor: str) -> Panel | None:
    rows = curve(table, stressor)
    if rows.ap_r1000.isna().all():
        return None
    stressed = table[table.stressor == stressor]
    named = pd.to_numeric(stressed.severity, errors="coerce").isna().any()
    unit = str(stressed.unit.iloc[0])
    title = stressor.replace("_", " ")
    with drawing():
        figure, ax = panel()
        for key, line in rows.groupby(["lidar", "detector"], sort=False):
            _line(names, ax, line, str(key[0]), str(key[1]), named=bool(named))
        if named:
            ticks = ["none", *dict.fromkeys(stressed.severity)]
            ax.set_xticks(range(len(ticks)), [names.model(t).split(" ")[-1] for t in ticks])
        if stressor == "training_frames":
            ax.invert_xaxis()
        ax.set(ylim=(0, 102), ylabel=AP_R1000, xlabel=UNITS.get(unit, unit))
        label = f"AP under {title}, {table.scene.iloc[0]}, preset {table.preset.iloc[0]}"
        return Panel(title, svg.inline(figure, svg.identifier("stress", label), label))


def _line(names: Names, ax: Any, rows: pd.DataFrame, lidar: str, by: str, *, named: bool) -> None:
    colour = names.look(lidar).colour
    line, marker = _style(by)
    style: dict[str, Any] = {"color": colour, "marker": marker, "markersize": 3.2, "linewidth": 1.1}
    if named:  # names have no order, so the markers are not joined by a line
        distances = [
            (rows.ap_r1000 - rows.ap_r1000_low).clip(lower=0),
            (rows.ap_r1000_high - rows.ap_r1000).clip(lower=0),
        ]
        shift = 0.07 * (list(DETECTORS).index(by) if by in DETECTORS else 0)
        ends = np.nan_to_num(np.array(distances))
        ax.errorbar(rows["at"] + shift, rows.ap_r1000, ends, linestyle="", elinewidth=0.6, **style)
        return
    ax.plot(rows["at"], rows.ap_r1000, linestyle=line, **style)
    ax.fill_between(
        rows["at"], rows.ap_r1000_low, rows.ap_r1000_high, color=colour, alpha=0.12, linewidth=0
    )


def _plain(material: Material, rows: pd.DataFrame, source: TableFile, caption: str) -> Table:
    """Returns a table with the columns of its file."""
    columns = [c for c in rows if c not in ("origin", "command", "version", "machine", "run")]
    numeric = {c: pd.to_numeric(rows[c], errors="coerce") for c in columns}
    is_number = {c: bool(v.notna().any()) and c != "seed" for c, v in numeric.items()}
    heads = [Column(c.replace("_", " "), number=is_number[c]) for c in columns]
    lines = [
        [
            _cell(material.names, str(row[c]), float(numeric[c][at]), row.origin, is_number[c])
            for c in columns
        ]
        for at, row in rows.iterrows()
    ]
    return Table(caption, heads, lines, source, closed=len(rows) > 12)


def _cell(names: Names, text: str, value: float, origin: str, is_number: bool) -> TableCell:
    if not is_number:
        return TableCell(DETECTORS.get(text, names.spelled(text)))
    return TableCell(f"{value:.4g}" if math.isfinite(value) else text, value, origin)
