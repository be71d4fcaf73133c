"""The study: repeats and tests the paper's results, and makes the tables of the documentation.

Run it from the root of a checkout as `python -m reproduction COMMAND ...`. No wheel contains it.
"""

from pathlib import Path

from pyinfra.core.version import __version__, machine

ROOT = Path(__file__).resolve().parent.parent


def provenance(command: str) -> dict[str, str]:
    """Returns the columns that record a row's origin: version, machine and command.

    command: name of the command with the options that affect the result.
    """
    made_by = f"python -m reproduction {command}"
    return {"version": __version__, "machine": machine(), "command": made_by}
