"""Measures pretrained detectors on the frozen test sites, paired with the first of them.

The sites are those of `frozen_sites`, simulated by the present version: 60 sites (`plain`) and 20
streets with much street furniture (`cluttered`).

Figures are the AP (R1000), the highest recall at a precision of 0.5, false positives per frame, and
the recall of vehicles that have stood for 30 s. Shown boxes have a calibrated score of 0.5 or more.
Intervals (Student's t) are computed from 1,000 bootstrap replicates of whole sites. Differences are
to the first model on the same frames.

The matches of each site and model are kept in the folder --work, so that a stopped command goes on
with the next site. The command writes out/detector_goals.csv:

    python -m reproduction detector_goals generalist-3 generalist --work data/goals
"""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated

import numpy as np
import pandas as pd

from pyinfra.core.arrays import BoolArray, FloatArray, IntArray
from pyinfra.core.boxes import bev_iou
from pyinfra.core.files import replacing
from pyinfra.core.vocabulary import ObjectClass
from pyinfra.dataset.regions import Region
from pyinfra.metrics import intervals, matching
from pyinfra.models.detectors import Detections
from pyinfra.models.detectors.classes import TYPES
from pyinfra.models.detectors.fuse_batchnorm import fused
from pyinfra.models.detectors.network import Network
from pyinfra.models.inference.detect import model_file
from pyinfra.models.training import checkpoint
from reproduction import provenance
from reproduction.arguments import Out, Work, command
from reproduction.commands import frozen_sites
from reproduction.commands.unseen import CLASSES, CUT, REPLICATES, Boxes, scored_boxes

FRAMES = 3  # number of frames per LiDAR
VEHICLES, ANYWHERE, QUEUES = "vehicle", "vehicle, no region", "vehicle in a queue"
# For each kind of object: the classes of boxes that may match, the metric and the threshold.
KINDS: dict[str, tuple[tuple[ObjectClass, ...], matching.Metric, float]] = {
    VEHICLES: (("vehicle",), "bev", 0.5),
    "pedestrian": (("pedestrian",), "centre", 0.5),
    "cyclist": (("cyclist",), "centre", 0.5),
    "vulnerable road user": (("pedestrian", "cyclist"), "centre", 0.5),
    ANYWHERE: (("vehicle",), "bev", 0.5),
    QUEUES: (("vehicle",), "bev", 0.5),
}
MOST = {"ap_r1000": 100.0, "false_per_frame": np.inf}  # maximum of a figure, if it is not 1


def in_frame(
    sample: frozen_sites.TestSample, detections: Detections, kind: str
) -> tuple[FloatArray, BoolArray, int]:
    """Returns scores (n,) and correctness (n,) of boxes of a kind, and the number of objects."""
    names, metric, limit = KINDS[kind]
    if kind == QUEUES:
        wanted = sample.queues & (sample.numbers == 0) & sample.region.holds(sample.boxes, 0.0)
        shown = (detections.names == TYPES["vehicle"]) & (detections.scores >= CUT)
        overlap = bev_iou(sample.boxes[wanted], detections.boxes[shown])
        found = overlap.max(axis=1, initial=0) >= limit
        return np.ones(len(found)), found, len(found)
    if kind == ANYWHERE:
        everywhere = Region(lambda boxes, _: np.ones(len(boxes), np.bool_), sample.region.corners)
        sample = frozen_sites.TestSample(**(vars(sample) | {"region": everywhere}))
    return scored_boxes(sample, detections, names, (kind, metric, limit))


def measured(network: Network, samples: Sequence[frozen_sites.TestSample]) -> dict[str, FloatArray]:
    """Returns the arrays of a model's matches at a site, by kind and name."""
    parts: dict[str, list[tuple[FloatArray, BoolArray, int]]] = {kind: [] for kind in KINDS}
    for sample in samples:
        network.know(sample.region)
        detections = network.predict(sample.points)
        for kind, part in parts.items():
            part.append(in_frame(sample, detections, kind))
    arrays = dict[str, FloatArray]()
    for kind, part in parts.items():
        scores, right, objects = zip(*part, strict=True)
        arrays[f"{kind}/scores"], arrays[f"{kind}/right"] = (
            np.concatenate(scores),
            np.concatenate(right),
        )
        arrays[f"{kind}/objects"] = np.array([sum(objects), len(part)])
    return arrays


def run_site(name: str, number: int, models: dict[str, Network], frames: int, work: Path) -> None:
    """Measures all models at a site of a set, except for results that exist."""
    keys, visits = list(frozen_sites.read_visits(name))[number]
    wanted = {digest: matches_file(work, name, number, digest, frames) for digest in models}
    if all(file.exists() for file in wanted.values()):
        return
    samples = [
        sample
        for _, of_lidar in frozen_sites.tested_at(keys, visits, CLASSES, frames)
        for sample in of_lidar
    ]
    for digest, file in wanted.items():
        if not file.exists():
            arrays = measured(models[digest], samples)
            with replacing(file) as beside, beside.open("wb") as opened:
                np.savez_compressed(opened, allow_pickle=False, **arrays)
    print(name, keys["name"], len(samples), "frames", flush=True)


def matches_file(work: Path, name: str, number: int, digest: str, frames: int) -> Path:
    return work / f"{name}_{number}_{frames}_{digest}.npz"


def gathered(files: Sequence[Path], kind: str) -> Boxes:
    """Returns the boxes of a kind at all sites, from one file per site.

    For `vehicle in a queue` they are the objects: `right` is whether each is found.
    """
    slots, scores, right, counts = [], [], [], []
    for number, file in enumerate(files):
        with np.load(file, allow_pickle=False) as data:
            scores.append(data[f"{kind}/scores"])
            right.append(data[f"{kind}/right"])
            counts.append(data[f"{kind}/objects"])
            slots.append(np.full(len(scores[-1]), number))
    objects, frames = np.stack(counts).T
    slot, score, is_right = (np.concatenate(column) for column in (slots, scores, right))
    return Boxes(slot, score, is_right, objects, frames)


def figures(matches: Boxes, kind: str, weights: IntArray) -> dict[str, FloatArray]:
    """Returns the figures of a kind for weights (replicates, sites): (replicates,) each."""
    if kind == QUEUES:
        objects = (weights @ matches.objects).astype(np.float64)
        found = weights @ np.bincount(matches.slot[matches.right], minlength=weights.shape[1])
        none = np.full(len(objects), np.nan)  # NaN for replicates without an object
        return {"recall": np.divide(found, objects, out=none, where=objects > 0)}
    false = matches.false_per_frame(weights)
    if kind == ANYWHERE:
        return {"false_per_frame": false}
    return {
        "ap_r1000": matches.ap(weights),
        "recall_at_half": recalls_at_half(matches, weights),
        "false_per_frame": false,
    }


def recalls_at_half(matches: Boxes, weights: IntArray) -> FloatArray:
    """Returns the highest recall at a precision of 0.5 or more, for each row of weights."""
    order = np.argsort(-matches.scores, kind="stable")
    slot, right = matches.slot[order], matches.right[order]
    recalls = []
    for row in weights:
        boxes = row[slot]
        true = np.cumsum(boxes * right)
        precise = true >= 0.5 * np.cumsum(boxes)
        recalls.append(true[precise].max(initial=0) / max(1, row @ matches.objects))
    return np.array(recalls)


def rows(
    name: str, files: dict[str, list[Path]], names: dict[str, str]
) -> Iterator[dict[str, object]]:
    """Yields the rows of a set of sites. files: those of each model, by its digest."""
    sites = len(next(iter(files.values())))
    drawn = np.random.default_rng(1).multinomial(sites, np.ones(sites) / sites, REPLICATES)
    weights = np.concatenate([np.ones((1, sites), np.int64), drawn])
    for kind in KINDS:
        first: dict[str, FloatArray] = {}
        for digest, of_sites in files.items():
            matches = gathered(of_sites, kind)
            for figure, values in figures(matches, kind, weights).items():
                less = values - first.setdefault(figure, values)
                blocks = int((matches.objects > 0).sum()) if kind == QUEUES else sites
                ends = np.clip(
                    intervals.interval(values[0], values[1:], blocks), 0, MOST.get(figure, 1.0)
                )
                ends_of_less = intervals.interval(less[0], less[1:], blocks)
                yield {
                    "model": names[digest],
                    "digest": digest,
                    "set": name,
                    "sites": sites,
                    "sites_with_objects": int((matches.objects > 0).sum()),
                    "kind": kind,
                    "figure": figure,
                    "objects": int(matches.objects.sum()),
                    "value": values[0],
                    "low": ends[0],
                    "high": ends[1],
                    "difference": less[0],
                    "difference_low": ends_of_less[0],
                    "difference_high": ends_of_less[1],
                }


@command
def main(
    models: Sequence[Path],
    *,
    work: Work,
    sites: Annotated[Sequence[int], {"metavar": ("PLAIN", "CLUTTERED"), "nargs": 2}] = (60, 20),
    frames: int = FRAMES,
    out: Out = Path("detector_goals.csv"),
) -> None:
    """
    Parameters
    ----------
    models : names, model files or run folders
    work : working folder for frames, about 1 GB
    sites : number of sites of each set (default: 60 20)
    frames : frames per LiDAR, at most 5 (default: 3)
    """
    networks, names = dict[str, Network](), dict[str, str]()
    for model in models:
        digest = checkpoint.digest(model_file(model))
        networks[digest] = fused(checkpoint.load(model_file(model)).network())
        names[digest] = model.stem if model.stem != "last" else model.parent.name
    words = f"detector_goals {' '.join(map(str, models))}"
    words += f" --sites {sites[0]} {sites[1]} --frames {frames}"
    tables = []
    for name, count in zip(("plain", "cluttered"), sites, strict=True):
        for number in range(count):
            run_site(name, number, networks, frames, work)
        files = {
            digest: [matches_file(work, name, number, digest, frames) for number in range(count)]
            for digest in networks
        }
        tables.append(pd.DataFrame(rows(name, files, names)))
    table = pd.concat(tables).assign(seed=1, **provenance(words))
    table.to_csv(out, index=False, float_format="%.4g")
    print(table.iloc[:, :-4].to_string(index=False))
