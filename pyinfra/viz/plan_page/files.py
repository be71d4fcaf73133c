"""The files of a plan's page in the folder of the plan."""

from pathlib import Path

DATA_FILE = "page.json"
PAGE_FILE = "plan.html"


def is_plan(folder: Path) -> bool:
    """Returns whether a folder is the output of `pyinfra plan`."""
    return (folder / DATA_FILE).is_file()
