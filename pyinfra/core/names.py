"""Finds files that the package ships by name. For an unknown name, suggests similar names."""

import difflib
import os
from collections.abc import Collection, Iterable, Sequence
from pathlib import Path

from pyinfra.core.errors import Error

StrPath = str | os.PathLike[str]


def path_of(value: object, argument: str) -> Path:
    """Converts an argument to a Path. Raises Error if it is neither a text nor a path."""
    if not isinstance(value, (str, os.PathLike)):
        raise Error(f"{argument}: expected a name or a path, got {type(value).__name__}")
    check_utf8(str(os.fspath(value)), argument)
    return Path(os.fspath(value))


def check_utf8(text: str, argument: str) -> None:
    """Raises Error for a text that cannot be written to a file or a page in UTF-8."""
    try:
        text.encode()
    except UnicodeEncodeError:
        shown = text.encode(errors="backslashreplace").decode()
        raise Error(f"{argument}: expected a text in UTF-8, got '{shown}'") from None


def file_or_name(word: StrPath, files: dict[str, Path], argument: str) -> Path:
    """Returns the shipped file with a given name, or the given file itself.

    Parameters
    ----------
    word : a path, or a key of `files`
    files : maps each name to its file
    argument : name of the caller's argument, for the message

    Raises
    ------
    Error : if `word` is neither a file nor a key; the message suggests similar keys
    """
    text = str(path_of(word, argument)) if not isinstance(word, str) else word
    if text in files:
        return files[text]
    path = Path(text)
    if path.is_file():
        return path
    raise Error(
        f"{argument}: expected a file or a name from the package, got '{text}'"
        f"{suggestion(path.stem, files)}"
    )


def check_name(
    word: str, names: Collection[str], argument: str, expected: str = "a known name"
) -> None:
    """Raises Error unless `word` is one of the names. The message suggests similar names."""
    if word not in names:
        raise Error(f"{argument}: expected {expected}, got '{word}'{suggestion(word, names)}")


def repeated(names: Sequence[str]) -> str:
    """Returns the first name that occurs twice; empty if all names differ."""
    return next((name for name in names if names.count(name) > 1), "")


def suggestion(word: str, names: Iterable[str]) -> str:
    """Returns a text such as `; did you mean 'highway'?`, or all names if none is similar."""
    names = sorted(names)
    as_written = {name.casefold(): name for name in reversed(names)}
    near = difflib.get_close_matches(word.casefold(), as_written, n=3, cutoff=0.6)
    near = [as_written[name] for name in near]
    if near:
        return "; did you mean " + " or ".join(f"'{name}'" for name in near) + "?"
    return f"; names: {', '.join(names)}" if names else ""
