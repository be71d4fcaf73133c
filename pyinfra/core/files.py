"""Atomic writing of files and folders, and locks between processes.

A file or folder is either complete or absent. FIFOs, devices and sockets are never replaced, and
`regular_files_only` also refuses to read them.
"""

import errno
import fcntl
import itertools
import os
import platform
import shutil
import stat
import sys
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from hashlib import sha256
from pathlib import Path
from typing import Any

from pyinfra.core.errors import Error

_KINDS = {
    stat.S_IFIFO: "a FIFO",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
    stat.S_IFSOCK: "a socket",
}
_COUNT = itertools.count()


def _beside(path: Path) -> Path:
    """Returns a hidden path next to `path` that is unique to this process and call."""
    return path.with_name(f"{_prefix(path)}{os.getpid()}.{next(_COUNT)}.tmp")


def _prefix(path: Path) -> str:
    # The name is shortened, because file names are limited to 255 bytes.
    return f".{path.name[:100]}.{platform.node()}."


def _remove_leftovers(path: Path) -> None:
    """Removes hidden folders of `new_folder` left by processes of this machine that have died."""
    prefix = _prefix(path)
    for leftover in [p for p in path.parent.iterdir() if p.name.startswith(prefix)]:
        pid = leftover.name.removeprefix(prefix).split(".")[0]
        if pid.isdecimal() and not Path("/proc", pid).exists():
            shutil.rmtree(leftover, ignore_errors=True)


def _expect_regular(file: Path) -> None:
    """Raises Error for a FIFO, a device or a socket."""
    try:
        found = file.stat()
    except (OSError, ValueError):  # if `stat` fails, the path cannot be opened either
        return
    kind = _KINDS.get(stat.S_IFMT(found.st_mode))
    if kind:
        raise Error(f"{file}: expected a regular file, got {kind}")


@contextmanager
def regular_files_only(within: Iterable[Path] = (Path("/"),)) -> Iterator[None]:
    """Context manager in which opening a FIFO, a device or a socket by its path raises Error.

    Reading such a file may never end. The check covers each `open` in all threads of this process,
    by Python and by packages that use Python's `open`. The null device can be opened.
    within: files and folders; only these files, and files in these folders, are checked. For the
    folder of a LiDAR, files in its data set are checked too.
    """
    if not _INSTALLED:
        _INSTALLED.append(True)
        sys.addaudithook(_check_open)  # added only once, because an audit hook cannot be removed
    paths = [Path(path).absolute() for path in within if "\0" not in str(path)]
    paths += [path.parent for path in paths if (path.parent / "dataset.yaml").exists()]
    checked = {text for path in paths for text in (os.path.normpath(path), os.path.realpath(path))}
    _CHECKED.extend(checked)
    try:
        yield
    finally:
        for path in checked:  # one by one, because another thread may have added the same path
            _CHECKED.remove(path)


_INSTALLED: list[bool] = []
_CHECKED: list[str] = []  # absolute paths that `regular_files_only` currently checks


def _check_open(event: str, arguments: tuple[Any, ...]) -> None:
    if event != "open" or not _CHECKED or not isinstance(arguments[0], (str, bytes)):
        return
    file = os.path.normpath(Path(os.fsdecode(arguments[0])).absolute())
    if file == os.devnull:
        return
    if any(file == path or file.startswith(f"{path.rstrip('/')}/") for path in tuple(_CHECKED)):
        _expect_regular(Path(file))


def check_size(file: Path, most: int) -> None:
    """Raises Error for a file with more than `most` bytes."""
    size = file.stat().st_size
    if size > most:
        raise Error(f"{file}: expected at most {most:,} bytes, got {size:,} bytes")


def _target_of(file: Path) -> Path:
    """Returns the path to which symbolic links lead. Raises OSError for a loop of links."""
    return resolved(file) if file.is_symlink() else file


def resolved(path: Path) -> Path:
    """Returns the absolute path without symbolic links. Raises OSError for a loop of links."""
    target = Path(os.path.realpath(path))
    try:
        target.stat()
    except OSError as error:
        if error.errno == errno.ELOOP:
            raise
    return target


def check_output(file: Path, begins: bytes) -> None:
    """Raises Error if `file` exists, has content and is not an earlier output.

    begins: the first bytes of an output; case and leading blanks do not count. The check keeps
    an output from replacing an input.
    """
    _expect_regular(file)
    if not file.is_file():
        return
    with file.open("rb") as stream:
        start = stream.read(1000)
    if start and not start.lstrip().lower().startswith(begins.lower()):
        raise Error(
            f"{file}: expected a new file or an earlier output of the same kind, got a file of "
            "different content; choose another name"
        )


@contextmanager
def replacing(file: Path) -> Iterator[Path]:
    """Yields a hidden path to write to. The file at this path replaces `file` at the block's end.

    If `file` is a symbolic link, its target is replaced. If the block raises, the new content is
    deleted and the old file stays. Each OSError, for example for a full disk, names `file`. Raises
    Error for a FIFO, a device or a socket.
    """
    target = _target_of(file)
    _expect_regular(target)
    beside = _beside(target)
    try:
        with naming(file, beside):
            yield beside
            beside.replace(target)
    except BaseException:
        beside.unlink(missing_ok=True)
        raise


def write(file: Path, data: bytes | str) -> None:
    """Writes the data (a text as UTF-8) atomically; on an error the old file stays."""
    with replacing(file) as beside:
        if isinstance(data, str):
            data = data.encode(errors="backslashreplace")
        beside.write_bytes(data)


@contextmanager
def new_folder(folder: Path) -> Iterator[Path]:
    """Yields a hidden folder to write to. It is renamed to `folder` when the block ends.

    If the block raises, the hidden folder is deleted. An OSError names the file or the folder.
    Raises FileExistsError if `folder` exists and is not an empty folder, at the start or at the
    end of the block.
    """
    folder = _target_of(folder)
    exists = FileExistsError(f"{folder}: expected a new or empty folder, got a folder with files")
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
        if error.errno is None:  # not an error of the system, so its text may name the file
            if str(path.parent) in str(error):
                raise
            raise OSError(errno.EIO, str(error) or os.strerror(errno.EIO), str(path)) from error
        named = [Path(os.fsdecode(n)) for n in (error.filename2, error.filename) if n is not None]
        at = [path / n.relative_to(beside) for n in named if beside and n.is_relative_to(beside)]
        error.filename, error.filename2 = str([*at, *named[-1:], path][0]), None
        raise


@contextmanager
def alone(folder: Path) -> Iterator[None]:
    """Context manager that keeps other processes of this machine from writing to the same folder.

    Raises Error if another process is in such a block for this folder. The lock file is not in the
    folder.
    """
    name = sha256(str(resolved(folder)).encode()).hexdigest()[:24]
    locks = Path(tempfile.gettempdir()) / f"pyinfra_locks_{os.getuid()}"
    with held(locks / name, wait=False) as ours:
        if not ours:
            raise Error(
                f"{folder}: another process writes to this folder; wait until it ends, or choose "
                "another folder"
            )
        yield


@contextmanager
def held(file: Path, *, wait: bool, shared: bool = False) -> Iterator[bool]:
    """Yields whether this process holds a lock on the file or the folder.

    The lock is exclusive. With `shared`, several processes can hold it together, but none can hold
    it exclusively at the same time. With `wait`, the function waits for the lock. Without `wait`,
    it yields False at once if another process holds a lock that prevents this one. The lock is
    released at the end of the block, and when the process dies.
    """
    file.parent.mkdir(parents=True, exist_ok=True)
    _expect_regular(file)
    flags = os.O_RDONLY if file.is_dir() else os.O_RDWR | os.O_CREAT
    descriptor = os.open(file, flags, 0o666)
    try:
        kind = fcntl.LOCK_SH if shared else fcntl.LOCK_EX
        try:
            fcntl.flock(descriptor, kind | (0 if wait else fcntl.LOCK_NB))
        except BlockingIOError:
            yield False
            return
        yield True
    finally:
        os.close(descriptor)
