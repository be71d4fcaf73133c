"""Rewrites CSV files of version 0.3 with the current names of columns, values and options.

Numbers keep every digit. `*draws.csv` becomes `*replicates.csv`.
"""

import csv
import re
from collections.abc import Sequence
from pathlib import Path

from pyinfra.core.files import replacing
from pyinfra.formats.csv_table import read_words
from reproduction.arguments import command

OPTIONS = {  # replaced option names in the column `command`
    r"--dials\b": "--severities",
    r"--draws\b": "--replicates",
    r"--stressors seam\b": "--stressors cut_angle",
}


def rewrite(file: Path) -> Path:
    """Rewrites one file and returns its new name. Raises Error if the file is not a table."""
    table = read_words(file)
    if "command" in table:
        table["command"] = table.command.replace(OPTIONS, regex=True)
    current = file.with_name(re.sub(r"draws\.csv$", "replicates.csv", file.name))
    with replacing(current) as beside, beside.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(table.columns)
        writer.writerows(table.itertuples(index=False))
    if current != file:
        file.unlink()
    return current


@command
def main(files: Sequence[Path]) -> None:
    """
    Parameters
    ----------
    files : CSV files
    """
    for file in files:
        print(rewrite(file))
