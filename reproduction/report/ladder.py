"""Shows how cheaper scene models change the conclusions, one setting at a time."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import pandas as pd

from pyinfra.experiments.result_tables import TableFile
from pyinfra.metrics import comparison
from pyinfra.metrics.replicates import are_pairs, difference, drawn
from pyinfra.metrics.row_selection import ap_name, with_r1000
from pyinfra.viz.report import svg
from pyinfra.viz.report.blocks import Block, Column, Figure, Panel, Table, TableCell, number
from pyinfra.viz.report.report_data import Material
from pyinfra.viz.report.sections.distance import legend
from pyinfra.viz.report.style import drawing, panel

NOT_SIGNIFICANT = (
    "The table keeps no replicates: which model leaves the conclusions as they are is not known."
)
# The values of each setting from cheap to expensive. The last value is the reference.
SEVERITIES = {
    "detail": ("box", "low", "mid", "fine"),
    "aggregation": ("instant", "slices:100", "exact"),
    "parts": ("none", "glass", "gap", "coat", "tyres", "reflectors", "glass+gap+coat", "all"),
    "vegetation": ("none", "scene"),
    "label_time": ("frame", "scan"),
    "frames": ("50", "100", "200", "500", "1000"),
}


@dataclass(frozen=True)
class Rung:
    """One value of one setting, compared with the most expensive value."""

    severity: str
    value: str
    seconds: float  # CPU time of the simulation
    change: float  # largest change of AP over all LiDARs
    same: bool  # whether all conclusions are the same
    known: bool  # whether every LiDAR has an interval


def blocks(material: Material) -> tuple[str, list[Block]]:
    """Returns the recommendation, and the blocks with its figure and table.

    Both are empty if the results have no table `ladder`.
    """
    table = with_r1000(material.results.table("ladder"))
    if table.empty:
        return "", []
    table = table.assign(seconds=table.ms_per_frame_set * table.frames.astype(float) / 1000)
    all_rungs = rungs(table)
    words = recommendation(all_rungs) if keeps_replicates(table) else NOT_SIGNIFICANT
    return words, [_figure(material, table), _table(material, all_rungs)]


def rungs(table: pd.DataFrame) -> list[Rung]:
    """Returns a Rung for every value of every setting.

    All other settings have their most frequent values.
    """
    usual = usual_of(table)
    made = []
    for severity, values in severities_of(table).items():
        selected = _turned(table, severity, usual)
        selected = selected[selected.ap_r1000.notna()]
        there = [value for value in values if value in set(selected[severity])]
        if not there:
            continue
        dearest = selected[selected[severity] == there[-1]].set_index("lidar")
        for value in there:
            rows = selected[selected[severity] == value].set_index("lidar")
            change = (rows.ap_r1000 - dearest.ap_r1000).abs().max()
            seconds = float(rows.seconds.mean())
            made.append(
                Rung(
                    severity,
                    value,
                    seconds,
                    float(change),
                    agrees(rows, dearest, of_frames=severity == "frames"),
                    rows.ap_r1000_low.notna().all(),
                )
            )
    return made


def severities_of(table: pd.DataFrame) -> dict[str, tuple[str, ...]]:
    """Returns the settings that a table has as columns."""
    return {severity: values for severity, values in SEVERITIES.items() if severity in table}


def usual_of(table: pd.DataFrame) -> dict[str, str]:
    """Returns the most frequent value of each setting."""
    return {severity: table[severity].astype(str).mode()[0] for severity in severities_of(table)}


def _turned(table: pd.DataFrame, severity: str, usual: dict[str, str]) -> pd.DataFrame:
    """Returns the rows in which only `severity` differs from the most frequent values."""
    keep = pd.Series(True, index=table.index)
    for other, value in usual.items():
        if other != severity:
            keep &= table[other].astype(str) == value
    return table[keep].assign(**{severity: table[severity].astype(str)})


def agrees(rows: pd.DataFrame, dearest: pd.DataFrame, *, of_frames: bool = False) -> bool:
    """Returns whether a cheaper model leads to the same conclusions as the most expensive one.

    Two conditions must hold. No LiDAR's AP differs significantly from its AP under the most
    expensive model. Every pair of LiDARs that differs significantly under the most expensive model
    also differs significantly, with the same sign, under the cheaper model. The result is False if
    a row has no bootstrap replicates.

    Parameters
    ----------
    rows, dearest : one row per LiDAR of the cheaper and of the most expensive model, both with the
        same traffic
    of_frames : tests only the second condition, because models with different frames have no paired
        replicates
    """
    if set(rows.index) != set(dearest.index) or not (
        keeps_replicates(rows) and keeps_replicates(dearest)
    ):
        return False
    if not of_frames:
        both = [(rows.loc[name], dearest.loc[name]) for name in dearest.index]
        if not all(are_pairs(a, b) for a, b in both):
            return False
        apart = [difference(a, b).measured() for a, b in both]
        if not all(interval.is_known and not interval.is_significant for interval in apart):
            return False
    ours, theirs = figures(rows), figures(dearest)
    return all(
        ours[a].less(ours[b]).measured().low > 0
        for a, b in itertools.permutations(theirs, 2)
        if theirs[a].less(theirs[b]).measured().low > 0
    )


def keeps_replicates(rows: pd.DataFrame) -> bool:
    return bool((rows.replicates > 0).all())


def figures(rows: pd.DataFrame) -> dict[str, comparison.Bootstrapped]:
    return {str(name): drawn(row) for name, row in rows.iterrows()}


def recommendation(all_rungs: list[Rung]) -> str:
    """Names the cheapest value of each setting that changes no conclusion.

    No more expensive value of the setting may change a conclusion either.
    """
    parts = []
    for severity in dict.fromkeys(rung.severity for rung in all_rungs):
        values = [rung for rung in all_rungs if rung.severity == severity]
        good = list(itertools.takewhile(lambda rung: rung.same, reversed(values)))
        if good:
            best, dearest = min(good[::-1], key=lambda rung: rung.seconds), values[-1]
            share = best.seconds / dearest.seconds
            parts.append(f"{severity} {best.value} ({share:.2f} of the time of {dearest.value})")
    if not parts:
        return "No model of the scene leaves all conclusions as the dearest one has them."
    return (
        "The cheapest model of the scene that leaves all conclusions as they are (no AP can be "
        "told from the dearest model's, and every order of two LiDARs that it decides stays): "
        + ", ".join(parts)
        + "."
    )


def _figure(material: Material, table: pd.DataFrame) -> Figure:
    panels = []
    lidars = material.names.sorted(table.lidar)
    usual = usual_of(table)
    for severity, values in severities_of(table).items():
        selected = _turned(table, severity, usual)
        with drawing():
            figure, ax = panel(3.2, 2.7, bottom=0.58)
            shown = [value for value in values if value in set(selected[severity])]
            for i, lidar in enumerate(lidars):
                rows = selected[selected.lidar == lidar].set_index(severity).reindex(shown)
                x = [tick + 0.12 * (i - (len(lidars) - 1) / 2) for tick in range(len(shown))]
                spread = [rows.ap_r1000 - rows.ap_r1000_low, rows.ap_r1000_high - rows.ap_r1000]
                look = material.names.look(lidar)
                ax.errorbar(
                    x, rows.ap_r1000, spread, linewidth=0.8, **look.style() | {"linestyle": "-"}
                )
            seconds = selected.groupby(severity).seconds.mean().reindex(shown)
            labels = [f"{v}\n{s:.3g} s" for v, s in zip(shown, seconds, strict=True)]
            ax.set_xticks(range(len(shown)), labels)
            ax.set(xlabel=f"{severity}, and CPU time of the run", ylabel=ap_name(selected))
            panels.append(
                Panel(severity, svg.inline(figure, f"ladder-{severity}", f"AP by {severity}"))
            )
    caption = (
        "Accuracy against the cost of the simulation: AP of Background on the highway with one "
        "severity of the model turned at a time, with 95 % intervals."
    )
    source = material.results.source("ladder")
    return Figure("figure-ladder", caption, panels, source, legend(material.names, lidars))


def _table(material: Material, all_rungs: list[Rung]) -> Table:
    heads = [Column("Severity"), Column("Value")]
    heads += [Column(c, number=True) for c in ("CPU time, s", "Largest change of AP")]
    rows = [
        [
            TableCell(rung.severity),
            TableCell(rung.value),
            number(rung.seconds, ".1f"),
            number(rung.change, ".2f"),
            TableCell(("same" if rung.same else "change") if rung.known else "no interval"),
        ]
        for rung in all_rungs
    ]
    made = pd.DataFrame([vars(rung) for rung in all_rungs])
    caption = "Conclusions with a cheaper model, from ladder.csv."
    source = TableFile("report_ladder.csv", made)
    return Table(caption, [*heads, Column("Conclusions")], rows, source)
