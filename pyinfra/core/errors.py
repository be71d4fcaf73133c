"""Errors that a user can mend: wrong input, with the file, line and key where there are some."""


class Error(ValueError):
    """A wrong argument, file or configuration; the message says what was expected."""


class FormatError(Error):
    """A file holds something else than its format allows: `file:line: found, allowed`."""


class ConfigError(Error):
    """A wrong configuration: `file:line: key: found, allowed`."""


def missing(package: str | None, extra: str) -> ImportError:
    """The error for a package that is not installed."""
    return ImportError(
        f"found no package '{package}', it comes with: pip install 'infrasim[{extra}]'"
    )
