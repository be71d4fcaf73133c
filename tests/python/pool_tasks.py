"""Tasks for the workers of a pool; they import this file, so it has little else."""

import os
import signal
import time
from pathlib import Path

from pyinfra.experiments.gpus import exclusive_gpu


def dies_once(task: Path) -> None:
    """Writes that it began; the first time the task named `victim` kills its process."""
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
        mark.touch(exist_ok=False)  # nobody else is at it
        time.sleep(0.1)
        mark.unlink()
        task.write_text(device)


def its_gpus(_: int) -> str:
    time.sleep(0.2)
    return os.environ["CUDA_VISIBLE_DEVICES"]
