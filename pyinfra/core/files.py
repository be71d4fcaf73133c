"""Atomic writing of files and folders, and locks between processes.

A file or folder is either complete or absent.
"""

import errno
import fcntl
import itertools
import os
import platform
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

_COUNT = itertools.count()


def _beside(path: Path) -> Path:
    """Returns a hidden path next to `path` that is unique to this process and call."""
    return path.with_name(f"{_prefix(path)}{os.getpid()}.{next(_COUNT)}.tmp")


def _prefix(path: Path) -> str:
    return f".{path.name[:100]}.{platform.node()}."  # file names are limited to 255 bytes


def _remove_leftovers(path: Path) -> None:
    """Removes hidden folders of `new_folder` left by processes of this machine that have died."""
    prefix = _prefix(path)
    for leftover in [p for p in path.parent.iterdir() if p.name.startswith(prefix)]:
        pid = leftover.name.removeprefix(prefix).split(".")[0]
        if pid.isdecimal() and not Path("/proc", pid).exists():
            shutil.rmtree(leftover, ignore_errors=True)


@contextmanager
def replacing(file: Path) -> Iterator[Path]:
    """Yields a hidden path to write to. The file at this path replaces `file` at the block's end.

    If the block raises, the new content is deleted and the old file stays. Each OSError, for
    example for a full disk, names `file`.
    """
    beside = _beside(file)
    try:
        with naming(file, beside):
            yield beside
            beside.replace(file)
    except BaseException:
        beside.unlink(missing_ok=True)
        raise


def write(file: Path, data: bytes | str) -> None:
    """Writes the data (a text as UTF-8) atomically; on an error the old file stays."""
    with replacing(file) as beside:
        beside.write_bytes(data.encode() if isinstance(data, str) else data)


@contextmanager
def new_folder(folder: Path) -> Iterator[Path]:
    """Yields a hidden folder to write to. It is renamed to `folder` when the block ends.

    If the block raises, the hidden folder is deleted. An OSError names the file or the folder.
    Raises FileExistsError if `folder` exists and is not an empty folder, at the start or at the
    end of the block.
    """
    exists = FileExistsError(f"{folder}: expected a new or an empty folder, got one with files")
    if folder.exists() and not (folder.is_dir() and not any(folder.iterdir())):
        raise exists
    folder.parent.mkdir(parents=True, exist_ok=True)
    _remove_leftovers(folder)
    beside = _beside(folder)
    try:
        with naming(folder, beside):
            beside.mkdir()
            yield beside
            try:
                beside.replace(folder)
            except OSError as error:
                if error.errno in (errno.ENOTEMPTY, errno.EEXIST, errno.ENOTDIR):
                    raise exists from error
                raise
    except BaseException:
        shutil.rmtree(beside, ignore_errors=True)
        raise


@contextmanager
def naming(path: Path, beside: Path | None = None) -> Iterator[None]:
    """Ensures that each OSError from the block names a file. An error without a name gets `path`.

    beside: the hidden path that will replace `path`. If an error names this path, or a file inside
    it, the name is changed to the final path.
    """
    try:
        yield
    except OSError as error:
        if error.errno is None:  # a library or this package raised it; the text may name the file
            if str(path.parent) in str(error):
                raise
            raise OSError(errno.EIO, str(error) or os.strerror(errno.EIO), str(path)) from error
        named = [Path(os.fsdecode(n)) for n in (error.filename2, error.filename) if n is not None]
        at = [path / n.relative_to(beside) for n in named if beside and n.is_relative_to(beside)]
        error.filename, error.filename2 = str([*at, *named[-1:], path][0]), None
        raise


@contextmanager
def held(file: Path, *, wait: bool, shared: bool = False) -> Iterator[bool]:
    """Yields whether this process holds a lock on the file.

    The lock is exclusive. With `shared`, several processes can hold it together, but none can hold
    it exclusively at the same time. With `wait`, the function waits for the lock. Without `wait`,
    it yields False at once if another process holds a lock that prevents this one. The lock is
    released at the end of the block, and when the process dies.
    """
    file.parent.mkdir(parents=True, exist_ok=True)
    with file.open("w") as stream:
        try:
            kind = fcntl.LOCK_SH if shared else fcntl.LOCK_EX
            fcntl.flock(stream, kind | (0 if wait else fcntl.LOCK_NB))
        except BlockingIOError:
            yield False
            return
        yield True
