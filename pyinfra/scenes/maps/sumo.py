"""SUMO's programs as processes: offline, their errors in one line."""

import importlib.util
import os
import subprocess
from collections.abc import Sequence
from pathlib import Path


def sumo_folder() -> Path:
    """Where SUMO lies. Raises ImportError that says what to install."""
    spec = importlib.util.find_spec("sumo")
    if spec is None or not spec.submodule_search_locations:
        raise ImportError("SUMO is not installed: pip install 'infrasim[site]'")
    return Path(spec.submodule_search_locations[0])


def run_tool(name: str, arguments: Sequence[str], *, longest_s: float | None = None) -> list[str]:
    """Runs a program of SUMO's; returns what it warns of.

    Raises RuntimeError with its first line of error, subprocess.TimeoutExpired, and ImportError.
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
        raise RuntimeError(f"{name}: {message} (exit {done.returncode})")
    return [line.removeprefix("Warning: ") for line in lines if line.startswith("Warning:")]
