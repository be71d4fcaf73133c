"""Prepares and runs a stress test."""

from __future__ import annotations

import math
import os
import warnings
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from pyinfra.core.errors import Error
from pyinfra.core.names import path_of
from pyinfra.core.progress import show_line
from pyinfra.core.public import CALLER, public
from pyinfra.experiments.stress import altered_scenes, summary, trials
from pyinfra.experiments.stress.altered_scenes import Base
from pyinfra.experiments.stress.stressors import STRESSORS, chosen
from pyinfra.experiments.stress.trials import Trial
from pyinfra.models.inference.boxes_table import TrainedDetector

FRAMES = 60  # maximum number of frames, evenly spread over the test frames
Model = TrainedDetector | str | os.PathLike[str]


@dataclass(frozen=True, eq=False)
class Prepared:
    """The trials of a stress test.

    `every` has all trials, `todo` the trials to run, and `wrong` the trials that cannot be
    simulated, with their errors.
    """

    base: Base
    every: Sequence[Trial]
    todo: Sequence[Trial]
    wrong: dict[Trial, Exception]
    left_out: dict[str, list[str]]  # stressors that cannot be applied to the data, by reason


@public(frames=(1, math.inf), seed=(0, 2**63))
def stress(
    models: Model | list[Model] | tuple[Model, ...],
    data: str | os.PathLike[str],
    *,
    work: str | os.PathLike[str],
    stressors: Sequence[str] | None = None,
    severities: Sequence[float | str] | None = None,
    frames: int = FRAMES,
    seed: int = 1,
    progress: Callable[[str], None] | None = None,
) -> pd.DataFrame:
    """Tests detectors under stressors of growing severity, and reports where each detector fails.

    Stressors change the point clouds, the simulated scene or LiDAR, or the training. Finished
    trials are not repeated. The same call resumes an interrupted test. A call with other stressors
    adds rows.

    Parameters
    ----------
    models : results of `load_detector`, or folders or files of trainings. If there are several
        trainings of one detector, stress is applied to the first. The others, which differ in
        training frames or seed, are compared with the first
    data : a LiDAR's folder with labels; its test frames are used
    work : folder for changed simulations, rows (stress.csv), summary and ranking
    stressors : names, such as `rain` or `tilt`; by default all
    severities : severities to test if there is only one stressor; by default the severities that
        are defined for the stressor
    frames : largest number of frames, evenly spread
    seed : seed of the random changes
    progress : called with a line of text before each trial

    Returns
    -------
    DataFrame : a row for each detector and stressor, with AP without stress, the least AP, the
        severities at which AP is 10 lower and at which it is half, and the error that
        increases first

    Raises
    ------
    Error : for an unknown stressor, a folder without test frames, or a model of another LiDAR

    Examples
    --------
    >>> import tempfile
    >>> import pyinfra as pi
    >>> frames = pi.simulate(pi.load_scene("highway"), "helios_16", range(0, 5000, 500))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     recording = pi.export(frames, "pcd", f"{folder}/recording")
    ...     data = pi.import_recording(recording, "pcd", f"{folder}/data/pole").folder
    ...     model = pi.train("background", data, work=f"{folder}/model")
    ...     table = pi.stress(model, data, work=f"{folder}/work", stressors=["drop_out"])
    >>> bool(table.ap_least[0] < table.ap_none[0])
    True
    """
    several = models if isinstance(models, (list, tuple)) else [models]
    paths = [_folder(model) for model in several]
    if not paths:
        raise Error("models: expected one or more models, got none")
    out, progress = path_of(work, "work"), progress or show_line
    words = None if severities is None else [str(severity) for severity in severities]
    names = list(STRESSORS) if stressors is None else list(stressors)
    plan = prepare(paths, path_of(data, "data"), out, names, words, frames, seed)
    for why, left in plan.left_out.items():
        text = f"left out {', '.join(left)}: {why}"
        progress(text)
        if stressors is not None:
            warnings.warn(text, stacklevel=CALLER)
    failed = dict(plan.wrong)
    for trial in plan.todo:
        progress(trial.title)
        if error := trials.attempt(trial, plan.base, out, seed):
            failed[trial] = error
    if failed:
        first, error = next(iter(failed.items()))
        text = (
            f"{len(failed)} of {len(plan.every)} trials failed; the first is {first.title}: {error}"
        )
        warnings.warn(f"{text}; call the function again to repeat them", stacklevel=CALLER)
    trials.write_summary(out)
    return summary.summary(trials.read(out / "stress.csv"))


def prepare(
    models: Iterable[Path],
    data: Path,
    out: Path,
    stressors: Sequence[str],
    severities: Sequence[str] | None,
    frames: int,
    seed: int,
) -> Prepared:
    """Returns all trials and the trials to run. Simulates no frames. Raises Error and OSError."""
    if frames < 1:
        raise Error(f"frames: expected 1 or more, got {frames}")
    with_severities = chosen(list(stressors), None if severities is None else list(severities))
    base = altered_scenes.read_base(data, frames)
    runs = [trials.read_run(folder, base) for folder in models]
    every = trials.plan(runs, trials.able(with_severities, base), base)
    todo = list(trials.missing(every, base, out, seed))
    wrong_at = trials.wrong_scenes(todo, base)
    wrong = {trial: wrong_at[trial.at] for trial in todo if trial.at in wrong_at}
    left = [trial for trial in todo if trial.at not in wrong_at]
    return Prepared(base, every, left, wrong, trials.left_out(with_severities, base))


def _folder(model: Model) -> Path:
    """Returns the folder in which a model was trained, or the model's file if there is none."""
    if not isinstance(model, TrainedDetector):
        return path_of(model, "models")
    of_training = model.file.name in ("last.safetensors", "background.npz")
    return model.file.parent if of_training else model.file
