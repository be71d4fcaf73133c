"""Files and folders that are whole or not there, and locks between processes."""

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
    """A hidden path that no other process and no other call has."""
    return path.with_name(f"{_prefix(path)}{os.getpid()}.{next(_COUNT)}.tmp")


def _prefix(path: Path) -> str:
    return f".{path.name[:100]}.{platform.node()}."  # a system allows names of 255 bytes


def _remove_leftovers(path: Path) -> None:
    """Removes the hidden folders of `new_folder` whose process, one of this machine, has died."""
    prefix = _prefix(path)
    for left in [p for p in path.parent.iterdir() if p.name.startswith(prefix)]:
        pid = left.name.removeprefix(prefix).split(".")[0]
        if pid.isdecimal() and not Path("/proc", pid).exists():
            shutil.rmtree(left, ignore_errors=True)


@contextmanager
def replacing(file: Path) -> Iterator[Path]:
    """A hidden path beside the file to write to; it takes the file's place when the block ends.

    If the block raises, what it wrote goes and the file that was there stays; an error of the
    system, as of a full disk, names the file.
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
    """The file holds the data, a text as UTF-8, or stays as it was; see replacing."""
    with replacing(file) as beside:
        beside.write_bytes(data.encode() if isinstance(data, str) else data)


@contextmanager
def new_folder(folder: Path) -> Iterator[Path]:
    """A hidden folder beside the path to write to; it takes the path when the block ends.

    If the block raises, what it wrote goes; an error of the system names the file or the folder.
    Raises FileExistsError if the path is there already, or comes to be meanwhile, and is not an
    empty folder.
    """
    there = FileExistsError(f"{folder}: is there already, allowed a new or an empty folder")
    if folder.exists() and not (folder.is_dir() and not any(folder.iterdir())):
        raise there
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
                    raise there from error
                raise
    except BaseException:
        shutil.rmtree(beside, ignore_errors=True)
        raise


@contextmanager
def naming(path: Path, beside: Path | None = None) -> Iterator[None]:
    """An OSError from the block names a file: `path` if it has none, as of an open file.

    beside: what will take the place; errors that name it, or what is in it, name the place.
    """
    try:
        yield
    except OSError as error:
        if error.errno is None:  # of a library, or of ours with the file in its text
            if str(path.parent) in str(error):
                raise
            raise OSError(errno.EIO, str(error) or os.strerror(errno.EIO), str(path)) from error
        named = [Path(os.fsdecode(n)) for n in (error.filename2, error.filename) if n is not None]
        at = [path / n.relative_to(beside) for n in named if beside and n.is_relative_to(beside)]
        error.filename, error.filename2 = str([*at, *named[-1:], path][0]), None
        raise


@contextmanager
def held(file: Path, *, wait: bool) -> Iterator[bool]:
    """Whether this process alone holds the lock; waits until it does, or says no at once.

    A process that dies lets go.
    """
    file.parent.mkdir(parents=True, exist_ok=True)
    with file.open("w") as stream:
        try:
            fcntl.flock(stream, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
        except BlockingIOError:
            yield False
            return
        yield True
