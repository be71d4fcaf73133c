"""Figures as markup inside a page: small, with own ids, and in the colours of the page."""

from __future__ import annotations

import html
import io
import re
import zlib
from functools import cache
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from pyinfra.report.looks import INK, NAMES, STYLE, drawing

DENSE = 400  # a line with more points is stored as a picture
POINTS_PER_PIXEL = 0.75


def inline(figure: Figure, name: str, label: str, dpi: int = 144) -> str:
    """A figure as an svg element whose accessible name is `label`; `name` makes its ids its own.

    dpi: of the dense clouds of points in it, which are stored as pictures.
    """
    for line in (line for axes in figure.axes for line in axes.lines):
        if np.size(line.get_xdata()) > DENSE:
            line.set_rasterized(True)
    with mpl.rc_context(STYLE | {"svg.hashsalt": name}), io.StringIO() as text:
        figure.savefig(text, format="svg", dpi=dpi, transparent=True, metadata={"Date": None})
        markup = text.getvalue()
    return _named(_bare(markup), name, label)


def identifier(*words: object) -> str:
    """Words as one that may be an id."""
    return "-".join(re.sub(r"\W+", "-", str(word)).strip("-") for word in words).lower()


@cache
def line_swatch(colour: str, line: Any, marker: str) -> str:
    """The picture of a line for a legend."""
    with drawing():
        figure = Figure(figsize=(0.42, 0.16))
        style: dict[str, Any] = {"color": colour, "linestyle": line, "marker": marker}
        artist = Line2D([0.05, 0.5, 0.95], [0.5] * 3, markevery=[1], markersize=4.5, **style)
        figure.add_artist(artist)
        return _swatch(figure, f"{colour}{line}{marker}")


@cache
def patch_swatch(colour: str, hatch: str) -> str:
    """The picture of a filled area for a legend."""
    with drawing():
        figure = Figure(figsize=(0.3, 0.16))
        look: dict[str, Any] = {"facecolor": colour, "hatch": hatch, "edgecolor": INK}
        patch = Patch(linewidth=0.6, **look)
        figure.legend(
            handles=[patch],
            labels=[""],
            loc="center",
            frameon=False,
            handlelength=1.8,
            borderpad=0,
            handletextpad=0,
        )
        return _swatch(figure, f"{colour}{hatch}")


def _swatch(figure: Figure, name: str) -> str:
    markup = inline(figure, identifier("swatch", name), "")
    return markup.replace('role="img" aria-label=""', 'aria-hidden="true"')


def _bare(markup: str) -> str:
    """Without prolog and metadata, with short numbers."""
    markup = markup[markup.index("<svg") :]
    for element in ("metadata", "style"):  # the style is the same in each; the page has it
        markup = re.sub(rf"<{element}[ >].*?</{element}>", "", markup, flags=re.DOTALL)
    markup = re.sub(r'(?<=[ "])(d|x|y|transform|points)="[^"]*"', _short, markup)
    markup = re.sub(r"font-family: [^;\"]*;? ?", "", markup)
    used = set(re.findall(r'(?:url\(#|href="#)([^)"]+)', markup))
    markup = re.sub(r' id="([^"]*)"', lambda m: m[0] if m[1] in used else "", markup)
    markup = re.sub(r">\s+<", "><", markup).strip()
    return re.sub(r"<g>((?:<(?:path|use|text|image)[^>]*/>)*)</g>", r"\1", markup)


def _short(attribute: re.Match[str]) -> str:
    """A tenth of a point is finer than a screen; scales of transforms need more."""
    digits = 3 if attribute[1] == "transform" else 1
    return " ".join(re.sub(rf"(\.\d{{{digits}}})\d+", r"\1", attribute[0]).split())


def _named(markup: str, name: str, label: str) -> str:
    """With ids of its own, the page's colours, and an accessible name; it scales with its place."""
    own = f"{zlib.crc32(name.encode()):x}"
    markup = re.sub(r'(\bid="|url\(#|href="#)', rf"\g<1>{own}-", markup)
    for colour, variable in NAMES.items():
        pattern = rf"{colour}(?![0-9a-f])"
        markup = re.sub(pattern, f"var(--{variable})", markup, flags=re.IGNORECASE)
    head, body = markup.split(">", 1)
    box = re.search(r'viewBox="0 0 (\S+) (\S+)"', head)
    assert box is not None, head
    width, height = (float(size) / POINTS_PER_PIXEL for size in box.groups())
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink" '
        f'{box[0]} width="{width:.0f}" height="{height:.0f}" '
        f'role="img" aria-label="{html.escape(label)}">{body}'
    )
