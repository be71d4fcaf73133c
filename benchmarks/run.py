"""Measures the speed of the simulator.

`make bench` runs this program, and docs/results/speed.md has the table. The program compares two
rates by the ratio of their medians. The runs of both alternate in one process. The number of rays
is that of the whole scan pattern: it includes rays whose result is read from the static layer.
`--before` adds a comparison with an earlier version; it names a checkout of that version in which
the binary has been built. The program writes out/speed.csv. To replace the committed table, name it
with `--out`:

    .venv/bin/python benchmarks/run.py [--before ../before] [--out results/speed.csv]
"""

from __future__ import annotations

import argparse
import json
import resource
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import process

from pyinfra.core.version import __version__, machine
from pyinfra.dataset import simulation
from reproduction import add_out

ROOT = Path(__file__).resolve().parent.parent
BUILD = ROOT / "build" / "dev"
SCENE = ROOT / "configs" / "scenes" / "highway.yaml"
LIDARS = [
    ROOT / "configs" / "lidars" / f"{name}.yaml"
    for name in ("livox_avia", "helios_16", "pandar_64", "ruby_plus")
]


def medians(repetitions: int) -> dict[str, float]:
    """Returns the median rate of each C++ benchmark in millions of rays per second.

    The repetitions of the benchmarks alternate.
    """
    with tempfile.NamedTemporaryFile(suffix=".json") as out:
        subprocess.run(
            [
                BUILD / "benchmarks" / "bench_simulate",
                f"--benchmark_repetitions={repetitions}",
                "--benchmark_min_time=0.2",
                "--benchmark_enable_random_interleaving=true",
                "--benchmark_report_aggregates_only=true",
                f"--benchmark_out={out.name}",
            ],
            check=True,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        report = json.loads(Path(out.name).read_text())
    return {
        run["run_name"]: run["items_per_second"] / 1e6
        for run in report["benchmarks"]
        if run["aggregate_name"] == "median"
    }


def core_rows(repetitions: int) -> list[tuple[str, float, str]]:
    """Compares the pipeline with its upper bounds, such as a loop that only casts ray packets."""
    rate = medians(repetitions)

    def r(name: str, threads: int = 2) -> float:
        return rate[f"{name}/real_time/threads:{threads}"]

    return [
        ("128-line pipeline, paper preset", r("pipeline_128"), "Mrays/s"),
        ("128-line pipeline, equal preset", r("pipeline_128_equal"), "Mrays/s"),
        ("128-line pipeline, datasheet preset", r("pipeline_128_datasheet"), "Mrays/s"),
        ("Avia pipeline, datasheet preset", r("pipeline_avia_datasheet"), "Mrays/s"),
        ("bare loop of 16-packets, same rays and scene", r("bare_loop"), "Mrays/s"),
        ("pipeline / bare loop, paper preset", r("pipeline_128") / r("bare_loop"), "ratio"),
        ("pipeline / bare loop, equal preset", r("pipeline_128_equal") / r("bare_loop"), "ratio"),
        (
            "pipeline / bare loop, datasheet preset",
            r("pipeline_128_datasheet") / r("bare_loop"),
            "ratio",
        ),
        ("exact / slices:100, four LiDARs", r("four_exact") / r("four_slices_100"), "ratio"),
        ("instant / exact, four LiDARs", r("four_instant") / r("four_exact"), "ratio"),
        ("time of 2 threads against 1", r("four_exact") / r("four_exact", 1), "speed-up"),
        ("time of 10 x triangles", r("detail_mid") / r("detail_fine"), "times"),
        ("time of 10 x vehicles", r("density_4") / r("density_40"), "times"),
    ]


def open3d_rows(repetitions: int) -> list[tuple[str, float, str]]:
    """Compares the speed of this simulator with Open3D's RaycastingScene.

    Both cast the same rays of the 128-line LiDAR into the same static scene.
    """
    import open3d as o3d

    lidar = simulation.load_lidar(LIDARS[3], "paper")
    world = simulation.load_scene(SCENE, preset="paper", set={"duration_s": 20})
    vertices, triangles = world.mesh(0)
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(o3d.core.Tensor(vertices), o3d.core.Tensor(triangles))
    azimuth, elevation = simulation.scan_pattern(lidar, range(1))[:, :2].T
    rays = np.zeros((len(azimuth), 6), np.float32)
    rays[:, 3] = np.cos(elevation) * np.cos(azimuth)
    rays[:, 4] = np.cos(elevation) * np.sin(azimuth)
    rays[:, 5] = np.sin(elevation)
    tensor = o3d.core.Tensor(rays)
    frames = 40

    def theirs() -> None:
        for _ in range(frames):
            scene.cast_rays(tensor, nthreads=2)

    def ours() -> None:
        for _ in simulation.simulate(world, [lidar], range(frames), threads=2):
            pass

    a, b = alternate(ours, theirs, repetitions)
    n = frames * len(rays) / 1e6
    return [
        ("128-line from Python, exact, with labels", n / a, "Mrays/s"),
        ("Open3D RaycastingScene, static scene", n / b, "Mrays/s"),
        ("ours / Open3D", b / a, "ratio"),
    ]


def alternate(
    a: Callable[[], object], b: Callable[[], object], repetitions: int
) -> tuple[float, float]:
    """Returns the median seconds of two functions whose runs alternate.

    The first run of each function is not timed.
    """
    seconds: tuple[list[float], list[float]] = ([], [])
    for i in range(repetitions + 1):
        for function, into in zip((a, b), seconds, strict=True):
            start = time.perf_counter()
            function()
            if i > 0:
                into.append(time.perf_counter() - start)
    return statistics.median(seconds[0]), statistics.median(seconds[1])


def run_binary(frames: int, out: Path | None) -> tuple[float, float]:
    """Returns the wall seconds and peak memory (MB) of one `infrasim run` of the four LiDARs."""
    command = [BUILD / "cpp" / "infrasim", "run", SCENE, "--lidar", *LIDARS, "--preset", "paper"]
    command += ["--frames", f"0:{frames}", "--threads", "2"]
    if out is not None:
        command += ["--out", out]
    cost = process.run(command)
    return cost.wall_s, cost.peak_mb


def seconds_of(tree: Path, lidars: list[str], preset: str, more: list[str]) -> float:
    """Returns the wall seconds that the binary of a source tree takes for 300 highway frames.

    The binary uses one thread for one LiDAR, and two threads for several LiDARs.
    """
    with tempfile.TemporaryDirectory(dir="/dev/shm") as out:
        command = [tree / "build/dev/cpp/infrasim", "run", tree / "configs/scenes/highway.yaml"]
        command += ["--lidar", *(tree / f"configs/lidars/{name}.yaml" for name in lidars)]
        command += ["--preset", preset, "--frames", "0:300", "--out", Path(out) / "data"]
        command += ["--threads", min(2, len(lidars)), "--set", "duration_s=40", *more]
        return process.run(command).wall_s


def before_rows(before: Path, repetitions: int) -> list[tuple[str, float, str]]:
    """Compares the speed with that of an earlier version.

    The runs of the two versions alternate. They write their files to memory.
    """
    four = [file.stem for file in LIDARS]
    plain = ["--set", "vegetation=[]"]
    rows = []
    cases: tuple[tuple[str, list[str], str, list[str]], ...] = (
        ("four LiDARs with writing, paper", four, "paper", []),
        ("four LiDARs with writing, equal", four, "equal", []),
        ("four LiDARs with writing, datasheet, no plants", four, "datasheet", plain),
        ("Avia with writing, datasheet, no plants", four[:1], "datasheet", plain),
    )
    for what, lidars, preset, more in cases:
        today, earlier = alternate(
            partial(seconds_of, ROOT, lidars, preset, more),
            partial(seconds_of, before, lidars, preset, []),
            repetitions,
        )
        rows.append((f"speed / before, {what}", earlier / today, "ratio"))
    return rows


def stream_rows(repetitions: int) -> list[tuple[str, float, str]]:
    """Compares the frame rate of the Python bindings with that of the binary, without start-up."""
    world = simulation.load_scene(SCENE, preset="paper")
    lidars = [simulation.load_lidar(file, "paper") for file in LIDARS]
    first, last = 100, 500
    ratios = []
    for _ in range(repetitions):
        binary = run_binary(last, None)[0] - run_binary(first, None)[0]
        start = time.perf_counter()
        for _ in simulation.simulate(world, lidars, range(first, last), threads=2):
            pass
        ratios.append(binary / (time.perf_counter() - start))
    return [("frames from Python / from the binary", statistics.median(ratios), "ratio")]


def growth_rows() -> list[tuple[str, float, str]]:
    """Measures how time and memory depend on the number of frames, and the cost of writing."""
    rows = []
    counts = (200, 400, 800)
    runs = {n: run_binary(n, None) for n in counts}
    rows.append(("time of 4 x frames", runs[800][0] / runs[200][0], "times"))
    rows += [(f"peak memory, {n} frames", runs[n][1], "MB") for n in counts]
    folder = Path(tempfile.mkdtemp())
    try:
        seconds, peak = run_binary(500, folder / "data")
        rows.append(("frame set of four LiDARs with writing", 1000 * seconds / 500, "ms"))
        rows.append(("peak memory with writing", peak, "MB"))
    finally:
        shutil.rmtree(folder)
    return rows


def arguments() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--repetitions",
        type=int,
        default=9,
        help="repetitions of each measurement (default: %(default)s)",
    )
    parser.add_argument(
        "--before",
        type=Path,
        help="checkout of an earlier version in which the binary has been built",
    )
    add_out(parser, "speed.csv")
    return parser


def main() -> None:
    args = arguments().parse_args()
    fewer = max(3, args.repetitions // 2)
    parts = [
        lambda: core_rows(args.repetitions),
        lambda: open3d_rows(args.repetitions),
        lambda: stream_rows(fewer),
        growth_rows,
    ]
    if args.before is not None:
        parts.append(lambda: before_rows(args.before.resolve(), fewer))
    rows = []
    for part in parts:
        for name, value, unit in part():
            print(f"{name:55s} {value:10.2f} {unit}", flush=True)
            rows.append({"what": name, "value": round(value, 3), "unit": unit})
    pd.DataFrame(rows).assign(
        command=f"benchmarks/run.py --repetitions {args.repetitions}",
        seed=1,
        version=__version__,
        machine=machine(),
    ).to_csv(args.out, index=False)
    print(
        f"peak of this process: {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024} MB",
        file=sys.stderr,
    )


if __name__ == "__main__":
    main()
