"""Rewrites CSV files of version 0.3 with the current names of columns, values and options.

Numbers keep every digit. `*draws.csv` becomes `*replicates.csv`.
"""

import argparse
import csv
import re
from pathlib import Path

from pyinfra.core.files import replacing
from pyinfra.formats.csv_table import read_words

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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("files", nargs="+", type=Path, help="CSV files")
    for file in parser.parse_args().files:
        print(rewrite(file))
