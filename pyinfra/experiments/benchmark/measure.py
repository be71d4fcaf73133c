"""One experiment: training, detection and evaluation; latency is measured separately."""

import time
from dataclasses import asdict
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from pyinfra.core.arrays import FloatArray
from pyinfra.core.errors import Error
from pyinfra.core.machine_load import OtherLoad, other_load
from pyinfra.core.version import __version__, machine
from pyinfra.core.vocabulary import SUBSETS
from pyinfra.dataset.frames import frame_numbers, spread
from pyinfra.dataset.frames_version import LEARNT, number_at
from pyinfra.dataset.prediction_origin import MODEL_FRAMES, read_origin, write_origin
from pyinfra.experiments.benchmark.matrix import Experiment
from pyinfra.formats import kitti
from pyinfra.formats.csv_table import read_csv
from pyinfra.metrics.evaluate import evaluated
from pyinfra.metrics.evaluation_result import Evaluation
from pyinfra.metrics.intervals import ranks_of_median
from pyinfra.metrics.row_selection import AP_COLUMNS, AP_ENDS, AP_OF, OFF_REGION
from pyinfra.metrics.settings import Settings
from pyinfra.models.inference import detect
from pyinfra.models.inference.frames_learnt import model_origin
from pyinfra.models.training.recipe import Recipe
from pyinfra.models.training.sources import read_source
from pyinfra.models.training.train import train

Tables = dict[str, pd.DataFrame]
SETTINGS = Settings(ground_truths=SUBSETS)
FEWEST_TIMED, MOST_TIMED = 15, 100  # minimum and maximum number of frames whose latency is measured
TIMED_S = 3.0  # intended total time of the frames whose latency is measured
FIRST_FRAMES = 3  # number of warm-up frames; a detector is slower in its first frames
OFF_REGION_SCORE = 0.5  # minimum score of the boxes outside the region that are counted
BUSY = 0.25  # load by other processes, in cores, above which a detector may have to wait
LATENCY = tuple(
    f"latency_{w}"
    for w in "p50_ms p95_ms low_ms high_ms other_cores frames threads version machine".split()
)
MEASURED = (
    *AP_COLUMNS,
    *("objects", "objects_all", "objects_present", OFF_REGION),
    *("train_seconds", "train_steps"),
    *LATENCY,
)


def tables(
    experiment: Experiment, recipe: Recipe, folder: Path, run: Path, *, device: str = "cpu"
) -> Tables:
    """Runs an experiment and returns its rows by table.

    The tables are `experiments`, `areas`, `replicates`, `ranges`, `distance` (without the rows of
    ground truth `common`), and `squares` for a site of lanes. An interrupted training resumes.
    folder: the LiDAR's folder, which has a split. run: folder for the trained detector. Raises the
    errors of training, detection and evaluation, and Error if no vehicle is in the subset
    `captured`.
    """
    seconds = trained(experiment, recipe, folder, run, device)
    detected(run, folder, device)
    evaluation = evaluated(folder, run / "predictions", SETTINGS, ranges=True)
    check_counted(evaluation)
    windows = evaluation.distance_ap
    return {
        "squares": keyed(experiment, evaluation.cells),
        "ranges": keyed(experiment, evaluation.ranges),
        "areas": keyed(experiment, evaluation.areas),
        "distance": keyed(experiment, windows[windows.ground_truth != "common"]),
        "replicates": keyed(experiment, evaluation.replicates),
        "experiments": pd.DataFrame(
            [row(experiment, evaluation, seconds, steps_of(recipe)) | numbers_of(folder, run)]
        ),
    }


def check_counted(evaluation: Evaluation) -> None:
    """Raises Error if no vehicle has a point, because AP is then undefined."""
    rows = evaluation.ap[evaluation.ap.ground_truth == "captured"]
    if not rows.objects.sum():
        raise Error(
            f"expected a vehicle with a point in the {len(evaluation.truth.frames)} test frames, "
            "got none: AP is undefined"
        )


def trained(experiment: Experiment, recipe: Recipe, folder: Path, run: Path, device: str) -> float:
    """Trains a detector and returns the CPU seconds of all its steps, including earlier runs."""
    before = time.process_time()
    source = read_source(folder, experiment.tier, classes=recipe.classes)
    train(recipe, [source], run, seed=experiment.seed, device=device, quiet=True)
    log = run / "log.csv"
    if log.exists():
        return float(read_csv(log).cpu_seconds.sum())
    return time.process_time() - before


def detected(run: Path, folder: Path, device: str) -> None:
    """Writes the predictions for the test frames to the folder `predictions` of a run."""
    files = [kitti.frame_file(folder, "velodyne", k) for k in frame_numbers(folder)]
    (run / "predictions").mkdir(exist_ok=True)
    write_origin(run / "predictions", model_origin(folder, detect.model_file(run)), replace=True)
    read = detect.reader_at(run, folder, files)
    detector = detect.detector_at(run, folder, device=device)
    detect.detect(detector, files, run / "predictions", read=read)


def timed_alone(
    run: Path, folder: Path, device: str, *, every: int | None = None
) -> tuple[dict[str, object], OtherLoad]:
    """Measures the latency from points to boxes, on one thread, or on the GPU `device`.

    Returns the columns of the latency, and the load of other processes. every: n uses every n-th
    test frame; by default FEWEST_TIMED to MOST_TIMED frames are used, which take about TIMED_S. The
    caller must make sure that nothing else runs.
    """
    numbers, detector = frame_numbers(folder), detect.detector_at(run, folder, device=device)
    file_of = partial(kitti.frame_file, folder, "velodyne")
    _, first_ms = detect.detect(detector, [file_of(k) for k in numbers[:FIRST_FRAMES]], None)
    frames = int(np.clip(1000 * TIMED_S / first_ms[-1], FEWEST_TIMED, MOST_TIMED))
    chosen = numbers[::every] if every else spread(numbers, frames)
    times = []
    with other_load() as load:
        for number in chosen:
            points = kitti.read_points(file_of(number))
            started = time.process_time()
            _, seconds = detect.timed(detector, points)
            times.append((seconds, time.process_time() - started))
    wall, cpu = 1000 * np.array(times).T
    waits = load.cores > BUSY and not device.startswith("cuda")
    columns = latency_columns(wall, np.minimum(cpu, wall) if waits else wall, load)
    return {**columns, "latency_machine": computer(run, device)}, load


def computer(run: Path, device: str) -> str:
    """Returns the machine that runs a detector, with the GPU if the detector uses one."""
    if not device.startswith("cuda") or detect.model_file(run).suffix == ".npz":
        return machine()
    import torch

    return f"{machine()} with {torch.cuda.get_device_name(device)}"


def latency_columns(times: FloatArray, least: FloatArray, load: OtherLoad) -> dict[str, object]:
    """Returns the columns of the latency. The median's interval is computed from order statistics.

    times: milliseconds of each frame. least: milliseconds that each frame would at least take on a
    machine without other processes; the low end of the interval is computed from them.
    """
    p50, p95 = np.percentile(times, (50, 95))
    low, high = ranks_of_median(len(times))
    return {
        "latency_p50_ms": round(p50, 2),
        "latency_p95_ms": round(p95, 2),
        "latency_low_ms": round(np.sort(least)[max(low - 1, 0)], 2),
        "latency_high_ms": round(np.sort(times)[min(high, len(times) - 1)], 2),
        "latency_other_cores": round(load.cores, 2),
        "latency_frames": len(times),
        "latency_threads": 1,
        "latency_version": __version__,
    }


def steps_of(recipe: Recipe) -> int:
    """Returns the training steps of a recipe.

    The number is 0 for `background`, and for a network that is used without further training.
    """
    return 0 if recipe.detector == "background" else recipe.learning.steps


def row(
    experiment: Experiment, evaluation: Evaluation, seconds: float, steps: int
) -> dict[str, object]:
    """Returns the row of a finished experiment; its latency is NaN until it is measured."""
    by_truth = evaluation.ap.set_index("ground_truth")
    return {
        **asdict(experiment),
        **{
            f"{name}{end}": by_truth[f"ap{end}"][which]
            for which, name in AP_OF.items()
            for end in AP_ENDS
        },
        "objects": int(by_truth.objects["captured"]),
        "objects_all": int(by_truth.objects["all"]),
        "objects_present": int(by_truth.objects["present"]),
        OFF_REGION: off_region_per_min(evaluation),
        "block_s": by_truth.block_s["captured"],
        "train_seconds": round(seconds, 1),
        "train_steps": steps,
        **dict.fromkeys(LATENCY, np.nan),
        **provenance(),
        "findings": " ".join(dict.fromkeys(finding.name for finding in evaluation.findings)),
    }


def numbers_of(folder: Path, run: Path) -> dict[str, str]:
    """Returns the frames_version of the test frames and of the detector's training frames."""
    learnt = (read_origin(run / "predictions") or {}).get(MODEL_FRAMES, "")
    return {"frames_version": number_at(folder), LEARNT: learnt}


def off_region_per_min(evaluation: Evaluation) -> float:
    """Returns the boxes outside the region per minute; NaN if no region is known.

    Only boxes with a score of OFF_REGION_SCORE or more count.
    """
    rows = evaluation.off_region
    return float(rows[rows.score == OFF_REGION_SCORE].boxes_per_min.iloc[0])


def failed(experiment: Experiment, error: BaseException) -> Tables:
    """Returns the row of a failed experiment, with the error as the reason, in one line."""
    reason = f"{type(error).__name__}: {' '.join(str(error).split())}"[:300]
    nothing = dict.fromkeys(MEASURED, np.nan)
    row = {**asdict(experiment), **nothing, **provenance(), "reason": reason}
    return {"experiments": pd.DataFrame([row])}


def provenance() -> dict[str, object]:
    return {
        "command": "pyinfra benchmark",
        "version": __version__,
        "machine": machine(),
    }


def keyed(experiment: Experiment, rows: pd.DataFrame | None) -> pd.DataFrame:
    """Returns the rows of an evaluation's table with the key columns of their experiment."""
    if rows is None:
        return pd.DataFrame()
    table = rows.drop(columns=["lidar", "class", "iou"]).reset_index(drop=True)
    return pd.concat([pd.DataFrame([asdict(experiment)] * len(table)), table], axis=1)
