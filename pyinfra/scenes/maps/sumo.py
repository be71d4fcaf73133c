"""Runs SUMO's programs as processes, without XML validation, and reports their errors."""

import importlib.util
import os
import subprocess
from collections.abc import Sequence
from pathlib import Path

from pyinfra.core.errors import Error, missing


class SumoError(Error):
    """A SUMO program failed. The message is the first line of the program's errors."""


def sumo_folder() -> Path:
    """Returns the folder of SUMO. Raises MissingPackage if SUMO is not installed."""
    spec = importlib.util.find_spec("sumo")
    if spec is None or not spec.submodule_search_locations:
        raise missing("eclipse-sumo", "site")
    return Path(spec.submodule_search_locations[0])


def run_tool(name: str, arguments: Sequence[str], *, longest_s: float | None = None) -> list[str]:
    """Runs a SUMO program and returns its warnings.

    Raises SumoError, subprocess.TimeoutExpired, and MissingPackage.
    """
    home = sumo_folder()
    done = subprocess.run(
        [str(home / "bin" / name), *arguments, "--xml-validation", "never"],
        capture_output=True,
        text=True,
        errors="replace",
        timeout=longest_s,
        env={**os.environ, "SUMO_HOME": str(home)},
        check=False,
    )
    lines = [line.strip() for line in done.stderr.splitlines() if line.strip()]
    if done.returncode:
        errors = [line for line in lines if line.startswith("Error:")] or lines or ["no reason"]
        message = errors[0].removeprefix("Error: ")
        raise SumoError(f"{name}: {message} (exit {done.returncode})")
    return [line.removeprefix("Warning: ") for line in lines if line.startswith("Warning:")]
