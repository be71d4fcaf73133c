"""The matrix scene x LiDAR x detector on the quick tier, preset `paper`: results/quick.csv.

    .venv/bin/python benchmarks/quick.py

A row is written when its cell is done, cells with a row are left out, and a training that was
stopped goes on. The same command started twice shares the cells. `--latency` measures the
latency of the rows again, on a quiet machine.
"""

from __future__ import annotations

import argparse
import itertools
import os
import platform
import resource
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd

from pyinfra import __version__, detect, kitti
from pyinfra.atomic import held, replacing
from pyinfra.evaluation.ground_truth import frame_numbers
from pyinfra.hits import infrasim, lidar_file, scene_file

ROOT = Path(__file__).resolve().parent.parent
SCENES = ("highway", "crossroad", "curve")
LIDARS = ("ruby_plus", "livox_avia", "pandar_64", "helios_16")
DETECTORS = (
    "background",
    "pointpillars",
    "centerpoint-pillar",
    "dsvt",
    "pointrcnn-remedied",
    "pointrcnn",
    "pv-rcnn",
)
CELL = ["scene", "lidar", "preset", "detector", "tier", "seed"]
PRESET, TIER = "paper", "quick"
FRAMES = "0:5000:5"


def cells(args: argparse.Namespace) -> Iterator[dict[str, object]]:
    """Scenes outermost, detectors before LiDARs: the first rows say most."""
    for scene, detector, lidar in itertools.product(args.scenes, args.detectors, args.lidars):
        names = (scene, lidar, PRESET, detector, TIER, args.seed)
        yield dict(zip(CELL, names, strict=True))


def prepared(scene: str, work: Path) -> Path:
    """The data set of a scene, split by time."""
    data = work / scene
    with held(work / f"{scene}.lock", wait=True):
        if not (data / "summary.csv").exists():
            lidars = [str(lidar_file(name)) for name in LIDARS]
            words = ["--preset", PRESET, "--frames", FRAMES, "--out", str(data)]
            infrasim("run", str(scene_file(scene)), "--lidar", *lidars, *words)
        if not list(data.glob("*/ImageSets")):
            pyinfra("split", data)
    return data


def run_folder(cell: dict[str, object], work: Path) -> Path:
    return work / "runs" / "_".join(str(value) for value in cell.values())


def pyinfra(*words: object) -> None:
    """Runs a command of the package on one core. Raises CalledProcessError."""
    environment = os.environ | {"OMP_NUM_THREADS": "1"}
    command = [sys.executable, "-m", "pyinfra", *map(str, words)]
    subprocess.run(command, check=True, env=environment, stdout=subprocess.DEVNULL)


def trained(cell: dict[str, object], folder: Path, out: Path) -> float:
    """Trains, or goes on; returns the CPU seconds of one core, over all goes."""
    config = ROOT / f"configs/detectors/{cell['detector']}.yaml"
    spent = out / "cpu_seconds"
    out.mkdir(parents=True, exist_ok=True)
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    words = ["--data", folder, "--tier", TIER, "--out", out, "--seed", cell["seed"]]
    pyinfra("train", config, *words)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    seconds = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    seconds += float(spent.read_text()) if spent.exists() else 0
    spent.write_text(f"{seconds}")
    return seconds


def latency(run: Path, folder: Path) -> tuple[float, float]:
    """Milliseconds a frame, points to boxes, one core: median and 95 %."""
    files = [kitti.frame_file(folder, "velodyne", k) for k in frame_numbers(folder)]
    detector = detect.load_detector(run)
    detect.detect(detector, files[:5], None)
    _, times = detect.detect(detector, files, None)
    low, high = np.percentile(times, (50, 95))
    return float(low), float(high)


def row(cell: dict[str, object], work: Path) -> dict[str, object]:
    """Everything of one cell."""
    folder = prepared(str(cell["scene"]), work) / str(cell["lidar"])
    out = run_folder(cell, work)
    seconds = trained(cell, folder, out)
    pyinfra("detect", out, "--data", folder, "--out", out / "predictions")
    words = ["--gt", folder, "--pred", out / "predictions", "--out", out / "evaluation"]
    pyinfra("evaluate", *words, "--ground-truth", "captured", "common", "all")
    table = pd.read_csv(out / "evaluation/ap.csv").set_index("ground_truth")
    first = table.loc["captured"]
    p50, p95 = latency(out, folder)
    return cell | {
        "ap": first.ap,
        "ap_low": first.ap_low,
        "ap_high": first.ap_high,
        "ap_common": table.ap["common"],
        "ap_all": table.ap["all"],
        "objects": int(first.objects),
        "train_seconds": round(seconds, 1),
        "latency_p50_ms": round(p50, 2),
        "latency_p95_ms": round(p95, 2),
        "command": "benchmarks/quick.py",
        "version": __version__,
        "latency_version": __version__,
        "machine": f"{os.cpu_count()} x {platform.processor() or platform.machine()}",
    }


def read(file: Path) -> pd.DataFrame:
    return pd.read_csv(file) if file.exists() else pd.DataFrame(columns=CELL)


def has(table: pd.DataFrame, cell: dict[str, object]) -> bool:
    return bool((table[CELL].astype(str) == pd.Series(cell).astype(str)).all(axis=1).any())


def write(table: pd.DataFrame, file: Path) -> None:
    with replacing(file) as beside:
        table.to_csv(beside, index=False, float_format="%.6g")


def fill(cell: dict[str, object], work: Path, file: Path) -> None:
    """The row of a cell that has none, unless another process is at it."""
    with held(run_folder(cell, work).with_suffix(".lock"), wait=False) as ours:
        if not ours or has(read(file), cell):
            return
        found = row(cell, work)
        with held(work / "results.lock", wait=True):
            write(pd.concat([read(file), pd.DataFrame([found])], ignore_index=True), file)
        print(*found.values(), flush=True)


def measured_again(file: Path, work: Path) -> None:
    """The latency of all rows whose runs are here."""
    table = read(file)
    for i, cell in enumerate(table[CELL].to_dict("records")):
        run = run_folder(cell, work)
        if run.is_dir():
            low, high = latency(run, work / str(cell["scene"]) / str(cell["lidar"]))
            table.loc[i, ["latency_p50_ms", "latency_p95_ms"]] = [round(low, 2), round(high, 2)]
            table.loc[i, "latency_version"] = __version__
            print(cell, f"{low:.1f} {high:.1f} ms", flush=True)
    write(table, file)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--work", type=Path, default=ROOT / "data" / "quick", help="folder of frames and runs"
    )
    parser.add_argument("--out", type=Path, default=ROOT / "results" / "quick.csv")
    parser.add_argument("--scenes", nargs="+", default=SCENES)
    parser.add_argument("--lidars", nargs="+", default=LIDARS)
    parser.add_argument("--detectors", nargs="+", default=DETECTORS)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--latency", action="store_true")
    args = parser.parse_args()
    if args.latency:
        return measured_again(args.out, args.work)
    for cell in cells(args):
        try:
            fill(cell, args.work, args.out)
        except subprocess.CalledProcessError as error:
            print(f"{cell}: failed with {error.returncode}: {error.cmd}", flush=True)


if __name__ == "__main__":
    main()
