"""Converts makers' tables of beams to a LiDAR file: Ouster, Velodyne, Hesai, RoboSense, Livox.

Conventions of the makers, and of the LiDAR file, whose azimuth offset is clockwise:
    Ouster     metadata JSON: beam_altitude_angles, beam_azimuth_angles (degrees, clockwise)
    Velodyne   YAML of the ROS driver or VeloView's XML: vert_correction, rot_correction
               (radians in YAML, degrees in XML; the azimuth is reduced by rot_correction)
    Hesai      correction .csv: Laser id, Elevation, Azimuth (degrees, clockwise)
    RoboSense  angle.csv: elevation, azimuth (degrees, clockwise), without a header
    Livox      .csv with time, azimuth and zenith (degrees; the zenith is counted from the axis)
"""

import csv
import io
import json
import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import yaml

from pyinfra.core.errors import Error, FormatError
from pyinfra.core.files import write
from pyinfra.exchange.json_boxes import number, shown

MOST_BEAMS = 512
MOST_BYTES = 20_000_000
MAX_RANGE_M = 200.0  # placeholder for the maximum range, which the user replaces
STEP_DEG = 0.2
PRICE = '{low: 1, high: 1, source: "not known, replace it", date: "2000-01"}'


@dataclass(frozen=True)
class BeamTable:
    """The beams of a spinning LiDAR, or the rays of a LiDAR with another scan pattern."""

    maker: str
    model: str
    beams: list[tuple[float, float]]  # elevation, azimuth offset (clockwise) of each beam, degrees
    columns_per_turn: int | None = None
    rate_hz: float = 10.0
    rays: list[tuple[float, float, float]] | None = None  # azimuth, elevation (degrees), time (s)


def read_beam_table(file: Path) -> BeamTable:
    """Reads a maker's table. Raises FormatError for any other content."""
    if file.stat().st_size > MOST_BYTES:
        raise FormatError(f"{file}: expected at most {MOST_BYTES} bytes, got {file.stat().st_size}")
    text = file.read_bytes().decode("utf-8-sig", "replace")
    suffix = file.suffix.lower()
    try:
        if suffix == ".json":
            table = _ouster(file, json.loads(text))
        elif suffix in (".yaml", ".yml"):
            table = _velodyne_yaml(file, yaml.load(text, yaml.CSafeLoader))
        elif suffix == ".xml":
            table = _velodyne_xml(file, ElementTree.fromstring(text))
        else:
            table = _columns(file, text)
    except (ValueError, TypeError, yaml.YAMLError, ElementTree.ParseError, RecursionError) as error:
        if isinstance(error, Error):
            raise
        raise FormatError(f"{file}: cannot be read: {str(error)[:200]}") from None
    count = len(table.beams)
    if table.rays is None and not 1 <= count <= MOST_BEAMS:
        raise FormatError(f"{file}: expected 1 to {MOST_BEAMS} beams, got {count}")
    for i, (elevation, azimuth) in enumerate(table.beams):
        if not (abs(elevation) <= 90 and abs(azimuth) <= 180):
            raise FormatError(
                f"{file}: beam {i}: expected an elevation of -90 to 90 degrees and an azimuth of "
                f"-180 to 180 degrees, got {elevation:g} and {azimuth:g}"
            )
    return table


def write_lidar_file(table: BeamTable, file: Path) -> Path:
    """Writes a LiDAR file and its table beside it, and returns the file of the table.

    The range and the price are not in the makers' tables: the file has values to replace.
    """
    name = re.sub(r"[^A-Za-z0-9_]", "_", file.stem)
    beside = file.with_name(f"{file.stem}_{'rays' if table.rays else 'channels'}.csv")
    for out in (file, beside):
        if out.exists():
            raise Error(f"{out}: expected a new file, got an existing file")
    if table.rays:
        head: tuple[str, ...] = ("azimuth_deg", "elevation_deg", "time_s")
        rows: list[tuple[Any, ...]] = [tuple(f"{v:.9g}" for v in ray) for ray in table.rays]
        pattern = f"  table: {{file: {beside.name}}}\n"
    else:
        head = ("channel", "elevation_deg", "azimuth_offset_deg", "fire_time_us")
        rows = [(i, f"{e:.9g}", f"{a:.9g}", "") for i, (e, a) in enumerate(table.beams)]
        turn = (
            f"columns_per_turn: {table.columns_per_turn}"
            if table.columns_per_turn
            else f"azimuth_step_deg: {STEP_DEG}  # assumed"
        )
        pattern = (
            f"  spinning:\n    rate_hz: {table.rate_hz:g}\n    {turn}\n"
            f"    channels: {{file: {beside.name}}}\n"
        )
    stream = io.StringIO()
    csv.writer(stream, lineterminator="\n").writerows([head, *rows])
    write(beside, stream.getvalue())
    write(
        file,
        f"name: {name}\nmodel: {json.dumps(table.model)}\nprice_usd: {PRICE}\n"
        f"pattern:\n{pattern}presets:\n  datasheet:\n    returns:  # assumed: replace the ranges\n"
        f"      max_range_m: {MAX_RANGE_M:g}\n      detection: {{range_at_10_percent_m: "
        f"{MAX_RANGE_M / 2:g}}}\n",
    )
    return beside


def _ouster(file: Path, content: Any) -> BeamTable:
    """Reads the metadata of firmware 1 to 3, whose keys are nested in newer versions."""
    inner = content.get("beam_intrinsics", content) if isinstance(content, dict) else {}
    altitude, azimuth = inner.get("beam_altitude_angles"), inner.get("beam_azimuth_angles")
    if not isinstance(altitude, list) or not isinstance(azimuth, list):
        raise FormatError(
            f"{file}: expected Ouster's beam_altitude_angles and beam_azimuth_angles, got "
            f"{shown(content)}"
        )
    if len(altitude) != len(azimuth):
        raise FormatError(
            f"{file}: beam_azimuth_angles: expected {len(altitude)} angles, as in "
            f"beam_altitude_angles, got {len(azimuth)}"
        )
    layout = content.get("lidar_data_format", content.get("data_format", {})) or {}
    mode = content.get("lidar_mode") or (content.get("config_params") or {}).get("lidar_mode")
    match = re.fullmatch(r"(\d+)x(\d+)", str(mode))
    columns = layout.get("columns_per_frame") or (int(match[1]) if match else None)
    model = content.get("prod_line") or (content.get("sensor_info") or {}).get("prod_line")
    beams = [(number(file, e), number(file, a)) for e, a in zip(altitude, azimuth, strict=True)]
    rate = float(match[2]) if match else 10.0
    return BeamTable(
        "Ouster", str(model or "Ouster"), beams, int(columns) if columns else None, rate
    )


def _velodyne_yaml(file: Path, content: Any) -> BeamTable:
    lasers = content.get("lasers") if isinstance(content, dict) else None
    if not isinstance(lasers, list):
        raise FormatError(f"{file}: expected Velodyne's key 'lasers', got {shown(content)}")
    beams = []
    for i, laser in enumerate(lasers):
        if not isinstance(laser, dict) or "vert_correction" not in laser:
            raise FormatError(f"{file}: lasers: {i}: expected the key vert_correction, got none")
        angles = (laser["vert_correction"], -number(file, laser.get("rot_correction", 0)))
        beams.append(tuple(math.degrees(number(file, angle)) for angle in angles))
    largest = max((abs(e) for e, _ in beams), default=0.0)
    if len(beams) > 1 and largest < 0.03:
        raise FormatError(
            f"{file}: vert_correction: expected angles in radians, got angles that are at most "
            f"{largest:.2g} degrees after conversion; check the unit"
        )
    return BeamTable("Velodyne", "Velodyne", [(e, a) for e, a in beams])


def _velodyne_xml(file: Path, root: ElementTree.Element) -> BeamTable:
    beams = []
    for item in root.iter("px"):
        words = {key: item.findtext(key) for key in ("vertCorrection_", "rotCorrection_")}
        if None not in words.values():
            beams.append(
                (float(words["vertCorrection_"] or 0), -float(words["rotCorrection_"] or 0))
            )
    enabled = [int(item.text or 0) for item in root.findall(".//enabled_/item")]
    if not beams:
        raise FormatError(
            f"{file}: expected Velodyne's elements <vertCorrection_> and <rotCorrection_>, got "
            f"none in <{root.tag}>"
        )
    lit = sum(enabled) if enabled else len(beams)
    return BeamTable("Velodyne", "Velodyne", beams[: lit or len(beams)])


def _columns(file: Path, text: str) -> BeamTable:
    rows = _cells(text)
    head = [word.lower() for word in rows[0][1]] if rows else []
    joined = " ".join(head)
    if "elevation" in joined and "azimuth" in joined:
        values = _numbers(file, rows, ("elevation", "azimuth"))
        return BeamTable("Hesai", "Hesai", [(elevation, azimuth) for elevation, azimuth in values])
    if "zenith" in joined:
        values = _numbers(file, rows, ("^t|time", "azimuth", "zenith"))
        rays = [(azimuth, 90 - zenith, t) for t, azimuth, zenith in values]
        return BeamTable("Livox", "Livox", [], rays=rays)
    if head and all(map(_is_number, head)) and len(head) == 2:
        values = _numbers(file, [(0, ["elevation", "azimuth"]), *rows], ("elevation", "azimuth"))
        beams = [(elevation, azimuth) for elevation, azimuth in values]
        return BeamTable("RoboSense", "RoboSense", beams)
    raise FormatError(
        f"{file}: expected a table of Hesai (Laser id, Elevation, Azimuth), RoboSense (two columns "
        f"of numbers) or Livox (time, azimuth, zenith), got '{' '.join(head)[:60]}'"
    )


def _cells(text: str) -> list[tuple[int, list[str]]]:
    """Returns the line number and the cells of each line that is not empty.

    The first line decides the separator of all lines: a semicolon, a tab, a comma, or else blanks.
    If the separator is not a comma, a comma in a number is a decimal point.
    """
    lines = [(n, line) for n, line in enumerate(text.splitlines(), start=1) if line.strip()]
    separator = next((sign for sign in ";\t," if lines and sign in lines[0][1]), None)
    rows = []
    for line_number, line in lines:
        cells = [cell.strip(' "') for cell in line.split(separator)]
        if separator != ",":
            cells = [re.sub(r"^([+-]?[0-9]*),([0-9]+)$", r"\1.\2", cell) for cell in cells]
        rows.append((line_number, cells))
    return rows


def _numbers(
    file: Path, rows: list[tuple[int, list[str]]], columns: tuple[str, ...]
) -> list[list[float]]:
    """Returns the numbers in the columns whose headers match patterns, in each row with numbers.

    The first row is the header. Rows without a number, such as units or a checksum, are left out.
    Raises FormatError with the line for a missing column, and for a row with more or fewer cells
    than the header.
    """
    (line, words), *others = rows
    at = []
    for column in columns:
        fitting = [i for i, word in enumerate(words) if re.search(column, word.lower())]
        if not fitting:
            name = column.rpartition("|")[2]
            raise FormatError(
                f"{file}:{line}: expected a column with '{name}', got {', '.join(words)[:100]}"
            )
        at.append(fitting[0])
    values = []
    for line, cells in others:
        if not any(map(_is_number, cells)):
            continue
        if len(cells) != len(words):
            raise FormatError(
                f"{file}:{line}: expected {len(words)} columns, got {len(cells)}; if commas "
                "separate the columns, write numbers with a decimal point"
            )
        values.append([number(f"{file}:{line}: {words[i]}", cells[i]) for i in at])
    return values


def _is_number(word: str) -> bool:
    try:
        return math.isfinite(float(word))
    except ValueError:
        return False
