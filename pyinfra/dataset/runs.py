"""Runs of the `infrasim` binary."""

import subprocess
from pathlib import Path

from pyinfra.core.errors import Error
from pyinfra.dataset import launch


class SimulatorError(Error):
    """The `infrasim` binary is missing or failed.

    The exit code is 2 for a wrong configuration, else 1.
    """

    def __init__(self, message: str, exit_code: int = 1) -> None:
        super().__init__(message)
        self.exit_code = exit_code


def infrasim(*words: str | Path) -> str:
    """Runs the binary and returns its standard output.

    Raises SimulatorError if there is no binary or the binary fails. The message of a failure is the
    last line of the binary's standard error.
    """
    binary = launch.binary()
    if binary is None:
        raise SimulatorError(f"infrasim: {launch.NO_BINARY}", 1)
    done = subprocess.run([binary, *words], capture_output=True, text=True, check=False)
    if done.returncode != 0:
        last = (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1]
        raise SimulatorError(f"infrasim {words[0]}: {last}", 2 if done.returncode == 2 else 1)
    return done.stdout
