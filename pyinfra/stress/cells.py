"""The cells of a stress test, run by dial, and the table of those that are done."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import pandas as pd
import yaml

from pyinfra import __version__, kitti, machine
from pyinfra.atomic import held
from pyinfra.benchmark import store
from pyinfra.detectors import Detector
from pyinfra.evaluation.ground_truth import read_ground_truth
from pyinfra.kitti import VEHICLE_TYPES
from pyinfra.stress import lidar, score, worlds
from pyinfra.stress.catalogue import NONE, OWN, Dial, Stressor
from pyinfra.stress.worlds import Base
from pyinfra.training.detect import detect, load_detector, model_file

# What a row is of; a cell with such a row is not computed again.
KEY = "detector run lidar preset scene stressor dial seed frames".split()
COLUMNS = (
    *KEY,
    "unit",
    "trained_frames",
    "trained_seed",
    *score.COLUMNS,
    "inputs",
    "command",
    "version",
    "machine",
)
WORLD_S = 4.0  # to simulate one; for the estimate alone


@dataclass(frozen=True)
class Run:
    """A trained detector and what its folder says of it; frames and seed are -1 if unknown."""

    folder: Path
    detector: str
    frames: int
    seed: int

    @property
    def name(self) -> str:
        return self.folder.resolve().name

    @cached_property
    def model(self) -> Detector:
        return load_detector(self.folder)

    @cached_property
    def digest(self) -> str:
        return hashlib.sha256(model_file(self.folder).read_bytes()).hexdigest()


@dataclass(frozen=True)
class Cell:
    """A run under one dial; of a stressor of training, `run` is the one to compare."""

    reference: Run
    run: Run
    stressor: Stressor
    dial: Dial

    @property
    def at(self) -> tuple[str, Dial]:
        return self.stressor.name, self.dial

    @property
    def title(self) -> str:
        return f"{self.run.name} {self.stressor.name} {self.dial}"


def read_run(folder: Path, base: Base) -> Run:
    """Raises FileNotFoundError, and ValueError for a model of another LiDAR."""
    if model_file(folder).suffix == ".npz":
        return Run(folder, "background", -1, -1)
    from pyinfra.training import checkpoint

    about = checkpoint.load(model_file(folder)).about
    if base.lidar.name not in about.lidar.split():
        raise ValueError(f"{folder}: lidar: found {about.lidar}, allowed {base.lidar.name}")
    description = folder / "run.yaml"
    said = yaml.safe_load(description.read_text("utf-8")) if description.is_file() else {}
    return Run(folder, about.detector, int(said.get("frames", -1)), about.seed)


def plan(
    runs: Sequence[Run], stressors: dict[Stressor, tuple[Dial, ...]], base: Base
) -> list[Cell]:
    """Every cell: first without stress, then stressor by stressor, so that early rows compare.

    The first run of a detector is stressed; its others are dials of the training's stressors.
    Raises ValueError for runs that differ from the first in more than one of them, or in none.
    """
    first: dict[str, Run] = {}
    for run in runs:
        first.setdefault(run.detector, run)
    cells = [Cell(run, run, NONE, NONE.dials[0]) for run in first.values()]
    others = [(first[run.detector], run) for run in runs if first[run.detector] is not run]
    trained = [(a, b, *_difference(a, b)) for a, b in others]
    for stressor, dials in stressors.items():
        own = {OWN, base.lidar.name, base.lidar.preset, base.scene_name}
        if stressor.acts_on == "training":
            cells += [
                Cell(a, b, stressor, dial) for a, b, name, dial in trained if name == stressor.name
            ]
        for dial in dials:
            if not (stressor.named and dial in own):
                cells += [Cell(run, run, stressor, dial) for run in first.values()]
    return cells


def _difference(a: Run, b: Run) -> tuple[str, Dial]:
    """The stressor of training, and its dial, that leads from run a to run b."""
    if (a.frames == b.frames) == (a.seed == b.seed):
        raise ValueError(
            f"{b.folder}: found {b.frames} frames and seed {b.seed}, allowed another number of "
            f"frames or another seed than {a.folder}, which has {a.frames} and {a.seed}"
        )
    return (
        ("training_frames", float(b.frames)) if a.seed == b.seed else ("training_seed", str(b.seed))
    )


def key_of(cell: Cell, base: Base, seed: int) -> dict[str, str]:
    run = cell.reference
    names = (run.detector, run.name, base.lidar.name, base.lidar.preset, base.scene_name)
    dial = cell.dial if isinstance(cell.dial, str) else f"{cell.dial:g}"
    values = (*names, cell.stressor.name, dial, str(seed), str(len(base.frames)))
    return dict(zip(KEY, values, strict=True))


def inputs_of(cell: Cell, base: Base) -> str:
    """A digest of what a row depends on beside its key: models, frames, scene and LiDAR."""
    parts = [cell.reference.digest, cell.run.digest, str(base.frames), str(base.scene)]
    text = (base.folder / lidar.FILE).read_text("utf-8")
    return hashlib.sha256("\n".join([*parts, text]).encode()).hexdigest()[:16]


def row_of(cell: Cell, base: Base, cache: Path, seed: int) -> dict[str, object]:
    """Detects and scores. Raises what simulating, reading and detecting raise."""
    stressor, dial, folder = cell.stressor, cell.dial, base.folder
    key = key_of(cell, base, seed)
    if stressor.world:
        name = f"{base.scene_name}_{stressor.name}_{key['dial']}"
        folder = worlds.simulated(base, stressor.world(base, dial), cache, name)
    found = []
    for k in base.frames:
        points = kitti.read_points(kitti.frame_file(folder, "velodyne", k))
        if stressor.cloud:
            points = stressor.apply(points, float(dial), seed, k)
        found.append(cell.run.model.predict(points))
    extra = [dial] if stressor.name == "vehicle_class" and dial not in VEHICLE_TYPES else []
    types = (*VEHICLE_TYPES, *map(str, extra))
    chosen = "" if stressor is NONE else f" --stressors {stressor.name} --dials {key['dial']}"
    return {
        **key,
        "unit": stressor.unit,
        "trained_frames": cell.run.frames,
        "trained_seed": cell.run.seed,
        **score.scored(read_ground_truth(folder, base.frames), found, types),
        "inputs": inputs_of(cell, base),
        "command": f"pyinfra stress{chosen} --seed {seed} --frames {len(base.frames)}",
        "version": __version__,
        "machine": machine(),
    }


def read(file: Path) -> pd.DataFrame:
    """The rows that are there; keys are text. Raises ValueError for another table."""
    if not file.is_file():
        return pd.DataFrame(columns=list(COLUMNS))
    table = pd.read_csv(file, dtype=dict.fromkeys((*KEY, "unit", "inputs"), str))
    if "inputs" not in table:  # of an earlier version
        table["inputs"] = None
    missing = [name for name in COLUMNS if name not in table]
    if missing:
        raise ValueError(f"{file}:1: found no column {missing[0]}, allowed a table of stress")
    return table.fillna({"unit": ""})


def fill(cell: Cell, base: Base, out: Path, seed: int) -> bool:
    """The row of a cell that has none, unless another process is at it; whether one was added."""
    file, key = out / "stress.csv", key_of(cell, base, seed)
    with held(out / "locks" / "_".join(key.values()), wait=False) as ours:
        if not ours or store.has(read(file), key):
            return False
        row = pd.DataFrame([row_of(cell, base, out / "worlds", seed)], columns=list(COLUMNS))
        store.put(file, row, KEY)
    return True


def attempt(cell: Cell, base: Base, out: Path, seed: int) -> Exception | None:
    """Fills a cell; returns what went wrong.

    Raises what a cell without stress raises: nothing compares without it.
    """
    try:
        fill(cell, base, out, seed)
    except (OSError, ValueError, RuntimeError) as error:
        if cell.stressor is NONE:
            raise
        return error
    return None


def missing(cells: Sequence[Cell], base: Base, out: Path, seed: int) -> Iterator[Cell]:
    """The cells without a row. Raises ValueError for a row of the same names, and other inputs."""
    file = out / "stress.csv"
    table = read(file)
    for cell in cells:
        key = key_of(cell, base, seed)
        rows = table[store.among(table, pd.DataFrame([key]), KEY)]
        if len(rows) == 0:
            yield cell
        elif not rows.inputs.isin([inputs_of(cell, base)]).all() and rows.inputs.notna().all():
            raise ValueError(
                f"{file}: {' '.join(key.values())}: found a row of another model, other frames or "
                "another data set of these names, allowed the same, or another --out"
            )


def left_out(stressors: Iterable[Stressor], base: Base) -> dict[str, list[str]]:
    """Names of the stressors that cannot act on a base, by the reason."""
    reasons: dict[str, list[str]] = {}
    for stressor in stressors:
        if why := stressor.lacks(base):
            reasons.setdefault(why, []).append(stressor.name)
    return reasons


def able(
    stressors: dict[Stressor, tuple[Dial, ...]], base: Base
) -> dict[Stressor, tuple[Dial, ...]]:
    """Those that can act on a base. Raises ValueError if none can."""
    reasons = left_out(stressors, base)
    names = {name for each in reasons.values() for name in each}
    if len(names) == len(stressors):
        raise ValueError("; ".join(reasons))
    return {stressor: dials for stressor, dials in stressors.items() if stressor.name not in names}


def wrong_worlds(cells: Iterable[Cell], base: Base) -> dict[tuple[str, Dial], Exception]:
    """What is wrong with the worlds of cells, by Cell.at; nothing is simulated."""
    wrong: dict[tuple[str, Dial], Exception] = {}
    for cell in {cell.at: cell for cell in cells if cell.stressor.world}.values():
        assert cell.stressor.world is not None
        try:
            worlds.check(base, cell.stressor.world(base, cell.dial))
        except (OSError, ValueError, RuntimeError) as error:
            wrong[cell.at] = error
    return wrong


def seconds_of(cells: Sequence[Cell], base: Base) -> float:
    """How long cells may take: detection as on two frames now, and a simulation for each world."""
    files = [kitti.frame_file(base.folder, "velodyne", k) for k in base.frames[:2]]
    per_run = {}
    for run in {cell.run.folder: cell.run for cell in cells}.values():
        start = time.perf_counter()
        detect(run.model, files, None)
        per_run[run.folder] = (time.perf_counter() - start) / len(files)
    new = {(c.stressor.name, c.dial) for c in cells if c.stressor.world}
    return len(new) * WORLD_S + len(base.frames) * sum(per_run[c.run.folder] for c in cells)
