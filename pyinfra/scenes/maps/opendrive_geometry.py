"""Reference lines and polynomials of ASAM OpenDRIVE (1.4 to 1.8), evaluated at arrays of s."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from pyinfra.core.arrays import FloatArray
from pyinfra.scenes.maps.lane_map import MapError, number_or_nan

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(12)


def read_root(file: Path) -> Element:
    """Reads an XML file, without the namespaces that some writers add. Raises ParseError."""
    root = ElementTree.parse(file).getroot()
    for node in root.iter():
        node.tag = node.tag.rpartition("}")[2]
    return root


def number(node: Element, name: str, default: float | None = None) -> float:
    """Returns an attribute as a finite number. Raises MapError that names the element."""
    text = node.get(name)
    if text is None and default is not None:
        return default
    value = number_or_nan(text)
    if not math.isfinite(value):
        attributes = " ".join(f'{k}="{v[:20]}"' for k, v in list(node.attrib.items())[:3])
        raise MapError(f"<{node.tag} {attributes}>: {name}: expected a number, got {text!r}")
    return value


@dataclass(frozen=True, eq=False)
class Cubics:
    """Piecewise cubics a + b u + c u^2 + d u^3, where u is the distance from a piece's start.

    Without pieces, the value is 0.
    """

    starts: FloatArray  # start of each piece (n,), increasing
    coefficients: FloatArray  # a, b, c, d of each piece (n, 4)

    def at(self, s: FloatArray) -> FloatArray:
        """Returns the values (n,) at s (n,)."""
        if not len(self.starts):
            return np.zeros_like(s)
        i = np.searchsorted(self.starts, s + 1e-9, side="right").clip(1) - 1
        u = s - self.starts[i]
        a, b, c, d = self.coefficients[i].T
        return np.asarray(a + u * (b + u * (c + u * d)))

    @property
    def bent(self) -> bool:
        """Whether any piece is not a straight line."""
        return bool(np.any(self.coefficients[:, 2:]))


def read_cubics(nodes: Sequence[Element], key: str = "s", at: float = 0.0) -> Cubics:
    """Reads cubics, sorted by start. The attribute `key` is the start, relative to `at`."""
    rows = [[at + number(n, key, 0.0), *(number(n, k) for k in "abcd")] for n in nodes]
    table = np.array(sorted(rows, key=lambda row: row[0])).reshape(-1, 5)
    return Cubics(table[:, 0], table[:, 1:])


# Maps the distance ds from the start of a geometry to u, v and the change of heading.
Line = Callable[[FloatArray], tuple[FloatArray, FloatArray, FloatArray]]


@dataclass(frozen=True, eq=False)
class ReferenceLine:
    """A road's reference line. Beyond its ends, the first and last piece are extended."""

    starts: FloatArray
    poses: FloatArray  # (n, 3) x y heading at the start of each piece
    pieces: tuple[Line, ...]
    length: float
    bent: bool

    def at(self, s: FloatArray) -> FloatArray:
        """Returns x y heading (n, 3) at s (n,)."""
        out = np.empty((len(s), 3))
        which = np.searchsorted(self.starts, s + 1e-9, side="right").clip(1) - 1
        for i in np.unique(which):
            here = which == i
            x, y, heading = self.poses[i]
            u, v, turn = self.pieces[i](s[here] - self.starts[i])
            cos, sin = math.cos(heading), math.sin(heading)
            out[here] = np.stack([x + cos * u - sin * v, y + sin * u + cos * v, heading + turn], 1)
        return out


@dataclass(frozen=True, eq=False)
class OpenDriveRoad:
    """Reference line, elevation, superelevation and lane offset of one road."""

    id: str
    line: ReferenceLine
    elevation: Cubics
    roll: Cubics
    offset: Cubics

    def positions(self, s: FloatArray, t: FloatArray) -> FloatArray:
        """Returns positions (n, 3) in the map's frame, at stations s and t metres to the left."""
        x, y, heading = self.line.at(s).T
        roll = self.roll.at(s)
        flat, z = t * np.cos(roll), self.elevation.at(s) + t * np.sin(roll)
        return np.stack([x - np.sin(heading) * flat, y + np.cos(heading) * flat, z], 1)


def read_reference_line(road: Element) -> ReferenceLine:
    """Reads the reference line of a road. Raises MapError."""
    nodes = road.findall("planView/geometry")
    if not nodes:
        raise MapError(f"road {road.get('id')}: expected a planView/geometry, got none")
    nodes.sort(key=lambda node: number(node, "s"))
    poses = [[number(node, k) for k in ("x", "y", "hdg")] for node in nodes]
    length = number(nodes[-1], "s") + number(nodes[-1], "length")
    if not 0 < length < 1e6:
        raise MapError(f"road {road.get('id')}: length: expected 0 to 1e6 m, got {length:g}")
    return ReferenceLine(
        np.array([number(node, "s") for node in nodes]),
        np.array(poses),
        tuple(_piece(node, road.get("id")) for node in nodes),
        length,
        any(node.find("line") is None for node in nodes),
    )


def _piece(node: Element, road: str | None) -> Line:
    shape = node[0] if len(node) else node
    length = number(node, "length")
    if length < 0:
        raise MapError(f"road {road}: geometry: length: expected 0 or more, got {length:g}")
    if shape.tag == "line":
        return lambda ds: (ds, 0 * ds, 0 * ds)
    if shape.tag == "arc":
        k = number(shape, "curvature")
        return _spiral(k, k, max(length, 1e-9))
    if shape.tag == "spiral":
        return _spiral(number(shape, "curvStart"), number(shape, "curvEnd"), max(length, 1e-9))
    if shape.tag == "poly3":
        # The curve ends where its arc length is `length`. At this end, u is less than `length`.
        return _along({"aV": [number(shape, k) for k in "abcd"], "aU": [0, 1, 0, 0]}, length)
    if shape.tag == "paramPoly3":
        sides = {f"a{k}": [number(shape, f"{c}{k}", 0.0) for c in "abcd"] for k in "UV"}
        return _along(sides, length if shape.get("pRange") == "arcLength" else 1.0, length)
    raise MapError(
        f"road {road}: geometry: expected one of line, arc, spiral, poly3, paramPoly3; "
        f"got {shape.tag!r}"
    )


def _spiral(start: float, end: float, length: float) -> Line:
    """Returns a curve whose curvature changes linearly from start to end along its length."""
    change = (end - start) / length

    def line(ds: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        u = ds[:, None] * (_NODES + 1) / 2  # nodes of the Gauss-Legendre quadrature from 0 to ds
        angle = u * (start + u * change / 2)
        weights = _WEIGHTS * ds[:, None] / 2
        turn = ds * (start + ds * change / 2)
        if change == 0 and start != 0:
            return np.sin(turn) / start, (1 - np.cos(turn)) / start, turn
        return (weights * np.cos(angle)).sum(1), (weights * np.sin(angle)).sum(1), turn

    return line


def _along(sides: dict[str, list[float]], end: float, length: float | None = None) -> Line:
    """Returns a curve as a function of arc length.

    The curve is given by cubics u and v of a parameter from 0 to `end`. If the geometry's length
    differs from the length of the curve, for example by rounding, s is scaled.
    """
    u_of, v_of = (np.polynomial.Polynomial(sides[k]) for k in ("aU", "aV"))
    du, dv = u_of.deriv(), v_of.deriv()
    table = np.linspace(0, end, 401)
    half = np.diff(table)[:, None] / 2
    middles = table[:-1, None] + half * (_NODES + 1)
    pieces = (np.hypot(du(middles), dv(middles)) * _WEIGHTS * half).sum(1)
    walked = np.concatenate([[0], np.cumsum(pieces)])
    stretch = float(walked[-1]) / length if length and walked[-1] > 0 else 1.0

    def line(ds: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        p = np.interp(ds * stretch, walked, table)
        return u_of(p), v_of(p), np.arctan2(dv(p), du(p))

    return line


def curve_length(node: Element) -> float:
    """Returns the arc length of a paramPoly3 in metres.

    For other shapes, returns the length that the file states.
    """
    shape, length = node[0] if len(node) else node, number(node, "length")
    if shape.tag != "paramPoly3":
        return length
    du, dv = (
        np.polynomial.Polynomial([number(shape, f"{c}{k}", 0.0) for c in "abcd"]).deriv()
        for k in "UV"
    )
    end = length if shape.get("pRange") == "arcLength" else 1.0
    p = np.linspace(0, end, 2001)
    speed = np.hypot(du(p), dv(p))
    return float(((speed[1:] + speed[:-1]) / 2 * np.diff(p)).sum())
