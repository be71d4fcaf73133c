"""Scripts that complete the commands and options of `pyinfra` in a shell."""

import argparse
from pathlib import Path

from pyinfra.cli.parser import actions
from pyinfra.core.errors import Error, missing

SHELLS = ("bash", "zsh")


def completion_script(parser: argparse.ArgumentParser, shell: str) -> str:
    """Returns the completion script for a shell. The script also completes paths of files.

    Raises Error for an unknown shell, and MissingPackage if shtab is not installed.
    """
    if shell not in SHELLS:
        raise Error(f"--completion: expected {' or '.join(SHELLS)}, got '{shell}'")
    try:
        import shtab
    except ModuleNotFoundError:
        raise missing("shtab", "completion") from None
    for action in actions(parser):
        if action.type is Path:
            action.complete = shtab.FILE  # type: ignore[attr-defined]
    return str(shtab.complete(parser, shell=shell))
