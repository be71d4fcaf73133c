"""Makes the tables of the page about the catalogue's LiDARs, from their files and results."""

import re

import numpy as np

from pyinfra.dataset.catalogue import lidar_file
from pyinfra.dataset.lidars import read_catalogue
from reproduction.tables.common import LIDARS, Rows, results, rows_with, with_heads
from reproduction.tables.rungs import BANDS

PRESET, SCENE = "datasheet", "highway"
GRADES = ("vendor", "driver", "third party", "nominal")  # grades of sources in LiDAR files
# Assumption that a comment with `assumed` or `not published` beside a LiDAR key describes.
ASSUMPTIONS = {
    "range_at_10_percent_m": "range by reflectance and light",
    "beam": "width of the beam",
    "echoes": "minimum distance of two echoes",
}


@with_heads(
    "product",
    "name",
    "name in results",
    "view, degrees",
    "range at 10 %, m",
    "US$",
    *BANDS.values(),
)
def catalogue() -> Rows:
    """Returns a table of the LiDARs, with their points per vehicle."""
    table = rows_with(results("frame_numbers"), scene=SCENE)
    for sheet in read_catalogue(PRESET):
        part = table[table.lidar == sheet.name]
        points = [
            f"{np.average(band.points_now, weights=band.vehicles):.1f}" if len(band) else ""
            for band in (part[part.from_m == from_m] for from_m in BANDS)
        ]
        low, high = sheet.price_low_usd, sheet.price_high_usd
        price = f"{low:,.0f}" if low == high else f"{low:,.0f} to {high:,.0f}"
        called = LIDARS.get(sheet.name, "")
        view = f"{sheet.horizontal_fov_deg:.0f} x {sheet.vertical_fov_deg:.0f}"
        facts = [view, f"{sheet.range_at_10_percent_m:.0f}", price]
        yield [sheet.model, f"`{sheet.name}`", called, *facts, *points]


@with_heads("product", "pattern", "assumed or not published", "grades", "price")
def sources() -> Rows:
    """Returns a table of each LiDAR's pattern, assumed values, grades of sources, and price."""
    for sheet in read_catalogue(PRESET):
        text = lidar_file(sheet.name).read_text(encoding="utf-8")
        head = re.match(r"(#[^\n]*\n)+", text)
        what = re.sub(r"\n?# ?", " ", head[0] if head else "").split(". ")[0].strip().rstrip(".")
        brand = sheet.model.split()[0]
        what = what.partition(": ")[2] if what.startswith(brand) else what.replace(": ", ", ")
        assumed = [words for key, words in ASSUMPTIONS.items() if is_assumed(text, key)]
        graded = [grade for grade in GRADES if f"[{grade}]" in text]
        price = f"{sheet.price_source}, {sheet.price_date}".strip(", ")
        yield [sheet.model, what, ", ".join(assumed), ", ".join(graded), price]


def is_assumed(text: str, key: str) -> bool:
    """Returns whether the comment on a key, beside it or above it, says that it is assumed."""
    marks = r"(assumed|not published)"
    beside = rf"{key}:[^\n]*#[^\n]*{marks}"
    above = rf"(?m)^ *#[^\n]*{marks}[^\n]*\n( *#[^\n]*\n)*[^\n#]*{key}:"
    return bool(re.search(beside, text) or re.search(above, text))
