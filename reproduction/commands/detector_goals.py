"""Measures pretrained detectors on the frozen test sites, and differences to the first detector.

The sites are those of `frozen_sites`, simulated by the present version: 60 sites (`plain`) and 20
streets with much street furniture (`cluttered`).

Figures are the AP (R1000), the highest recall at a precision of 0.5, false positives per frame, and
the recall of vehicles that have stood for 30 s. Shown boxes have a calibrated score of 0.5 or more.
Intervals (Student's t) are computed from 1,000 bootstrap replicates of whole sites. Differences are
to the first model on the same frames. The command writes out/detector_goals.csv:

    python -m reproduction detector_goals generalist-3 generalist
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated

import numpy as np
import pandas as pd

from pyinfra.core.arrays import FloatArray, IntArray
from pyinfra.core.boxes import bev_iou
from pyinfra.dataset.regions import Region
from pyinfra.metrics import intervals, matching
from pyinfra.models.detectors import Detections
from pyinfra.models.detectors.classes import TYPES
from pyinfra.models.detectors.fuse_batchnorm import fused
from pyinfra.models.detectors.network import Network
from pyinfra.models.inference.detect import model_file
from pyinfra.models.training import checkpoint
from reproduction import frozen_sites, provenance, site_boxes
from reproduction.arguments import Out, command
from reproduction.site_boxes import (
    CUT,
    REPLICATES,
    Boxes,
    Matches,
    gathered,
    scored_boxes,
    with_ends,
)

FRAMES = 3  # number of frames per LiDAR
VEHICLES, ANYWHERE, QUEUES = "vehicle", "vehicle, no region", "vehicle in a queue"
KINDS = {**site_boxes.KINDS, ANYWHERE: site_boxes.KINDS[VEHICLES]}
KINDS[QUEUES] = KINDS[VEHICLES]
Key = tuple[str, str]  # digest of a model and kind of object of a result
MOST = {"ap_r1000": 100.0, "false_per_frame": np.inf}  # maximum of a figure, if it is not 1


def in_frame(sample: frozen_sites.TestSample, detections: Detections, kind: str) -> Matches:
    """Returns scores (n,) and correctness (n,) of boxes of a kind, and the number of objects.

    For `vehicle in a queue`, an entry is a vehicle instead of a box, and correct if it is found.
    """
    if kind == QUEUES:
        wanted = sample.queues & (sample.numbers == 0) & sample.region.holds(sample.boxes, 0.0)
        shown = (detections.names == TYPES["vehicle"]) & (detections.scores >= CUT)
        overlap = bev_iou(sample.boxes[wanted], detections.boxes[shown])
        found = overlap.max(axis=1, initial=0) >= matching.IOU
        return np.ones(len(found)), found, len(found)
    if kind == ANYWHERE:
        everywhere = Region(lambda boxes, _: np.ones(len(boxes), np.bool_), sample.region.corners)
        sample = replace(sample, region=everywhere)
    return scored_boxes(sample, detections, *KINDS[kind])


def measured(
    networks: dict[str, Network], samples: Sequence[frozen_sites.TestSample]
) -> dict[Key, list[Matches]]:
    """Returns the results of `in_frame` for each frame of a site, by model digest and kind."""
    found: dict[Key, list[Matches]] = {}
    for digest, network in networks.items():
        for sample in samples:
            network.know(sample.region)
            detections = network.predict(sample.points)
            for kind in KINDS:
                matches = in_frame(sample, detections, kind)
                found.setdefault((digest, kind), []).append(matches)
    return found


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
        "recall_at_half": matches.recalls_at_half(weights),
        "false_per_frame": false,
    }


def rows(name: str, pooled: dict[Key, Boxes], names: dict[str, str]) -> Iterator[dict[str, object]]:
    """Yields the rows of a set of sites. names: names of the models, by digest."""
    sites = len(next(iter(pooled.values())).frames)
    drawn = np.random.default_rng(1).multinomial(sites, np.ones(sites) / sites, REPLICATES)
    weights = np.concatenate([np.ones((1, sites), np.int64), drawn])
    for kind in KINDS:
        first: dict[str, FloatArray] = {}
        for digest, model in names.items():
            matches = pooled[digest, kind]
            with_objects = int((matches.objects > 0).sum())
            for figure, values in figures(matches, kind, weights).items():
                less = values - first.setdefault(figure, values)
                blocks = with_objects if kind == QUEUES else sites
                ends = intervals.interval(values[0], values[1:], blocks)
                low, high = np.clip(ends, 0, MOST.get(figure, 1.0))
                yield {
                    "model": model,
                    "digest": digest,
                    "set": name,
                    "sites": sites,
                    "sites_with_objects": with_objects,
                    "kind": kind,
                    "figure": figure,
                    "objects": int(matches.objects.sum()),
                    "value": values[0],
                    "low": low,
                    "high": high,
                    **with_ends("difference", less, blocks),
                }


@command
def main(
    models: Sequence[Path],
    *,
    sites: Annotated[Sequence[int], {"metavar": ("PLAIN", "CLUTTERED"), "nargs": 2}] = (60, 20),
    frames: int = FRAMES,
    out: Out = Path("detector_goals.csv"),
) -> None:
    """
    Parameters
    ----------
    models : names, model files or run folders
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
    for name, count in zip(frozen_sites.SETS, sites, strict=True):
        pooled = gathered(name, count, frames, partial(measured, networks))
        tables.append(pd.DataFrame(rows(name, pooled, names)))
    table = pd.concat(tables).assign(seed=1, **provenance(words))
    table.to_csv(out, index=False, float_format="%.4g")
    print(table.iloc[:, :-4].to_string(index=False))
