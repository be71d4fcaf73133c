"""Errors for wrong input, which the user can correct.

Their messages name file, line and key if these are known. Any other exception, except OSError, is
a bug in the package.
"""

import errno
import os
import traceback
from pathlib import Path
from typing import NoReturn


class Error(ValueError):
    """A wrong argument, file or configuration; the message states what was expected."""

    exit_code = 2  # exit code of a command that fails with this error


class FindingWarning(UserWarning):
    """Input that the library finds suspicious, such as headings in degrees."""


class FormatError(Error):
    """A file violates its format. The message is `file:line: expected ..., got ...`."""


class ConfigError(Error):
    """A wrong configuration. The message is `file:line: key: expected ..., got ...`."""


class MissingPackage(Error, ImportError):
    """An optional package is missing; the message names the extra that installs it."""


def missing(package: str | None, extra: str) -> MissingPackage:
    """Returns the error for a package that is not installed."""
    return MissingPackage(
        f"expected the package '{package}', got none; "
        f"install it with: pip install 'infrasim[{extra}]', or in a checkout: "
        f"scripts/setup.sh {extra}"
    )


def fail(file: Path, what: str, line: int | None = None) -> NoReturn:
    """Raises FormatError with the message `what`, after the file and, if given, the line."""
    raise FormatError(f"{file}:{line}: {what}" if line else f"{file}: {what}")


def not_found(path: Path, text: str) -> FileNotFoundError:
    """Returns the error for a missing path. If the path exists, `text` says what it lacks."""
    return FileNotFoundError(
        errno.ENOENT, text if path.exists() else os.strerror(errno.ENOENT), str(path)
    )


def check_exists(path: Path) -> None:
    """Raises FileNotFoundError for a missing path, so that later checks need not do so."""
    if not path.exists():
        raise not_found(path, "")


def refuse(*faults: tuple[object, str]) -> None:
    """Raises Error with the text of the first fault (condition, text) whose condition is true.

    All conditions and texts are evaluated before the first check, so they must be cheap and valid.
    """
    for is_fault, text in faults:
        if is_fault:
            raise Error(text)


def keep_traceback(error: BaseException, file: Path) -> None:
    """Writes the traceback of an error to a file, for failures that do not stop the run."""
    file.parent.mkdir(parents=True, exist_ok=True)
    text = "".join(traceback.format_exception(error))
    file.write_text(text, encoding="utf-8", errors="backslashreplace")
