"""Public API functions that train detectors and run benchmarks in a folder.

The other public functions are in `conversion.py` and in the packages on lower layers.
`pyinfra/__init__.py` lists all public functions.
"""

from __future__ import annotations

import atexit
import math
import os
import shutil
import tempfile
import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from pyinfra.core.errors import Error
from pyinfra.core.names import StrPath, file_or_name, path_of
from pyinfra.core.progress import show_line
from pyinfra.core.public import CALLER, public
from pyinfra.dataset.catalogue import shipped
from pyinfra.dataset.frame_sequence import FrameSequence

if TYPE_CHECKING:
    from pyinfra.core.vocabulary import Tier
    from pyinfra.models.inference.boxes_table import TrainedDetector

Progress = Callable[[str], None]


@public(seed=(0, 2**63), steps=(0, 10_000_000))
def train(
    config: StrPath,
    frames: FrameSequence | StrPath | Sequence[FrameSequence | StrPath],
    *,
    work: StrPath | None = None,
    steps: int | None = None,
    tier: Tier = "quick",
    start: StrPath | None = None,
    seed: int = 1,
    device: str = "cpu",
    augment: Callable[..., Any] | None = None,
    loss: Callable[..., Any] | None = None,
    progress: Callable[..., Any] | None = None,
) -> TrainedDetector:
    """Trains a detector, or resumes a training that was stopped.

    The function warns of labels of types that are no class of the detector.

    Parameters
    ----------
    config : a name (`pointpillars`, `centerpoint-pillar`, `generalist`, ...) or a file
    frames : frames of `simulate` or `load_dataset`, which are all used; or folders of LiDARs, whose
        train frames are used; or a list of these
    work : output folder of checkpoints and log; by default a temporary folder, which is removed
        when the process ends (`TrainedDetector.save` keeps the weights)
    steps : number of training steps; by default that of the tier
    tier : `smoke` (a quick check), `quick` (minutes) or `full`
    start : a model whose weights are the initial weights of the training
    seed : seed of the initial weights, the sample order and the augmentation
    device : torch device
    augment : further augmentation: a function of points (n, 4), boxes (k, 7), z from the road, and
        a NumPy random generator, which returns points and boxes. It must keep the number of boxes
    loss : a function of the losses of a step, a dict of PyTorch scalars by name, and of its batch,
        which returns such a dict; the sum of its values is minimised
    progress : called after each step with an object that has `step`, `steps`, `rate`, `loss`, and
        `parts`, the losses by name; in any case terminals and notebooks show a bar

    Returns
    -------
    The trained detector, an input of `detect`

    Raises
    ------
    Error : for an unknown name, a wrong key, or folders without vehicles

    Examples
    --------
    >>> import tempfile
    >>> import pyinfra as pi
    >>> frames = pi.simulate(pi.load_scene("highway"), "helios_16", range(0, 5000, 500))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     recording = pi.export(frames, "pcd", f"{folder}/recording")
    ...     data = pi.import_recording(recording, "pcd", f"{folder}/data/pole")
    ...     model = pi.train("background", data.folder, work=f"{folder}/model")
    ...     detections = pi.detect(model, data)
    >>> len(detections) > 0
    True
    >>> model = pi.train("background", frames)
    >>> len(pi.detect(model, frames)) > 0
    True
    """
    from pyinfra.models.inference.boxes_table import load_detector
    from pyinfra.models.training import train as training
    from pyinfra.models.training.recipe import read_recipe
    from pyinfra.models.training.sources import read_source, sequence_source

    given: list[Any] = list(frames) if isinstance(frames, (list, tuple)) else [frames]
    if not given:
        raise Error("frames: expected one or more frames, got none")
    recipe = read_recipe(file_or_name(config, shipped("detectors"), "config"), tier)
    if steps is not None:
        recipe = replace(recipe, learning=replace(recipe.learning, steps=steps))
    recipe = replace(recipe, hook=augment, loss=loss)
    if work is None:
        work = tempfile.mkdtemp(prefix="pyinfra_train_")
        atexit.register(shutil.rmtree, work, ignore_errors=True)
    if start is not None:
        recipe = recipe.begun_with(Path(start))
    sources = [
        sequence_source(one, tier, recipe.classes)
        if isinstance(one, FrameSequence)
        else read_source(path_of(one, "frames"), tier, classes=recipe.classes)
        for one in given
    ]
    for text in filter(None, (source.read_warning() for source in sources)):
        warnings.warn(f"other-types: {text}", stacklevel=CALLER)
    model = training.train(recipe, sources, Path(work), seed=seed, device=device, watch=progress)
    return load_detector(model, device=device)


@public(jobs=(1, math.inf))
def benchmark(
    config: StrPath,
    out: StrPath,
    *,
    work: StrPath,
    tier: Tier = "quick",
    scene: StrPath = "",
    jobs: int = 1,
    latency: bool = False,
    device: str = "cpu",
    progress: Progress | None = None,
) -> pd.DataFrame:
    """Runs all experiments of a benchmark, or resumes a benchmark that was stopped.

    An experiment is one combination of scene, LiDAR, preset, detector and seed.

    Parameters
    ----------
    config : name of a file in configs/benchmarks, or a path
    out : folder of the result tables
    work : folder of frames and trained detectors
    tier : `smoke`, `quick` or `full`
    scene : scene name or file that replaces the scenes of the configuration
    jobs : number of experiments that run in parallel
    latency : only measure the finished experiments' run time again, one at a time
    device : torch device
    progress : callback that receives one line of text per step

    Returns
    -------
    DataFrame : one row per experiment; the row of a failed experiment states the reason

    Raises
    ------
    Error : for an unknown name or a wrong key

    Examples
    --------
    >>> import tempfile
    >>> import pyinfra as pi
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     table = pi.benchmark("example", f"{folder}/out", work=f"{folder}/work", tier="smoke")
    >>> table[["lidar", "detector"]].values.tolist()
    [['helios_16', 'background']]
    """
    from pyinfra.experiments.benchmark.latency import time_again
    from pyinfra.experiments.benchmark.matrix import read_plan
    from pyinfra.experiments.benchmark.runner import benchmark as run
    from pyinfra.experiments.benchmark.workspace import Workspace
    from pyinfra.experiments.pool import Pool
    from pyinfra.experiments.store import read

    file = file_or_name(config, shipped("benchmarks"), "config")
    plan = read_plan(file, tier, os.fspath(scene))
    workspace = Workspace(Path(work), Path(out), tier)
    if latency:
        time_again(plan, workspace, device=device, progress=progress or show_line)
    else:
        pool = Pool("local", jobs, "", gpu=device != "cpu")
        run(plan, workspace, pool, device=device, progress=progress or show_line)
    return read(workspace.table("experiments"))


@public()
def export_onnx(model: TrainedDetector | StrPath, out: StrPath) -> Path:
    """Writes a dense detector as one ONNX file: from points to boxes, with suppression.

    The input `points` is (n, 4) float32, n >= 1: x y z and intensity (0 to 1), inside the area in
    the metadata of the file.
    The outputs are `boxes` (k, 7) and `scores` (k,), best first, and with several classes their
    numbers `classes` (k,). z of points and boxes is the height above the road, and scores are not
    calibrated.

    Parameters
    ----------
    model : a trained `pointpillars` or `centerpoint-pillar`: a result of `train` or
        `load_detector`, or the folder or name of a model
    out : .onnx file

    Returns
    -------
    Path of the file

    Raises
    ------
    Error : for a detector of another kind, or of stacked frames

    Examples
    --------
    >>> import pyinfra as pi
    >>> try:
    ...     pi.export_onnx("nothing", "model.onnx")
    ... except pi.Error as error:
    ...     print(str(error).partition(":")[0])
    model
    """
    from pyinfra.models.inference.boxes_table import TrainedDetector
    from pyinfra.models.pytorch import need_pytorch

    need_pytorch()
    from pyinfra.models.inference.onnx import export

    file = path_of(out, "out")
    run = model.file if isinstance(model, TrainedDetector) else path_of(model, "model")
    export(run, file)
    return file
