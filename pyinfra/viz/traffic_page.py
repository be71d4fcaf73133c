"""A page of traffic counts: a map whose arrows are as wide as their flow, plots, and tables."""

import html
import io
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch
from matplotlib.path import Path as Curve

from pyinfra.core.arrays import FloatArray
from pyinfra.tracking.counts import Counts
from pyinfra.tracking.lines import Line
from pyinfra.tracking.movements import UNKNOWN
from pyinfra.viz.page_file import check_file, write_page_file
from pyinfra.viz.picture_style import COLOURS, STYLE

WIDEST = 9.0  # line width, in points, of the largest flow
LONE_M = 14.0  # length of the arrow of a movement that crosses only one line
LARGEST_MB = 20.0
_CSS = """
body{font:15px/1.5 system-ui,sans-serif;margin:2em auto;max-width:62em;padding:0 1em;color:#222}
table{border-collapse:collapse;margin:1em 0;font-size:14px}
th,td{padding:.2em .8em;border-bottom:1px solid #ddd;text-align:right}
th:first-child,td:first-child{text-align:left}
svg{max-width:100%;height:auto}
"""


def write_page(counts: Counts, out: Path, *, title: str = "Traffic") -> None:
    """Writes one HTML file without references to other files. Raises Error if `out` is a folder."""
    check_file(out)
    moved = counts.movements.groupby("movement", as_index=False)[["count"]].sum()
    moved["flow_per_h"] = 3600 * moved["count"] / max(counts.seconds, 1e-3)
    lanes = counts.flows.drop(columns=["std_km_h"])
    unseen = int((counts.passages.unseen == 1).sum())
    parts = [
        f"<h1>{html.escape(title)}</h1>",
        f"<p>{len(counts.passages)} passages of {counts.passages.id.nunique()} tracks at "
        f"{len(counts.lines)} lines in {counts.seconds:.0f} s."
        + (f" {unseen} of them are unseen, and have no speed.</p>" if unseen else "</p>"),
        "<h2>Flows</h2>",
        _svg(flow_map(counts)),
        _table(moved),
        "<h2>Speeds and headways</h2>",
        _svg(speed_plots(counts)),
        _table(lanes),
        "<h2>Travel times</h2>",
        _table(counts.travel),
        "<h2>Queues</h2>",
        _table(counts.queues),
    ]
    page = (
        f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{html.escape(title)}</title>'
        f"<style>{_CSS}</style>{''.join(parts)}</html>\n"
    )
    write_page_file(page, out, LARGEST_MB, "use longer intervals")


def flow_map(counts: Counts) -> Figure:
    """Draws the lines, and an arrow per movement whose width is proportional to its count."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(6.5, 5.5), layout="constrained")
        ax = figure.subplots()
        lines = {line.name: line for line in counts.lines}
        for line in counts.lines:
            ax.plot(*np.transpose([line.start, line.end]), color="#666666", linewidth=1.2)
            ax.annotate(line.name, line.end, fontsize=7, color="#444444")
        ax.plot(0, 0, marker="^", color="black", markersize=6)
        ax.annotate("LiDAR", (0, 0), fontsize=7, xytext=(4, 4), textcoords="offset points")
        table = counts.movements.groupby(["start", "end"], as_index=False)["count"].sum()
        table = table[(table.start != UNKNOWN) & (table.end != UNKNOWN)]
        most = max(int(table["count"].max()), 1) if len(table) else 1
        for row in table.sort_values("count", ascending=False).itertuples():
            _arrow(ax, lines, row, most)
        ax.set_aspect("equal")
        ax.margins(0.15)
        ax.set(xlabel="x (m), levelled LiDAR frame", ylabel="y (m)")
    return figure


def _arrow(ax: Axes, lines: dict[str, Line], row: Any, most: int) -> None:
    start = lines[row.start]
    along, middle = _axis(start)
    if row.end in lines:
        inside = [_axis(line)[1] for line in lines.values() if line.group == start.group]
        out_along, out_middle = _axis(lines[row.end])
        # Traffic keeps right: it enters on the right of the line and leaves on its left.
        last = out_middle - out_along * lines[row.end].length_m / 4
        points = np.array([middle + along * start.length_m / 4, np.mean(inside, axis=0), last])
    else:
        sign = 1 if row.end in (start.forward, f"({start.forward})") else -1
        ahead = np.array([-along[1], along[0]]) * sign
        base = middle + sign * along * start.length_m / 4
        points = np.array([base - ahead * LONE_M / 2, base, base + ahead * LONE_M / 2])
    colour = COLOURS[sorted(lines).index(row.start) % len(COLOURS)]
    width = WIDEST * row.count / most
    codes = [Curve.MOVETO, Curve.CURVE3, Curve.CURVE3]
    style = f"-|>,head_length={4 + width / 2},head_width={2 + width / 2}"
    patch = FancyArrowPatch(
        path=Curve(points, codes), arrowstyle=style, linewidth=width, color=colour, alpha=0.75
    )
    ax.add_patch(patch)
    ax.update_datalim(points)
    label = np.array([0.16, 0.48, 0.36]) @ points  # point of the curve at its parameter 0.6
    box = {
        "boxstyle": "round,pad=0.15",
        "facecolor": "white",
        "edgecolor": colour,
        "linewidth": 0.6,
    }
    ax.annotate(str(row.count), label, fontsize=7, ha="center", va="center", bbox=box, zorder=5)


def _axis(line: Line) -> tuple[FloatArray, FloatArray]:
    """Returns the direction (2,) from the start to the end of a line, and its middle (2,)."""
    start, end = np.array(line.start), np.array(line.end)
    return (end - start) / line.length_m, (start + end) / 2


def speed_plots(counts: Counts) -> Figure:
    """Draws the distribution of speeds and of headways, one curve per line and direction."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(6.5, 2.6), layout="constrained")
        left, right = figure.subplots(1, 2)
        for (line, direction), part in counts.passages.groupby(["line", "direction"]):
            label = f"{line} {direction}"
            for ax, values in ((left, part.speed_km_h.dropna()), (right, part.headway_s.dropna())):
                ordered = np.sort(values.to_numpy(np.float64))
                if len(ordered):
                    share = 100 * np.arange(1, len(ordered) + 1) / len(ordered)
                    ax.step(ordered, share, where="post", label=label, linewidth=1)
        left.set(xlabel="speed (km/h)", ylabel="passages with at most this (%)")
        right.set(xlabel="headway (s)")
        if left.lines:
            left.legend(fontsize=6, frameon=False)
    return figure


def _svg(figure: Figure) -> str:
    """Returns a figure as an svg element. Equal counts always give the same text."""
    with mpl.rc_context({**STYLE, "svg.hashsalt": "counts"}), io.StringIO() as text:
        figure.savefig(text, format="svg", metadata={"Date": None})
        return text.getvalue().partition("<svg")[2].join(["<svg", ""])


def _table(table: pd.DataFrame) -> str:
    if not len(table):
        return "<p>none</p>"
    return str(table.to_html(index=False, float_format="%.1f", border=0, na_rep="", escape=True))
