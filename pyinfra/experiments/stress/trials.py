"""The trials of a stress test, one for each run and severity, and the table of finished ones."""

import hashlib
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path

import pandas as pd

from pyinfra.core.errors import Error, keep_traceback
from pyinfra.core.files import held, resolved
from pyinfra.core.version import __version__, machine
from pyinfra.core.vocabulary import VEHICLE_TYPES
from pyinfra.experiments import store
from pyinfra.experiments.stress import altered_scenes, score, summary
from pyinfra.experiments.stress.altered_scenes import Base
from pyinfra.experiments.stress.stressors import NONE, UNSTRESSED, Severity, Stressor
from pyinfra.formats import kitti
from pyinfra.formats.csv_table import WORDS, number_text, read_csv, write_tables
from pyinfra.metrics.ground_truth import read_ground_truth
from pyinfra.models.inference.detect import detect, detector_at, model_file
from pyinfra.models.training.provenance import is_among, read_provenance

# Columns that identify a row. A trial with a row in the table is not computed again.
KEY = "detector run lidar preset scene stressor severity seed frames".split()
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
SCENE_S = 4.0  # assumed time of one simulation, used to estimate the run time


@dataclass(frozen=True)
class TrainedRun:
    """A trained detector. The number of training frames and the seed are -1 if unknown."""

    folder: Path
    detector: str
    frames: int
    seed: int

    @property
    def name(self) -> str:
        return resolved(self.folder).name

    @cached_property
    def digest(self) -> str:
        return hashlib.sha256(model_file(self.folder).read_bytes()).hexdigest()


@dataclass(frozen=True)
class Trial:
    """One run tested at one severity.

    If the stressor compares trainings, `run` is the training that is compared with `reference`.
    Otherwise both are the same.
    """

    reference: TrainedRun
    run: TrainedRun
    stressor: Stressor
    severity: Severity

    @property
    def at(self) -> tuple[str, Severity]:
        return self.stressor.name, self.severity

    @property
    def title(self) -> str:
        return f"{self.run.name} {self.stressor.name} {self.severity}"


def read_run(folder: Path, base: Base) -> TrainedRun:
    """Reads a trained detector.

    Raises FileNotFoundError, and Error if the detector was trained for another LiDAR.
    """
    if model_file(folder).suffix == ".npz":
        return TrainedRun(folder, "background", -1, -1)
    provenance = read_provenance(model_file(folder))
    if not provenance.anywhere and not is_among(base.lidar.name, provenance.lidar):
        raise Error(
            f"{folder}: lidar: expected a model trained on {base.lidar.name}, got a model trained "
            f"on {provenance.lidar}"
        )
    description = folder / "run.yaml"
    keys = kitti.read_keys(description) if description.is_file() else {}
    return TrainedRun(folder, provenance.detector, int(keys.get("frames", -1)), provenance.seed)


def plan(
    runs: Sequence[TrainedRun], stressors: dict[Stressor, tuple[Severity, ...]], base: Base
) -> list[Trial]:
    """Returns all trials: first the trials without stress, then one stressor after another.

    Stress is applied to the first run of each detector. Its other runs are severities of the
    stressors `training_frames` and `training_seed`. Raises Error for a run that differs from the
    first in both frames and seed, or in neither, and for two runs with the same severity.
    """
    first: dict[str, TrainedRun] = {}
    for run in runs:
        first.setdefault(run.detector, run)
    trials = [Trial(run, run, NONE, NONE.severities[0]) for run in first.values()]
    others = [(first[run.detector], run) for run in runs if first[run.detector] is not run]
    trained = [(a, b, *_difference(a, b)) for a, b in others]
    known: set[tuple[str, str, Severity]] = set()
    for _, run, name, severity in trained:
        if (run.detector, name, severity) in known:
            raise Error(
                f"{run.folder}: expected one run for each value of {name}, got two runs with "
                f"{severity}"
            )
        known.add((run.detector, name, severity))
    for stressor, severities in stressors.items():
        defaults = {UNSTRESSED, base.lidar.name, base.lidar.preset, base.scene_name}
        if stressor.acts_on == "training":
            trials += [
                Trial(a, b, stressor, severity)
                for a, b, name, severity in trained
                if name == stressor.name
            ]
        for severity in severities:
            if not (stressor.named and severity in defaults):
                trials += [Trial(run, run, stressor, severity) for run in first.values()]
    return trials


def _difference(a: TrainedRun, b: TrainedRun) -> tuple[str, Severity]:
    """Returns how run b differs from run a: `training_frames` or `training_seed`, and its value."""
    if (a.frames == b.frames) == (a.seed == b.seed):
        raise Error(
            f"{b.folder}: expected either the {a.frames} frames or the seed {a.seed} of "
            f"{a.folder}, got {b.frames} frames and seed {b.seed}"
        )
    return (
        ("training_frames", float(b.frames)) if a.seed == b.seed else ("training_seed", str(b.seed))
    )


def key_of(trial: Trial, base: Base, seed: int) -> dict[str, str]:
    run = trial.reference
    names = (run.detector, run.name, base.lidar.name, base.lidar.preset, base.scene_name)
    severity = trial.severity if isinstance(trial.severity, str) else f"{trial.severity:g}"
    values = (*names, trial.stressor.name, severity, str(seed), str(len(base.frames)))
    return dict(zip(KEY, values, strict=True))


def inputs_of(trial: Trial, base: Base) -> str:
    """Returns a digest of the inputs that are not in a row's key: models, frames, scene, LiDAR."""
    parts = [trial.reference.digest, trial.run.digest, str(base.frames), base.identity]
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()[:16]


def row_of(
    trial: Trial, base: Base, cache: Path, seed: int
) -> tuple[dict[str, object], pd.DataFrame]:
    """Runs a trial; returns its row and its bootstrap replicates.

    Raises the errors of the simulation and the detection.
    """
    stressor, severity, folder = trial.stressor, trial.severity, base.folder
    key = key_of(trial, base, seed)
    if stressor.scene_change:
        name = f"{base.scene_name}_{stressor.name}_{key['severity']}"
        folder = altered_scenes.simulated(base, stressor.scene_change(base, severity), cache, name)
    detections, model = [], detector_at(trial.run.folder, folder)
    for k in base.frames:
        points = kitti.read_points(kitti.frame_file(folder, "velodyne", k))
        if stressor.cloud:
            points = stressor.apply(points, float(severity), seed, k)
        detections.append(model.predict(points))
    extra = [severity] if stressor.name == "vehicle_class" and severity not in VEHICLE_TYPES else []
    types = (*VEHICLE_TYPES, *map(str, extra))
    chosen = (
        "" if stressor is NONE else f" --stressors {stressor.name} --severities {key['severity']}"
    )
    scores, replicates = score.scored(read_ground_truth(folder, base.frames), detections, types)
    row = {
        **key,
        "unit": stressor.unit,
        "trained_frames": trial.run.frames,
        "trained_seed": trial.run.seed,
        **scores,
        "inputs": inputs_of(trial, base),
        "command": f"pyinfra stress{chosen} --seed {seed} --max-frames {len(base.frames)}",
        "version": __version__,
        "machine": machine(),
    }
    return row, pd.concat(
        [pd.DataFrame([key] * len(replicates)), replicates.drop(columns="frames")], axis=1
    )


def read(file: Path) -> pd.DataFrame:
    """Reads a table of trials, with its keys as text. The table is empty if there is no file.

    Raises Error if the file is not a table of trials.
    """
    if not file.is_file():
        return pd.DataFrame(columns=list(COLUMNS))
    table = read_csv(file, WORDS.union(KEY))
    if "inputs" not in table:  # a table of an earlier version
        table["inputs"] = None
    missing = [name for name in COLUMNS if name not in table]
    if missing:
        raise Error(
            f"{file}:1: expected the columns of a table of `pyinfra stress`; the column "
            f"{missing[0]} is missing"
        )
    return table.fillna({"unit": ""})


def fill(trial: Trial, base: Base, out: Path, seed: int) -> bool:
    """Runs a trial unless it has a row or another process runs it; returns whether it ran."""
    file, key = out / "stress.csv", key_of(trial, base, seed)

    def measured() -> None:
        row, replicates = row_of(trial, base, out / "worlds", seed)
        store.put(out / "stress_replicates.csv", replicates, KEY)
        store.put(file, pd.DataFrame([row], columns=list(COLUMNS)), KEY)

    lock = out / "locks" / "_".join(key.values())
    return store.fill(lock, lambda: store.has(read(file), key), measured)


def attempt(trial: Trial, base: Base, out: Path, seed: int) -> Exception | None:
    """Calls `fill` for a trial. If it fails, returns the error and saves its traceback in `out`.

    The error of a trial without stress is raised, because all other trials are compared with this
    trial.
    """
    traceback = out / "tracebacks" / f"{'_'.join(key_of(trial, base, seed).values())}.txt"
    try:
        fill(trial, base, out, seed)
    except Exception as error:  # after any error, the other trials continue
        if trial.stressor is NONE:
            raise
        keep_traceback(error, traceback)
        return error
    traceback.unlink(missing_ok=True)
    return None


def missing(trials: Sequence[Trial], base: Base, out: Path, seed: int) -> Iterator[Trial]:
    """Yields the trials without a row. Raises Error if a row has the same key but other inputs."""
    file = out / "stress.csv"
    table = read(file)
    for trial in trials:
        key = key_of(trial, base, seed)
        rows = table[store.among(table, pd.DataFrame([key]), KEY)]
        if len(rows) == 0:
            yield trial
        elif not rows.inputs.isin([inputs_of(trial, base)]).all() and rows.inputs.notna().all():
            raise Error(
                f"{file}: {' '.join(key.values())}: expected a row of this model, these frames and "
                "this data set, got a row of other inputs with the same names; choose a different "
                "`out`"
            )


def write_summary(out: Path) -> list[Path]:
    """Writes summary and ranking of all finished trials. Returns the files of all tables."""
    table = read(out / "stress.csv")
    made = {"stress_summary": summary.summary(table), "stress_ranking": summary.ranking(table)}
    with held(out / "locks" / "summary", wait=True):
        return [out / "stress.csv", *write_tables(out, made, partial(number_text, digits=4))]


def left_out(stressors: Iterable[Stressor], base: Base) -> dict[str, list[str]]:
    """Returns the names of stressors that cannot be applied to a base, grouped by reason."""
    reasons: dict[str, list[str]] = {}
    for stressor in stressors:
        if why := stressor.lacks(base):
            reasons.setdefault(why, []).append(stressor.name)
    return reasons


def able(
    stressors: dict[Stressor, tuple[Severity, ...]], base: Base
) -> dict[Stressor, tuple[Severity, ...]]:
    """Returns the stressors that can be applied to a base. Raises Error if there are none."""
    reasons = left_out(stressors, base)
    names = {name for each in reasons.values() for name in each}
    if len(names) == len(stressors):
        raise Error("; ".join(reasons))
    return {
        stressor: severities
        for stressor, severities in stressors.items()
        if stressor.name not in names
    }


def wrong_scenes(trials: Iterable[Trial], base: Base) -> dict[tuple[str, Severity], Exception]:
    """Checks the changed simulations of trials without running them.

    Returns the errors by the stressor and severity of the trial (`Trial.at`).
    """
    wrong: dict[tuple[str, Severity], Exception] = {}
    for trial in {trial.at: trial for trial in trials if trial.stressor.scene_change}.values():
        assert trial.stressor.scene_change is not None
        try:
            altered_scenes.check(base, trial.stressor.scene_change(base, trial.severity))
        except (OSError, Error) as error:
            wrong[trial.at] = error
    return wrong


def seconds_of(trials: Sequence[Trial], base: Base) -> float:
    """Estimates the seconds that trials take.

    Each detector is timed on two frames. Each changed simulation is assumed to take SCENE_S.
    """
    files = [kitti.frame_file(base.folder, "velodyne", k) for k in base.frames[:2]]
    per_run = {}
    for run in {trial.run.folder: trial.run for trial in trials}.values():
        start = time.perf_counter()
        detect(detector_at(run.folder, base.folder), files, None)
        per_run[run.folder] = (time.perf_counter() - start) / len(files)
    new = {(c.stressor.name, c.severity) for c in trials if c.stressor.scene_change}
    return len(new) * SCENE_S + len(base.frames) * sum(per_run[c.run.folder] for c in trials)
