"""Measures delays and memory of `pyinfra detect --follow` over an hour.

The command simulates some seconds of a scene, and copies their clouds again and again into a folder
at the LiDAR's rate, as a driver would. Old clouds are deleted. A second process follows the folder
with the pretrained detector. The output has one row per ten minutes: delays from the arrival of a
cloud to the printed line of its tracks, dropped frames, and the memory of the process.

    python -m reproduction follow --work out/follow --minutes 60
"""

import json
import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd

import pyinfra as pi
from reproduction import provenance
from reproduction.arguments import Out, Work, command

FRAMES = 150  # number of simulated frames, which are written repeatedly
KEPT = 20  # number of newest clouds that stay in the folder
INTERVAL_MIN = 10.0
LONGEST_START_S = 120.0  # maximum time until the process prints its first line


@command
def main(
    *,
    work: Work,
    minutes: float = 60.0,
    scene: str = "highway",
    lidar: str = "helios_16",
    threads: int = 1,
    out: Out = Path("follow.csv"),
) -> None:
    """
    Parameters
    ----------
    work : working folder for frames, about 1 GB
    minutes : duration of the measurement in minutes (default: 60)
    scene : name of the scene (default: highway)
    lidar : name of the LiDAR (default: helios_16)
    threads : threads of the detector (default: 1)
    """
    frames = pi.simulate(pi.load_scene(scene, seed=1), lidar, range(FRAMES))
    clouds = [frame.points[:, :4].astype("<f4").tobytes() for frame in frames]
    outline = work / "outline.yaml"
    height_m = frames.lidar.T_world_levelled.z
    folder = work / "clouds"
    folder.mkdir(exist_ok=True)
    for old in folder.glob("*.bin"):
        old.unlink()
    pi.propose_region(frames, outline)
    words = ["detect", str(folder), "--follow", "--height-m", f"{height_m:g}"]
    words += ["--region", str(outline), "--threads", str(threads), "--idle-s", "30"]
    rows = list(followed(words, folder, clouds, frames.period_s, minutes))
    options = f"--scene {scene} --lidar {lidar} --threads {threads}"
    origin = provenance(f"follow --work WORK --minutes {minutes:g} {options}")
    table = pd.DataFrame(rows).assign(scene=scene, lidar=lidar, threads=threads, **origin)
    table.to_csv(out, index=False)
    print(table.iloc[:, :10].to_string(index=False))


def followed(
    words: list[str], folder: Path, clouds: list[bytes], period_s: float, minutes: float
) -> Iterator[dict[str, float]]:
    """Yields a row for each interval. words: arguments of the `pyinfra` that follows the folder."""
    command = [sys.executable, "-m", "pyinfra", *words]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        lines: list[tuple[float, float, int]] = []  # each line's arrival, delay and dropped frames
        reader = threading.Thread(target=read, args=(process, lines), daemon=True)
        reader.start()
        number, since = 0, time.monotonic()
        while not lines and time.monotonic() - since < LONGEST_START_S:
            number = written(folder, clouds, number, period_s, time.time())
        start, first, written_before = time.monotonic(), len(lines), number
        taken, dropped = first, lines[-1][2] if lines else 0
        intervals = max(1, round(minutes / INTERVAL_MIN))
        for interval in range(intervals):
            until = start + 60 * minutes * (interval + 1) / intervals
            while time.monotonic() < until:
                number = written(folder, clouds, number, period_s, time.time())
            part, taken = lines[taken:], len(lines)
            delays = 1000 * np.array([delay for _, delay, _ in part])
            yield {
                "minute": minutes * (interval + 1) / intervals,
                "clouds": number - written_before,
                "lines": len(part),
                "dropped": part[-1][2] - dropped,
                "delay_p50_ms": float(np.percentile(delays, 50)),
                "delay_p95_ms": float(np.percentile(delays, 95)),
                "delay_max_ms": float(delays.max()),
                "memory_mb": memory_mb(process.pid),
                "load": os.getloadavg()[0],
            }
            dropped, written_before = part[-1][2], number
        process.terminate()
        reader.join()


def read(process: subprocess.Popen[str], lines: list[tuple[float, float, int]]) -> None:
    assert process.stdout is not None
    for text in process.stdout:
        line = json.loads(text)
        lines.append((time.time(), line["delay_s"], line["dropped"]))


def written(folder: Path, clouds: list[bytes], number: int, period_s: float, now: float) -> int:
    """Writes cloud `number`, waits until the next cloud is due, and returns the next number."""
    beside = folder / "writing"
    beside.write_bytes(clouds[number % len(clouds)])
    beside.rename(folder / f"{now:017.6f}.bin")
    if number % KEPT == 0:
        for old in sorted(folder.glob("*.bin"))[:-KEPT]:
            old.unlink()
    time.sleep(max(0.0, period_s - (time.time() - now)))
    return number + 1


def memory_mb(pid: int) -> float:
    """Returns the resident memory of a process."""
    status = Path(f"/proc/{pid}/status").read_text()
    return float(status.split("VmRSS:")[1].split()[0]) / 1024
