"""The study: what repeats and tests the paper's results, and what makes the tables of the docs.

Run from the root of a checkout as `python -m reproduction COMMAND ...`; no part of the wheel.
"""

from pathlib import Path

from pyinfra.core.version import __version__, machine

ROOT = Path(__file__).resolve().parent.parent


def provenance(command: str) -> dict[str, str]:
    """The columns that say what made a row; command: its name and the options that decide."""
    made_by = f"python -m reproduction {command}"
    return {"version": __version__, "machine": machine(), "command": made_by}
