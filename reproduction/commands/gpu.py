"""Measures the training and the latency of networks on a GPU, within some minutes.

For each detector, the command measures steps per second with the recipe of the tier `full`, the
share of the time in which the GPU waits, its memory, the latency from points to boxes, and the AP
after a fixed number of steps of the tier `quick`. It also measures the batches per second with
several numbers of worker processes. Each detector is measured in its own process, and each value is
written at once. A failure or the end of the time loses only the values that are not yet measured.
On a CPU all values have the tier `quick`:

    python -m reproduction gpu --work out/gpu --out results/gpu.csv
"""

import dataclasses
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from statistics import median
from typing import Annotated, Literal

import pandas as pd
import torch
from torch.profiler import ProfilerActivity, profile

from pyinfra.core.version import machine
from pyinfra.core.vocabulary import Tier
from pyinfra.experiments import store
from pyinfra.models.detectors.detection_area import Site, site_of
from pyinfra.models.detectors.fuse_batchnorm import fused
from pyinfra.models.detectors.network import Network, device_of, one_thread
from pyinfra.models.training import checkpoint, loop
from pyinfra.models.training.recipe import Precision, Recipe, read_recipe
from pyinfra.models.training.samples import Frames
from pyinfra.models.training.sources import on_road, read_source
from pyinfra.models.training.validation import average_precision
from reproduction import ROOT, provenance
from reproduction.arguments import Out, Work, command
from reproduction.simulate import simulate
from reproduction.tables.gpu import AP_STEPS, DETECTORS

Part = Literal["batches", "rates", "latency", "ap", "settings"]
WORKERS = (0, 1, 2, 4, 8)
SCENE, LIDAR, PRESET, SEED = "highway", "ruby_plus", "paper", 1
FRAMES = "0:5000:30"  # frames of the traffic with seed SEED; only frames before 400 s are used
HELD_OUT = 20  # number of last frames, on which the AP is measured
WARM_UP, PROFILED = 6, 5  # numbers of steps before the measurement, and of steps with timed kernels
LONGEST = 8  # number of slowest kernels that are printed
KEY = ["device", "detector", "tier", "setting", "measure"]

# Maps the name of a setting to the precision and to the changed fields of loop.Pace.
Rates = dict[str, tuple[Precision, dict[str, bool]]]
ON_CPU: Rates = {"float32": ("float32", {})}  # few CPUs can multiply matrices of 16-bit numbers
# `pyinfra train` on a GPU uses `tf32` or, with --precision bfloat16, `bfloat16`.
RATES: Rates = {
    "tf32": ("float32", {"tf32": True}),
    "bfloat16": ("bfloat16", {"tf32": True}),
    "float32": ("float32", {"tf32": False}),
}
# Settings other than the default, with which a GPU may be faster.
SETTINGS: Rates = {
    "tuned": ("float32", {"tf32": True, "tuned": True}),
    "bfloat16 tuned": ("bfloat16", {"tf32": True, "tuned": True}),
    "compiled": ("float32", {"tf32": True, "tuned": True, "compiled": True}),
    "bfloat16 compiled": ("bfloat16", {"tf32": True, "tuned": True, "compiled": True}),
}
# Detector and parts that one process measures, and the time limit of the process in seconds.
TASKS: tuple[tuple[str, tuple[Part, ...], float], ...] = (
    ("centerpoint-pillar", ("batches",), 60),
    *((detector, ("rates", "latency", "ap"), 110) for detector in DETECTORS),
    *((detector, ("settings",), 100) for detector in DETECTORS),
)


@dataclass(frozen=True)
class Bench:
    """The measurements of one detector on one device."""

    detector: str
    device: torch.device
    folder: Path  # folder with the frames of the LiDAR
    out: Path
    seconds: float  # duration of one measurement of training steps

    @property
    def tier(self) -> Tier:
        return "full" if self.device.type == "cuda" else "quick"

    def recipe(self, tier: Tier, steps: int) -> Recipe:
        recipe = read_recipe(ROOT / "configs/detectors" / f"{self.detector}.yaml", tier)
        learning = dataclasses.replace(recipe.learning, steps=steps, validate_frames=0)
        if tier == "full":
            learning = dataclasses.replace(learning, batch=8)
        return dataclasses.replace(recipe, learning=learning)

    def frames(self) -> tuple[Frames, Frames, Site]:
        """Returns the training frames, the held-out frames, and the site."""
        source = on_road(read_source(self.folder, "full"))
        frames = Frames(source.clouds, source.read_boxes())
        site = site_of(frames.boxes, [] if source.region is None else [source.region])
        return frames.part(slice(0, -HELD_OUT)), frames.part(slice(-HELD_OUT, None)), site

    def write(self, tier: Tier, setting: str, measure: str, value: float) -> None:
        name = torch.cuda.get_device_name() if self.device.type == "cuda" else machine()
        row = dict(zip(KEY, (name, self.detector, tier, setting, measure), strict=True))
        words = f"gpu --device {self.device.type}"
        columns = {**row, "value": value, "seed": SEED, **provenance(words)}
        store.put(self.out, pd.DataFrame([columns]), KEY)
        print(f"{self.detector} {tier} {setting}: {measure} {value:.4g}", flush=True)


def build(recipe: Recipe, site: Site) -> Network:
    torch.manual_seed(SEED)
    return checkpoint.build(recipe.detector, recipe.network, site)


def batches(bench: Bench) -> None:
    """Measures the batches per second with several numbers of worker processes."""
    frames, _, site = bench.frames()
    recipe = bench.recipe("full", 100_000)
    network = build(recipe, site)
    for workers in (n for n in WORKERS if n <= (os.cpu_count() or 1)):
        pace = loop.Pace(workers=workers, in_memory=True)
        made = loop.batches_of(frames, recipe, network, SEED, 0, pace, torch.device("cpu"))
        with closing(made):
            for _ in range(16 + 4 * workers):
                next(made)  # batches made in advance are not timed
            count, started = 0, time.perf_counter()
            while (spent := time.perf_counter() - started) < bench.seconds / 2:
                next(made)
                count += 1
        bench.write("full", f"{workers} workers", "batches_per_s", count / spent)


def rates(bench: Bench, chosen: Rates | None = None) -> None:
    """Measures steps per second with each setting, by default with 32 and with 16 bits."""
    default = ON_CPU if bench.device.type == "cpu" else RATES
    for name, (precision, changes) in (chosen or default).items():
        attempt(bench, name, partial(rate, bench, name, precision, changes))


def attempt(bench: Bench, setting: str, measure: Callable[[], None]) -> None:
    """Measures a setting; a failure is printed, and the next setting is measured."""
    try:
        measure()
    except Exception as error:
        print(f"{bench.detector} {setting}: {type(error).__name__}: {error}", flush=True)


@contextmanager
def training(
    bench: Bench, recipe: Recipe, frames: Frames, site: Site, precision: Precision, pace: loop.Pace
) -> Iterator[tuple[Network, Callable[[], None], loop.Readings]]:
    """Yields a new network, a function that makes a training step, and the losses of the steps."""
    network, device = build(recipe, site), bench.device
    made = loop.batches_of(frames, recipe, network, SEED, 0, pace, device)
    step_of = loop.begin(network, recipe, precision, device, pace)
    readings = loop.Readings(pace.reads_every, recipe.learning.steps, Path("none"), None)

    def step() -> None:
        number, batch = next(made)
        readings.add(number, *step_of(number, batch.to(device)))

    with closing(made), one_thread(), loop.products_of(pace):
        yield network, step, readings


def rate(bench: Bench, setting: str, precision: Precision, changes: dict[str, bool]) -> None:
    """Measures steps per second, the share of the time in which the GPU waits, and its memory."""
    frames, _, site = bench.frames()
    recipe, device = bench.recipe(bench.tier, 100_000), bench.device
    pace = dataclasses.replace(loop.pace_of(device), **changes)
    with training(bench, recipe, frames, site, precision, pace) as (_, step, _):
        for _ in range(WARM_UP if device.type == "cuda" else 1):
            step()
        wait_for(device)
        if device.type == "cuda":
            torch.cuda.reset_peak_memory_stats()
        count, started = 0, time.perf_counter()
        while time.perf_counter() - started < bench.seconds or count < 3:
            step()
            count += 1
        wait_for(device)
        per_step = (time.perf_counter() - started) / count
        bench.write(bench.tier, setting, "steps_per_s", 1 / per_step)
        if device.type == "cuda":
            memory = torch.cuda.max_memory_allocated() / 1e9
            bench.write(bench.tier, setting, "memory_gb", memory)
            busy = busy_s(step) / PROFILED
            bench.write(bench.tier, setting, "waits", max(0.0, 1 - busy / per_step))


def busy_s(step: Callable[[], None]) -> float:
    """Returns the time in which the GPU computes, in PROFILED steps; prints the longest kernels."""
    with profile(activities=[ProfilerActivity.CUDA]) as profiler:
        for _ in range(PROFILED):
            step()
        torch.cuda.synchronize()
    times = {event.key: float(event.self_device_time_total) for event in profiler.key_averages()}
    for name in sorted(times, key=lambda key: -times[key])[:LONGEST]:
        print(f"    {times[name] / 1000 / PROFILED:8.2f} ms {name[:100]}", flush=True)
    return sum(times.values()) / 1e6


def trained(bench: Bench, recipe: Recipe, frames: Frames, site: Site, steps: int) -> Network:
    """Returns a network after some steps of its recipe."""
    pace = loop.pace_of(bench.device)
    with training(bench, recipe, frames, site, "float32", pace) as (network, step, readings):
        for _ in range(steps):
            step()
        readings.read()
    return network.eval()


def latency(bench: Bench) -> None:
    """Measures the median time from points to boxes of a network of the tier's size."""
    frames, held_out, site = bench.frames()
    steps = 20 if bench.device.type == "cuda" else 2
    network = fused(trained(bench, bench.recipe(bench.tier, 1000), frames, site, steps))
    in_memory = [cloud() for cloud in held_out.clouds]
    times = []
    for cloud in [*in_memory[:5], *in_memory, *in_memory]:
        started = time.perf_counter()
        network.predict(cloud)
        times.append(1000 * (time.perf_counter() - started))
    bench.write(bench.tier, "float32", "latency_ms", median(times[5:]))


def ap(bench: Bench) -> None:
    """Measures the AP on held-out frames after AP_STEPS steps of the tier `quick`."""
    frames, held_out, site = bench.frames()
    network = trained(bench, bench.recipe("quick", AP_STEPS), frames, site, AP_STEPS)
    bench.write("quick", "float32", "ap_r1000", average_precision(network, held_out))


def wait_for(device: torch.device) -> None:
    if device.type == "cuda":
        torch.cuda.synchronize()


MEASURES: dict[Part, Callable[[Bench], None]] = {
    "batches": batches,
    "rates": rates,
    "latency": latency,
    "ap": ap,
    "settings": partial(rates, chosen=SETTINGS),
}


def measure(bench: Bench, parts: tuple[Part, ...]) -> None:
    """Measures parts in this process. A part that fails is printed, and the next one follows."""
    for part in parts:
        attempt(bench, part, partial(MEASURES[part], bench))


def simulated(work: Path) -> Path:
    """Returns the folder of the LiDAR's frames, which are simulated if they do not exist."""
    data = work / "frames"
    if not (data / LIDAR).is_dir():
        simulate(SCENE, [LIDAR], data, preset=PRESET, seed=SEED, frames=FRAMES)
    return data / LIDAR


@command
def main(
    *,
    work: Work,
    out: Out = Path("gpu.csv"),
    device: str = "cuda" if torch.cuda.is_available() else "cpu",
    detectors: Annotated[Sequence[str], {"choices": DETECTORS}] = tuple(DETECTORS),
    parts: Sequence[Part] = tuple(MEASURES),
    seconds: float = 360,
    alone: bool = False,
) -> int:
    """
    Parameters
    ----------
    work : working folder for frames, about 1 GB
    device : PyTorch device (default: a GPU if there is one)
    detectors : detectors to measure (default: all)
    parts : quantities to measure (default: all)
    seconds : maximum duration of all measurements on a GPU together
    alone : measure one detector in this process
    """
    started, chosen_device = time.monotonic(), device_of(device)
    folder = simulated(work)
    if alone:
        bench = Bench(detectors[0], chosen_device, folder, out, 6.0)
        measure(bench, tuple(parts))
        return 0
    limited = chosen_device.type == "cuda"  # only time on a GPU is limited
    for detector, parts_of_task, longest in TASKS:
        chosen = [part for part in parts_of_task if part in parts]
        left = seconds - (time.monotonic() - started)
        if not chosen or detector not in detectors or (limited and left < 15):
            continue
        if chosen_device.type == "cpu" and chosen == ["settings"]:
            continue
        words = ["--work", work, "--out", out, "--device", device]
        line = [sys.executable, "-m", "reproduction", "gpu", "--alone", *map(str, words)]
        try:
            subprocess.run(
                [*line, "--detectors", detector, "--parts", *chosen],
                check=False,
                timeout=min(longest, left) if limited else None,
            )
        except subprocess.TimeoutExpired:
            print(f"{detector} {' '.join(chosen)}: not finished in time", flush=True)
    return 0
