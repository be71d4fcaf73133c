"""The paper's claims about detection, tested on a benchmark's tables.

The rules stand in docs/conventions.md, "Claims about detection".
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict

import numpy as np
import pandas as pd

from pyinfra.claims import ABOVE_0, ABOVE_1, AVIA, LINES_64, LINES_128, SPINNING, Row, verdict
from pyinfra.statistics.compare import Figure

DETECTORS = ("pointpillars", "pv-rcnn", "dsvt", "centerpoint-pillar")
PUBLISHED = ("pv-rcnn", "pointpillars", "dsvt")
BUNDLE = "bundle_5_livox_avia"
AT_MOST_5 = (-math.inf, 5.0)
WINDOWS_OVERLAP = 4
AHEAD_M = 100.0
LEAST_WINDOWS = 5
STEEPEST_DEG = 20.0


COLUMNS = "scene preset claim statement value low high verdict version".split(" ")
Cells = dict[tuple[str, str], Figure]  # AP by LiDAR and detector


def claims_table(tables: dict[str, pd.DataFrame]) -> pd.DataFrame:
    """One row a claim and case, for every scene and preset of `cells`.

    tables: `cells`, `areas`, `distance` and `value` of a benchmark, and `stress` where there is
    one. A case whose cells are not all there has no row.
    """
    kept = {name: of_first_seed(rows) for name, rows in tables.items() if len(rows)}
    cells = kept["cells"].dropna(subset=["ap"])
    rows: list[dict[str, object]] = []
    for (scene, preset), own in cells.groupby(["scene", "preset"], sort=False):
        here = {
            name: t[(t.scene == scene) & (t.preset == preset)]
            for name, t in kept.items()
            if name in ("areas", "distance", "value")
        }
        case = {"scene": scene, "preset": preset, "version": own.version.iloc[-1]}
        rows.extend(asdict(row) | case for row in claims(own, here))
    rows.extend(tilt(kept.get("stress", pd.DataFrame())))
    return pd.DataFrame(rows, columns=COLUMNS)


def of_first_seed(rows: pd.DataFrame) -> pd.DataFrame:
    """Those of the smallest seed."""
    return rows[rows.seed == rows.seed.min()] if "seed" in rows else rows


def claims(cells: pd.DataFrame, tables: dict[str, pd.DataFrame]) -> Iterator[Row]:
    """The claims of one scene under one preset."""
    ap = {(c.lidar, c.detector): Figure(c.ap, c.ap_low, c.ap_high) for c in cells.itertuples()}
    for detector in DETECTORS:
        yield from across_lidars(ap, detector)
        yield from areas(tables.get("areas", pd.DataFrame()), detector)
        yield from gentle(tables.get("distance", pd.DataFrame()), detector)
        yield from value(ap, tables.get("value", pd.DataFrame()), detector)
    for lidar in (LINES_128, AVIA, LINES_64, "helios_16"):
        yield from across_detectors(ap, lidar)


def tested(claim: str, text: str, found: Figure, inside: tuple[float, float]) -> Row:
    verdict_ = verdict(found.low, found.high, inside)
    return Row(claim, text, found.value, found.low, found.high, verdict_)


def across_lidars(ap: Cells, detector: str) -> Iterator[Row]:
    """comparable and 64-below."""
    wide, avia, narrow = (ap.get((name, detector)) for name in (LINES_128, AVIA, LINES_64))
    if wide and avia:
        text = f"{detector}: AP of the Avia less that of 128 lines within 3"
        yield tested("comparable", text, avia.less(wide), (-3.0, 3.0))
    if wide and avia and narrow:
        least = min(wide, avia, key=lambda f: f.value)
        text = f"{detector}: the smaller AP of Avia and 128 lines less that of 64 lines above 0"
        yield tested("64-below", text, least.less(narrow), ABOVE_0)


def across_detectors(ap: Cells, lidar: str) -> Iterator[Row]:
    """algorithms and similar."""
    found = {name: ap[lidar, name] for name in PUBLISHED if (lidar, name) in ap}
    if len(found) < len(PUBLISHED):
        return
    order = sorted(found, key=lambda name: found[name].value)
    best, worst = found[order[-1]], found[order[0]]
    if (lidar, "pointrcnn") in ap:
        text = f"{lidar}: AP of {order[-1]} less that of PointRCNN 20 or more"
        behind = best.less(ap[lidar, "pointrcnn"])
        yield tested("algorithms", text, behind, (20.0, math.inf))
    for name in ("pv-rcnn", "pointpillars"):
        text = f"{lidar}: AP of {order[-1]} less that of {name} 5 or less"
        zero = Figure(0.0, 0.0, 0.0)
        lead = best.less(found[name]) if name != order[-1] else zero
        yield tested("algorithms", text, lead, AT_MOST_5)
    text = f"{lidar}: AP of {order[-1]} less that of {order[0]} 5 or less"
    yield tested("similar", text, best.less(worst), AT_MOST_5)


def areas(table: pd.DataFrame, detector: str) -> Iterator[Row]:
    """Share and number of high-quality areas, over all roads."""
    if table.empty:
        return
    captured = table[(table.ground_truth == "captured") & (table.detector == detector)]
    sums = captured.groupby("lidar")[["n_tda", "n_hqda", "undecided"]].sum()
    sums = sums[sums.n_tda > 0]  # a run so short that no area counts says nothing
    if AVIA not in sums.index or LINES_128 not in sums.index:
        return
    counts = {name: sums.loc[name] for name in (AVIA, LINES_128)}
    share, number = {}, {}
    for name, c in counts.items():
        low, high = max(0, c.n_hqda - c.undecided), min(c.n_tda, c.n_hqda + c.undecided)
        number[name] = Figure(float(c.n_hqda), float(low), float(high))
        share[name] = number[name].times(100 / c.n_tda)
    text = f"{detector}: share of high-quality areas of the Avia less that of 128 lines within 10"
    yield tested("areas", text, share[AVIA].less(share[LINES_128]), (-10.0, 10.0))
    text = f"{detector}: number of high-quality areas of 128 lines less that of the Avia above 0"
    yield tested("areas", text, number[LINES_128].less(number[AVIA]), ABOVE_0)


def gentle(table: pd.DataFrame, detector: str) -> Iterator[Row]:
    """How much more slowly AP falls off for the Avia than for the best spinning LiDAR."""
    if table.empty:
        return
    ahead = table[
        (table.ground_truth == "captured")
        & (table.detector == detector)
        & table.s.between(0, AHEAD_M)
        & (table.ap_high > table.ap_low)
    ]
    slopes = {name: slope(own) for name, own in ahead.groupby("lidar") if len(own) >= LEAST_WINDOWS}
    others = [slopes[name] for name in SPINNING if name in slopes]
    if AVIA not in slopes or len(others) < len(SPINNING):
        return
    best = max(others, key=lambda f: f.value)
    text = f"{detector}: AP per 10 m of the Avia less the highest of the spinning LiDARs above 0"
    yield tested("gentle", text, slopes[AVIA].less(best), ABOVE_0)


def slope(windows: pd.DataFrame) -> Figure:
    """AP per 10 m, weighted least squares, with its 95 % interval."""
    sigma = (windows.ap_high - windows.ap_low).to_numpy() / (2 * 1.96)
    weight = 1 / (WINDOWS_OVERLAP * sigma**2)
    x, y = windows.s.to_numpy() / 10, windows.ap.to_numpy()
    centred = x - np.average(x, weights=weight)
    spread = float((weight * centred**2).sum())
    value, half = float((weight * centred * y).sum() / spread), 1.96 / math.sqrt(spread)
    return Figure(value, value - half, value + half)


def value(ap: Cells, table: pd.DataFrame, detector: str) -> Iterator[Row]:
    """AP and areas per dollar of the Avia, single and as a bundle, over the best of the others."""
    if table.empty:
        return
    own = table[table.detector == detector].set_index("lidar")
    if not set(SPINNING) <= set(own.index):
        return
    for name, words in ((AVIA, "the Avia"), (BUNDLE, "five Avias")):
        if name not in own.index:
            continue
        bought = {
            lidar: ap[lidar, detector].times(1000 / own.price_usd[lidar])
            for lidar in (name, *SPINNING)
        }
        best = max(SPINNING, key=lambda lidar: bought[lidar].value)
        text = f"{detector}: AP per dollar of {words} over that of {best} above 1"
        yield tested("value", text, bought[name].over(bought[best]), ABOVE_1)
        count = own.n_hqda / own.price_usd
        best = count[list(SPINNING)].idxmax()
        if not count[best] > 0:
            continue
        ratio = float(count[name] / count[best])
        text = f"{detector}: high-quality areas per dollar of {words} over {best} above 1"
        yield tested("value", text, Figure(ratio, ratio, ratio), ABOVE_1)


def tilt(stress: pd.DataFrame) -> list[dict[str, object]]:
    """The best tilt of the Avia against none, of every detector."""
    if stress.empty:
        return []
    rows = []
    own = stress[(stress.lidar == AVIA) & stress.stressor.isin(["none", "tilt"])]
    own = own.assign(dial=pd.to_numeric(own.dial)).dropna(subset=["ap"])
    for (scene, detector), curve in own.groupby(["scene", "detector"], sort=False):
        level = curve[curve.stressor == "none"]
        tilted = curve[(curve.stressor == "tilt") & curve.dial.between(0, STEEPEST_DEG)]
        if level.empty or tilted.empty:
            continue
        both = (tilted.loc[tilted.ap.idxmax()], level.iloc[0])
        best, without = (Figure(r.ap, r.ap_low, r.ap_high) for r in both)
        text = f"{detector}: highest AP with a tilt of up to 20 deg less AP with none 2 or less"
        row = tested("tilt", text, best.less(without), (-math.inf, 2.0))
        case = {"scene": scene, **curve[["preset", "version"]].iloc[-1]}
        rows.append(asdict(row) | case)
    return rows
