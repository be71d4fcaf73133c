"""Detectors, evaluation and reports for roadside LiDAR frames."""

import os
import platform
import re
import subprocess
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pyinfra.evaluation.evaluate import evaluate

__all__ = ["__version__", "evaluate", "machine"]

_CODE = ("cpp", "bindings", "pyinfra", "configs")


def _source_version() -> str:
    """The commit of a source tree that was not installed, with "-dirty" if its code was changed."""
    root = Path(__file__).parent.parent
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
    about = Path("/proc/cpuinfo")
    text = about.read_text(encoding="utf-8", errors="replace") if about.is_file() else ""
    named = re.search(r"^model name\s*:\s*(.+)$", text, re.MULTILINE)
    return f"{os.cpu_count()} x {named[1] if named else platform.machine()}"


try:
    __version__ = version("infrasim")
except PackageNotFoundError:
    __version__ = _source_version()


def __getattr__(name: str) -> object:
    """`pyinfra.evaluate(...)`; what it needs is imported when it is asked for."""
    if name == "evaluate":
        from pyinfra.evaluation.evaluate import evaluate

        return evaluate
    raise AttributeError(f"module 'pyinfra' has no attribute '{name}'")
