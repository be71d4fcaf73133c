"""Compares predicted with measured AP and recall at sites that were not used in the fit.

A prediction uses what the LiDAR sees of the site's own traffic. AP and recall are measured with
other seeds of the traffic. A group is one site and LiDAR with several poses.
"""

import math
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from scipy import stats

from pyinfra.core.arrays import FloatArray
from pyinfra.dataset.catalogue import lidar_file
from pyinfra.dataset.simulation import load_lidar
from pyinfra.experiments.planner import detectability as laws
from pyinfra.metrics.comparison import over_replicates
from pyinfra.metrics.intervals import student
from reproduction.commands.experiments import at_catalogue_law, at_own_cut_angle
from reproduction.detectability import empty_scene
from reproduction.detectability.fit import average_precision
from reproduction.detectability.runs import (
    CHECK_SEEDS,
    Outcome,
    Run,
    pose_of,
    read,
    scene_file_of,
    site_of,
)

GROUP = ["site", "lidar"]
PEOPLE_STD = 0.045  # root mean square error of the shares of people in results/plans.csv
PREDICTORS = ("ap_predicted", "ten_points_percent", "coverage_percent", "information_bits")
REPLICATES = 2000
BINS = 10
MEASURED_FRAMES = 30  # number of frames in a run
LEAST_BOXES = 9  # minimum number of false boxes of a used pose; fewer give an uncertain rate
LEAST_RATE = 0.03  # minimum number of false boxes per frame of a used option
OfPair = Callable[[FloatArray, FloatArray], float]  # function of two values of each pose


def predicted(outcome: Outcome, law: laws.Law) -> dict[str, float]:
    """Returns predicted figures of the vehicles, from what the LiDAR sees of them."""
    vehicles = outcome.objects[~outcome.objects.person]
    seen = vehicles[vehicles.points > 0]
    terms = laws.object_terms(seen)
    p = laws.detection_probability(law.detection[0], terms, laws.CUT)
    spins = outcome.spinning
    ap = average_precision(
        law.detection[0], law.false[0], terms, len(vehicles), outcome.frames, spinning=spins
    )
    rate = laws.false_per_frame(law.false[0], laws.CUT, len(seen) / outcome.frames, spins)
    return {
        "ap_predicted": ap,
        "recall_predicted": 100 * float(p.sum()) / len(vehicles),
        "false_predicted": float(rate[0]),
        "ten_points_percent": 100 * float((vehicles.points >= 10).mean()),
        "vehicles_per_frame": len(vehicles) / outcome.frames,
    }


def measured(outcome: Outcome, detector: str) -> dict[str, float]:
    """Returns measured figures of the vehicles."""
    vehicles = outcome.objects[~outcome.objects.person]
    score = vehicles[f"score_{detector}"]
    return {
        "ap_measured": outcome.ap[detector],
        "recall_measured": 100 * float((score >= laws.CUT).mean()),
        "false_measured": float((outcome.false[detector] >= laws.CUT).sum()) / outcome.frames,
    }


def empty_scene_measures(runs: list[Run], frames: int, work: Path) -> dict[Run, dict[str, float]]:
    """Returns coverage and information (see `empty_scene`) of runs with the site's own traffic."""
    out = {}
    for site in sorted({run.site for run in runs}):
        file = scene_file_of(site, work)
        plan_site, filled = site_of(site, frames, work), empty_scene.occupancy(file)
        empty = empty_scene.empty_scene(file)
        for run in (one for one in runs if one.site == site):
            lidar = load_lidar(lidar_file(run.lidar), plan_site.preset)
            coverage, bits = empty_scene.measures(
                plan_site, empty, filled, pose_of(run, plan_site), lidar
            )
            out[run] = {"coverage_percent": 100 * coverage, "information_bits": bits}
    return out


def check_table(
    runs: list[Run], detector: str, law: laws.Law, empty: dict[Run, dict[str, float]], work: Path
) -> pd.DataFrame:
    """Returns a row for each site, LiDAR, pose and measured traffic seed.

    Columns end in `_predicted` where the prediction uses the site's own traffic, and in
    `_same_traffic` where it uses the traffic of the measurement.
    """
    rows = []
    for own in (run for run in runs if run.seed == 0):
        first = predicted(read(own, work), law) | empty[own]
        for seed in CHECK_SEEDS:
            outcome = read(Run(own.site, own.pose, own.lidar, seed), work)
            same = predicted(outcome, law)
            rows.append(
                {
                    "detector": detector,
                    "site": own.site,
                    "lidar": own.lidar,
                    "pose": own.pose,
                    "seed": seed,
                    **first,
                    "ap_same_traffic": same["ap_predicted"],
                    "recall_same_traffic": same["recall_predicted"],
                    **measured(outcome, detector),
                }
            )
    return pd.DataFrame(rows)


def unseen_std(table: pd.DataFrame) -> dict[str, float]:
    """Returns the fields of `UnseenErrors` for random poses.

    The mean of a pose over its traffic seeds is compared with its prediction. The noise of the
    measured and of the predicted frames is that of the seeds of a pose, and is subtracted.
    table: the rows of one detector in `check_table`.
    """

    def std(measured: pd.Series, predicted: pd.Series) -> float:
        groups = (measured - predicted).groupby([table.site, table.lidar, table.pose])
        noise = groups.var(ddof=1).mean() * (1 + 1 / groups.size().mean())
        return float(np.sqrt(np.maximum(0.0, (groups.mean() ** 2).mean() - noise)))

    poses = table.groupby(["site", "lidar", "pose"])
    boxes = MEASURED_FRAMES * poses.false_measured.sum()
    ratio = np.log(poses.false_measured.mean() / poses.false_predicted.mean())
    ratio, boxes = ratio[boxes >= LEAST_BOXES], boxes[boxes >= LEAST_BOXES]
    log_false = float(np.sqrt(np.maximum(0.0, (ratio**2).mean() - (1 / boxes).mean())))
    return {
        "recall": round(std(table.recall_measured, table.recall_predicted) / 100, 4),
        "people": PEOPLE_STD,
        "ap": round(std(table.ap_measured, table.ap_predicted), 2),
        "log_false": round(log_false, 3),
    }


def unseen_std_of_options(options: pd.DataFrame) -> dict[str, float]:
    """Returns the fields of `UnseenErrors` for the options of plans.

    A plan chooses the options with the highest predictions, so that the errors of its options are
    larger than those of random poses. options: rows of `plan_coverage`; its test sites are left
    out.
    """
    rows = options[(options.source == "predicted") & (options.use == "calibration")]
    rows = rows.dropna(subset=["value", "mean_low"])
    error, half = rows.value - rows["mean"], (rows.mean_high - rows.mean_low) / 2
    squared = error**2 - (half / rows.seeds.map(student)) ** 2
    std = np.sqrt(squared.groupby(rows.figure).mean().clip(lower=0))
    false = rows[(rows.figure == "false_per_frame") & (rows["mean"] >= LEAST_RATE)]
    return {
        "recall": round(float(std["recall"]) / 100, 4),
        "people": round(float(std["people_recall"]) / 100, 4),
        "ap": round(float(std["ap"]), 2),
        "log_false": round(math.sqrt((np.log(false.value / false["mean"]) ** 2).mean()), 3),
    }


def fine_tuning_ap(fairness: pd.DataFrame, experiments: pd.DataFrame) -> dict[str, float]:
    """Returns the AP that 120 steps of fine-tuning add with preset `datasheet`, by LiDAR.

    A LiDAR of the experiments has the mean over their scenes, because these have replicates. The
    other LiDARs have the gain in `fairness`.
    """
    fairness = fairness.replace({"arm": {"none": "pretrained", "tuned_120": "fine-tuned"}})
    fairness = fairness.rename(columns={"arm": "training", "site": "scene"})
    rows = at_catalogue_law(at_own_cut_angle(experiments))
    rows = rows[(rows.subset == "captured") & (rows.label_time == "scan")]
    gains = pd.concat([_gains(rows), _gains(fairness)])
    gains = gains[~gains.index.duplicated()].sort_index()
    return {str(name): round(float(gain), 1) for name, gain in gains.items()}


def _gains(rows: pd.DataFrame) -> pd.Series:
    """Returns the fine-tuned minus the pretrained AP of each LiDAR, as the mean over scenes."""
    rows = rows[rows.preset == "datasheet"]
    wide = rows.groupby(["lidar", "scene", "training"]).ap_r1000.mean().unstack("training")
    return (wide["fine-tuned"] - wide["pretrained"]).dropna().groupby("lidar").mean()


def summary(table: pd.DataFrame) -> Iterator[dict[str, object]]:
    """Yields a row for each measure: its mean over sites and LiDARs, with a 95 % interval."""
    for figure in ("ap", "recall"):
        predicted, measured = f"{figure}_predicted", f"{figure}_measured"
        each = {
            "mean error": partial(_over_poses, _mean_error, predicted, measured),
            "mean error with the same traffic": partial(_same_traffic_error, figure),
            "mean error of another seed": partial(_over_seeds, _mean_error, measured),
        }
        for name, of in each.items():
            yield row(f"{name}, {figure}", "", per_group(table, of))
    of_ap = {"r within a site": _correlation, "regret of the best pose, AP": _regret}
    for predictor in PREDICTORS:
        for name, of_pair in of_ap.items():
            of = partial(_over_poses, of_pair, predictor, "ap_measured")
            yield row(name, predictor, per_group(table, of))
    seed_r, seed_regret = (partial(_over_seeds, of, "ap_measured") for of in of_ap.values())
    yield row("r within a site", "another seed", per_group(table, seed_r))
    density = table.groupby(GROUP).vehicles_per_frame.transform("mean")
    middle = density.groupby([table[name] for name in GROUP]).first().median()
    for part, half in (("less", table[density < middle]), ("more", table[density >= middle])):
        for predictor in PREDICTORS:
            of = partial(_over_poses, _correlation, predictor, "ap_measured")
            yield row(f"r within a site with {part} traffic", predictor, per_group(half, of))
    yield row("regret of the best pose, AP", "another seed", per_group(table, seed_regret))


def row(measure: str, predictor: str, values: FloatArray) -> dict[str, object]:
    """Returns the mean over groups with Student's 95 % interval, clipped to possible values."""
    values = values[np.isfinite(values)]
    mean = over_replicates(values.tolist())
    low, high = np.clip([mean.low, mean.high], *limits(measure))
    return {
        "measure": measure,
        "predictor": predictor,
        "groups": len(values),
        "value": mean.value,
        "low": float(low),
        "high": float(high),
        "median": float(np.median(values)) if len(values) else math.nan,
    }


def limits(measure: str) -> tuple[float, float]:
    """Returns the least and the largest possible value of a measure."""
    return (-1.0, 1.0) if measure.startswith("r ") else (0.0, math.inf)


def per_group(table: pd.DataFrame, of: Callable[[pd.DataFrame], float]) -> FloatArray:
    return np.array([of(group) for _, group in table.groupby(GROUP)])


def _over_poses(of: OfPair, a: str, b: str, group: pd.DataFrame) -> float:
    """Applies `of` to the means of two columns over the seeds of each pose."""
    means = group.groupby("pose")[[a, b]].mean()
    return of(means[a].to_numpy(), means[b].to_numpy())


def _over_seeds(of: OfPair, column: str, group: pd.DataFrame) -> float:
    """Applies `of` to each seed and the mean of the other seeds; returns the mean result."""
    values = np.asarray(group.pivot(index="pose", columns="seed", values=column), float)
    others = (np.delete(values, s, axis=1).mean(1) for s in range(values.shape[1]))
    return float(np.mean([of(one, other) for one, other in zip(values.T, others, strict=True)]))


def _same_traffic_error(figure: str, group: pd.DataFrame) -> float:
    return float((group[f"{figure}_same_traffic"] - group[f"{figure}_measured"]).abs().mean())


def _mean_error(a: FloatArray, b: FloatArray) -> float:
    return float(np.abs(a - b).mean())


def _correlation(a: FloatArray, b: FloatArray) -> float:
    if np.ptp(a) == 0 or np.ptp(b) == 0:
        return float("nan")
    return float(stats.pearsonr(a, b).statistic)


def _regret(predicted: FloatArray, ap: FloatArray) -> float:
    """Returns the AP of the best pose minus the AP of the pose with the best prediction."""
    return float(ap.max() - ap[predicted.argmax()])


def reliability(
    runs: list[Run], detector: str, law: laws.Law, work: Path, *, person: bool
) -> pd.DataFrame:
    """Returns predicted and measured shares of detected objects, in bins of the prediction.

    The intervals resample sites.
    """
    parts = []
    for run in runs:
        objects = read(run, work).objects
        some = objects[(objects.person == person) & (objects.points > 0)]
        p = laws.detection_probability(law.detection[0], laws.object_terms(some), laws.CUT)
        hit = (some[f"score_{detector}"] >= laws.CUT).to_numpy(float)
        parts.append(pd.DataFrame({"site": run.site, "p": p, "detected": hit}))
    table = pd.concat(parts)
    table["bin"] = np.minimum((table.p * BINS).astype(int), BINS - 1)
    sums = table.groupby(["bin", "site"]).agg(
        n=("p", "size"), p=("p", "sum"), hit=("detected", "sum")
    )
    rng, rows = np.random.default_rng(1), []
    for number, some in sums.groupby("bin"):
        picks = rng.integers(len(some), size=(REPLICATES, len(some)))
        n, hit = some.n.to_numpy(), some.hit.to_numpy()
        low, high = np.quantile(hit[picks].sum(1) / n[picks].sum(1), [0.025, 0.975])
        rows.append(
            {
                "detector": detector,
                "class": "pedestrian" if person else "vehicle",
                "bin": number,
                "objects": int(n.sum()),
                "sites": len(some),
                "predicted_percent": 100 * some.p.sum() / n.sum(),
                "measured_percent": 100 * hit.sum() / n.sum(),
                "measured_low": 100 * low,
                "measured_high": 100 * high,
            }
        )
    return pd.DataFrame(rows)
