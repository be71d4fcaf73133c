"""Label files with lines `x y z dx dy dz heading category`, in the LiDAR frame, metres, radians.

Lines may also end with id and visibility; -1 means that they are unknown.
"""

from pathlib import Path

import numpy as np

from pyinfra.core.arrays import FloatArray, IntArray, NameArray
from pyinfra.core.files import write
from pyinfra.exchange.recording import Boxes
from pyinfra.formats.kitti.read import BOX_RULES
from pyinfra.formats.text_table import NamedRows, between, lines_of

COLUMNS = "x y z dx dy dz heading category".split()
KNOWN = ["id", "visibility"]


def read_boxes(file: Path) -> Boxes:
    """Reads the boxes of a label file. Raises FormatError with file and line."""
    rows = {i: line.split() for i, line in enumerate(lines_of(file), start=1) if line.strip()}
    known = bool(rows) and all(len(row) == len(COLUMNS) + len(KNOWN) for row in rows.values())
    columns = [*COLUMNS, *KNOWN] if known else COLUMNS
    table = NamedRows(file, list(rows), list(rows.values()), columns, "category")
    table.check(BOX_RULES)
    if not known:
        return Boxes(table.names, table.values)
    table.check((between(["id"], -1, 2**31 - 1, whole=True), between(["visibility"], -1, 1)))
    ids, visibility = table["id"].astype(np.int64), table["visibility"]
    for i, number in enumerate(ids.tolist()):
        if number >= 0 and number in ids[:i]:
            table.fail(i, f"{number} twice", "each id once, or -1 for an unknown id", "id")
    return Boxes(table.names, table.values[:, :7], ids, visibility)


def write_boxes(
    file: Path,
    names: NameArray,
    boxes: FloatArray,
    known: tuple[IntArray, FloatArray] | None = None,
) -> None:
    """Writes names (k,) and boxes (k, 7), with six decimals.

    known: ids and visibility, (k,) each; -1 if they are unknown.
    """
    ends = [""] * len(names)
    if known is not None:
        ends = [f" {number} {share:.4f}" for number, share in zip(*known, strict=True)]
    lines = [
        " ".join([*(f"{value:.6f}" for value in box), str(name)]) + f"{end}\n"
        for name, box, end in zip(names, boxes, ends, strict=True)
    ]
    write(file, "".join(lines))
