"""Writes the tables of the documentation that repeat a CSV of results/: `make docs`.

A table stands in a page between `<!-- table NAME -->` and `<!-- end -->`; NAME is a row of TABLES
with what it is made of. `--check` writes nothing and fails if a page differs.
"""

from __future__ import annotations

import argparse
import itertools
import math
import re
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import astuple
from functools import cache, partial
from pathlib import Path

import numpy as np
import pandas as pd

from pyinfra.evaluation.draws import are_pairs, difference
from pyinfra.statistics.compare import over_worlds

ROOT = Path(__file__).resolve().parents[1]
PAGES = (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")))
BLOCK = re.compile(r"(<!-- table (.+?) -->\n)(.*?)(<!-- end -->)", re.DOTALL)
SHOWN = 90  # letters of a finding
PEOPLE_POINTS, PEOPLE_BIN_M = 5, 10  # as benchmarks/people.py has them
LEAST_BOXES = 10  # of a site, for its own precision
PRESETS = ("paper", "equal", "datasheet")
DETECTORS = {
    "background": "Background",
    "pointpillars": "PointPillars",
    "centerpoint-pillar": "CenterPoint-Pillar",
    "pv-rcnn": "PV-RCNN",
    "dsvt": "DSVT",
    "pointrcnn-remedied": "PointRCNN, remedied",
    "pointrcnn": "PointRCNN",
}
LIDARS = {
    "ruby_plus": "128 lines",
    "livox_avia": "Avia",
    "pandar_64": "64 lines",
    "helios_16": "16 lines",
}

# Claims about scanning: what the paper says, the claim, and words of its statement.
SCANNING = (
    ("the Avia has about twice the points far out", "far-range", "view,", "all vehicles"),
    ("128 lines have more points close by", "near-range", "", ""),
    ("twice the lines, twice the points", "ratio", "ruby_plus over pandar_64", "128 / 64"),
    ("four times the lines, four times the points", "ratio", "pandar_64 over helios_16", "64 / 16"),
    ("the Avia's points fall off more gently", "gentle", "", "points"),
    ("motion takes points out of the box", "deskew", "", ""),
    ("the Avia alone sees some far vehicles", "only-one", "view,", "all vehicles"),
)
# Claims about detection, likewise.
DETECTION = (
    ("the Avia's AP is that of 128 lines", "comparable", "", ""),
    ("64 lines are below both", "64-below", "", ""),
    ("the Avia's share of high-quality areas is that of 128 lines", "areas", "share of", "share"),
    ("but their number is lower", "areas", "number of", "number"),
    ("the Avia's AP falls off more gently", "gentle", "", "AP"),
    ("the Avia is the best value, alone", "value", ": AP per dollar of the Avia", "AP per dollar"),
    ("", "value", ": high-quality areas per dollar of the Avia", "areas per dollar"),
    (
        "(not said) five Avias for a whole junction",
        *("value", ": AP per dollar of five Avias", "AP per dollar"),
    ),
    ("PointRCNN is far behind, the others near the best", "algorithms", "", ""),
    ("pillars, voxels and transformer are alike", "similar", "", ""),
    ("tilting the Avia does not help", "tilt", "", ""),
)
# A row of a table of one scene: claim, words of its statement, how it is said, digits.
OF_A_SCENE = (
    ("comparable", "", "`comparable`: Avia less 128 lines within 3", "{:+.1f}"),
    ("64-below", "", "`64-below`: the smaller of both less 64 lines above 0", "{:+.1f}"),
    ("areas", "share of", "`areas`: share, Avia less 128 lines within 10", "{:+.1f}"),
    ("areas", "number of", "`areas`: number, 128 lines less Avia above 0", "{:.0f}"),
    ("gentle", "", "`gentle`: AP per 10 m, Avia less the best other above 0", "{:+.1f}"),
    (
        *("value", ": AP per dollar of the Avia"),
        *("`value`: AP per dollar, Avia over the best other above 1", "{:.2f}"),
    ),
    (
        *("value", ": high-quality areas per dollar of the Avia"),
        *("`value`: high-quality areas per dollar, likewise", "{:.1f}"),
    ),
    (
        *("value", ": AP per dollar of five Avias"),
        *("`value`: AP per dollar, five Avias over the best other above 1", "{:.2f}"),
    ),
)
# A row of the table of scanning: claim, words of its statement, how it is said, set and distance.
OF_SCANNING = (
    (
        *("far-range", " common,", "`far-range`: Avia / best other within 1.5 to 2.5"),
        "common, 90 to 120 m (paper: to 100 m)",
    ),
    ("far-range", " view,", "", "view, 90 to 120 m"),
    ("near-range", "", "`near-range`: 128 lines / Avia above 1", "common, 30 to 50 m"),
    ("ratio", "ruby_plus over pandar_64", "`ratio`: 128 / 64 within 1.6 to 2.4", "common"),
    ("ratio", "pandar_64 over helios_16", "`ratio`: 64 / 16 within 3.2 to 4.8", "common"),
    ("gentle", "", "`gentle`: smallest other exponent less the Avia's above 0", "common"),
    *(
        ("deskew", f"box of {name} ", f"`deskew`: {words}, points in the box, %", "common")
        for name, words in LIDARS.items()
    ),
    (
        *("only-one", " common,", "`only-one`: Avia alone less another without it, per 100"),
        "common, 90 to 120 m (paper: to 100 m)",
    ),
    ("only-one", " view,", "", "view, 90 to 120 m"),
)


@cache
def results(name: str) -> pd.DataFrame:
    return pd.read_csv(ROOT / "results" / f"{name}.csv")


def rows_of(table: pd.DataFrame, claim: str, words: str, **equal: str) -> pd.DataFrame:
    """Rows of a claim whose statement has the words and whose columns are as given."""
    keep = (table.claim == claim) & table.statement.str.contains(words, regex=False)
    for column, value in equal.items():
        keep &= table[column] == value
    return table[keep]


def markdown(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [f"| {' | '.join(cells)} |\n" for cells in (heads, *rows)]
    return "".join([lines[0], "|" + "---|" * len(heads) + "\n", *lines[1:]])


def in_short() -> str:
    """Every claim under every preset: a verdict, or how many hold, fail and are undecided."""
    rows = [
        [said, named(claim, note), *(scanned(claim, words, preset) for preset in PRESETS)]
        for said, claim, words, note in SCANNING
    ]
    rows += [
        [said, named(claim, note), *(counted(claim, words, preset) for preset in PRESETS)]
        for said, claim, words, note in DETECTION
    ]
    return markdown(["the paper says", "claim", *(f"`{p}`" for p in PRESETS)], rows)


def named(claim: str, note: str) -> str:
    """The claim with what it is about."""
    if claim == "gentle":
        return f"`{claim}` ({note})"
    return f"`{claim}` {note}" if claim == "ratio" else f"`{claim}`" + (f", {note}" if note else "")


def scanned(claim: str, words: str, preset: str) -> str:
    found = rows_of(results("claims"), claim, words, preset=preset)
    verdicts = sorted(set(found.verdict))
    times = f" ({number(found.value.iloc[0])} times)" if claim == "far-range" else ""
    return " / ".join(verdicts) + times


def counted(claim: str, words: str, preset: str) -> str:
    found = rows_of(results("quick_claims"), claim, words, preset=preset).verdict
    if found.empty:
        return ""
    return " / ".join(str((found == verdict).sum()) for verdict in ("holds", "fails", "undecided"))


def number(value: float) -> str:
    """Three digits of what is below 1, else one or two behind the point."""
    return f"{value:.2f}" if abs(value) < 1 else f"{value:.1f}"


def scanning() -> str:
    """Value, interval and verdict of each claim about scanning."""
    rows = []
    for claim, words, said, where in OF_SCANNING:
        cells = []
        for preset in PRESETS:
            now, before = (
                scanned_row(name, claim, words, preset) for name in ("claims", "claims_0.2.0")
            )
            cells.append(f"{now} (was {before})")
        rows.append([said, where, *cells])
    return markdown(["claim", "set, distance", *PRESETS], rows)


def scanned_row(name: str, claim: str, words: str, preset: str) -> str:
    found = rows_of(results(name), claim, words, preset=preset)
    ((value, low, high, verdict),) = found[["value", "low", "high", "verdict"]].itertuples(
        index=False
    )
    return f"{with_interval(value, low, high)} {verdict}"


def with_interval(value: float, low: float, high: float) -> str:
    if value == low == high:
        return f"{value:g}"
    digits = 1 if abs(value) >= 10 else 2
    return f"{value:.{digits}f} [{low:.{digits}f}, {high:.{digits}f}]"


def of_a_scene(scene: str, preset: str, names: Sequence[str]) -> str:
    """A column a detector; a row that none of them has is left out."""
    rows = []
    for claim, words, said, shape in OF_A_SCENE:
        cells = [verdict(scene, preset, claim, words, d, shape) for d in names]
        if any(cells):
            rows.append([said, *cells])
    return markdown(["claim", *(DETECTORS[d] for d in names)], rows)


def of_scenes(preset: str, scenes: Sequence[str], names: Sequence[str]) -> str:
    """A column a scene, the detectors beside each other in it."""
    rows = []
    for claim, words, said, shape in OF_A_SCENE:
        cells = [
            " / ".join(filter(None, (verdict(s, preset, claim, words, d, shape) for d in names)))
            for s in scenes
        ]
        if any(cells):
            rows.append([said, *cells])
    return markdown(["claim", *scenes], rows)


def verdict(scene: str, preset: str, claim: str, words: str, detector: str, shape: str) -> str:
    """Value and verdict of a claim about one detector; nothing if it was not tested."""
    found = rows_of(results("quick_claims"), claim, words, scene=scene, preset=preset)
    found = found[found.statement.str.startswith(f"{detector}:")]
    if found.empty:
        return ""
    ((value, text),) = found[["value", "verdict"]].itertuples(index=False)
    return f"{shape.format(value)} {text}"


def detectors(scene: str, preset: str) -> str:
    """AP of the smallest seed with its interval, and the time of training."""
    table = results("quick")
    table = table[(table.scene == scene) & (table.preset == preset)].sort_values("seed")
    rows = []
    for name, words in DETECTORS.items():
        own = table[table.detector == name].drop_duplicates("lidar").set_index("lidar")
        cells = [
            with_interval_of_ap(*own.loc[x, ["ap", "ap_low", "ap_high"]]) if x in own.index else ""
            for x in LIDARS
        ]
        seconds = own.train_seconds.dropna()
        span = f"{seconds.min():.0f} to {seconds.max():.0f}" if len(seconds) else ""
        rows.append([words, *cells, span])
    return markdown(["detector", *LIDARS.values(), "train, CPU s"], rows)


def with_interval_of_ap(value: float, low: float, high: float) -> str:
    return f"{value:.1f}" if math.isnan(low) else f"{value:.1f} [{low:.1f}, {high:.1f}]"


def doors() -> str:
    """What is wrong, and what 0.2.0 and the latest version made of it; crashes are bold."""
    table = results("doors")
    versions = list(dict.fromkeys(table.version))
    before, now = (table[table.version == v].set_index(["door", "tried"]) for v in versions)
    rows = []
    for key, row in now.iterrows():
        was = before.loc[key] if key in before.index else None
        rows.append([str(key[0]), key[1], "" if was is None else told(was), told(row)])
    return markdown(["door", "tried", "0.2.0", "now"], rows)


def told(row: pd.Series) -> str:
    """A finding in a cell of a table."""
    text = re.sub(r"[|<>`*]", " ", str(row.found))
    short = text if len(text) <= SHOWN else text[:SHOWN].rsplit(" ", 1)[0] + " ..."
    return short if row.shut else f"**open**: {short}"


def static_layers() -> str:
    """Of each preset: what casting with static layers changed, cast and took."""
    rows = []
    for preset, own in results("static_layer").groupby("preset"):
        cast, time = 100 * own.cast_share, own.time_ratio
        rows.append(
            [
                str(preset),
                str(len(own)),
                str(own.different_files.sum()),
                f"{cast.median():.0f} ({cast.min():.0f} to {cast.max():.0f})",
                f"{time.median():.2f} ({time.min():.2f} to {time.max():.2f})",
            ]
        )
    names = ["preset", "scenes x LiDARs", "files that differ", "rays cast, %", "time / casting all"]
    return markdown(names, rows)


def speed() -> str:
    """What `make bench` measured."""
    rows = results("speed").itertuples()
    return markdown(["what", "value"], [[r.what, f"{r.value:.2f} {r.unit}"] for r in rows])


def points_before() -> str:
    """Points per vehicle by preset, LiDAR and distance: of 0.2.0, and today's share of them."""
    table = results("before")
    rows = []
    for preset in PRESETS:
        for lidar, words in LIDARS.items():
            own = table[(table.preset == preset) & (table.lidar == lidar)]
            points = own.pivot(index="from_m", columns="model", values="points_per_vehicle")
            cells = [f"{r.before:.1f} x {r.today / r.before:.2f}" for r in points.itertuples()]
            rows.append([preset, words, *cells])
    return markdown(["preset", "LiDAR", *(f"from {m} m" for m in sorted(set(table.from_m)))], rows)


def points_by_model() -> str:
    """What each model of `datasheet` leaves of the points of 0.2.0, one more at a time."""
    table = results("before")
    table = table[table.preset == "datasheet"]
    rows = []
    for lidar, words in LIDARS.items():
        own = table[table.lidar == lidar]
        points = own.pivot(index="from_m", columns="model", values="points_per_vehicle")
        for model in ("law", "and glass", "and gap", "and coat", "today"):
            shares = points[model] / points.before
            said = {"law": "the law", "today": "and plants"}.get(model, model)
            rows.append([words, said, *(f"{share:.2f}" for share in shares)])
    return markdown(["LiDAR", "model", *(f"from {m} m" for m in sorted(set(table.from_m)))], rows)


def deskew_by_seam() -> str:
    """Points in the box from `instant` to `exact`, in %, with the seams turned."""
    table = results("deskew")
    table["name"] = table.statement.str.extract(r"box of (\w+) ")
    rows = [
        [
            words,
            *(
                f"{row.value:.1f} {row.verdict}"
                for row in table[table.name == lidar].sort_values("seam_turned_deg").itertuples()
            ),
        ]
        for lidar, words in LIDARS.items()
    ]
    turns = sorted(set(table.seam_turned_deg))
    return markdown(["LiDAR", *(f"{degrees}°" for degrees in turns)], rows)


def label_times() -> str:
    """By how much a motor's phase moves AP of all vehicles: least to most, ends of intervals."""
    table = results("label_time")
    table = table[table.ground_truth == "all"]
    rows = []
    keys = ["detector", "scene", "lidar", "label_time"]
    for (detector, scene, lidar, label_time), own in table.groupby(keys, sort=False):
        (base,) = own[own.dial == "none"].ap
        cells = [
            f"{part.change.min():+.1f} to {part.change.max():+.1f} "
            f"[{part.change_low.min():+.1f}, {part.change_high.max():+.1f}]"
            for part in (own[own.dial == dial] for dial in ("turn", "seam", "phase"))
        ]
        rows.append([DETECTORS[detector], scene, LIDARS[lidar], label_time, f"{base:.1f}", *cells])
    heads = ["detector", "scene", "LiDAR", "labels", "AP", "turned", "other seams", "other phases"]
    return markdown(heads, rows)


def ladder(name: str = "ladder") -> str:
    """Fine AP of the default model of a scene; of others one dial away, how far they are from it.

    In pairs where the worlds are one, else AP. CPU seconds of the run.
    """
    table = results(name)
    dials = ["detail", "aggregation", "parts", "vegetation", "label_time", "frames"]
    table = table.astype(dict.fromkeys(dials, str))
    usual = {dial: table[dial].mode()[0] for dial in dials}
    lidars = [lidar for lidar in LIDARS if lidar in set(table.lidar)]
    rows, default = [], None
    for model, own in table.groupby(dials, sort=False):
        other = [f"{d} `{v}`" for d, v in zip(dials, model, strict=True) if v != usual[d]]
        seconds = own.ms_per_frame_set.astype(float).iloc[0] * int(model[-1]) / 1000
        by_lidar = own.set_index("lidar")
        default = by_lidar if default is None else default
        cells = [_step(by_lidar.loc[x], default.loc[x] if other else None) for x in lidars]
        rows.append([", ".join(other) or "the default", f"{seconds:.0f}", *cells])
    return markdown(["model", "CPU, s", *(LIDARS[lidar] for lidar in lidars)], rows)


def _step(own: pd.Series, default: pd.Series | None) -> str:
    """AP, or a signed difference, bold where its interval does not hold 0."""
    if default is None or not are_pairs(own, default):
        return with_interval_of_ap(*own[["ap_fine", "ap_fine_low", "ap_fine_high"]].astype(float))
    found = difference(own, default).measured()
    text = f"{found.value:+.1f} [{found.low:+.1f}, {found.high:+.1f}]"
    return f"**{text}**" if found.low > 0 or found.high < 0 else text


def coverage() -> str:
    """How often intervals held the truth, and how wide they were, by scene, span and rule."""
    table = results("coverage")
    rows = []
    for (scene, span, rule), own in table.groupby(["scene", "span_s", "rule"], sort=False):
        cells = [f"{r.held_percent:.0f} ({r.width:.1f})" for r in own.itertuples()]
        rows.append([scene, f"{span}", rule, f"{own.block_s.iloc[0]:.0f}", *cells])
    figures = list(dict.fromkeys(table.figure))
    return markdown(["scene", "test, s", "rule", "block, s", *figures], rows)


def correlation() -> str:
    """How long errors of Background last by its own detections, of each LiDAR, and the block."""
    table = results("correlation")
    table = table[table.ground_truth == "all"]
    by_lidar = table.pivot(index="scene", columns="lidar", values="correlation_s")
    rows = [
        [scene, f"{own.block_s.iloc[0]:.0f}", *(f"{by_lidar.loc[scene, x]:.0f}" for x in LIDARS)]
        for scene, own in table.groupby("scene", sort=False)
    ]
    return markdown(["scene", "block, s", *LIDARS.values()], rows)


def differences() -> str:
    """Of each pair of LiDARs and ground truth `all`: the interval by each rule."""
    table = results("differences")
    table = table[table.ground_truth == "all"]
    rows = []
    for (scene, a, b), own in table.groupby(["scene", "lidar", "less"], sort=False):
        cells = [f"{r.value:+.1f} [{r.low:+.1f}, {r.high:+.1f}]" for r in own.itertuples()]
        rows.append([scene, f"{LIDARS[a]} less {LIDARS[b]}", *cells])
    return markdown(["scene", "LiDARs", *dict.fromkeys(table.rule)], rows)


def people() -> str:
    """How far people have 5 points a frame, and how many they have on the way."""
    table = results("people")
    at_m = (20, 50, 100, 150)
    rows = []
    for lidar, own in table.groupby("lidar", sort=False):
        walkers = own[own["class"] == "Pedestrian"].set_index("from_m").points
        reached = [people_reach(own[own["class"] == name]) for name in ("Pedestrian", "Cyclist")]
        rows.append([str(lidar), *reached, *(f"{walkers.get(m, 0):g}" for m in at_m)])
    heads = ["LiDAR", "pedestrian, m", "cyclist, m"]
    return markdown([*heads, *(f"points from {m} m" for m in at_m)], rows)


def people_reach(own: pd.DataFrame) -> str:
    """The end of the last bin with enough points, and that of the last without a gap before it."""
    enough = (own.points >= PEOPLE_POINTS).to_numpy()
    if not enough.any():
        return "-"
    end = own.from_m.to_numpy() + PEOPLE_BIN_M
    first, last = enough.argmax(), len(enough) - 1 - enough[::-1].argmax()
    if enough[first : last + 1].all():
        return f"{end[last]}"
    unbroken = first + (~enough[first:]).argmax() - 1
    return f"{end[last]} (all to {end[unbroken]})"


def generalist_sites() -> str:
    """By LiDAR, precision and recall of the shipped network's vehicles at sites it never saw."""
    rows, table = [], results("generalist_sites")
    for lidar, own in table[table["class"] == "vehicle"].groupby("lidar", sort=True):
        found = own[["boxes", "objects"]].sum()
        right = (own.precision * own.boxes).sum()
        said = (own.precision_said * own.boxes).sum() / found.boxes
        low, high = own[own.boxes >= LEAST_BOXES].precision.quantile([0.1, 0.9])
        spread = f"{low:.2f} to {high:.2f}"
        shares = (
            f"{right / found.boxes:.2f}",
            spread,
            f"{said:.2f}",
            f"{right / found.objects:.2f}",
        )
        rows.append([str(lidar), str(own.site.nunique()), f"{found.objects:.0f}", *shares])
    heads = ["precision", "of 80 % of the sites", "precision said", "recall"]
    return markdown(["LiDAR", "sites", "vehicles", *heads], rows)


ARMS = {
    "none": "as it comes",
    "tuned_30": "30 s",
    "tuned_120": "120 s",
    "specialist": "a specialist",
}


def generalist() -> str:
    """Fine AP of the shipped network as it comes, after a little training, and of a specialist."""
    rows = []
    table = results("generalist")
    for (site, lidar, world), own in table.groupby(["site", "lidar", "seed"], sort=False):
        by_arm = own.set_index("arm")
        cells = (
            with_interval_of_ap(*_ends(by_arm.loc[arm], "ap_fine")) if arm in by_arm.index else ""
            for arm in ARMS
        )
        rows.append([str(site), str(lidar), str(world), *cells])
    return markdown(["site", "LiDAR", "world", *ARMS.values()], rows)


def beside_specialists() -> str:
    """Differences of fine AP to a specialist, cell by cell: another site, world and training."""
    rows = []
    table = results("generalist")[["site", "seed", "lidar", "arm", "ap_fine"]]
    kind = np.where(table.site.str.startswith("site_"), "generated", "the study's")
    cells = table.assign(kind=kind).pivot_table("ap_fine", ["kind", "site", "seed", "lidar"], "arm")
    for (kind, own), arm in itertools.product(cells.groupby("kind"), list(ARMS)[:-1]):
        less = (own[arm] - own.specialist).dropna().to_numpy()
        if len(less) == 0:
            continue
        least, middle, most = (f"{v:+.1f}" for v in np.percentile(less, [0, 50, 100]))
        spread = f"{least} to {most}"
        mean = with_interval_of_ap(*astuple(over_worlds(less)))
        rows.append([kind, ARMS[arm], str(len(less)), mean, middle, spread])
    heads = ["sites", "trained there", "cells", "mean difference", "median", "all cells"]
    return markdown(heads, rows)


def unseen() -> str:
    """Fine AP by class at generated sites that no training saw, of the shipped network first."""
    table, rows = results("unseen"), []
    models = list(dict.fromkeys(table.model))
    key = ["sites", "class", "measure"]
    for (sites, name, measure), own in table.groupby(key, sort=False):
        of = own.set_index("model")
        ap = (
            with_interval_of_ap(*_ends(of.loc[model], "ap_fine")) if model in of.index else ""
            for model in models
        )
        last = _ends(of.iloc[-1], "difference")
        less = "" if math.isnan(last[0]) else "{:+.1f} [{:.1f}, {:.1f}]".format(*last)
        count, objects = own[["count", "objects"]].iloc[0]
        rows.append([f"{sites} ({count})", name, measure, str(objects), *ap, less])
    names = (model.replace("_", " ") for model in models)
    return markdown(["sites", "class", "found by", "objects", *names, "difference"], rows)


def _ends(row: pd.Series, name: str) -> list[float]:
    return [float(row[column]) for column in (name, f"{name}_low", f"{name}_high")]


def unlabelled() -> str:
    """Precision promised and found after a minute without labels, over sites."""
    rows = []
    for way, own in results("unlabelled").groupby("way", sort=False):
        own = own[own.boxes >= LEAST_BOXES]
        off = (own.precision_said - own.precision).abs()
        right, objects = (own.precision * own.boxes).sum(), own.objects.sum()
        rows.append(
            [
                str(way),
                str(len(own)),
                f"{right / own.boxes.sum():.2f}",
                f"{(own.precision_said * own.boxes).sum() / own.boxes.sum():.2f}",
                f"{off.median():.3f}",
                f"{100 * (off <= 0.05).mean():.0f} %",
                f"{(own.recall * own.objects).sum() / objects:.2f}",
            ]
        )
    heads = ["boxes", "sites", "precision", "said", "off by (median)", "within 0.05", "recall"]
    return markdown(heads, rows)


STRESSED = {
    "background": "Background",
    "centerpoint": "specialist",
    "generalist": "generalist",
}  # by the end of the run's name


def stress_generalist() -> str:
    """Where AP falls by 10 and to half, and AP under names, of three detectors and two LiDARs."""
    curves, trials = (
        results(name).assign(who=lambda t: t.run.str.rsplit("_", n=1).str[-1])
        for name in ("stress_generalist_summary", "stress_generalist")
    )
    columns = [(lidar, who) for lidar in curves.lidar.unique() for who in STRESSED]
    rows = [["AP (fine) without", *(_unstressed(trials, *own) for own in columns)]]
    for (stressor, unit), own in curves[curves.unit != "name"].groupby(
        ["stressor", "unit"], sort=False
    ):
        cells = own.set_index(["lidar", "who"])[["falls_by_10", "falls_to_half"]]
        falls = (" / ".join(cells.loc[c]) if c in cells.index else "" for c in columns)
        rows.append([f"{stressor}, {unit}", *falls])
    names = trials[trials.unit == "name"]
    for (stressor, dial), own in names.groupby(["stressor", "dial"], sort=False):
        ap = own.set_index(["lidar", "who"]).ap_fine
        cells = (f"{ap[c]:.0f}" if c in ap.index else "" for c in columns)
        rows.append([f"{stressor}: {dial}", *cells])
    return markdown(["", *(f"{LIDARS[a]}: {STRESSED[b]}" for a, b in columns)], rows)


def _unstressed(trials: pd.DataFrame, lidar: str, who: str) -> str:
    own = trials[(trials.stressor == "none") & (trials.lidar == lidar) & (trials.who == who)]
    return with_interval_of_ap(*_ends(own.iloc[0], "ap_fine"))


WAYS = (("stacked", "newest"), ("aged", "newest"), ("aged", "middle"))


def integration() -> str:
    """Fine AP of stacked frames, of captured vehicles and of all, each way of input and label."""
    rows = []
    key = ["lidar", "speed_km_h", "accumulate"]
    for (lidar, speed, frames), own in results("integration").groupby(key, sort=False):
        by_way = own.set_index(["input", "label_at"])
        cells = [_both_ap(by_way.loc[way]) if way in by_way.index else "" for way in WAYS]
        rows.append([LIDARS[str(lidar)], f"{speed} km/h", f"{frames / 10:g} s", *cells])
    heads = ["points alone", "with their age", "with their age, label in the middle"]
    return markdown(["LiDAR", "traffic at", "time", *heads], rows)


def _both_ap(row: pd.Series) -> str:
    return f"{with_interval_of_ap(*_ends(row, 'ap_fine'))}; {row.ap_all:.1f}"


def hill() -> str:
    """AP of the generalist by grade, with the road's height at each place and with one."""
    rows = []
    key = ["lidar", "grade_percent", "seed"]
    for (lidar, percent, seed), own in (
        results("hill").sort_values(key[1:]).groupby(key, sort=False)
    ):
        by_height = own.set_index("height")
        ap = (with_interval_of_ap(*_ends(by_height.loc[h], "ap_fine")) for h in ("local", "one"))
        iou = by_height.iou_3d.iloc[0]
        rows.append([LIDARS[str(lidar)], f"{percent} %", str(seed), *ap, f"{iou:.2f}"])
    rows.sort(key=lambda row: list(LIDARS.values()).index(row[0]))
    return markdown(["LiDAR", "grade", "world", "local height", "one height", "3-D IoU"], rows)


def traffic() -> str:
    """How SUMO's vehicles, riders and people on foot move, before and after smoothing."""
    rows = []
    for (net, seed), own in results("traffic").groupby(["net", "seed"], sort=False):
        before, after = own.iloc[0], own.iloc[1]
        pairs = ("turn_deg", "acceleration_m_s2", "overlap_percent")
        figures = (f"{before[name]:.4g} / {after[name]:.4g}" for name in pairs)
        tracks = f"{after.vehicles_and_riders} + {after.pedestrians}"
        rows.append([net, str(seed), tracks, str(after.left_out), *figures, str(after.appearing)])
    heads = ["network", "seed", "vehicles and riders + people on foot", "left out", "turn, degrees"]
    return markdown([*heads, "acceleration, m/s2", "overlaps, %", "appear"], rows)


def engines() -> str:
    """How much faster a frame is with another engine in the generalist, and its AP."""
    table = results("engines")
    rows = []
    for engine, own in table.groupby("engine", sort=False):
        by_scene = own.set_index("scene")
        both = (f"{row.speed:.2f}, {row.ap_fine:.1f}" for _, row in by_scene.iterrows())
        rows.append([str(engine), *both])
    scenes = table.drop_duplicates("scene")
    heads = (f"{r.scene}, {LIDARS[r.lidar]}" for r in scenes.itertuples())
    return markdown(["engine", *heads], rows)


def sites() -> str:
    """Ten maps: what they hold, seconds of each step, and Background's AP by LiDAR."""
    table = results("sites")
    steps = ("import", "traffic", "check", "run")
    rows = []
    for site, own in table.groupby("site", sort=False):
        first = own.iloc[0]
        counts = [f"{first.lanes}", f"{first.triangles / 1000:.0f}", f"{first.vehicles}"]
        seconds = [f"{first[f'{step}_s']:.1f}" for step in steps]
        by_lidar = own.set_index("lidar")
        line = by_lidar.loc["ruby_plus"]
        seconds += [f"{line.detect_s + line.evaluate_s:.1f}"]
        found = [site_ap(by_lidar.loc[lidar], "all") for lidar in ("ruby_plus", "livox_avia")]
        captured = [site_ap(by_lidar.loc["livox_avia"], "captured")]
        rows.append([str(site).replace("_", " "), *counts, *seconds, *found, *captured])
    heads = ["site", "lanes", "triangles, k", "vehicles", *(f"{step}, s" for step in steps)]
    heads += ["Background, s", "AP of all, 128 lines", "AP of all, Avia", "of captured, Avia"]
    return markdown(heads, rows)


def site_ap(row: pd.Series, truth: str) -> str:
    return with_interval_of_ap(*(float(row[f"ap_{truth}{end}"]) for end in ("", "_low", "_high")))


FOUR = ("pointpillars", "pv-rcnn", "dsvt", "centerpoint-pillar")
TWO = ("pointpillars", "centerpoint-pillar")


def poles() -> str:
    """AP by the number of poles, and what more poles add."""
    rows = []
    for names, own in of_poles():
        ap = [
            with_interval(*own[n][["ap_fine", "ap_fine_low", "ap_fine_high"]]) if n in own else ""
            for n in (1, 2, 4)
        ]
        rows.append([*names, *ap, _less(own.get(2), own.get(1)), _less(own.get(4), own.get(2))])
    heads = ["1 pole", "2 poles", "4 poles", "2 less 1", "4 less 2"]
    return markdown(["LiDAR", "detector", *heads], rows)


def pole_errors() -> str:
    """What each error costs, of two poles and of four."""
    rows = []
    for names, own in of_poles():
        for right in (own[n] for n in (2, 4) if n in own):
            cells = [_less(wrong, right) for wrong in _errors(right)]
            rows.append([*names, f"{right.poles}", *cells])
    return markdown(["LiDAR", "detector", "poles", *POLE_ERRORS.values()], rows)


POLE_DETECTORS = DETECTORS | {"background-relearnt": "Background, learnt anew"}
POLE_ERRORS = {
    "clock_20_ms": "clocks by 20 ms",
    "clock_50_ms": "50 ms",
    "yaw_0.2_deg": "yaw by 0.2 degrees",
    "yaw_0.5_deg": "0.5 degrees",
}


def of_poles() -> Iterable[tuple[list[str], dict[int, pd.Series]]]:
    """LiDAR and detector, and by the number of poles the row of `all` without an error."""
    table = results("poles")
    right = table[(table.error == "none") & (table.ground_truth == "all")]
    for detector, (lidar, words) in itertools.product(POLE_DETECTORS, LIDARS.items()):
        own = right[(right.lidar == lidar) & (right.arm == detector)]
        if len(own):
            rows = {int(row.poles): row for _, row in own.iterrows()}
            yield [words, POLE_DETECTORS[detector]], rows


def _errors(right: pd.Series) -> Iterable[pd.Series | None]:
    """The same cell with each error, if it is there."""
    table = results("poles")
    keys = ["lidar", "arm", "poles", "ground_truth"]
    own = table[(table[keys] == right[keys]).all(axis=1)].set_index("error", drop=False)
    return (own.loc[name] if name in own.index else None for name in POLE_ERRORS)


def _less(a: pd.Series | None, b: pd.Series | None) -> str:
    """Their difference with its interval; nothing if one is not there."""
    if a is None or b is None:
        return ""
    found = difference(a, b).measured()
    return f"{found.value:+.1f} [{found.low:+.1f}, {found.high:+.1f}]"


TABLES: dict[str, Callable[[], str]] = {
    "claims in short": in_short,
    "claims about scanning": scanning,
    "claims on the highway, paper": partial(of_a_scene, "highway", "paper", FOUR),
    "claims on the crossroad, paper": partial(of_a_scene, "crossroad", "paper", FOUR),
    "claims on the curve, paper": partial(of_a_scene, "curve", "paper", FOUR),
    "claims on the highway, equal": partial(of_a_scene, "highway", "equal", TWO),
    "claims, datasheet": partial(of_scenes, "datasheet", ("highway", "crossroad", "curve"), TWO),
    "doors": doors,
    "speed": speed,
    "static layers": static_layers,
    "points before and today": points_before,
    "points by model": points_by_model,
    "label times": label_times,
    "deskew by seam": deskew_by_seam,
    "ladder": ladder,
    "ladder of PointPillars": partial(ladder, "ladder_pointpillars"),
    "coverage": coverage,
    "correlation": correlation,
    "differences": differences,
    "people": people,
    "poles": poles,
    "pole errors": pole_errors,
    "engines": engines,
    "generalist": generalist,
    "beside specialists": beside_specialists,
    "hill": hill,
    "integration": integration,
    "stress_generalist": stress_generalist,
    "unlabelled": unlabelled,
    "unseen": unseen,
    "traffic": traffic,
    "generalist at sites": generalist_sites,
    "sites": sites,
    "detectors on the highway, paper": partial(detectors, "highway", "paper"),
}


def rewritten(page: Path) -> str:
    """The page with its tables made anew. Raises ValueError for a table of no name here."""

    def table(match: re.Match[str]) -> str:
        begin, name, _, end = match.groups()
        if name not in TABLES:
            raise ValueError(f"{page}: found table '{name}', allowed {', '.join(TABLES)}")
        return begin + TABLES[name]() + end

    return BLOCK.sub(table, page.read_text(encoding="utf-8"))


def main() -> int:
    parser = argparse.ArgumentParser(description="Tables of the documentation, from results/.")
    parser.add_argument("--check", action="store_true", help="write nothing; fail if one differs")
    check = parser.parse_args().check
    stale = [page for page in PAGES if rewritten(page) != page.read_text(encoding="utf-8")]
    for page in stale:
        print(f"{page.relative_to(ROOT)}: {'differs from results/' if check else 'written'}")
        if not check:
            page.write_text(rewritten(page), encoding="utf-8")
    return 1 if check and stale else 0


if __name__ == "__main__":
    sys.exit(main())
