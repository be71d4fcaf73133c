"""The version of the package, and the machine that a measurement was made on."""

import os
import platform
import re
import subprocess
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

_CODE = ("cpp", "bindings", "pyinfra", "configs")


def _source_version() -> str:
    """The commit of a source tree that was not installed, with "-dirty" if its code was changed."""
    root = Path(__file__).resolve().parents[2]
    commit = _git(root, "rev-parse", "--short", "HEAD") or "source"
    return f"0+{commit}" + ("-dirty" if _git(root, "diff", "--stat", "HEAD", "--", *_CODE) else "")


def _git(root: Path, *words: str) -> str:
    """What git prints; nothing outside of a repository."""
    try:
        return subprocess.run(
            ["git", *words], cwd=root, capture_output=True, text=True
        ).stdout.strip()
    except OSError:
        return ""


def machine() -> str:
    """The cores and processor that a measured row is of."""
    cpuinfo = Path("/proc/cpuinfo")
    text = cpuinfo.read_text(encoding="utf-8", errors="replace") if cpuinfo.is_file() else ""
    named = re.search(r"^model name\s*:\s*(.+)$", text, re.MULTILINE)
    return f"{os.cpu_count()} x {named[1] if named else platform.machine()}"


try:
    __version__ = version("infrasim")
except PackageNotFoundError:
    __version__ = _source_version()
