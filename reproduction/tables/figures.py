"""Draws the first figure of each page of results, from results/*.csv."""

import hashlib
from collections.abc import Callable
from dataclasses import astuple, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import matplotlib as mpl
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.text import Text

from pyinfra.core.files import replacing
from pyinfra.experiments.stress.stressors import NONE
from pyinfra.metrics.comparison import over_replicates
from pyinfra.viz.picture_style import COLOURS, STYLE
from reproduction.commands.verdicts import LEVEL_AP, WIDE
from reproduction.tables import integration, simulator, sites, tracks
from reproduction.tables.common import LIDARS, results
from reproduction.tables.verdicts import (
    AVIA,
    TRAINED,
    TRAININGS,
    aps_of,
    means_of_detectors,
    shown_verdicts,
)

SIZE_IN = (6.4, 3.0)
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "*")
SVG: Any = {"svg.fonttype": "none", "svg.hashsalt": "infrasim"}
DECIDE = ("fine-tuned", "from scratch")  # detectors that are trained for each LiDAR
DETECTOR_SCENE = ("highway", "paper")
VALUE = ["value", "low", "high"]


@dataclass(frozen=True)
class Picture:
    """A figure: the rows that it shows, and the function that draws them."""

    rows: Callable[[], pd.DataFrame]
    draw: Callable[[pd.DataFrame], Figure]


def rows_of_claim(claim: str, subset: str = "captured") -> pd.DataFrame:
    """Returns value, low and high of a claim by scene, preset and the detectors that decide."""
    table = shown_verdicts(claim, subset)
    table = table[table["training"].isin(DECIDE)].dropna(subset=["value"])
    where = table.scene + ", " + table.preset
    columns = table[["value", "low", "high"]]
    return columns.assign(row=where, series=table["training"].map(TRAININGS)).reset_index(drop=True)


def draw_intervals(
    rows: pd.DataFrame, label: str, holds: tuple[float, float] | None = None
) -> Figure:
    """Draws the intervals of each row. holds: range in which the claim holds."""
    names, series = list(rows.row.unique()), list(rows.series.unique())
    figure, ax = _empty(max(SIZE_IN[1], 0.9 + 0.09 * len(names) * (1 + len(series))))
    for number, (name, part) in enumerate(rows.groupby("series", sort=False)):
        y = part.row.map(names.index) + 0.6 / len(series) * (number - (len(series) - 1) / 2)
        ends = [part.value - part.low, part.high - part.value]
        style: Any = {"color": COLOURS[number], "fmt": MARKERS[number], "markersize": 4}
        ax.errorbar(part.value, y, xerr=ends, capsize=2, label=str(name), **style)
    left, right = ax.get_xlim()
    if holds is not None:
        ax.axvspan(max(left, holds[0]), min(right, holds[1]), color="0.92", zorder=0)
    ax.axvline(0, color="0.4", linewidth=0.6)
    ax.set(yticks=range(len(names)), yticklabels=names, xlabel=label, xlim=(left, right))
    ax.invert_yaxis()
    return _finished(figure, ax)


def rows_of_prices() -> pd.DataFrame:
    """Returns AP of `present` with its interval, and the price, by scene, preset and LiDAR."""
    prices = results("lidars").drop_duplicates("lidar").set_index("lidar").price_high_usd
    rows = []
    for (scene, preset), aps in aps_of("present"):
        for lidar in aps:
            mean = over_replicates(aps[lidar].to_list())
            key = (f"{scene}, {preset}", prices[lidar], LIDARS.get(lidar, "5 Avias"))
            rows.append((*key, mean.value, mean.low, mean.high))
    return pd.DataFrame(rows, columns=["series", "x", "name", "value", "low", "high"])


def draw_prices(rows: pd.DataFrame) -> Figure:
    figure, ax = _empty()
    for number, (name, part) in enumerate(rows.groupby("series", sort=False)):
        line = part.sort_values("x")
        style: Any = {"color": COLOURS[number // 2], "linestyle": ("-", "--")[number % 2]}
        ax.plot(line.x, line.value, marker=MARKERS[number], markersize=4, label=str(name), **style)
    ax.axhline(LEVEL_AP, color="0.4", linewidth=0.6)
    ax.set(xscale="log", xlabel="price, USD", ylabel="AP (R1000) of all vehicles")
    ticks = sorted(rows.x.unique())
    names = rows.drop_duplicates("x").set_index("x").name
    ax.set_xticks(ticks, [f"{names[x]}\n{x:,.0f}" for x in ticks], fontsize=6)
    ax.minorticks_off()
    return _finished(figure, ax)


def rows_of_detectors() -> pd.DataFrame:
    """Returns AP, milliseconds of a frame and CPU seconds of training by detector and LiDAR.

    The scene is DETECTOR_SCENE. A detector that is not trained has 0 s.
    """
    aps, training, times = means_of_detectors(*DETECTOR_SCENE)
    rows = [
        (TRAINED[key], LIDARS[lidar], times[key], training.fillna(0)[key], aps.loc[key, lidar])
        for key in TRAINED
        if key in aps.index and key in times.index
        for lidar in (WIDE, AVIA)
    ]
    return pd.DataFrame(rows, columns=["series", "lidar", "frame_ms", "training_s", "value"])


def draw_detectors(rows: pd.DataFrame) -> Figure:
    """Draws AP against the time of a frame and against the time of training."""
    figure = Figure(figsize=SIZE_IN, layout="constrained")
    panels = figure.subplots(1, 2, sharey=True)
    for ax, x in zip(panels, ("frame_ms", "training_s"), strict=True):
        for number, (name, part) in enumerate(rows.groupby("series", sort=False)):
            style: Any = {"color": COLOURS[number % len(COLOURS)], "marker": MARKERS[number]}
            ax.plot(part[x], part.value, linewidth=0.6, markersize=0, **style)
            for lidar, row in part.set_index("lidar").iterrows():
                filled = lidar == LIDARS[WIDE]
                style["markerfacecolor"] = style["color"] if filled else "none"
                label = str(name) if filled else None
                ax.plot(row[x], row.value, linestyle="none", label=label, **style)
    panels[0].set(xscale="log", xlabel="time of a frame on one thread, ms")
    panels[0].set_ylabel("AP (R1000) of captured vehicles\nfilled: Ruby Plus, empty: Avia")
    panels[1].set_xscale("symlog", linthresh=10, linscale=0.3)
    panels[1].set_xticks([0, 10, 100, 1000], ["0", "10", "100", "1,000"])
    panels[1].set(xlabel="time of training, CPU s", xlim=(-3, 2 * rows.training_s.max()))
    panels[1].grid(alpha=0.3, linewidth=0.4)
    return _finished(figure, panels[0])


def rows_of_stress() -> pd.DataFrame:
    """Returns the change of the mean AP over seeds by stressor, severity and LiDAR.

    The detector is the fine-tuned one. Stressors with named severities are left out.
    """
    table = results("stress_seeds")
    table = table[(table.setup == "fine-tuned") & table.lidar.isin(LIDARS)]
    table = table.assign(severity=pd.to_numeric(table.severity, errors="coerce")).dropna(
        subset=["severity", "ap_r1000"]
    )
    keys = ["stressor", "unit", "lidar", "severity"]
    unstressed = table[table.stressor == NONE.name].groupby("lidar").ap_r1000.mean()
    means = table[table.stressor != NONE.name].fillna({"unit": ""}).groupby(keys, sort=False)
    rows = means.ap_r1000.mean().reset_index(name="value")
    return rows.assign(value=rows.value - rows.lidar.map(unstressed))


def draw_stress(rows: pd.DataFrame) -> Figure:
    stressors = list(rows.stressor.unique())
    columns = 3
    lines = -(-len(stressors) // columns)
    figure = Figure(figsize=(SIZE_IN[0], 1.4 * lines), layout="constrained")
    axes = figure.subplots(lines, columns, sharey=True, squeeze=False).ravel()
    for ax, name in zip(axes, stressors, strict=False):
        part = rows[rows.stressor == name]
        for number, lidar in enumerate(rows.lidar.unique()):
            line = part[part.lidar == lidar].sort_values("severity")
            style: Any = {"marker": MARKERS[number], "markersize": 3, "color": COLOURS[number]}
            ax.plot(line.severity, line.value, linewidth=1, label=LIDARS[lidar], **style)
        ax.set_title(f"{name}, {part.unit.iloc[0]}")
    for ax in axes[len(stressors) :]:
        ax.remove()
    for ax in axes[::columns]:
        ax.set_ylabel("change of AP")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=4)
    return figure


def rows_of_models() -> pd.DataFrame:
    """Returns the change of AP with its interval by changed setting of the scene and LiDAR."""
    rows = [
        (f"{setting} {value}", LIDARS[lidar], *astuple(change))
        for (setting, value), changes in simulator.changes_of_models().items()
        for lidar, change in sorted(changes.items(), key=lambda pair: [*LIDARS].index(pair[0]))
    ]
    return pd.DataFrame(rows, columns=["row", "series", *VALUE])


def rows_of_integration() -> pd.DataFrame:
    """Returns the change of AP with its interval by speed, LiDAR, integration time and label."""
    rows = [
        (
            f"{speed} km/h, {LIDARS[lidar]}",
            integration.name_of(stack),
            *astuple(integration.change(of_seeds, stack)),
        )
        for (speed, lidar), of_seeds in integration.aps("captured").items()
        for stack in of_seeds
        if stack != integration.SINGLE
    ]
    return pd.DataFrame(rows, columns=["row", "series", *VALUE])


def rows_of_people() -> pd.DataFrame:
    """Returns the median points on a pedestrian by distance and LiDAR of the study."""
    table = results("people")
    table = table[(table["class"] == "Pedestrian") & table.lidar.isin(LIDARS)]
    table = table.sort_values("lidar", key=lambda c: c.map([*LIDARS].index), kind="stable")
    return pd.DataFrame(
        {"series": table.lidar.map(LIDARS), "x": table.from_m, "value": table.points}
    )


def draw_people(rows: pd.DataFrame) -> Figure:
    figure, ax = _empty()
    for number, (name, part) in enumerate(rows.groupby("series", sort=False)):
        style: Any = {"color": COLOURS[number], "marker": MARKERS[number], "markersize": 3}
        shown = part[part.value > 0]
        ax.plot(shown.x, shown.value, linewidth=1, label=str(name), **style)
    ax.axhline(sites.PEOPLE_POINTS, color="0.4", linewidth=0.6)
    ax.set(yscale="log", xlabel="distance, m", ylabel="points on a pedestrian")
    return _finished(figure, ax)


def rows_of_tracks() -> pd.DataFrame:
    """Returns the mean HOTA of the detector's tracks over seeds, by scene and LiDAR."""
    table = tracks.rows_of("detector")
    names = {"row": table.scene.map(tracks.SCENES), "series": table.lidar.map(LIDARS)}
    return pd.DataFrame({**names, "value": table.hota}).reset_index(drop=True)


def draw_tracks(rows: pd.DataFrame) -> Figure:
    figure, ax = _empty()
    scenes = list(rows.row.unique())
    for number, (name, part) in enumerate(rows.groupby("series", sort=False)):
        style: Any = {"color": COLOURS[number], "marker": MARKERS[number], "markersize": 5}
        ax.plot(part.value, part.row.map(scenes.index), linestyle="none", label=str(name), **style)
    ax.set(yticks=range(len(scenes)), yticklabels=scenes, xlabel="HOTA", xlim=(0, 100))
    ax.invert_yaxis()
    return _finished(figure, ax)


def rows_of_coverage() -> pd.DataFrame:
    """Returns the recall of each option of plans: predicted, and the mean of further traffic.

    The sites are test sites: their errors were not used to set the width of the intervals.
    """
    table = results("plan_coverage")
    table = table.query("figure == 'recall' and source == 'predicted' and use == 'test'")
    return table[[*VALUE, "mean", "mean_low", "mean_high"]].reset_index(drop=True)


def draw_coverage(rows: pd.DataFrame) -> Figure:
    figure, ax = _empty()
    ends = [rows.value - rows.low, rows.high - rows.value]
    of_mean = [rows["mean"] - rows.mean_low, rows.mean_high - rows["mean"]]
    style: Any = {"fmt": "o", "markersize": 3, "elinewidth": 0.6, "color": COLOURS[0]}
    ax.errorbar(rows["mean"], rows.value, xerr=of_mean, yerr=ends, label="an option", **style)
    ax.plot([0, 100], [0, 100], color="0.4", linewidth=0.6)
    low = 5 * int(min(rows.low.min(), rows.mean_low.min()) // 5)
    ax.set(xlim=(max(0, low), 100), ylim=(max(0, low), 100), aspect="equal")
    ax.set(xlabel="vehicles found in further traffic, %", ylabel="predicted, %")
    return _finished(figure, ax)


def _empty(height_in: float = SIZE_IN[1]) -> tuple[Figure, Axes]:
    figure = Figure(figsize=(SIZE_IN[0], height_in), layout="constrained")
    return figure, figure.subplots()


def _finished(figure: Figure, ax: Axes) -> Figure:
    ax.grid(alpha=0.3, linewidth=0.4)
    entries = ax.get_legend_handles_labels()
    figure.legend(*entries, loc="outside lower center", ncols=3)
    return figure


CLAIM = partial(draw_intervals, holds=(0.0, 1e9))
FIGURES: dict[str, Picture] = {  # figures by the name of their file in docs/pictures/results
    "comparable": Picture(
        partial(rows_of_claim, "comparable"),
        partial(draw_intervals, label="AP of the Avia minus AP of Ruby Plus", holds=(-3.0, 3.0)),
    ),
    "gentle": Picture(
        partial(rows_of_claim, "gentle"),
        partial(CLAIM, label="decrease of AP with distance, best spinning LiDAR minus Avia"),
    ),
    "areas": Picture(
        partial(rows_of_claim, "areas"),
        partial(CLAIM, label="share of high-quality areas (%), Avia minus Ruby Plus"),
    ),
    "value": Picture(rows_of_prices, draw_prices),
    "detectors": Picture(rows_of_detectors, draw_detectors),
    "stress": Picture(rows_of_stress, draw_stress),
    "ladder": Picture(rows_of_models, partial(draw_intervals, label="change of AP (R1000)")),
    "integration": Picture(
        rows_of_integration, partial(draw_intervals, label="change of AP (R1000) from 0.1 s")
    ),
    "people": Picture(rows_of_people, draw_people),
    "tracks": Picture(rows_of_tracks, draw_tracks),
    "plans": Picture(rows_of_coverage, draw_coverage),
}


def drawn(name: str) -> tuple[Figure, str]:
    """Returns a figure, and a digest of its rows and texts."""
    rows = FIGURES[name].rows()
    figure = FIGURES[name].draw(rows)
    texts = [text.get_text() for text in figure.findobj(Text) if isinstance(text, Text)]
    shown = rows.to_csv(index=False, float_format="%.5g") + "\n".join(texts)
    return figure, hashlib.sha256(shown.encode()).hexdigest()[:16]


def is_current(name: str, folder: Path) -> bool:
    """Returns whether the file of a figure shows the present rows and texts."""
    file = folder / f"{name}.svg"
    with mpl.rc_context({**STYLE, **SVG}):
        _, digest = drawn(name)
    return file.is_file() and digest in file.read_text(encoding="utf-8")


def write(name: str, folder: Path) -> None:
    """Draws a figure. Its digest is in the file, so that a file that is out of date is found."""
    folder.mkdir(parents=True, exist_ok=True)
    with mpl.rc_context({**STYLE, **SVG}), replacing(folder / f"{name}.svg") as beside:
        figure, digest = drawn(name)
        figure.savefig(beside, format="svg", metadata={"Date": None, "Identifier": digest})
