"""Reads clouds as text with one point per line: .csv, .txt, .xyz, .asc and .pts files.

Columns have names in the first line; without names, they are x y z and intensity. Known names are
those of CloudCompare, VeloView and Livox Viewer.
"""

import re
import warnings
from pathlib import Path

import pandas as pd

from pyinfra.core.arrays import Records
from pyinfra.core.errors import FormatError
from pyinfra.exchange.record_clouds import read_clouds
from pyinfra.exchange.recording import Options, Recording, records_of

SUFFIXES = (".csv", ".txt", ".xyz", ".asc", ".pts")
# Names of x, y and z in other programs, for example `Points_m_XYZ:0` in VeloView.
AXES = {
    axis: (axis, f"{axis}_m", f"{axis}(m)", f"points_m_xyz:{i}", f"points:{i}", f"pos_{axis}")
    for i, axis in enumerate("xyz")
}
OTHER = {"laser_id": "ring", "adjustedtime": "time", "remission": "intensity"}
UNNAMED = ("x", "y", "z", "intensity")


def read(source: Path, options: Options) -> Recording:
    """Opens a file, or a folder of them. Reading a frame raises FormatError."""
    return read_clouds(source, SUFFIXES, read_csv, options)


def read_csv(file: Path) -> Records:
    """Reads a file into records (n,) with x, y, z and all other columns of numbers.

    Raises FormatError with the line.
    """
    with file.open("rb") as stream:
        head = stream.read(65536).decode("utf-8-sig", "replace")
    first = head.splitlines()[0] if head.strip() else ""
    separator = next((s for s in (";", "\t", ",") if s in first), r"\s+")
    if not first:
        raise FormatError(f"{file}:1: expected column names or a point, got an empty line")
    words = [w.strip().strip('"') for w in re.split(separator, first.lstrip("/# ").strip())]
    has_names = not all(map(_is_number, words))
    if not has_names and len(words) == 1:  # .pts files begin with the number of points
        raise FormatError(
            f"{file}:1: expected column names or the x, y and z of a point, got '{first[:40]}'"
        )
    names = _known(words) if has_names else list(UNNAMED[: len(words)])
    if len(set(names)) < len(names) or not {"x", "y", "z"} <= set(names):
        raise FormatError(
            f"{file}:1: expected columns named x, y and z once each, got {', '.join(words)[:200]}"
        )
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            table = pd.read_csv(
                file,
                sep=separator,
                header=None,
                names=names,
                usecols=range(len(names)),
                skiprows=int(has_names),
                encoding="utf-8-sig",
                encoding_errors="replace",
                index_col=False,
            )
    except (ValueError, pd.errors.ParserError, OverflowError) as error:
        raise FormatError(f"{file}: cannot be read as columns: {str(error)[:200]}") from None
    if table.empty:
        table = table.astype(float)  # pandas reads columns without values as objects
    numbers = [name for name in names if table[name].dtype.kind in "iuf"]
    for axis in "xyz":
        if axis not in numbers:
            values = pd.to_numeric(table[axis], errors="coerce")
            line = int(values.isna().to_numpy().argmax()) + 1 + has_names
            got = table[axis].iloc[line - 1 - has_names]
            raise FormatError(f"{file}:{line}: {axis}: expected a number, got '{str(got)[:40]}'")
    return records_of({name: table[name].to_numpy() for name in numbers})


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _known(words: list[str]) -> list[str]:
    """Returns column names in lower case; names of AXES and OTHER become the names used here."""
    names = [OTHER.get(word.lower(), word.lower()) for word in words]
    for axis, others in AXES.items():
        if axis not in names and (known := next((n for n in others if n in names), None)):
            names[names.index(known)] = axis
    return names
