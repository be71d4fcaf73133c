"""The decorator of public API functions. It checks arguments and names wrong paths."""

from __future__ import annotations

import errno
import functools
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeVar, cast

from pyinfra.core.arguments import Range, checked_call
from pyinfra.core.errors import Error
from pyinfra.core.files import regular_files_only

F = TypeVar("F", bound=Callable[..., Any])
CALLER = 3  # `stacklevel` with which a public function's warning shows the line of the user's call
MENDABLE = {errno.ENOENT, errno.ENOTDIR, errno.EISDIR, errno.EEXIST, errno.EACCES, None}


class PathError(Error, OSError):
    """The path in an argument is missing, of the wrong kind, not accessible, or exists already."""

    exit_code = 1  # exit code of a command, the same as for other errors of files

    def __new__(cls, *args: object) -> PathError:
        """Creates the error as an OSError, even if __init__ is not called (as by Dask)."""
        made = OSError.__new__(cls, *args)
        made.args = args
        return made


def public(**ranges: Range) -> Callable[[F], F]:
    """Returns a decorator that checks arguments, and names the argument of a wrong path.

    Arguments must fit the annotations of the function (`arguments.py`). ranges: the smallest and
    the largest allowed value of each numeric argument. Wrong paths raise a PathError. Other system
    errors, such as a full disk, stay OSError. FIFOs and devices in path arguments, and in their
    folders, are not opened.
    """
    return lambda function: _checked(function, ranges)


def _checked(function: F, ranges: dict[str, Range]) -> F:
    @functools.wraps(function)
    def call(*args: Any, **named: Any) -> Any:
        given = checked_call(function, args, named, ranges)
        try:
            with regular_files_only(path for _, path in _paths(given)):
                return function(**given)
        except Error:
            raise
        except OSError as error:
            if error.errno not in MENDABLE:
                raise
            text = f"{error.filename}: {error.strerror}" if error.filename else str(error)
            names = [name for name, path in _paths(given) if str(path) in text]
            raise PathError(": ".join([*names[:1], text])) from error

    return cast("F", call)


def _paths(given: dict[str, Any]) -> Iterator[tuple[str, Path]]:
    """Returns the argument name and the path of each path argument, the longest path first.

    Paths in lists are included.
    """
    paths = []
    for name, value in given.items():
        values = value if isinstance(value, (list, tuple)) else [value]
        paths += [(name, Path(v)) for v in values if isinstance(v, (str, os.PathLike)) and v]
    return iter(sorted(paths, key=lambda pair: -len(str(pair[1]))))
