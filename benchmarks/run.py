"""Measures the speed of the simulator.

`make bench` runs this program, and docs/results/speed.md has the table. The program compares two
rates by the ratio of their medians. The runs of both alternate in one process. The number of rays
is that of the whole scan pattern: it includes rays whose result is read from the static layer.
The program writes out/speed.csv. To replace the committed table, name it with `--out`:

    .venv/bin/python benchmarks/run.py [--out results/speed.csv]

`--against` compares this build with that of another checkout, such as an earlier version, in which
the binary has been built. It measures nothing else, and writes out/speed_against.csv. A value above
1 means that this build is faster, or takes more memory:

    .venv/bin/python benchmarks/run.py --against ../other
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
from pathlib import Path

import numpy as np
import pandas as pd
import process

from pyinfra.core.version import __version__, machine
from pyinfra.dataset import simulation
from reproduction import add_out

ROOT = Path(__file__).resolve().parent.parent
BUILD = ROOT / "build" / "dev"
BINARY = Path("build/dev/cpp/infrasim")  # path of infrasim in a checkout
SCENE = ROOT / "configs" / "scenes" / "highway.yaml"
DURATION_S = 40  # duration of the scene of `--against`
FIRST_FRAMES, LAST_FRAMES = 20, 220
STAGE_NAMES = (
    *("making rays", "casting", "leaves", "panes", "beam", "return model"),
    "collecting",
)
AGAINST = "this / other: "  # prefix of the row names of `--against`
STAGES = {
    "ruby_plus_paper": "128 lines, paper",
    "ruby_plus_datasheet": "128 lines, datasheet",
    "livox_avia_paper": "Avia, paper",
    "livox_avia_datasheet": "Avia, datasheet",
}
LIDARS = [
    ROOT / "configs" / "lidars" / f"{name}.yaml"
    for name in ("livox_avia", "helios_16", "pandar_64", "ruby_plus")
]


def medians(repetitions: int) -> dict[str, dict[str, float]]:
    """Returns the medians of each C++ benchmark, by name.

    `items_per_second` is the rate in rays per second. Benchmarks of stages also have the
    nanoseconds per ray of each stage. The repetitions of the benchmarks alternate.
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
        run["run_name"]: run
        for run in report["benchmarks"]
        if run.get("aggregate_name", "median") == "median"  # a single repetition has no aggregates
    }


def core_rows(repetitions: int) -> list[tuple[str, float, str]]:
    """Compares the ray rate of the pipeline with upper bounds, such as ray casting alone."""
    every = medians(repetitions)

    def r(name: str, threads: int = 2) -> float:
        return every[f"{name}/real_time/threads:{threads}"]["items_per_second"] / 1e6

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
        *stage_rows(every),
    ]


def stage_rows(every: dict[str, dict[str, float]]) -> list[tuple[str, float, str]]:
    """Returns the nanoseconds per ray of each stage, without stages that a LiDAR does not have.

    every: the result of `medians`.
    """
    return [
        (f"{words}: {stage}", every[f"stages_{name}"][stage], "ns/ray")
        for name, words in STAGES.items()
        for stage in STAGE_NAMES
        if every[f"stages_{name}"][stage] > 0
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
    command = [ROOT / BINARY, "run", SCENE, "--lidar", *LIDARS, "--preset", "paper"]
    command += ["--frames", f"0:{frames}", "--threads", "2"]
    if out is not None:
        command += ["--out", out]
    cost = process.run(command)
    return cost.wall_s, cost.peak_mb


def cost_of(
    tree: Path, lidars: list[str], preset: str, frames: int, *, write: bool
) -> process.Cost:
    """Returns the cost of simulating frames of the highway with a checkout's binary, on one thread.

    write: whether the binary writes the frames, to a file system in memory.
    """
    with tempfile.TemporaryDirectory(dir="/dev/shm") as out:
        command = [tree / BINARY, "run", tree / "configs/scenes/highway.yaml"]
        command += ["--lidar", *(tree / f"configs/lidars/{name}.yaml" for name in lidars)]
        command += ["--preset", preset, "--frames", f"0:{frames}", "--threads", "1"]
        command += ["--set", f"duration_s={DURATION_S}"]
        command += ["--out", Path(out) / "data"] if write else []
        return process.run(command)


def against_rows(other: Path, repetitions: int) -> list[tuple[str, float, str]]:
    """Compares this build with that of another checkout.

    The runs of both alternate. The speed is that of the frames after the first FIRST_FRAMES, so
    that the start of the program does not count. It is measured in CPU time, which depends less on
    other processes than the wall time.
    """
    four = [file.stem for file in LIDARS]
    cases: tuple[tuple[str, list[str], str, bool], ...] = (
        ("128 lines, datasheet", ["ruby_plus"], "datasheet", False),
        ("Avia, datasheet", ["livox_avia"], "datasheet", False),
        ("128 lines, paper", ["ruby_plus"], "paper", False),
        ("four LiDARs with files, paper", four, "paper", True),
    )
    rows = []
    for what, lidars, preset, write in cases:
        seconds: dict[Path, list[float]] = {ROOT: [], other: []}
        peaks: dict[Path, list[float]] = {ROOT: [], other: []}
        for _ in range(repetitions):
            for tree in (ROOT, other):
                few = cost_of(tree, lidars, preset, FIRST_FRAMES, write=write)
                many = cost_of(tree, lidars, preset, LAST_FRAMES, write=write)
                seconds[tree].append(many.cpu_s - few.cpu_s)
                peaks[tree].append(many.peak_mb)
        ours, theirs = (statistics.median(seconds[tree]) for tree in (ROOT, other))
        rows.append((f"{AGAINST}speed, {what}", theirs / ours, "times"))
    here, there = (statistics.median(peaks[tree]) for tree in (ROOT, other))
    rows.append((f"{AGAINST}peak memory, {cases[-1][0]}", here / there, "times"))
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
        "--against",
        type=Path,
        metavar="CHECKOUT",
        help="only compare this build with that of another checkout, in build/dev",
    )
    add_out(parser, "speed.csv")
    return parser


def main() -> None:
    parser = arguments()
    args = parser.parse_args()
    if args.against is not None and not (args.against / BINARY).is_file():
        parser.error(f"--against: expected a checkout with {BINARY}, got {args.against}")
    fewer = max(3, args.repetitions // 2)
    parts = [
        lambda: core_rows(args.repetitions),
        lambda: open3d_rows(args.repetitions),
        lambda: stream_rows(fewer),
        growth_rows,
    ]
    out: Path = args.out
    if args.against is not None:
        parts = [lambda: against_rows(args.against.resolve(), fewer)]
        out = out.with_name(f"{out.stem}_against.csv")
    rows = []
    for part in parts:
        for name, value, unit in part():
            print(f"{name:55s} {value:10.2f} {unit}", flush=True)
            rows.append({"what": name, "value": round(value, 3), "unit": unit})
    pd.DataFrame(rows).assign(
        command=f"benchmarks/run.py --repetitions {args.repetitions}",
        seed=1,
        version=__version__,
        frames_version=simulation.frames_version(),
        machine=machine(),
    ).to_csv(out, index=False)
    print(
        f"peak of this process: {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024} MB",
        file=sys.stderr,
    )


if __name__ == "__main__":
    main()
