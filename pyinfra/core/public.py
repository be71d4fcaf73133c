"""What every function of the public API does with files that it cannot find."""

from __future__ import annotations

import errno
import functools
import inspect
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeVar, cast

from pyinfra.core.errors import Error

F = TypeVar("F", bound=Callable[..., Any])
MENDABLE = {errno.ENOENT, errno.ENOTDIR, errno.EISDIR, errno.EEXIST, errno.EACCES, None}


class PathError(Error, OSError):
    """A file or folder of an argument that is not there, is another, or is in the way."""


def public(function: F) -> F:
    """The function, but a path that the user can mend is a PathError that names the argument.

    A full disk and the like stay OSError.
    """

    @functools.wraps(function)
    def call(*args: Any, **named: Any) -> Any:
        try:
            return function(*args, **named)
        except Error:
            raise
        except OSError as error:
            if error.errno not in MENDABLE:
                raise
            text = f"{error.filename}: {error.strerror}" if error.filename else str(error)
            given = inspect.signature(function).bind(*args, **named).arguments
            names = [name for name, path in _paths(given) if str(path) in text]
            raise PathError(": ".join([*names[:1], text])) from error

    return cast("F", call)


def _paths(given: dict[str, Any]) -> Iterator[tuple[str, Path]]:
    """The arguments that are paths, or lists of them, longest first."""
    found = []
    for name, value in given.items():
        values = value if isinstance(value, (list, tuple)) else [value]
        found += [(name, Path(v)) for v in values if isinstance(v, (str, os.PathLike)) and v]
    return iter(sorted(found, key=lambda pair: -len(str(pair[1]))))
