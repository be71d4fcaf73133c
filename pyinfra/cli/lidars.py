"""`pyinfra lidars`: lists the LiDARs of the package, or LiDARs from files."""

import argparse
import json
import math
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from pyinfra.cli.parser import argument, usage
from pyinfra.core.errors import Error
from pyinfra.core.names import file_or_name
from pyinfra.core.vocabulary import PRESETS
from pyinfra.dataset.catalogue import shipped
from pyinfra.dataset.lidars import LidarSheet, read_catalogue, read_sheet
from pyinfra.exchange.beam_tables import read_beam_table, write_lidar_file

NOTHING = "-"
HEADS = ("lidar", "model", "lines", "view, deg", "range", "10 %", "USD", "", "presets")
LEFT = (0, 1, 7, 8)  # indices of the text columns, which are left-aligned
ASSUMED = "*"
ASSUMPTION = (
    f"{ASSUMED} the only published range: its dependence on reflectance and light is assumed"
)
LETTERS: dict[str, str] = {name: name[0] for name in PRESETS}
LEGEND = ", ".join(f"{letter} {name}" for name, letter in LETTERS.items())


add_arguments = usage(
    "Lists LiDARs, one row each: number of lines, width and height of the field of view, "
    "maximum range and range to a target of 10 % reflectance (metres), price in US dollars "
    "with its source, and presets.",
    "example: pyinfra lidars ruby_plus mine.yaml",
    argument(
        "lidars",
        nargs="*",
        metavar="LIDAR",
        help="names from the package, or LiDAR files; default: all LiDARs of the package",
    ),
    argument(
        "--preset",
        default="",
        help="preset for which numbers are shown; default: the first of datasheet, equal and "
        "paper that a LiDAR has",
    ),
    argument(
        "--from-table",
        type=Path,
        metavar="FILE",
        help="convert a maker's table of beams to a LiDAR file: Ouster's metadata (.json), "
        "Velodyne's calibration (.yaml, .xml), angles of Hesai and RoboSense, rays of Livox (.csv)",
    ),
    argument("--out", type=Path, metavar="LIDAR.yaml", help="new LiDAR file for --from-table"),
    argument("--json", action="store_true", help="print JSON with named values"),
)


def run(args: argparse.Namespace) -> int:
    files = [file_or_name(word, shipped("lidars"), "LIDAR") for word in args.lidars]
    if (args.from_table is None) != (args.out is None):
        raise Error("--from-table: use --from-table and --out together")
    if args.from_table is not None:
        table = read_beam_table(args.from_table)
        beside = write_lidar_file(table, args.out)
        count = f"{len(table.rays)} rays" if table.rays else f"{len(table.beams)} beams"
        print(
            f"{args.out}, {beside}: {count} of {table.maker}; replace the example price and range"
        )
        files.append(args.out)
    sheets = [read_sheet(f, args.preset) for f in files] or read_catalogue(args.preset)
    print(as_json(sheets) if args.json else "\n".join(lines(sheets)))
    return 0


def as_json(sheets: Sequence[LidarSheet]) -> str:
    """Returns the sheets as a JSON list of objects, in which unknown values are null."""
    rows = [
        {k: None if isinstance(v, float) and math.isnan(v) else v for k, v in asdict(sheet).items()}
        for sheet in sheets
    ]
    return json.dumps(rows, indent=2)


def lines(sheets: Sequence[LidarSheet]) -> list[str]:
    """Returns lines to print: a table, the sources of the prices, and files with problems."""
    sources = list(dict.fromkeys(source(sheet) for sheet in sheets if source(sheet)))
    rows = [HEADS, *(row(sheet, sources) for sheet in sheets)]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    table = [
        " ".join(
            cell.ljust(width) if index in LEFT else cell.rjust(width)
            for index, (cell, width) in enumerate(zip(cells, widths, strict=True))
        ).rstrip()
        for cells in rows
    ]
    notes = [f"[{index}] {text}" for index, text in enumerate(sources, 1)]
    problems = [f"{sheet.name}: {sheet.problem}" for sheet in sheets if sheet.problem]
    assumption = [ASSUMPTION] if any(sheet.published_ranges == 1 for sheet in sheets) else []
    legend = f"presets: {LEGEND}; the numbers are those of the preset in capitals"
    return [*table, "", legend, *assumption, *notes, *problems]


def row(sheet: LidarSheet, sources: Sequence[str]) -> tuple[str, ...]:
    low, high = sheet.price_low_usd, sheet.price_high_usd
    view = f"{whole(sheet.horizontal_fov_deg)} x {whole(sheet.vertical_fov_deg)}"
    letters = [LETTERS.get(p, p) for p in sheet.presets]
    selected = LETTERS.get(sheet.preset, sheet.preset)
    presets = [word.upper() if word == selected else word for word in letters]
    return (
        sheet.name,
        sheet.model,
        str(sheet.lines or NOTHING),
        view if math.isfinite(sheet.horizontal_fov_deg) else NOTHING,
        whole(sheet.range_m),
        whole(sheet.range_at_10_percent_m) + (ASSUMED if sheet.published_ranges == 1 else ""),
        whole(low) if not low < high else f"{whole(low)}-{whole(high)}",
        f"[{sources.index(source(sheet)) + 1}]" if source(sheet) else "",
        " ".join(presets),
    )


def whole(value: float) -> str:
    return f"{value:.0f}" if math.isfinite(value) else NOTHING


def source(sheet: LidarSheet) -> str:
    """Returns the source and the date of a price, or an empty text if neither is known."""
    return f"{sheet.price_source}, {sheet.price_date}".strip(", ")
