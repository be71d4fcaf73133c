"""Messages of a command on stderr. Names of arguments are replaced by names of options."""

import argparse
import re
import shlex
import sys
import tempfile
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from pyinfra.cli.parser import actions
from pyinfra.core.errors import FindingWarning, keep_traceback
from pyinfra.core.version import __version__

Options = Mapping[str, str]  # maps an argument such as `height_m` to its option `--height-m`


def options_of(parser: argparse.ArgumentParser) -> dict[str, str]:
    """Maps each argument of a command and of its subcommands to its option."""
    names: dict[str, str] = {}
    for action in actions(parser):
        if action.option_strings:
            names[action.dest] = action.option_strings[-1]
        elif isinstance(action.metavar, str):
            names[action.dest] = action.metavar
    return names


def with_options(text: str, options: Options) -> str:
    """Returns a message of the library with option names in place of argument names.

    An argument name is replaced at the beginning of the message before a colon, as in `height_m:
    expected 0 to 100, got -3`, and in backquotes, as in "set `columns`".
    """
    text = re.sub(r"^(\w+)(?=: )", lambda m: options.get(m[1], m[1]), text)
    return re.sub(r"`(\w+)`", lambda m: options.get(m[1], m[0]), text)


def printable(text: str) -> str:
    """Returns a text as one line in which control characters are escaped."""
    line = " ".join(text.split())
    escaped = (c if c.isprintable() else c.encode("unicode_escape").decode() for c in line)
    return "".join(escaped)


def message_of(error: BaseException, options: Options | None = None) -> str:
    """Returns the message of an error as one line. That of an OSError begins with the path."""
    text = str(error) if str(error).strip() else type(error).__name__
    if isinstance(error, OSError) and error.filename is not None:
        text = f"{error.filename}: {error.strerror}"
    return printable(with_options(text, options or {}))


def warn(text: str, args: argparse.Namespace) -> None:
    """Prints a warning of the library."""
    print(f"pyinfra: warning: {with_options(text, args.options)}", file=sys.stderr)


def note(text: str, args: argparse.Namespace) -> None:
    """Prints a note of the library."""
    print(f"pyinfra: note: {with_options(text, args.options)}", file=sys.stderr)


def progress(line: str) -> None:
    """Prints a line of a benchmark's progress to stderr."""
    print(line, file=sys.stderr, flush=True)


def report_bug(error: Exception, words: Sequence[str]) -> str:
    """Saves the traceback of an internal error to a file, and returns the message to print."""
    text = f"internal error: {type(error).__name__}: {message_of(error)}"
    error.add_note(f"command: pyinfra {shlex.join(words)}")
    error.add_note(f"version: {__version__}, Python {sys.version.split()[0]}")
    try:
        with tempfile.NamedTemporaryFile(prefix="pyinfra_", suffix=".txt", delete=False) as file:
            keep_traceback(error, Path(file.name))
    except OSError as no_file:
        return f"{text}; no traceback was written: {message_of(no_file)}"
    return f"{text}; please report it with its traceback, which is in {file.name}"


@contextmanager
def printed_findings(args: argparse.Namespace) -> Iterator[None]:
    """Context manager that prints each FindingWarning of the library as the command's warning."""
    with warnings.catch_warnings():
        show = warnings.showwarning

        def printed(message: Warning | str, category: type[Warning], *rest: Any) -> None:
            if issubclass(category, FindingWarning):
                warn(str(message), args)
            else:
                show(message, category, *rest)

        warnings.showwarning = printed  # type: ignore[assignment]
        warnings.simplefilter("always", FindingWarning)
        yield
