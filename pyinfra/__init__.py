"""Detectors, evaluation and reports for roadside LiDAR frames."""

import subprocess
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path


def _source_version() -> str:
    """The commit of a source tree that was not installed, with "-dirty" if it was changed."""
    describe = ["git", "describe", "--always", "--dirty", "--exclude=*"]
    try:
        run = subprocess.run(describe, cwd=Path(__file__).parent, capture_output=True, text=True)
    except OSError:
        return "0+source"
    return f"0+{run.stdout.strip() or 'source'}"


try:
    __version__ = version("infrasim")
except PackageNotFoundError:
    __version__ = _source_version()
