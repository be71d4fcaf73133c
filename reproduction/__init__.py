"""The study: repeats and tests the paper's results, and makes the tables of the documentation.

Run it from the root of a checkout as `python -m reproduction COMMAND ...`. No wheel contains it.
"""

import argparse
from pathlib import Path

from pyinfra.core.version import __version__, machine

ROOT = Path(__file__).resolve().parent.parent
RECORDED = ROOT / "results"  # committed measurements


def add_out(
    parser: argparse.ArgumentParser, name: str = "", option: str = "--out", recorded: str = ""
) -> None:
    """Adds the option that names the output, which by default replaces no recorded measurement.

    name: file in out/; empty for a command that writes several files into a folder. recorded: where
    the output is committed, by default results/NAME. Parsing makes the folder of the output, so
    that a wrong path is an error before anything is measured.
    """

    def path(text: str) -> Path:
        out = Path(text)
        try:
            (out.parent if name else out).mkdir(parents=True, exist_ok=True)
        except OSError as error:
            reason = f"expected a path that can be written, got {text}: {error.strerror}"
            raise argparse.ArgumentTypeError(reason) from error
        return out

    recorded = recorded or f"results/{name}"
    parser.add_argument(
        option,
        type=path,
        default=str(ROOT / "out" / name),
        help=f"output {'file' if name else 'folder'}; default: out/{name}. To record the "
        f"measurement: {option} {recorded}",
    )


def provenance(command: str) -> dict[str, str]:
    """Returns the columns that record a row's origin: version, machine and command.

    command: name of the command with the options that affect the result.
    """
    made_by = f"python -m reproduction {command}"
    return {"version": __version__, "machine": machine(), "command": made_by}
