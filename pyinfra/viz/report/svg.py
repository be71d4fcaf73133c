"""Turns figures into small markup inside a page, with unique ids and the page's colours."""

from __future__ import annotations

import html
import io
import re
import zlib
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.markers import MarkerStyle
from matplotlib.path import Path
from matplotlib.transforms import Affine2D

from pyinfra.viz.report.style import NAMES, STYLE

DASHES = {"-": "none", "--": "6 3", "-.": "7 3 2 3", ":": "2 3"}
DENSE = 400  # a line with more points is stored as a bitmap
POINTS_PER_PIXEL = 0.75


def inline(figure: Figure, name: str, label: str, dpi: int = 144) -> str:
    """Returns a figure as an svg element with the accessible name `label`.

    name: prefix that makes the ids unique. dpi: resolution of dense point clouds, which are stored
    as bitmaps.
    """
    for line in (line for axes in figure.axes for line in axes.lines):
        if np.size(line.get_xdata()) > DENSE:
            line.set_rasterized(True)
    with mpl.rc_context(STYLE | {"svg.hashsalt": name}), io.StringIO() as text:
        figure.savefig(text, format="svg", dpi=dpi, transparent=True, metadata={"Date": None})
        markup = text.getvalue()
    return _named(_bare(markup), name, label)


def identifier(*words: object) -> str:
    """Joins words into one that is valid as an id."""
    return "-".join(re.sub(r"\W+", "-", str(word)).strip("-") for word in words).lower()


def line_swatch(colour: str, line: Any, marker: str) -> str:
    """Returns a line and its marker as a legend swatch; it has no ids, so it may be repeated."""
    shape = MarkerStyle(marker or "none")
    path = shape.get_path().transformed(shape.get_transform() + Affine2D().scale(6, -6))
    drawn = "".join(
        f"{'M' if code == Path.MOVETO else 'L'}{x + 20:.1f} {y + 7:.1f}"
        for (x, y), code in path.cleaned(curves=False).iter_segments()
        if code in (Path.MOVETO, Path.LINETO)
    )
    paint = _paint(colour)
    if drawn:
        drawn = f'<path d="{drawn}z" fill="{paint}" stroke="{paint}"/>'
    if line != "none":
        dashes = DASHES[line] if isinstance(line, str) else " ".join(f"{n:g}" for n in line[1])
        stroke = f'stroke="{paint}" stroke-width="2" stroke-dasharray="{dashes}"'
        drawn = f'<path d="M0 7H40" {stroke}/>{drawn}'
    return _swatch(40, drawn)


def patch_swatch(colour: str, hatch: str) -> str:
    """Returns a filled area as a legend swatch, optionally hatched."""
    strokes = '<path d="M2 13L12 1M10 13L20 1M18 13L26 3" stroke="var(--ink)"/>' if hatch else ""
    look = f'fill="{_paint(colour)}" stroke="var(--ink)"'
    return _swatch(28, f'<rect x="1" y="1" width="26" height="12" {look}/>{strokes}')


def _swatch(width: int, drawn: str) -> str:
    size = f'viewBox="0 0 {width} 14" width="{width}" height="14"'
    return f'<svg {size} aria-hidden="true">{drawn}</svg>'


def _paint(colour: str) -> str:
    """Returns the page's variable for a colour, or the colour itself if it has none."""
    return f"var(--{NAMES[colour.lower()]})" if colour.lower() in NAMES else colour


def _bare(markup: str) -> str:
    """Removes the prolog, metadata and unused ids, and shortens numbers."""
    markup = markup[markup.index("<svg") :]
    # the style is the same in all figures, and the page has it
    for element in ("metadata", "style"):
        markup = re.sub(rf"<{element}[ >].*?</{element}>", "", markup, flags=re.DOTALL)
    markup = re.sub(r'(?<=[ "])(d|x|y|transform|points)="[^"]*"', _short, markup)
    markup = re.sub(r"font-family: [^;\"]*;? ?", "", markup)
    used = set(re.findall(r'(?:url\(#|href="#)([^)"]+)', markup))
    markup = re.sub(r' id="([^"]*)"', lambda m: m[0] if m[1] in used else "", markup)
    markup = re.sub(r">\s+<", "><", markup).strip()
    return re.sub(r"<g>((?:<(?:path|use|text|image)[^>]*/>)*)</g>", r"\1", markup)


def _short(attribute: re.Match[str]) -> str:
    """Shortens decimals to 0.1 point, finer than a screen; transforms keep three digits."""
    digits = 3 if attribute[1] == "transform" else 1
    return " ".join(re.sub(rf"(\.\d{{{digits}}})\d+", r"\1", attribute[0]).split())


def _named(markup: str, name: str, label: str) -> str:
    """Prefixes the ids, replaces colours by the page's, and sets size and accessible name."""
    prefix = f"{zlib.crc32(name.encode()):x}"
    markup = re.sub(r'(\bid="|url\(#|href="#)', rf"\g<1>{prefix}-", markup)
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
