"""Files that this process writes for arguments in memory, and removes when it ends."""

import atexit
import os
import shutil
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path

_FILES: set[Path] = set()


def own_file(name: str, write: Callable[[Path], object]) -> Path:
    """Returns the path of this process's file `name`. If it does not exist, `write` writes it."""
    file = Path(tempfile.gettempdir()) / f"pyinfra_{os.getpid()}" / name
    _put(file, write)
    return file


def named_in(text: str) -> dict[Path, bytes]:
    """Maps the files of this process whose paths are in a text to their content."""
    return {file: file.read_bytes() for file in _FILES if str(file) in text}


def put(files: Mapping[Path, bytes]) -> None:
    """Writes files that `named_in` returned in another process, unless they exist."""
    for file, content in files.items():
        _put(file, lambda path, content=content: path.write_bytes(content))  # type: ignore[misc]


def _put(file: Path, write: Callable[[Path], object]) -> None:
    if not file.parent.is_dir():
        file.parent.mkdir()
        atexit.register(shutil.rmtree, file.parent, ignore_errors=True)
    if not file.exists():
        write(file)
    _FILES.add(file)
