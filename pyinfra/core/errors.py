"""Errors that a user can mend: wrong input, with the file, line and key where there are some.

Any other exception but OSError is a bug of the package.
"""

import traceback
from pathlib import Path


class Error(ValueError):
    """A wrong argument, file or configuration; the message says what was expected."""

    exit_code = 2  # of a command that ends with it


class FormatError(Error):
    """A file holds something else than its format allows: `file:line: found, allowed`."""


class ConfigError(Error):
    """A wrong configuration: `file:line: key: found, allowed`."""


class MissingPackage(Error, ImportError):
    """A package that an extra of the installation brings; the message says which."""


def missing(package: str | None, extra: str) -> MissingPackage:
    """The error for a package that is not installed."""
    return MissingPackage(
        f"found no package '{package}', it comes with: pip install 'infrasim[{extra}]'"
    )


def keep_traceback(error: BaseException, file: Path) -> None:
    """Writes where an error comes from, for a failure that others do not wait for."""
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text("".join(traceback.format_exception(error)), errors="backslashreplace")
