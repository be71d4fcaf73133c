"""Reads boxes from a CSV file whose columns can have any names.

A quantity has a key, such as `length`. Usual column names of each key are recognised; a user's
mapping of keys to columns takes precedence. All boxes are in the LiDAR frame, in metres.
"""

import csv
import io
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

import numpy as np

from pyinfra.core.arrays import FloatArray, IntArray, NameArray
from pyinfra.core.errors import FormatError
from pyinfra.formats.text_table import MOST_RADIANS, ColumnRule, NumberRows, between, lines_of

# Accepted column names for each key. They are compared in lower case and without signs other than
# letters and digits.
NAMES: dict[str, tuple[str, ...]] = {
    "frame": ("frame", "frameid", "framenumber", "frameindex", "frameidx", "frameno"),
    "class": (
        *("class", "type", "label", "category", "classname", "objtype", "objecttype"),
        *("labelname", "objectclass", "name", "objectname"),
    ),
    "x": ("x", "cx", "centerx", "centrex", "xcenter", "xcentre", "posx", "positionx", "xm", "tx"),
    "y": ("y", "cy", "centery", "centrey", "ycenter", "ycentre", "posy", "positiony", "ym", "ty"),
    "z": ("z", "cz", "centerz", "centrez", "zcenter", "zcentre", "posz", "positionz", "zm", "tz"),
    "z_bottom": ("zbottom", "bottomz", "zground", "zmin"),
    "length": ("length", "l", "dx", "len", "lengthm", "sizex", "dimx", "boxlength", "scalex"),
    "width": ("width", "w", "dy", "wid", "widthm", "sizey", "dimy", "boxwidth", "scaley"),
    "height": ("height", "h", "dz", "heightm", "sizez", "dimz", "boxheight", "scalez"),
    "yaw": ("yaw", "heading", "yawrad", "headingrad", "rotz", "rotationz", "rz", "theta"),
    "yaw_deg": ("yawdeg", "headingdeg", "yawdegrees", "headingdegrees", "rotzdeg", "thetadeg"),
    "score": ("score", "confidence", "conf", "probability", "prob"),
    "id": ("id", "trackid", "objectid", "objid", "instanceid"),
}
NUMBERS = ("x", "y", "z", "length", "width", "height", "yaw")  # keys of a box, in column order
SIZES = ("length", "width", "height")
ALTERNATIVES = {"z": "z_bottom", "yaw": "yaw_deg"}  # keys that can replace z and yaw
FARTHEST_M, MOST_M = 1e4, 1000.0
Frame = TypeVar("Frame", bound=int | str)  # the number of a frame, or the name of its cloud


@dataclass(frozen=True, eq=False)
class BoxTable:
    """The n boxes of a file, in its order."""

    frames: list[str] | None  # cells of the column `frame`; None if the file has no such column
    names: NameArray  # (n,) classes; `vehicle` if the file has no class column
    boxes: FloatArray  # (n, 7) x y z dx dy dz heading, z of the centre
    scores: FloatArray | None  # (n,) scores; None if the file has no score column
    tracks: list[str] | None  # cells of the column `id`; None if the file has no such column
    lines: list[int]  # line number of each box in the file
    columns: dict[str, str]  # maps each key to the name of its column
    unread: list[str]  # names of the columns that are not read


def read_box_csv(file: Path, columns: Mapping[str, str] | None = None) -> BoxTable:
    """Reads a file. `columns` maps keys of NAMES to the columns of the file.

    Raises FormatError with file, line and column.
    """
    rows, lines, header = _cells(file)
    column_of = _columns(file, header, columns or {})
    at = {key: header.index(name) for key, name in column_of.items()}
    keys = [key for key in column_of if key not in ("frame", "class", "id")]
    cells = [[row[at[key]] for key in keys] for row in rows]
    table = NumberRows(file, lines, cells, [column_of[key] for key in keys])
    table.check([_metres([column_of[key] for key in SIZES], 0.001, MOST_M)])
    positions = [column_of[key] for key in ("x", "y", "z", "z_bottom") if key in column_of]
    table.check([_metres(positions, -FARTHEST_M, FARTHEST_M)])
    values = {key: table[column_of[key]] for key in keys}
    if "z" not in values:
        values["z"] = values["z_bottom"] + values["height"] / 2
    if "yaw" not in values:
        values["yaw"] = np.radians(values["yaw_deg"])
    elif len(rows) > 0 and (most := float(np.abs(values["yaw"]).max())) > MOST_RADIANS:
        raise FormatError(
            f"{file}: {column_of['yaw']}: expected radians, -2 pi to 2 pi, got {most:g}; if the "
            f"column has degrees, map it as `yaw_deg={column_of['yaw']}`"
        )
    names = [row[at["class"]].strip() or "unknown" for row in rows] if "class" in at else None
    return BoxTable(
        frames=[row[at["frame"]].strip() for row in rows] if "frame" in at else None,
        names=np.array(names or ["vehicle"] * len(rows), dtype=np.str_),
        boxes=np.stack([values[key] for key in NUMBERS], axis=1),
        scores=values.get("score"),
        tracks=[row[at["id"]].strip() for row in rows] if "id" in at else None,
        lines=lines,
        columns=column_of,
        unread=[name for name in header if name not in column_of.values()],
    )


def rows_of_frames(
    file: Path, table: BoxTable, names: Sequence[tuple[str, Frame]]
) -> dict[Frame, IntArray]:
    """Returns the rows (k,) of each frame that has boxes.

    names: pairs of a name and its frame; of two frames with the same name, the last one counts. A
    cell of the column `frame` is a name, with or without ending and folder, or a number. Raises
    FormatError for a table without this column, an unknown frame, and a number of several frames.
    """
    if table.frames is None:
        raise FormatError(
            f"{file}:1: expected a column `frame` with names or numbers of clouds, got the columns "
            f"{', '.join(table.columns.values())}; frame=COLUMN names this column"
        )
    frames = dict(names)
    numbered: dict[int, dict[Frame, str]] = {}
    for name, frame in names:
        if name.isdecimal():
            numbered.setdefault(int(name), {}).setdefault(frame, name)
    rows: dict[Frame, list[int]] = {}
    for i, word in enumerate(table.frames):
        at = f"{file}:{table.lines[i]}: {table.columns['frame']}"
        whole = word.removesuffix(".0")
        is_number = whole.isdecimal() and len(whole) < 20
        fitting = numbered.get(int(whole), {}) if is_number else {}
        if len(fitting) > 1:
            meanings = " and ".join(f"frame {frame} ('{n}')" for frame, n in fitting.items())
            raise FormatError(
                f"{at}: expected a number that fits one frame, got '{word[:40]}', which fits "
                f"{meanings}; write names of clouds with their ending, such as {word}.pcd"
            )
        path = Path(word)
        words = (word, path.name, path.name.removesuffix(path.suffix))
        found = [*(frames[w] for w in words if w in frames), *fitting]
        if not found:
            example = f", such as {names[0][0]}" if names else ""
            raise FormatError(
                f"{at}: expected the name or number of a cloud{example}, got '{word[:40]}'"
            )
        rows.setdefault(found[0], []).append(i)
    return {frame: np.array(values, dtype=np.int64) for frame, values in rows.items()}


def parse_columns(words: Sequence[str]) -> dict[str, str]:
    """Parses texts KEY=COLUMN. Raises FormatError for another text or key."""
    columns = {}
    for word in words:
        key, equals, name = word.partition("=")
        if not equals or not name or key not in NAMES:
            keys = ", ".join(NAMES)
            raise FormatError(f"expected KEY=COLUMN with KEY one of {keys}; got '{word}'")
        columns[key] = name
    return columns


def _cells(file: Path) -> tuple[list[list[str]], list[int], list[str]]:
    """Returns the cells of all rows, the line of each row, and the names of the columns."""
    text = lines_of(file)
    first = next((line for line in text if line.strip()), "")
    separator = next((sign for sign in (";", "\t", ",") if sign in first), ",")
    reader = csv.reader(io.StringIO("\n".join(text)), delimiter=separator, skipinitialspace=True)
    rows, lines, header = [], [], list[str]()
    try:
        for row in reader:
            if not row or not any(cell.strip() for cell in row):
                continue
            if not header:
                header = [cell.strip() for cell in row]
            elif len(row) != len(header):
                raise FormatError(
                    f"{file}:{reader.line_num}: expected {len(header)} columns, got {len(row)}"
                )
            else:
                rows.append(row)
                lines.append(reader.line_num)
    except csv.Error as error:
        raise FormatError(f"{file}:{reader.line_num}: {error}") from None
    return rows, lines, header


def _columns(file: Path, header: Sequence[str], given: Mapping[str, str]) -> dict[str, str]:
    """Returns the column of each key. Raises FormatError for a missing or ambiguous column."""
    got = ", ".join(header)[:300] or "an empty file"
    found = {}
    for key, name in given.items():
        if key not in NAMES or header.count(name) != 1:
            raise FormatError(f"{file}:1: expected one column '{name}' for `{key}`, got {got}")
        found[key] = name
    free = [name for name in header if name not in given.values()]
    for key, names in NAMES.items():
        if key in found or any(ALTERNATIVES.get(k) == key for k in given):
            continue
        fitting = [name for name in free if re.sub(r"[^a-z0-9]", "", name.lower()) in names]
        if len(fitting) > 1:
            raise FormatError(
                f"{file}:1: expected one column for `{key}`, got {', '.join(fitting)}; "
                f"`{key}={fitting[0]}` selects one"
            )
        if fitting and not (key in ALTERNATIVES and ALTERNATIVES[key] in given):
            found[key] = fitting[0]
    for key, other in ALTERNATIVES.items():
        if key in found and other in found:
            del found[other]
    missing = [k for k in NUMBERS if k not in found and ALTERNATIVES.get(k) not in found]
    if missing:
        raise FormatError(
            f"{file}:1: expected columns for {', '.join(missing)}, got {got}; KEY=COLUMN names the "
            f"column of a key, such as {missing[0]}=NAME. Keys are {', '.join(NAMES)}"
        )
    return found


def _metres(columns: Sequence[str], low: float, high: float) -> ColumnRule:
    rule = between(columns, low, high)
    return replace(rule, allowed=f"{rule.allowed} m")
