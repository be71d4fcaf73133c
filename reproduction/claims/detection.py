"""Tests the paper's claims about detection on a benchmark's tables.

docs/verdict_rules.md, "Claims about detection", defines the rules.
"""

import math
from collections.abc import Callable, Iterator
from functools import partial

import pandas as pd

from pyinfra.metrics.comparison import Bootstrapped
from pyinfra.metrics.replicates import bootstrapped_of, check_pair, difference
from pyinfra.metrics.row_selection import first_seed, first_stress
from reproduction.claims.scanning import (
    ABOVE_0,
    ABOVE_1,
    AVIA,
    LINES_16,
    LINES_64,
    LINES_128,
    SPINNING,
    Row,
    columns_of,
    verdict,
)

DETECTORS = ("pointpillars", "pv-rcnn", "dsvt", "centerpoint-pillar")
PUBLISHED = ("pv-rcnn", "pointpillars", "dsvt")
BUNDLE = "bundle_5_livox_avia"
# Ground-truth subsets under which a difference between LiDARs can have opposite signs.
TRUTHS = ("captured", "common")
AT_MOST_5 = (-math.inf, 5.0)
STEEPEST_DEG = 20.0
COLUMNS = "scene preset claim statement value low high verdict version".split(" ")
# A function of LiDAR, detector, ground-truth subset and measure. It returns the bootstrapped value,
# or None if the table has no value.
Figures = Callable[[str, str, str, str], Bootstrapped | None]


def claims_table(tables: dict[str, pd.DataFrame]) -> pd.DataFrame:
    """Returns one row per claim and case, for every scene and preset of `experiments`.

    A case has no row if one of its experiments is missing or has no bootstrap replicates.

    Parameters
    ----------
    tables : a benchmark's tables `experiments`, `replicates` and `value`, and optionally
        `stress_replicates`
    """
    kept = {name: rows for name, rows in tables.items() if len(rows)}
    # If the experiment of a seed failed, first_seed() chooses the next seed.
    kept["experiments"] = kept["experiments"].dropna(subset=["ap"])
    kept |= {
        name: first_seed(kept[name])
        for name in ("experiments", "replicates", "value")
        if name in kept
    }
    rows: list[dict[str, object]] = []
    for (scene, preset), group in kept["experiments"].groupby(["scene", "preset"], sort=False):
        here = {
            name: t[(t.scene == scene) & (t.preset == preset)]
            for name, t in kept.items()
            if name in ("replicates", "value")
        }
        versions = " ".join(dict.fromkeys(group.version.astype(str)))
        case = {"scene": scene, "preset": preset, "version": versions}
        rows.extend(columns_of(row) | case for row in claims(here))
    rows.extend(tilt(kept.get("stress_replicates", pd.DataFrame())))
    return pd.DataFrame(rows, columns=COLUMNS)


def claims(tables: dict[str, pd.DataFrame]) -> Iterator[Row]:
    """Yields the tested claims of one scene under one preset."""
    of = figures_of(tables.get("replicates", pd.DataFrame()))
    for detector in DETECTORS:
        for truth in TRUTHS:
            yield from across_lidars(of, detector, truth)
        yield from areas(of, detector)
        yield from gentle(of, detector)
        yield from value(of, tables.get("value", pd.DataFrame()), detector)
    for lidar in (LINES_128, AVIA, LINES_64, LINES_16):
        yield from across_detectors(of, lidar)


def figures_of(replicates: pd.DataFrame) -> Figures:
    """Returns a function that looks up values in `replicates`.

    The function raises Error if a row has other time blocks than the first row.
    """
    if replicates.empty:
        return lambda *_: None
    rows = {
        (str(row.lidar), str(row.detector), str(row.ground_truth), str(row.measure)): row
        for _, row in replicates.iterrows()
    }
    first = replicates.iloc[0]

    def of(*key: str) -> Bootstrapped | None:
        row = rows.get((key[0], key[1], key[2], key[3]))
        if row is None:
            return None
        check_pair(row, first, ("tier",))
        return bootstrapped_of(row)

    return of


def tested(claim: str, text: str, bootstrapped: Bootstrapped, inside: tuple[float, float]) -> Row:
    interval = bootstrapped.measured()
    return Row(
        claim, text, interval.value, interval.low, interval.high, partial(verdict, inside=inside)
    )


def across_lidars(of: Figures, detector: str, truth: str) -> Iterator[Row]:
    """Tests the claims `comparable` and `64-below` for one detector and ground-truth subset."""
    lidars = (LINES_128, AVIA, LINES_64)
    wide, avia, narrow = (of(name, detector, truth, "ap_r1000") for name in lidars)
    case = f"{detector}, {truth}"
    if wide and avia:
        text = f"{case}: AP of the Avia minus that of 128 lines within 3"
        yield tested("comparable", text, avia.less(wide), (-3.0, 3.0))
    if wide and avia and narrow:
        least = min(wide, avia, key=lambda f: f.value)
        text = f"{case}: the smaller AP of Avia and 128 lines minus that of 64 lines above 0"
        yield tested("64-below", text, least.less(narrow), ABOVE_0)


def across_detectors(of: Figures, lidar: str) -> Iterator[Row]:
    """Tests the claims `algorithms` and `similar` for one LiDAR."""
    names = (*PUBLISHED, "pointrcnn")
    figures = {name: of(lidar, name, "captured", "ap_r1000") for name in names}
    known = {name: figure for name, figure in figures.items() if figure is not None}
    by_detector = {name: known[name] for name in PUBLISHED if name in known}
    if len(by_detector) < len(PUBLISHED):
        return
    order = sorted(by_detector, key=lambda name: by_detector[name].value)
    best, worst = by_detector[order[-1]], by_detector[order[0]]
    if "pointrcnn" in known:
        text = f"{lidar}: AP of the best ({order[-1]}) minus that of PointRCNN 20 or more"
        yield tested("algorithms", text, best.less(known["pointrcnn"]), (20.0, math.inf))
    lower = min(("pv-rcnn", "pointpillars"), key=lambda name: by_detector[name].value)
    text = f"{lidar}: AP of {lower}, the lower one of PV-RCNN and PointPillars, minus that of dsvt"
    yield tested("algorithms", f"{text} above 0", by_detector[lower].less(known["dsvt"]), ABOVE_0)
    text = f"{lidar}: AP of the best ({order[-1]}) less the lowest ({order[0]}) 5 or less"
    yield tested("similar", text, best.less(worst), AT_MOST_5)


def areas(of: Figures, detector: str) -> Iterator[Row]:
    """Compares the share of high-quality areas of the Avia and of the 128 lines."""
    avia, wide = (of(name, detector, "captured", "p_hqda") for name in (AVIA, LINES_128))
    if avia and wide:
        text = f"{detector}: share of high-quality areas of the Avia minus that of 128 lines within"
        yield tested("areas", f"{text} 10", avia.less(wide), (-10.0, 10.0))


def gentle(of: Figures, detector: str) -> Iterator[Row]:
    """Compares the change of AP with distance between the Avia and the best spinning LiDAR."""
    avia = of(AVIA, detector, "captured", "ap_slope")
    others = [of(name, detector, "captured", "ap_slope") for name in SPINNING]
    known = [figure for figure in others if figure is not None]
    if avia and len(known) == len(SPINNING):
        best = max(known, key=lambda f: f.value)
        text = f"{detector}: AP per 10 m of the Avia minus the highest of the spinning LiDARs"
        yield tested("gentle", f"{text} above 0", avia.less(best), ABOVE_0)


def value(of: Figures, table: pd.DataFrame, detector: str) -> Iterator[Row]:
    """Compares AP per dollar, and high-quality areas per dollar, with the best spinning LiDAR.

    The comparison is made for one Avia and for five Avias.
    """
    if table.empty:
        return
    usd = table[table.detector == detector].set_index("lidar").price_usd
    for first, words in ((AVIA, "the Avia"), (BUNDLE, "five Avias")):
        rivals = (first, *SPINNING)
        if not set(rivals) <= set(usd.index):
            continue
        for what, truth, measure in (
            ("AP", "captured", "ap_r1000"),
            ("high-quality areas", "all", "n_hqda"),
        ):
            bought = {name: of(name, detector, truth, measure) for name in rivals}
            known = {name: figure for name, figure in bought.items() if figure is not None}
            if len(known) == len(rivals):
                yield from per_dollar(f"{detector}: {what} per dollar of {words}", known, usd)


def per_dollar(text: str, bought: dict[str, Bootstrapped], usd: pd.Series) -> Iterator[Row]:
    """Compares the amount per dollar of the first LiDAR in `bought` with the best of the others.

    Yields no row if the amount of every other LiDAR is 0.
    """
    first, *others = ((name, figure.times(1000 / usd[name])) for name, figure in bought.items())
    best, most = max(others, key=lambda pair: pair[1].value)
    if most.value > 0:
        text = f"{text} over the best of the others ({best}) above 1"
        yield tested("value", text, first[1].over(most), ABOVE_1)


def tilt(stress: pd.DataFrame) -> list[dict[str, object]]:
    """Compares the Avia's AP at its best tilt with its AP without tilt, for every detector."""
    if stress.empty:
        return []
    rows = []
    selected = first_stress(stress[stress.lidar == AVIA])
    selected = selected[selected.stressor.isin(["none", "tilt"]) & selected.value.notna()]
    selected = selected.assign(severity=pd.to_numeric(selected.severity))
    for key, curve in selected.groupby(["scene", "preset", "detector"], sort=False):
        level = curve[curve.stressor == "none"]
        tilted = curve[(curve.stressor == "tilt") & curve.severity.between(0, STEEPEST_DEG)]
        if level.empty or tilted.empty:
            continue
        best = difference(tilted.loc[tilted.value.idxmax()], level.iloc[0])
        text = f"{key[2]}: highest AP with a tilt of up to 20 deg less AP with none 2 or less"
        row = tested("tilt", text, best, (-math.inf, 2.0))
        case = {"scene": key[0], "preset": key[1], "version": curve.version.iloc[-1]}
        rows.append(columns_of(row) | case)
    return rows
