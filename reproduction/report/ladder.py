"""Shows how cheaper scene models change the conclusions, one setting at a time."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import pandas as pd

from pyinfra.experiments.result_tables import TableFile
from pyinfra.metrics import comparison
from pyinfra.metrics.replicates import are_pairs, bootstrapped_of, difference
from pyinfra.metrics.row_selection import ap_name, with_r1000
from pyinfra.viz.report import svg
from pyinfra.viz.report.blocks import Block, Column, Figure, Panel, Table, TableCell, number
from pyinfra.viz.report.report_data import Material
from pyinfra.viz.report.sections.distance import legend
from pyinfra.viz.report.style import drawing, panel

NOT_SIGNIFICANT = (
    "The table has no bootstrap replicates, so it is not known which scene models change no "
    "conclusion."
)
# The values of each setting from cheap to expensive. The last value is the reference.
SETTINGS = {
    "detail": ("box", "low", "mid", "fine"),
    "aggregation": ("instant", "slices:100", "exact"),
    "parts": ("none", "glass", "gap", "coat", "tyres", "reflectors", "glass+gap+coat", "all"),
    "vegetation": ("none", "scene"),
    "label_time": ("frame", "scan"),
    "frames": ("50", "100", "200", "500", "1000"),
}


@dataclass(frozen=True)
class ComparedValue:
    """One value of one setting, compared with the most expensive value."""

    setting: str
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
    steps = compared_values(table)
    words = recommendation(steps) if keeps_replicates(table) else NOT_SIGNIFICANT
    return words, [_figure(material, table), _table(material, steps)]


def compared_values(table: pd.DataFrame) -> list[ComparedValue]:
    """Returns a ComparedValue for every value of every setting.

    All other settings have their most frequent values.
    """
    usual = usual_of(table)
    made = []
    for setting, values in settings_of(table).items():
        selected = _with_usual_others(table, setting, usual)
        selected = selected[selected.ap_r1000.notna()]
        present = [value for value in values if value in set(selected[setting])]
        if not present:
            continue
        reference = selected[selected[setting] == present[-1]].set_index("lidar")
        for value in present:
            rows = selected[selected[setting] == value].set_index("lidar")
            change = (rows.ap_r1000 - reference.ap_r1000).abs().max()
            seconds = float(rows.seconds.mean())
            made.append(
                ComparedValue(
                    setting,
                    value,
                    seconds,
                    float(change),
                    agrees(rows, reference, of_frames=setting == "frames"),
                    rows.ap_r1000_low.notna().all(),
                )
            )
    return made


def settings_of(table: pd.DataFrame) -> dict[str, tuple[str, ...]]:
    """Returns the settings that a table has as columns."""
    return {setting: values for setting, values in SETTINGS.items() if setting in table}


def usual_of(table: pd.DataFrame) -> dict[str, str]:
    """Returns the most frequent value of each setting."""
    return {setting: table[setting].astype(str).mode()[0] for setting in settings_of(table)}


def _with_usual_others(table: pd.DataFrame, setting: str, usual: dict[str, str]) -> pd.DataFrame:
    """Returns the rows in which only `setting` differs from the most frequent values."""
    keep = pd.Series(True, index=table.index)
    for other, value in usual.items():
        if other != setting:
            keep &= table[other].astype(str) == value
    return table[keep].assign(**{setting: table[setting].astype(str)})


def agrees(rows: pd.DataFrame, reference: pd.DataFrame, *, of_frames: bool = False) -> bool:
    """Returns whether a cheaper model leads to the same conclusions as the most expensive one.

    Two conditions must hold. No LiDAR's AP differs significantly from its AP under the most
    expensive model. Every pair of LiDARs that differs significantly under the most expensive model
    also differs significantly, with the same sign, under the cheaper model. The result is False if
    a row has no bootstrap replicates.

    Parameters
    ----------
    rows, reference : one row per LiDAR of the cheaper and of the most expensive model, both with
        the same traffic
    of_frames : tests only the second condition, because models with different frames have no paired
        replicates
    """
    if set(rows.index) != set(reference.index) or not (
        keeps_replicates(rows) and keeps_replicates(reference)
    ):
        return False
    if not of_frames:
        pairs = [(rows.loc[name], reference.loc[name]) for name in reference.index]
        if not all(are_pairs(a, b) for a, b in pairs):
            return False
        differences = [difference(a, b).measured() for a, b in pairs]
        if not all(interval.is_known and not interval.is_significant for interval in differences):
            return False
    ours, theirs = figures(rows), figures(reference)
    return all(
        ours[a].less(ours[b]).measured().low > 0
        for a, b in itertools.permutations(theirs, 2)
        if theirs[a].less(theirs[b]).measured().low > 0
    )


def keeps_replicates(rows: pd.DataFrame) -> bool:
    return bool((rows.replicates > 0).all())


def figures(rows: pd.DataFrame) -> dict[str, comparison.Bootstrapped]:
    return {str(name): bootstrapped_of(row) for name, row in rows.iterrows()}


def recommendation(steps: list[ComparedValue]) -> str:
    """Names the cheapest value of each setting that changes no conclusion.

    No more expensive value of the setting may change a conclusion either.
    """
    parts = []
    for setting in dict.fromkeys(step.setting for step in steps):
        values = [step for step in steps if step.setting == setting]
        good = list(itertools.takewhile(lambda step: step.same, reversed(values)))
        if good:
            best, reference = min(good[::-1], key=lambda step: step.seconds), values[-1]
            share = best.seconds / reference.seconds
            parts.append(f"{setting} {best.value} ({share:.2f} of the time of {reference.value})")
    if not parts:
        return "Every cheaper scene model changes a conclusion of the most expensive model."
    return (
        f"The cheapest scene model that changes no conclusion: {', '.join(parts)}. No AP differs "
        "significantly from that of the most expensive model, and every significant order of two "
        "LiDARs is the same."
    )


def _figure(material: Material, table: pd.DataFrame) -> Figure:
    panels = []
    lidars = material.names.sorted(table.lidar)
    usual = usual_of(table)
    for setting, values in settings_of(table).items():
        selected = _with_usual_others(table, setting, usual)
        with drawing():
            figure, ax = panel(3.2, 2.7)
            shown = [value for value in values if value in set(selected[setting])]
            for i, lidar in enumerate(lidars):
                rows = selected[selected.lidar == lidar].set_index(setting).reindex(shown)
                x = [tick + 0.12 * (i - (len(lidars) - 1) / 2) for tick in range(len(shown))]
                spread = [rows.ap_r1000 - rows.ap_r1000_low, rows.ap_r1000_high - rows.ap_r1000]
                look = material.names.look(lidar)
                ax.errorbar(
                    x, rows.ap_r1000, spread, linewidth=0.8, **look.style() | {"linestyle": "-"}
                )
            seconds = selected.groupby(setting).seconds.mean().reindex(shown)
            labels = [f"{v}\n{s:.3g} s" for v, s in zip(shown, seconds, strict=True)]
            ax.set_xticks(range(len(shown)), labels)
            ax.set(xlabel=f"{setting}, and CPU time of the run", ylabel=ap_name(selected))
            panels.append(
                Panel(setting, svg.inline(figure, f"ladder-{setting}", f"AP by {setting}"))
            )
    caption = (
        "Accuracy against the cost of the simulation: AP of Background on the highway, with 95 % "
        "intervals. Each panel varies one setting of the scene model."
    )
    source = material.results.source("ladder")
    return Figure("figure-ladder", caption, panels, source, legend(material.names, lidars))


def _table(material: Material, steps: list[ComparedValue]) -> Table:
    heads = [Column("Setting"), Column("Value")]
    heads += [Column(c, number=True) for c in ("CPU time, s", "Largest change of AP")]
    rows = [
        [
            TableCell(step.setting),
            TableCell(step.value),
            number(step.seconds, ".1f"),
            number(step.change, ".2f"),
            TableCell(("same" if step.same else "changed") if step.known else "no interval"),
        ]
        for step in steps
    ]
    made = pd.DataFrame([vars(step) for step in steps])
    caption = "Whether a cheaper scene model changes the conclusions, from ladder.csv."
    source = TableFile("report_ladder.csv", made)
    return Table(caption, [*heads, Column("Conclusions")], rows, source)
