"""Tasks for the workers of a pool. Workers import this file, so it imports little."""

import os
import signal
import time
from pathlib import Path

from pyinfra.experiments.gpus import exclusive_gpu


def dies_once(task: Path) -> None:
    """Writes a file when it begins. The first run of the task named `victim` kills its process."""
    begun = task.with_suffix(".begun")
    first = not begun.exists()
    begun.touch()
    if task.name == "victim" and first:
        os.kill(os.getpid(), signal.SIGKILL)
    time.sleep(0.05)
    task.touch()


def dies(task: Path) -> None:
    if task.name == "victim":
        os.kill(os.getpid(), signal.SIGKILL)
    task.touch()


def takes_a_gpu(task: Path) -> None:
    with exclusive_gpu("cuda", task.parent) as device:
        mark = task.parent / device.replace(":", "_")
        mark.touch(exist_ok=False)  # fails if another process is working on the task
        time.sleep(0.1)
        mark.unlink()
        task.write_text(device)
