"""Label files with lines `x y z dx dy dz heading category`, in the LiDAR frame, metres, radians."""

from __future__ import annotations

from pathlib import Path

from pyinfra.core.arrays import FloatArray, NameArray
from pyinfra.core.files import write
from pyinfra.exchange.recording import Boxes
from pyinfra.formats.kitti.read import BOX_RULES
from pyinfra.formats.text_table import NamedRows, lines_of

COLUMNS = "x y z dx dy dz heading category".split()


def read_boxes(file: Path) -> Boxes:
    """Reads the boxes of a label file. Raises FormatError with file and line."""
    rows = {i: line.split() for i, line in enumerate(lines_of(file), start=1) if line.strip()}
    table = NamedRows(file, list(rows), list(rows.values()), COLUMNS, "category")
    table.check(BOX_RULES)
    return Boxes(table.names, table.values)


def write_boxes(file: Path, names: NameArray, boxes: FloatArray) -> None:
    """Writes names (k,) and boxes (k, 7), with six decimals."""
    lines = [
        " ".join([*(f"{value:.6f}" for value in box), str(name)]) + "\n"
        for name, box in zip(names, boxes, strict=True)
    ]
    write(file, "".join(lines))
