"""The version of the package, and a description of the machine for measurements."""

import os
import platform
import re
import subprocess
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

_CODE = ("cpp", "bindings", "pyinfra", "configs")


def _source_version() -> str:
    """Returns "0+COMMIT" for a source tree, with "-dirty" if its code has uncommitted changes."""
    root = Path(__file__).resolve().parents[2]
    commit = _git(root, "rev-parse", "--short", "HEAD") or "source"
    return f"0+{commit}" + ("-dirty" if _git(root, "diff", "--stat", "HEAD", "--", *_CODE) else "")


def _git(root: Path, *words: str) -> str:
    """Returns the output of a git command; an empty text outside a repository."""
    try:
        return subprocess.run(
            ["git", *words], cwd=root, capture_output=True, text=True
        ).stdout.strip()
    except OSError:
        return ""


def machine() -> str:
    """Returns the number of cores and the processor model of this machine."""
    cpuinfo = Path("/proc/cpuinfo")
    text = cpuinfo.read_text(encoding="utf-8", errors="replace") if cpuinfo.is_file() else ""
    named = re.search(r"^model name\s*:\s*(.+)$", text, re.MULTILINE)
    return f"{os.cpu_count()} x {named[1] if named else platform.machine()}"


try:
    __version__ = version("infrasim")
except PackageNotFoundError:
    __version__ = _source_version()
