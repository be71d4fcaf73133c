"""The training loop: AdamW with a one-cycle learning rate over a fixed number of steps.

Random numbers and the learning rate are functions of the step (and the seed). Therefore an
interrupted training resumes at its last checkpoint and gives the same result.
"""

import csv
import dataclasses
import math
import os
import time
from collections.abc import Callable, Generator, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from pyinfra.core.errors import Error
from pyinfra.core.files import naming, write
from pyinfra.models.detectors import distributed, windows
from pyinfra.models.detectors.batch import Batch, Windows, make_batch
from pyinfra.models.detectors.network import Network, keep_memory, one_thread
from pyinfra.models.training import checkpoint
from pyinfra.models.training.batches import ahead, from_workers
from pyinfra.models.training.checkpoint import Checkpoint
from pyinfra.models.training.kept_frames import kept
from pyinfra.models.training.provenance import Provenance
from pyinfra.models.training.recipe import Learning, Precision, Recipe
from pyinfra.models.training.resumption import optimizer_tensors, resume
from pyinfra.models.training.samples import Frames, Samples, augmented
from pyinfra.models.training.validation import Checks, is_due

WARM_UP = 0.4  # share of the steps in which the learning rate rises
DIVIDED = 10.0  # ratio of the highest learning rate to the first
LAST = 1e-4  # ratio of the last learning rate to the first
MOMENTA = (0.95, 0.85)
SAVES = 20  # number of times that a training writes a checkpoint
READS = 20  # number of steps between two readings of the losses, each of which waits for the GPU
MOST_WORKERS = 8  # maximum number of processes that make batches for one GPU


class TrainingDiverged(Error):
    """Raised when the loss or the gradients are not finite."""

    exit_code = 1


@dataclass(frozen=True)
class Progress:
    """The progress of a training after a step."""

    step: int
    steps: int
    rate: float
    loss: float
    parts: dict[str, float]
    seconds: float  # time since this process started or resumed the training
    # CPU time in seconds since the previous step, including batches that a thread makes in advance
    cpu_seconds: float


@dataclass(frozen=True)
class Pace:
    """How a training uses its device. These settings change the weights only by rounding."""

    workers: int = 0  # number of processes that make batches; if 0, a thread makes them
    in_memory: bool = False  # whether all frames are read once, before the first step
    reads_every: int = 1  # number of steps after which losses are read, checked and reported
    fused: bool = False  # whether the optimiser changes all weights in one kernel
    tf32: bool = False  # whether products of matrices round inputs to 10 bits of mantissa
    tuned: bool = False  # whether cuDNN tries its algorithms and uses the fastest
    compiled: bool = False  # whether torch.compile compiles the two-dimensional network


def pace_of(device: torch.device) -> Pace:
    """Returns the default pace of a device."""
    if device.type == "cpu":
        return Pace()
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    workers = min(MOST_WORKERS, ((cores or 1) - 1) // distributed.count())
    return Pace(workers=workers, in_memory=workers > 0, reads_every=READS, fused=True, tf32=True)


def train(
    network: Network,
    frames: Samples,
    recipe: Recipe,
    provenance: Provenance,
    out: Path,
    *,
    begun: Checkpoint | None = None,
    held_out: Frames | None = None,
    device: torch.device | None = None,
    precision: Precision = "float32",
    report: Callable[[Progress], None] | None = None,
    pace: Pace | None = None,
) -> Network:
    """Trains a network to the last step; writes `out`/last.safetensors at intervals.

    held_out: frames whose AP selects best.safetensors; they do not affect the training. begun: the
    checkpoint to resume from, as `read_begun` returns it. pace: by default that of the device.
    Raises TrainingDiverged with the step, the loss and the last checkpoint.
    """
    learning, device = recipe.learning, device or torch.device("cpu")
    pace = pace or pace_of(device)
    done = begun.provenance.step if begun is not None else 0
    # Workers are forked before this process uses the GPU.
    batches = batches_of(frames, recipe, network, provenance.seed, done, pace, device)
    first = distributed.rank() == 0  # only the first process writes files
    step_of = begin(network, recipe, precision, device, pace)
    optimizer = step_of.optimizer
    last = out / "last.safetensors"
    if begun is not None:
        resume(network, optimizer, begun)
    checks = Checks(held_out, out / "validation.csv", done) if held_out is not None else None
    readings = Readings(pace.reads_every, learning.steps, last, report)
    keep_memory()
    with one_thread(), products_of(pace), closing(batches):
        for step, made in batches:
            readings.add(step, *step_of(step, made.to(device)))
            done = step + 1
            described = dataclasses.replace(provenance, step=done)
            # The network is checked before last.safetensors is written. If the process ends between
            # check and writing, a resumed training repeats the check.
            checked = checks is not None and is_due(done, learning.steps)
            saved = done % max(1, learning.steps // SAVES) == 0 or done == learning.steps
            if checked or saved or done == learning.steps:
                readings.read()  # weights that are not finite are never saved
            if first and checks is not None and checks.find_best(network, done, learning.steps):
                checkpoint.save(out / "best.safetensors", network, {}, described)
            if first and saved:
                checkpoint.save(last, network, optimizer_tensors(optimizer), described)
    return network.eval()


@dataclass(frozen=True, eq=False)
class Step:
    """A callable that does one step of a training."""

    network: Network
    optimizer: torch.optim.Optimizer
    recipe: Recipe
    precision: Precision
    device: torch.device

    def __call__(self, step: int, batch: Batch) -> tuple[float, tuple[str, ...], Tensor]:
        """Changes the weights; returns the rate, the names of the losses, and their values.

        The values are on the device: the sum, each loss, and the norm of the gradients.
        """
        network, learning = self.network, self.recipe.learning
        rate = set_rate(self.optimizer, learning, step)
        half = self.precision == "bfloat16"
        with torch.autocast(self.device.type, torch.bfloat16, enabled=half):
            parts = network.losses(batch)
            parts = parts if self.recipe.loss is None else self.recipe.loss(parts, batch)
        loss = torch.stack(list(parts.values())).sum()
        # The loss of the whole batch is checked, so that all processes stop together.
        values = distributed.mean(torch.stack([loss, *parts.values()]))
        self.optimizer.zero_grad(set_to_none=True)
        loss.backward()  # type: ignore[no-untyped-call]
        distributed.average_gradients(network)
        norm = torch.nn.utils.clip_grad_norm_(network.parameters(), learning.clip)
        self.optimizer.step()
        return rate, tuple(parts), torch.cat([values, norm.detach().view(1)])


def begin(
    network: Network, recipe: Recipe, precision: Precision, device: torch.device, pace: Pace
) -> Step:
    """Moves a network to its device in train mode, and returns the step of its training."""
    network = network.to(device).train()
    distributed.share_norms(network)
    part = getattr(network, "bev", None)
    if pace.compiled and part is not None:
        part.compile(dynamic=False)  # tensor shapes are the same in each step
    optimizer = torch.optim.AdamW(
        network.parameters(), recipe.learning.rate, foreach=False, fused=pace.fused
    )
    return Step(network, optimizer, recipe, precision, device)


class Readings:
    """The losses of some steps on the device, which are read, checked and reported together."""

    def __init__(
        self, every: int, steps: int, last: Path, report: Callable[[Progress], None] | None
    ) -> None:
        self.every, self.steps, self.last, self.report = every, steps, last, report
        self.start, self.before = time.monotonic(), time.process_time()
        self.rows: list[tuple[int, float, tuple[str, ...], float, float]] = []
        self.values: list[Tensor] = []

    def add(self, step: int, rate: float, names: tuple[str, ...], values: Tensor) -> None:
        """Adds the values of a step, and reads them if `every` steps were added."""
        now = time.process_time()
        times, self.before = (time.monotonic() - self.start, now - self.before), now
        self.rows.append((step, rate, names, *times))
        self.values.append(values)
        if len(self.rows) == self.every:
            self.read()

    def read(self) -> None:
        """Reads, checks and reports the values. Raises TrainingDiverged."""
        if not self.rows:
            return
        rows, values = self.rows, torch.stack(self.values).tolist()
        self.rows, self.values = [], []
        for (step, rate, names, seconds, cpu_seconds), (loss, *parts, norm) in zip(
            rows, values, strict=True
        ):
            check_finite("loss", loss, step, self.last)
            check_finite("norm of the gradients", norm, step, self.last)
            if self.report is not None:
                numbers = dict(zip(names, parts, strict=True))
                self.report(
                    Progress(step + 1, self.steps, rate, loss, numbers, seconds, cpu_seconds)
                )


def batches_of(
    frames: Samples,
    recipe: Recipe,
    network: Network,
    seed: int,
    done: int,
    pace: Pace,
    device: torch.device,
) -> Generator[tuple[int, Batch]]:
    """Yields each remaining step with its batch. Processes of the pace start at once."""
    steps, batch = range(done, recipe.learning.steps), recipe.learning.batch
    if pace.in_memory and isinstance(frames, Frames) and steps:
        frames = kept(frames, pasted=recipe.augmentation.pasted > 0)
    make = partial(batch_of, frames, recipe, network, seed)
    if pace.workers == 0:
        return ahead(make, steps)
    together = -(-frames.together // batch)
    pinned = device.type == "cuda"
    return from_workers(make, steps, pace.workers, together=together, pinned=pinned)


@contextmanager
def products_of(pace: Pace) -> Iterator[None]:
    """Context manager that sets the precision of products and the cuDNN tuning as in a pace."""
    before = torch.get_float32_matmul_precision(), torch.backends.cudnn.benchmark
    torch.set_float32_matmul_precision("high" if pace.tf32 else before[0])
    torch.backends.cudnn.benchmark = pace.tuned
    try:
        yield
    finally:
        torch.set_float32_matmul_precision(before[0])
        torch.backends.cudnn.benchmark = before[1]


def check_finite(name: str, value: float, step: int, last: Path) -> None:
    """Raises TrainingDiverged if a value is not finite. last: file of the last checkpoint."""
    if not math.isfinite(value):
        good = f"the last valid checkpoint is {last}" if last.exists() else "there is no checkpoint"
        raise TrainingDiverged(f"step {step}: the {name} is {value}; {good}")


def batch_of(frames: Samples, recipe: Recipe, network: Network, seed: int, step: int) -> Batch:
    """Returns the augmented samples of a step as a batch.

    If there are several processes, the batch is this process's share.
    """
    learning = recipe.learning
    size = learning.batch
    samples, centres = [], []
    for n in range(step * size + distributed.rank(), (step + 1) * size, distributed.count()):
        i = frames.nth(seed, n)
        rng = np.random.default_rng([seed, 1, n])
        paste = recipe.augmentation.pasted > 0
        other = frames.another(i, rng) if paste else None
        sample = augmented(frames.sample(i), other, recipe.augmentation, rng)
        if recipe.hook is not None:
            points, boxes = recipe.hook(sample.points, sample.boxes, rng)
            sample = dataclasses.replace(sample, points=points, boxes=boxes)
        samples.append(sample)
        centres.append(windows.centre_of(sample, network.site.area, rng, learning.rare_windows))
    batch = make_batch(samples, network.site.area, network.columns)
    batch = dataclasses.replace(batch, balance=learning.balance)
    if learning.window_m2 == 0:
        return batch
    middles = tuple((float(x), float(y)) for x, y in centres)
    training_windows = Windows(learning.window_m2, middles)
    return dataclasses.replace(batch, windows=training_windows)


def set_rate(optimizer: torch.optim.Optimizer, learning: Learning, step: int) -> float:
    """Sets and returns the learning rate of a step, by the one-cycle policy (Smith, 2018).

    The rate rises and falls along cosines; the momentum falls and rises.
    """
    top, bottom = learning.rate, learning.rate / DIVIDED
    turn = WARM_UP * learning.steps
    if step < turn:
        share, rates, momenta = step / turn, (bottom, top), MOMENTA
    else:
        share = (step - turn) / max(1, learning.steps - turn)
        rates, momenta = (top, bottom * LAST), MOMENTA[::-1]
    weight = (1 - math.cos(math.pi * share)) / 2
    rate = rates[0] + (rates[1] - rates[0]) * weight
    for group in optimizer.param_groups:
        group["lr"] = rate
        group["weight_decay"] = learning.weight_decay
        group["betas"] = (momenta[0] + (momenta[1] - momenta[0]) * weight, 0.999)
    return rate


class Log:
    """`log.csv`, one row per step. A resumed training removes the rows after its checkpoint."""

    def __init__(self, file: Path, done: int) -> None:
        self.file = file
        rows = file.read_text(encoding="utf-8").splitlines() if file.exists() else []
        # An incomplete row, for example after a full disk, is removed. Its step is not finished.
        whole = [row for row in rows if row.count(",") == rows[0].count(",")]
        kept = [row for row in whole[1:] if int(row.split(",")[0]) <= done]
        write(file, "".join(f"{row}\n" for row in [*whole[:1], *kept]))

    def __call__(self, p: Progress) -> None:
        new = self.file.stat().st_size == 0
        with naming(self.file), self.file.open("a", encoding="utf-8", newline="") as opened:
            writer = csv.writer(opened)
            if new:
                writer.writerow(["step", "rate", "loss", *p.parts, "seconds", "cpu_seconds"])
            numbers = [p.rate, p.loss, *p.parts.values(), p.seconds, p.cpu_seconds]
            writer.writerow([p.step, *(f"{v:.6g}" for v in numbers)])
