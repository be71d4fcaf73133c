"""Scripts that complete the commands and options of `pyinfra` in a shell."""

import argparse
from pathlib import Path

from pyinfra.core.errors import Error, missing

SHELLS = ("bash", "zsh")


def completion_script(parser: argparse.ArgumentParser, shell: str) -> str:
    """Returns the completion script for a shell. It completes values that are paths to files.

    Raises Error for an unknown shell, and MissingPackage if shtab is not installed.
    """
    if shell not in SHELLS:
        raise Error(f"--completion: expected {' or '.join(SHELLS)}, got '{shell}'")
    try:
        import shtab
    except ModuleNotFoundError:
        raise missing("shtab", "completion") from None
    complete_files(parser, shtab.FILE)
    return str(shtab.complete(parser, shell=shell))


def complete_files(parser: argparse.ArgumentParser, how: object) -> None:
    """Marks the arguments whose values are paths, in a parser and in its subcommands."""
    for action in parser._actions:  # argparse has no public list of the actions
        if isinstance(action, argparse._SubParsersAction):
            for sub in action.choices.values():
                complete_files(sub, how)
        elif action.type is Path:
            action.complete = how  # type: ignore[attr-defined]
