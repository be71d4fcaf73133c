"""Ctrl-C during parallel tasks ends all processes with one message."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

# A shell starts background commands with SIGINT ignored, and the tests may run as such a command.
SCRIPT = """
import signal, sys, time
signal.signal(signal.SIGINT, signal.default_int_handler)
from pyinfra.cli import lidars, main
from pyinfra.experiments.pool import Pool, call_all

def run(args):
    print("ready", flush=True)
    call_all(time.sleep, [60.0, 60.0, 60.0], Pool(jobs=2))

if __name__ == "__main__":
    lidars.run = run
    sys.exit(main.main(["lidars"]))
"""


@pytest.mark.parametrize("after_s", [0.5, 4])
def test_ctrl_c_leaves_one_line_and_no_leaked_semaphore(after_s: float, tmp_path: Path) -> None:
    """The terminal sends the signal to all processes, including workers that are just starting."""
    script = tmp_path / "tasks.py"
    script.write_text(SCRIPT)
    process = subprocess.Popen(
        [sys.executable, script],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    time.sleep(after_s)
    os.killpg(process.pid, signal.SIGINT)
    _, error = process.communicate(timeout=60)
    assert process.returncode == 130
    (line,) = error.splitlines()
    assert line.startswith("pyinfra: interrupted")
