"""Reads SUMO's floating car data, which are front bumper positions per time step.

The file is XML, plain or compressed as .gz.
"""

import gzip
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, cast
from xml.etree import ElementTree

import numpy as np

from pyinfra.core.arrays import FloatArray
from pyinfra.core.errors import FormatError
from pyinfra.formats.csv_table import numbers, read_words
from pyinfra.scenes.maps.lane_map import number_or_nan

MOST_OBJECTS = 100_000  # maximum number of objects per file


@dataclass(frozen=True)
class Recorded:
    """The rows of one object in a file.

    `rows` (n, 5) are t, x, y, z, heading (rad). The heading is NaN if the file has no angle.
    `speeds` (n,) are in m/s, and NaN if the file has no speed. `kind` is vehicle or person.
    """

    name: str
    type_name: str
    rows: FloatArray
    speeds: FloatArray
    kind: str = "vehicle"


def is_fcd_csv(file: Path) -> bool:
    """Returns whether a file is SUMO's floating car data as a table."""
    if not file.is_file():
        return False
    with file.open("rb") as stream:
        return b"timestep_time" in stream.readline(10_000)


def _read_csv(file: Path) -> list[Recorded]:
    """Reads the table that SUMO's xml2csv.py and SUMO itself write."""
    table = read_words(file, ";")
    out = []
    for kind in ("vehicle", "person"):
        columns = {key: f"{kind}_{key}" for key in ("id", "type", "x", "y", "z", "angle", "speed")}
        if columns["id"] not in table or not {columns["x"], columns["y"]} <= set(table.columns):
            continue
        rows = table[table[columns["id"]] != ""]
        values = {
            key: numbers(file, rows[columns[key]]).to_numpy(float)
            if columns[key] in rows
            else np.full(len(rows), np.nan if key in ("angle", "speed") else 0.0)
            for key in ("x", "y", "z", "angle", "speed")
        }
        t = numbers(file, rows["timestep_time"]).to_numpy(float)
        heading = np.radians(90 - values["angle"])
        states = np.column_stack([t, values["x"], values["y"], values["z"], heading])
        wrong = ~np.isfinite(states[:, :4]).all(axis=1) | (np.abs(states[:, :4]) > 1e8).any(axis=1)
        if wrong.any():
            line = int(rows.index[int(wrong.argmax())]) + 2
            got = ", ".join(f"{value:g}" for value in states[int(wrong.argmax()), :3])
            raise FormatError(f"{file}:{line}: expected time, x and y up to 1e8, got {got}")
        for name, of_name in rows.groupby(columns["id"], sort=False):
            at = rows.index.get_indexer(of_name.index)
            if (np.diff(states[at, 0]) <= 0).any():
                back = int(np.flatnonzero(np.diff(states[at, 0]) <= 0)[0])
                before, time = states[at[back : back + 2], 0]
                raise FormatError(
                    f"{file}: {kind} {name}: expected ascending times, got {time:g} after "
                    f"{before:g}"
                )
            type_name = str(of_name[columns["type"]].iloc[0]) if columns["type"] in rows else ""
            out.append(Recorded(str(name), type_name, states[at], values["speed"][at], kind))
    if not out:
        raise FormatError(
            f"{file}: expected rows with vehicle_id, vehicle_x, vehicle_y or person_id, person_x, "
            f"person_y, got no such row in the columns {', '.join(table)[:200]}"
        )
    return out


def read_fcd(file: Path) -> list[Recorded]:
    """Reads all objects, in the order of their first rows. Raises FormatError, OSError."""
    if is_fcd_csv(file):
        return _read_csv(file)
    rows: dict[tuple[str, str], list[tuple[float, ...]]] = {}  # maps kind and id to rows
    types: dict[tuple[str, str], str] = {}
    try:
        with _opened(file) as stream:
            for t, element in _objects(stream, file):
                name = element.get("id", "")
                key = element.tag, name
                if key not in rows and len(rows) == MOST_OBJECTS:
                    raise FormatError(f"{file}: expected at most {MOST_OBJECTS} objects, got more")
                types.setdefault(key, element.get("type", ""))
                rows.setdefault(key, []).append((t, *_state(file, t, name, element)))
    except ElementTree.ParseError as error:
        raise FormatError(
            f"{file}: expected SUMO's fcd-export, got broken XML ({error})"
        ) from error
    except (gzip.BadGzipFile, EOFError, zlib.error) as error:
        raise FormatError(
            f"{file}: expected a complete .gz file, got a damaged file ({error})"
        ) from error
    if not rows:
        raise FormatError(f"{file}: expected one or more vehicles or people, got none")
    return [
        Recorded(key[1], types[key], np.array(values)[:, :5], np.array(values)[:, 5], key[0])
        for key, values in rows.items()
    ]


def _opened(file: Path) -> BinaryIO:
    return cast(BinaryIO, gzip.open(file, "rb")) if file.suffix == ".gz" else file.open("rb")


def _objects(stream: BinaryIO, file: Path) -> Iterator[tuple[float, ElementTree.Element]]:
    """Yields each element of a vehicle or person, with the time of the step that contains it."""
    before, step = -np.inf, 0
    root: ElementTree.Element | None = None
    for event, element in ElementTree.iterparse(stream, events=("start", "end")):
        if root is None:
            root = element
            if element.tag != "fcd-export":
                raise FormatError(f"{file}: expected <fcd-export>, got <{element.tag[:40]}>")
        if event == "end" and element.tag == "timestep":
            step += 1
            t, where = number_or_nan(element.get("time")), f"{file}: timestep {step}: time"
            if not np.isfinite(t) or abs(t) > 1e8:
                raise FormatError(
                    f"{where}: expected seconds from -1e8 to 1e8, got {element.get('time')!r}"
                )
            if t <= before:
                raise FormatError(f"{where}: expected above {before:g}, got {t:g}")
            before = t
            for child in element:
                if child.tag in ("vehicle", "person"):
                    yield t, child
            root.clear()


def _state(
    file: Path, t: float, name: str, element: ElementTree.Element
) -> tuple[float, float, float, float, float]:
    """Returns x, y, z, heading and speed of an element. z, angle and speed are optional."""
    if not name:
        raise FormatError(f"{file}: time {t:g}: expected an id for each <{element.tag}>, got none")
    x, y = (number_or_nan(element.get(key)) for key in ("x", "y"))
    z, angle = (number_or_nan(element.get(key, "0")) for key in ("z", "angle"))
    for key, value in (("x", x), ("y", y), ("z", z), ("angle", angle)):
        if not np.isfinite(value) or abs(value) > 1e7:
            raise FormatError(
                f"{file}: time {t:g}: {name}: {key}: expected a number, got {element.get(key)!r}"
            )
    # SUMO's angle counts clockwise from north.
    heading = np.nan if element.get("angle") is None else np.radians(90 - angle)
    return x, y, z, heading, number_or_nan(element.get("speed"))
