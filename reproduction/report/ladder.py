"""Shows how cheaper scene models change the conclusions, one setting at a time."""

import itertools
from dataclasses import dataclass

import pandas as pd

from pyinfra.experiments.result_tables import TableFile
from pyinfra.metrics.comparison import Interval, over_replicates
from pyinfra.viz.report import svg
from pyinfra.viz.report.blocks import (
    Block,
    Columns,
    Figure,
    Panel,
    Table,
    number_in,
    table_of,
)
from pyinfra.viz.report.report_data import Material
from pyinfra.viz.report.sections.distance import legend
from pyinfra.viz.report.style import drawing, panel

TOO_FEW_SEEDS = (
    "The table has fewer than three seeds, so it is not known which scene models change no "
    "conclusion."
)
MARGIN_AP = 3.0  # a model changes no AP if the interval of each difference is within +- MARGIN_AP
LEAST_SEEDS = 3
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


def blocks(material: Material) -> tuple[str, list[Block]]:
    """Returns the recommendation, and the blocks with its figure and table.

    Both are empty if the results have no table `ladder`. Of several detectors or presets, the one
    with most rows is used.
    """
    table = material.results.table("ladder")
    if table.empty:
        return "", []
    for name in ("detector", "preset"):
        if name in table:
            table = table[table[name] == table[name].mode()[0]]
    table = table.assign(seconds=table.ms_per_frame_set * table.frames.astype(float) / 1000)
    steps = compared_values(table)
    words = recommendation(steps) if has_seeds(table) else TOO_FEW_SEEDS
    return words, [_figure(material, table), _table(material, steps, has_seeds(table))]


def has_seeds(table: pd.DataFrame) -> bool:
    """Returns whether a table has enough seeds for an interval."""
    return bool(table.seed.nunique() >= LEAST_SEEDS)


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
        by_value = {value: by_seed(selected[selected[setting] == value]) for value in present}
        for value, aps in by_value.items():
            reference = by_value[present[-1]]
            change = (aps - reference).mean().abs().max()
            seconds = float(selected[selected[setting] == value].seconds.mean())
            same = agrees(aps, reference)
            made.append(ComparedValue(setting, value, seconds, float(change), same))
    return made


def by_seed(rows: pd.DataFrame) -> pd.DataFrame:
    """Returns the AP of one model: one row per seed and one column per LiDAR."""
    return rows.pivot(index="seed", columns="lidar", values="ap_r1000")


def interval(aps: pd.Series) -> Interval:
    """Returns the mean over seeds with its 95 % interval; NaN as ends if there are too few."""
    values = aps.dropna().to_list()
    mean = over_replicates(values)
    return mean if len(values) >= LEAST_SEEDS else Interval(mean.value, float("nan"), float("nan"))


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


def agrees(aps: pd.DataFrame, reference: pd.DataFrame) -> bool:
    """Returns whether a cheaper model leads to the same conclusions as the most expensive one.

    Two conditions must hold. The 95 % interval of each LiDAR's change of AP lies within MARGIN_AP
    to either side. Every pair of LiDARs that differs significantly under the most expensive model
    also differs significantly, with the same sign, under the cheaper model. Differences are paired
    by seed. The result is False if there are too few seeds for an interval.

    Parameters
    ----------
    aps, reference : results of `by_seed` for the cheaper and for the most expensive model
    """
    if set(aps) != set(reference):
        return False
    changes = [interval(aps[lidar] - reference[lidar]) for lidar in reference]
    if not all(change.low >= -MARGIN_AP and change.high <= MARGIN_AP for change in changes):
        return False
    return all(
        interval(aps[a] - aps[b]).low > 0
        for a, b in itertools.permutations(reference, 2)
        if interval(reference[a] - reference[b]).low > 0
    )


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
        f"The cheapest scene model that changes no conclusion: {', '.join(parts)}. Each AP differs "
        f"by less than {MARGIN_AP:g} from that of the most expensive model, and every significant "
        "order of two LiDARs is the same."
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
                rows = selected[selected.lidar == lidar]
                aps = [interval(rows[rows[setting] == value].ap_r1000) for value in shown]
                x = [tick + 0.12 * (i - (len(lidars) - 1) / 2) for tick in range(len(shown))]
                spread = [[ap.value - ap.low for ap in aps], [ap.high - ap.value for ap in aps]]
                style = material.names.look(lidar).style() | {"linestyle": "-", "linewidth": 0.8}
                ax.errorbar(x, [ap.value for ap in aps], spread, **style)
            seconds = selected.groupby(setting).seconds.mean().reindex(shown)
            labels = [f"{v}\n{s:.3g} s" for v, s in zip(shown, seconds, strict=True)]
            ax.set_xticks(range(len(shown)), labels)
            ax.set(xlabel=f"{setting}, and CPU time of the run", ylabel="AP (R1000), %")
            panels.append(
                Panel(setting, svg.inline(figure, f"ladder-{setting}", f"AP by {setting}"))
            )
    caption = (
        "Accuracy against the cost of the simulation: AP of Background on the highway, with 95 % "
        "intervals over traffic seeds. Each panel varies one setting of the scene model."
    )
    source = material.results.source("ladder")
    return Figure("figure-ladder", caption, panels, source, legend(material.names, lidars))


def _table(material: Material, steps: list[ComparedValue], known: bool) -> Table:
    made = pd.DataFrame([vars(step) for step in steps])
    columns: Columns = {
        "Setting": lambda row: str(row.setting),
        "Value": lambda row: str(row.value),
        "CPU time, s": number_in("seconds"),
        "Largest change of AP": number_in("change", ".2f"),
        "Conclusions": lambda row: ("same" if row.same else "changed") if known else "no interval",
    }
    caption = "Whether a cheaper scene model changes the conclusions, from ladder.csv."
    return table_of(caption, made, columns, TableFile("report_ladder.csv", made))
