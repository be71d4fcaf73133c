"""Kills commands, fills disks and damages files, and checks that nothing is lost.

`make attack` runs it. Every folder is the program's own, and the small disks are mounted in it. A
fault is an internal error, a crash, a command without an end, an incomplete file, or a file outside
the output. The last lines are the counts; the exit code is 1 if there is a fault.
"""

from __future__ import annotations

import argparse
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
INFRASIM = str(Path(sys.executable).with_name("infrasim"))
PYINFRA = [sys.executable, "-m", "pyinfra"]
LONGEST_S = 1200.0  # the machine may be busy
MOST_CPU_S = 120  # of a command
MOST_BYTES = 6 << 30  # address space of a command
ODD = (b"", b"nan", b"1e308", b"-1", b"1e-320", b"=1+1", b"\xff\x00", b"9" * 40, b"*a", b"../../x")
ENDINGS = {".bin", ".csv", ".txt", ".yaml", ".xodr", ".xml", ".npy"}

Words = Sequence[object]


class Attack:
    """The counts of tries, and the faults that were found."""

    def __init__(self, folder: Path, seed: int) -> None:
        self.folder, self.random = folder, random.Random(seed)
        self.tries: Counter[str] = Counter()
        self.faults: list[str] = []

    def fault(self, kind: str, words: Words, what: str) -> None:
        line = f"{kind}: {' '.join(map(str, words))}: {what}"
        print(f"FAULT {line}", flush=True)
        self.faults.append(line)

    def run(self, kind: str, words: Words, cwd: Path | None = None) -> int:
        """Runs a command that may fail with a message, and returns its exit code."""
        self.tries[kind] += 1
        try:
            done = subprocess.run(
                [str(word) for word in words],
                cwd=cwd,
                capture_output=True,
                timeout=LONGEST_S,
                preexec_fn=_limit,
                check=False,
            )
        except subprocess.TimeoutExpired:
            self.fault(kind, words, "no end")
            return -1
        message = done.stderr.decode(errors="replace")
        if done.returncode not in (0, 1, 2) or "internal error" in message:
            self.fault(kind, words, f"exit code {done.returncode}: {message[-300:]}")
        elif done.returncode and not (done.stdout + done.stderr).strip():  # validate: on stdout
            self.fault(kind, words, "no message")
        return done.returncode


def _limit() -> None:
    """Limits the memory and the processor time of a child process."""
    resource.setrlimit(resource.RLIMIT_AS, (MOST_BYTES, MOST_BYTES))
    resource.setrlimit(resource.RLIMIT_CPU, (MOST_CPU_S, MOST_CPU_S))


def files_of(folder: Path) -> dict[str, bytes]:
    """Returns the content of each visible file below a folder."""
    return {
        str(file.relative_to(folder)): file.read_bytes()
        for file in sorted(folder.rglob("*"))
        if file.is_file() and not any(p.startswith(".") for p in file.relative_to(folder).parts)
    }


def made(attack: Attack) -> tuple[Path, Path]:
    """Returns a data set of two frames, and a map."""
    import site_maps

    from pyinfra.scenes.maps.sumo import sumo_folder

    data = attack.folder / "data"
    words = [INFRASIM, "run", "highway", "--lidar", "helios_16", "--frames", "0:2", "--fields"]
    assert attack.run("preparation", [*words, "--out", data]) == 0
    return data, site_maps.t_junction(attack.folder, sumo_folder())


def commands(data: Path, street_map: Path) -> dict[str, Callable[[Path], list[object]]]:
    """Returns the words of commands for the path of their output, which is new."""
    lidar, helios = data / "helios_16", ["--lidar", "helios_16", "--frames", "0:20"]
    return {
        "run": lambda out: [INFRASIM, "run", "highway", *helios, "--threads", "1", "--out", out],
        "import": lambda out: [*PYINFRA, "import", "sample", "--out", out / "lid"],
        "export": lambda out: [*PYINFRA, "export", lidar, "--to", "nuscenes", "--out", out],
        "view": lambda out: [*PYINFRA, "view", data, "--out", out / "view.html"],
        "statistics": lambda out: [*PYINFRA, "statistics", data, "--out", out],
        "site": lambda out: [*PYINFRA, "site", "import", street_map, "--out", out],
    }


def kill(attack: Attack, every: dict[str, Callable[[Path], list[object]]], count: int) -> None:
    """Kills each command at random moments. The same command then gives what it always gives."""
    for name, words_of in every.items():
        whole = attack.folder / f"whole_{name}"
        start = time.monotonic()
        if attack.run("undisturbed", words_of(whole)) != 0:
            attack.fault("undisturbed", words_of(whole), "failed")
            continue
        longest, expected = time.monotonic() - start, files_of(whole)
        for i in range(count):
            out = attack.folder / f"killed_{name}_{i}"
            words = [str(word) for word in words_of(out)]
            process = subprocess.Popen(
                words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
            )
            time.sleep(attack.random.uniform(0.3, 1.0) * longest)
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
            attack.tries["kills"] += 1
            for file, content in files_of(out).items() if out.exists() else ():
                if name != "run" and expected.get(file) not in (None, content) and _fixed(file):
                    attack.fault("kills", words, f"{file} is incomplete")
            if attack.run("again", words) not in (0, 1):
                attack.fault("kills", words, "failed after a kill")
            found = files_of(out)
            if {*found} != {*expected}:
                attack.fault("kills", words, f"other files: {sorted({*found} ^ {*expected})[:3]}")
            shutil.rmtree(out)


def _fixed(file: str) -> bool:
    """Returns whether the bytes of a file do not depend on the folder or the time."""
    return Path(file).suffix in (".bin", ".npy")


def beside_each_other(attack: Attack, count: int) -> None:
    """Imports four recordings at once into one data set. Their object ids differ, so one wins."""
    for i in range(count):
        data = attack.folder / f"parallel_{i}"
        words = [[*PYINFRA, "import", "sample", "--out", data / f"l{k}"] for k in range(4)]
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        processes = [subprocess.Popen([str(w) for w in one], **quiet) for one in words]
        codes = sorted(process.wait() for process in processes)
        attack.tries["parallel"] += len(codes)
        found = [file.parent.parent for file in data.rglob("lidar.yaml")]
        if codes != [0, 2, 2, 2] or found != [data] or not (data / "dataset.yaml").is_file():
            attack.fault("parallel", words[0], f"exit codes {codes}, layout {found}")
        shutil.rmtree(data)


def fill(attack: Attack, every: dict[str, Callable[[Path], list[object]]], count: int) -> None:
    """Runs each command on full disks of random sizes."""
    disk = attack.folder / "disk"
    disk.mkdir()
    for name, words_of in every.items():
        for _ in range(count):
            size = 2 ** attack.random.uniform(13, 21)
            words = ["mount", "-t", "tmpfs", "-o", f"size={size:.0f}", "tmpfs", str(disk)]
            if os.geteuid() or subprocess.run(words, capture_output=True, check=False).returncode:
                print("no small disks: mounting is not allowed", flush=True)
                return
            try:
                attack.run(f"full disk: {name}", words_of(disk / "out"))
                left = [file for file in disk.rglob(".*.tmp") if file.is_file()]
                if left:
                    attack.fault("full disk", words_of(disk / "out"), f"left {left[0].name}")
            finally:
                subprocess.run(["umount", str(disk)], check=True)


def damage(attack: Attack, data: Path, street_map: Path, count: int) -> None:
    """Damages each kind of file, and gives it to the commands that read it."""
    copy = attack.folder / "mutants"
    for i in range(count):
        shutil.rmtree(copy, ignore_errors=True)
        shutil.copytree(data, copy / "data")
        shutil.copy(street_map, copy / "map.xodr")
        shutil.copy(ROOT / "configs/scenes/highway.yaml", copy / "scene.yaml")
        shutil.copytree(ROOT / "configs/lidars", copy / "lidars")
        files = [file for file in sorted(copy.rglob("*")) if file.suffix in ENDINGS]
        kinds = sorted({_kind(file.relative_to(copy)) for file in files})
        kind = kinds[i % len(kinds)]
        same = [file for file in files if _kind(file.relative_to(copy)) == kind]
        file = attack.random.choice(same)
        file.write_bytes(_damaged(attack.random, file.read_bytes()))
        attack.tries[f"mutants of {kind}"] += 1
        for words in _readers(kind, file, copy):
            attack.run("readers of mutants", words, copy)


def _kind(path: Path) -> str:
    return "/".join(p for p in path.with_name(f"*{path.suffix}").parts[:-1]) + f" *{path.suffix}"


def _readers(kind: str, file: Path, copy: Path) -> list[list[object]]:
    if kind.startswith("lidars"):
        lidar = copy / "lidars/helios_16.yaml"
        return [[INFRASIM, "check", file if file.suffix == ".yaml" else lidar]]
    if file.name == "scene.yaml":
        return [[INFRASIM, "check", file]]
    if file.suffix == ".xodr":
        return [[*PYINFRA, "site", "import", file, "--out", copy / "site"]]
    more = [INFRASIM, "run", "highway", "--lidar", "helios_16", "--frames", "0:3", "--fields"]
    return [
        [*PYINFRA, "validate", copy / "data"],
        [*PYINFRA, "statistics", copy / "data", "--out", copy / "statistics"],
        [*more, "--out", copy / "data"],
    ]


def _damaged(chance: random.Random, data: bytes) -> bytes:
    """Cuts the bytes, changes one, removes or doubles a part, or puts in something odd."""
    at = chance.randrange(len(data) + 1)
    end = min(len(data), at + chance.choice((1, 4, 100)))
    way = chance.randrange(5)
    if way == 0:
        return data[:at]
    if way == 1:
        return data[:at] + bytes([chance.randrange(256)]) + data[at + 1 :]
    if way == 2:
        return data[:at] + data[end:]
    if way == 3:
        return data[:end] + data[at:]
    return data[:at] + chance.choice(ODD) + data[end:]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=5, help="kills and full disks of a command")
    parser.add_argument("--mutants", type=int, default=100)
    parser.add_argument("--seed", type=int, default=int(time.time()))
    args = parser.parse_args()
    print(f"seed {args.seed}", flush=True)
    with tempfile.TemporaryDirectory() as name:
        attack = Attack(Path(name), args.seed)
        data, street_map = made(attack)
        every = commands(data, street_map)
        kill(attack, every, args.count)
        beside_each_other(attack, args.count)
        fill(attack, every, args.count)
        damage(attack, data, street_map, args.mutants)
    for kind, count in sorted(attack.tries.items()):
        print(f"{count:6} {kind}")
    print(f"{len(attack.faults):6} faults")
    return 1 if attack.faults else 0


if __name__ == "__main__":
    sys.exit(main())
