"""Runs SUMO's programs as processes, without XML validation, and reports their errors."""

import errno
import importlib.util
import os
import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path

from pyinfra.core.errors import Error, missing


class SumoError(Error):
    """A SUMO program failed. The message is the first line of the program's errors.

    crashed: whether the program was ended by a signal, so that the message has no reason.
    """

    crashed: bool = False


def sumo_folder() -> Path:
    """Returns the folder of SUMO. Raises MissingPackage if SUMO is not installed."""
    spec = importlib.util.find_spec("sumo")
    if spec is None or not spec.submodule_search_locations:
        raise missing("eclipse-sumo", "site")
    return Path(spec.submodule_search_locations[0])


CRASHED = 128  # exit codes above this mean that a signal ended the program
# Options that name output files, and the text at the end of a complete file.
_OUTPUTS = {"--output-file": b"</net>", "--fcd-output": b"</fcd-export>"}
_FILES = {
    *_OUTPUTS,
    *("-c", "--net-file", "--opendrive-files", "--osm-files", "--route-files", "--sumo-net-file"),
}


def run_tool(name: str, arguments: Sequence[str], *, longest_s: float | None = None) -> list[str]:
    """Runs a SUMO program and returns its warnings.

    Raises SumoError, subprocess.TimeoutExpired, and MissingPackage. Raises OSError for an output
    that is not complete, because SUMO does not report a full disk.
    """
    home = sumo_folder()
    with tempfile.TemporaryDirectory() as work:
        words, names = _without_commas(arguments, Path(work))
        done = subprocess.run(
            [str(home / "bin" / name), *words, "--xml-validation", "never"],
            capture_output=True,
            text=True,
            errors="replace",
            timeout=longest_s,
            cwd=work,
            # SUMO would print a warning if the user's locale were not installed.
            env={**os.environ, "SUMO_HOME": str(home), "LC_ALL": "C.UTF-8"},
            check=False,
        )
    text = done.stderr
    for link, path in names.items():
        text = text.replace(link, path)
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    if done.returncode:
        errors = [line for line in lines if line.startswith("Error:")] or lines or ["no reason"]
        message = errors[0].removeprefix("Error: ")
        failure = SumoError(f"{name}: {message} (exit {done.returncode})")
        failure.crashed = done.returncode < 0 or done.returncode > CRASHED
        raise failure
    for option, end in _OUTPUTS.items():
        if option in arguments:
            _check_complete(Path(arguments[arguments.index(option) + 1]), end)
    return [line.removeprefix("Warning: ") for line in lines if line.startswith("Warning:")]


def _without_commas(words: Sequence[str], work: Path) -> tuple[list[str], dict[str, str]]:
    """Makes the paths of files absolute, and replaces paths with a comma by links in `work`.

    SUMO takes such a path for a list of files. Returns the words, and the path for each link. The
    links are relative to `work`.
    """
    changed, names = list(words), dict[str, str]()
    for i, word in enumerate(words[1:], start=1):
        if words[i - 1] not in _FILES:
            continue
        path = Path(word).absolute()
        changed[i] = str(path)
        if "," not in changed[i]:
            continue
        link = f"folder{i}/{path.name}"
        (work / f"folder{i}").symlink_to(path.parent)
        if "," in path.name:
            link = f"file{i}{''.join(path.suffixes[-2:]).replace(',', '')}"
            (work / link).symlink_to(path)
        changed[i], names[link] = link, word
    return changed, names


def _check_complete(file: Path, end: bytes) -> None:
    """Raises OSError if an existing file does not end in `end`."""
    if not file.is_file():
        return
    with file.open("rb") as stream:
        stream.seek(max(0, file.stat().st_size - 100))
        if not stream.read().rstrip().endswith(end):
            reason = "SUMO wrote an incomplete file; the disk may be full"
            raise OSError(errno.EIO, reason, str(file))
