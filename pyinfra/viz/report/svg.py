"""Turns figures into small markup inside a page, with unique ids and the page's colours."""

import io
import re
import zlib
from typing import Any
from xml.etree import ElementTree

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.markers import MarkerStyle
from matplotlib.path import Path
from matplotlib.transforms import Affine2D

from pyinfra.viz.report.style import NAMES, STYLE, fit_labels

DASHES = {"-": "none", "--": "6 3", "-.": "7 3 2 3", ":": "2 3"}
DENSE = 400  # number of points above which a line is stored as a bitmap
POINTS_PER_PIXEL = 0.75
SVG = "{http://www.w3.org/2000/svg}"
URL = re.compile(r"url\(#([^)]+)\)")  # pattern of a reference to an id in a style
HREF = re.compile(r"^#(.+)")  # pattern of a reference to an id in a link
COLOUR = re.compile(r"#[0-9a-fA-F]{6}(?![0-9a-fA-F])")
# Pattern of a font, which is removed because the page sets the font.
FONT = re.compile(r"font-family: [^;]*;? ?")
ElementTree.register_namespace("", SVG[1:-1])
ElementTree.register_namespace("xlink", "http://www.w3.org/1999/xlink")


def inline(figure: Figure, name: str, label: str, dpi: int = 144) -> str:
    """Returns a figure as an svg element with the accessible name `label`.

    name: prefix that makes the ids unique in a page. dpi: resolution of dense point clouds, which
    are stored as bitmaps.
    """
    for line in (line for axes in figure.axes for line in axes.lines):
        if np.size(line.get_xdata()) > DENSE:
            line.set_rasterized(True)
    with mpl.rc_context(STYLE | {"svg.hashsalt": name}), io.BytesIO() as text:
        if figure.get_layout_engine() is None and len(figure.axes) == 1:
            fit_labels(figure)
        figure.savefig(text, format="svg", dpi=dpi, transparent=True, metadata={"Date": None})
        root = ElementTree.fromstring(text.getvalue())
    _remove_extras(root)
    _rename_ids(root, f"{zlib.crc32(name.encode()):x}")
    for element in root.iter():
        for key, value in element.attrib.items():
            painted = COLOUR.sub(lambda m: _paint(m[0]), FONT.sub("", value))
            element.set(key, _short(key, painted))
    width, height = (float(size) / POINTS_PER_PIXEL for size in root.get("viewBox", "").split()[2:])
    sizes = {"viewBox": root.get("viewBox", ""), "width": f"{width:.0f}", "height": f"{height:.0f}"}
    root.attrib.clear()
    root.attrib.update({**sizes, "role": "img", "aria-label": label})
    return ElementTree.tostring(root, "unicode")


def identifier(*words: object) -> str:
    """Joins words into one word that is valid as an id."""
    return "-".join(re.sub(r"\W+", "-", str(word)).strip("-") for word in words).lower()


def line_swatch(colour: str, line: Any, marker: str) -> str:
    """Returns a line and its marker as a legend swatch.

    The markup has no ids, so it may be repeated in a page.
    """
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
    """Returns the page's variable for a colour, or the colour itself if there is no variable."""
    return f"var(--{NAMES[colour.lower()]})" if colour.lower() in NAMES else colour


def _remove_extras(element: ElementTree.Element) -> None:
    """Removes metadata, styles that the page sets, blanks, and groups without attributes."""
    if element.tag != f"{SVG}text":
        element.text = None
    children = []
    for child in element:
        child.tail = None
        if child.tag in (f"{SVG}metadata", f"{SVG}style"):
            continue
        _remove_extras(child)
        bare = child.tag == f"{SVG}g" and not child.attrib.keys() - {"id"}
        children += list(child) if bare else [child]
    element[:] = children


def _rename_ids(root: ElementTree.Element, prefix: str) -> None:
    """Prefixes the ids that the figure refers to, and removes all others."""
    used = set()
    for element in root.iter():
        for key, value in element.attrib.items():
            refers = HREF if key.endswith("href") else URL
            used.update(refers.findall(value))
            element.set(key, refers.sub(lambda m: m[0].replace("#", f"#{prefix}-"), value))
    for element in root.iter():
        name = element.attrib.pop("id", None)
        if name in used:
            element.set("id", f"{prefix}-{name}")


def _short(key: str, value: str) -> str:
    """Cuts numbers to one decimal place (0.1 point), or to three in a transform."""
    if key not in ("d", "x", "y", "transform", "points"):
        return value
    digits = 3 if key == "transform" else 1
    return " ".join(re.sub(rf"(\.\d{{{digits}}})\d+", r"\1", value).split())
