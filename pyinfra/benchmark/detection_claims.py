"""The paper's claims about detection, tested on a benchmark's tables.

The rules stand in docs/conventions.md, "Claims about detection".
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict

import numpy as np
import pandas as pd

from pyinfra.evaluation.tables import HIGH_QUALITY
from pyinfra.statistics.compare import Measured
from pyinfra.statistics.scanning_claims import (
    ABOVE_0,
    ABOVE_1,
    AVIA,
    LINES_16,
    LINES_64,
    LINES_128,
    SPINNING,
    Row,
    verdict,
)
from pyinfra.statistics.selection import first_seed, first_stress

DETECTORS = ("pointpillars", "pv-rcnn", "dsvt", "centerpoint-pillar")
PUBLISHED = ("pv-rcnn", "pointpillars", "dsvt")
BUNDLE = "bundle_5_livox_avia"
AT_MOST_5 = (-math.inf, 5.0)
WINDOWS_OVERLAP = 4
AHEAD_M = 100.0
LEAST_WINDOWS = 5
STEEPEST_DEG = 20.0
COLUMNS = "scene preset claim statement value low high verdict version".split(" ")
Cells = dict[tuple[str, str], Measured]  # AP by LiDAR and detector


def claims_table(tables: dict[str, pd.DataFrame]) -> pd.DataFrame:
    """One row a claim and case, for every scene and preset of `cells`.

    tables: `cells`, `distance` and `value` of a benchmark, and `stress` where there is
    one. A case whose cells are not all there has no row.
    """
    kept = {name: rows for name, rows in tables.items() if len(rows)}
    kept["cells"] = kept["cells"].dropna(subset=["ap"])  # of a seed that failed another stands in
    of_cells = ("cells", "distance", "value")
    kept |= {name: first_seed(kept[name]) for name in of_cells if name in kept}
    cells = kept["cells"]
    rows: list[dict[str, object]] = []
    for (scene, preset), own in cells.groupby(["scene", "preset"], sort=False):
        here = {
            name: t[(t.scene == scene) & (t.preset == preset)]
            for name, t in kept.items()
            if name in of_cells
        }
        versions = " ".join(dict.fromkeys(own.version.astype(str)))
        case = {"scene": scene, "preset": preset, "version": versions}
        rows.extend(asdict(row) | case for row in claims(own, here))
    rows.extend(tilt(kept.get("stress", pd.DataFrame())))
    return pd.DataFrame(rows, columns=COLUMNS)


def claims(cells: pd.DataFrame, tables: dict[str, pd.DataFrame]) -> Iterator[Row]:
    """The claims of one scene under one preset."""
    ap = {(c.lidar, c.detector): Measured(c.ap, c.ap_low, c.ap_high) for c in cells.itertuples()}
    for detector in DETECTORS:
        yield from across_lidars(ap, detector)
        yield from areas(tables.get("distance", pd.DataFrame()), detector)
        yield from gentle(tables.get("distance", pd.DataFrame()), detector)
        yield from value(ap, tables, detector)
    for lidar in (LINES_128, AVIA, LINES_64, LINES_16):
        yield from across_detectors(ap, lidar)


def tested(claim: str, text: str, found: Measured, inside: tuple[float, float]) -> Row:
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
        text = f"{lidar}: AP of the best ({order[-1]}) less that of PointRCNN 20 or more"
        behind = best.less(ap[lidar, "pointrcnn"])
        yield tested("algorithms", text, behind, (20.0, math.inf))
    for name in ("pv-rcnn", "pointpillars"):
        if name != order[-1]:
            text = f"{lidar}: AP of the best ({order[-1]}) less that of {name} 5 or less"
            yield tested("algorithms", text, best.less(found[name]), AT_MOST_5)
    text = f"{lidar}: AP of the best ({order[-1]}) less the lowest ({order[0]}) 5 or less"
    yield tested("similar", text, best.less(worst), AT_MOST_5)


def areas(table: pd.DataFrame, detector: str) -> Iterator[Row]:
    """Share and number of high-quality areas, over all roads."""
    number = high_quality(table, detector, "captured")
    if AVIA not in number or LINES_128 not in number:
        return
    share = {name: count.times(100 / every) for name, (count, every) in number.items()}
    text = f"{detector}: share of high-quality areas of the Avia less that of 128 lines within 10"
    yield tested("areas", text, share[AVIA].less(share[LINES_128]), (-10.0, 10.0))
    text = f"{detector}: number of high-quality areas of 128 lines less that of the Avia above 0"
    yield tested("areas", text, number[LINES_128][0].less(number[AVIA][0]), ABOVE_0)


def high_quality(
    table: pd.DataFrame, detector: str, ground_truth: str
) -> dict[str, tuple[Measured, float]]:
    """Areas with an AP above 85, by LiDAR, and all areas; table: a row a window of the road.

    From those that are decided to be high to those and the undecided ones. A LiDAR without areas,
    in a run so short that none counts, is left out.
    """
    if table.empty:
        return {}
    own = table[(table.ground_truth == ground_truth) & (table.detector == detector)]
    found = {}
    for lidar, windows in own[own.quality != "few"].groupby("lidar"):
        sure = float((windows.quality == "high").sum())
        most = sure + float((windows.quality == "undecided").sum())
        number = float((windows.ap > HIGH_QUALITY).sum())
        found[str(lidar)] = (Measured(number, sure, most), float(len(windows)))
    return found


def gentle(table: pd.DataFrame, detector: str) -> Iterator[Row]:
    """How much more slowly AP falls off for the Avia than for the best spinning LiDAR."""
    if table.empty:
        return
    ahead = table[
        (table.ground_truth == "captured")
        & (table.road == table.road.iloc[0])
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


def slope(windows: pd.DataFrame) -> Measured:
    """AP per 10 m, weighted least squares, with its 95 % interval."""
    sigma = (windows.ap_high - windows.ap_low).to_numpy() / (2 * 1.96)
    weight = 1 / (WINDOWS_OVERLAP * sigma**2)
    line, variance = np.polyfit(
        windows.s / 10, windows.ap, deg=1, w=np.sqrt(weight), cov="unscaled"
    )
    value, half = float(line[0]), 1.96 * math.sqrt(variance[0, 0])
    return Measured(value, value - half, value + half)


def value(ap: Cells, tables: dict[str, pd.DataFrame], detector: str) -> Iterator[Row]:
    """AP and areas per dollar of the Avia, single and as a bundle, over the best of the others."""
    table = tables.get("value", pd.DataFrame())
    if table.empty:
        return
    good = high_quality(tables.get("distance", pd.DataFrame()), detector, "all")
    own = table[table.detector == detector].set_index("lidar")
    if not set(SPINNING) <= set(own.index):
        return
    for name, words in ((AVIA, "the Avia"), (BUNDLE, "five Avias")):
        if name not in own.index:
            continue
        rivals = (name, *SPINNING)
        bought = {lidar: ap[lidar, detector] for lidar in rivals}
        yield from per_dollar(f"{detector}: AP per dollar of {words}", bought, own.price_usd)
        if set(rivals) <= set(good):
            counts = {lidar: good[lidar][0] for lidar in rivals}
            text = f"{detector}: high-quality areas per dollar of {words}"
            yield from per_dollar(text, counts, own.price_usd)


def per_dollar(text: str, bought: dict[str, Measured], usd: pd.Series) -> Iterator[Row]:
    """The first per dollar over the best of the others; nothing if these have nothing."""
    first, *others = ((name, figure.times(1000 / usd[name])) for name, figure in bought.items())
    best, most = max(others, key=lambda pair: pair[1].value)
    if most.value > 0:
        text = f"{text} over the best of the others ({best}) above 1"
        yield tested("value", text, first[1].over(most), ABOVE_1)


def tilt(stress: pd.DataFrame) -> list[dict[str, object]]:
    """The best tilt of the Avia against none, of every detector."""
    if stress.empty:
        return []
    rows = []
    own = first_stress(stress[stress.lidar == AVIA])
    own = own[own.stressor.isin(["none", "tilt"]) & own.ap.notna()]
    own = own.assign(dial=pd.to_numeric(own.dial))
    for key, curve in own.groupby(["scene", "preset", "detector"], sort=False):
        level = curve[curve.stressor == "none"]
        tilted = curve[(curve.stressor == "tilt") & curve.dial.between(0, STEEPEST_DEG)]
        if level.empty or tilted.empty:
            continue
        both = (tilted.loc[tilted.ap.idxmax()], level.iloc[0])
        best, without = (Measured(r.ap, r.ap_low, r.ap_high) for r in both)
        text = f"{key[2]}: highest AP with a tilt of up to 20 deg less AP with none 2 or less"
        row = tested("tilt", text, best.less(without), (-math.inf, 2.0))
        case = {"scene": key[0], "preset": key[1], "version": curve.version.iloc[-1]}
        rows.append(asdict(row) | case)
    return rows
