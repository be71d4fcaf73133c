"""Makes the report's section on the verdicts of the paper's claims under each preset."""

import re

import pandas as pd

from pyinfra.experiments.result_tables import TableFile
from pyinfra.viz.report.blocks import NOTHING, Column, Section, Table, TableCell, Text, shown, span
from pyinfra.viz.report.names import Names, in_order, ordered
from pyinfra.viz.report.report_data import Material
from reproduction.report.scenes import are_of_the_paper

CLAIMS = {
    "comparable": "The non-repetitive and the 128-line LiDAR have about the same AP",
    "far-range": "Beyond 90 m the non-repetitive LiDAR has about twice the points on a vehicle",
    "near-range": "At short distance the 128 lines have the most points on a vehicle",
    "ratio": "128, 64 and 16 lines have points on a vehicle in the ratio 8 : 4 : 1",
    "gentle": "Points and AP of the non-repetitive LiDAR decrease more slowly with distance",
    "areas": "The non-repetitive LiDAR has the same share of high-quality areas as the 128 lines",
    "algorithms": (
        "PointRCNN has a much lower AP than the others; PV-RCNN and PointPillars have the highest"
    ),
    "value": "The non-repetitive LiDAR has the highest AP per dollar",
    "deskew": "On moving vehicles, points collected over a frame differ from those of one instant",
    "tilt": "Tilting the non-repetitive LiDAR does not raise the AP",
    "only-one": "Only the non-repetitive LiDAR has points on some far vehicles",
    "64-below": "The 128-line and the non-repetitive LiDAR have a higher AP than the 64 lines",
    "similar": "Pillar, voxel and transformer detectors are within a few points of each other",
}
VERDICTS = ("holds", "fails", "undecided")


def section(material: Material) -> Section | None:
    """Returns a section whose table has a row per test and a verdict per preset.

    Returns None if the results have no claims, or none of the paper's scenes.
    """
    if not are_of_the_paper(material):
        return None
    parts = [material.results.table(name) for name in ("claims", "ap_claims")]
    rows = pd.concat(parts, ignore_index=True)
    if rows.empty:
        return None
    rows = rows.assign(key=[common_statement(text) for text in rows.statement])
    if "scene" in rows:
        rows["key"] = [
            f"{s}, {k}" if isinstance(s, str) else k for s, k in rows[["scene", "key"]].values
        ]
    presets = ordered(rows.preset)
    table = Table(
        "One row per test. A claim holds if the 95 % interval lies inside the stated range. It "
        "fails if the interval lies outside, and is undecided otherwise.",
        [Column("Claim"), Column("Test"), *(Column(f"Preset {p}") for p in presets)],
        _table_rows(rows, presets, material.names),
        TableFile("report_claims.csv", rows.drop(columns=["key"])),
    )
    left = [f"{name} ({text[0].lower()}{text[1:]})" for name, text in CLAIMS.items()]
    left = [text for name, text in zip(CLAIMS, left, strict=True) if name not in set(rows.claim)]
    more = [Text(f"Not tested in these results: {'; '.join(left)}.")] if left else []
    return Section("claims", "The paper's claims", _lead(rows, presets), [table, *more])


def common_statement(statement: str) -> str:
    """Returns a statement without the parts that differ between presets.

    These parts are numbers of vehicles and text in brackets.
    """
    what, _, where = re.sub(r"\s*\([^)]*\)", "", statement).partition(";")
    words = [w.strip() for w in where.split(",") if not re.search(r"\d+ (moving )?vehicles", w)]
    return "; ".join([what.strip(), *([", ".join(words)] if any(words) else [])])


def _lead(rows: pd.DataFrame, presets: list[str]) -> str:
    """Returns a sentence with the number of tests by verdict under each preset."""
    parts = []
    for preset in presets:
        counts = rows[rows.preset == preset].verdict.value_counts()
        counted = [f"{counts[v]} {_plural(v, counts[v])}" for v in VERDICTS if v in counts]
        parts.append(f"under preset {preset} {', '.join(counted)}")
    tested = rows.claim.nunique()
    of_all = f"{tested} of the paper's {len(CLAIMS)} claims were tested, some in several ways."
    return f"{of_all} Of the tests, {'; '.join(parts)}."


def _plural(verdict: str, count: int) -> str:
    return verdict.removesuffix("s") if count > 1 else verdict


def _table_rows(rows: pd.DataFrame, presets: list[str], names: Names) -> list[list[TableCell]]:
    order = in_order(rows.claim, CLAIMS)
    rows = rows.assign(rank=rows.claim.map(order.index)).sort_values("rank", kind="stable")
    lines = []
    for (claim, key), group in rows.groupby(["claim", "key"], sort=False):
        by_preset = {row.preset: row for row in group.itertuples()}
        cells = [_verdict(by_preset.get(preset)) for preset in presets]
        head = TableCell(str(claim), below=CLAIMS.get(str(claim), ""))
        lines.append([head, TableCell(names.spelled(str(key))), *cells])
    return lines


def _verdict(row: object) -> TableCell:
    if row is None:
        return TableCell(NOTHING)
    value, low, high = (float(getattr(row, name)) for name in ("value", "low", "high"))
    verdict = str(getattr(row, "verdict", ""))
    known = verdict if verdict in VERDICTS else "undecided"
    text = f"{shown(value, '.3g')} {span(low, high, '.3g')}".strip()
    origin = f"{getattr(row, 'origin', '')}: {getattr(row, 'statement', '')}"
    return TableCell("", verdict=known, below=text, origin=origin)
