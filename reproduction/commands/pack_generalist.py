"""Calibrates the scores of a network of many sites where it did not learn, and packs it.

    python -m reproduction pack_generalist RUN

looks at sites that no training saw, fits for each class the line of logits that makes scores
shares of right boxes, and writes pyinfra/models/generalist.safetensors: layers in half precision,
the lines and their figures in the header. results/generalist_sites.csv has precision and recall of
the boxes from the cut on, by site, LiDAR and class, and what their scores say.
"""

from __future__ import annotations

import argparse
import itertools
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd
from torch import Tensor

from pyinfra.core.arrays import BoolArray, FloatArray
from pyinfra.core.version import __version__
from pyinfra.core.vocabulary import VEHICLES, ObjectClass
from pyinfra.dataset.regions import FOOTWAYS_M
from pyinfra.metrics import matching
from pyinfra.models.detectors import Detections, calibration
from pyinfra.models.detectors.classes import METRICS, TYPES
from pyinfra.models.detectors.fuse_batchnorm import fused
from pyinfra.models.detectors.network import Network
from pyinfra.models.inference.detect import MODELS, model_file
from pyinfra.models.training import checkpoint
from pyinfra.models.training.samples import SiteSample
from reproduction import ROOT
from reproduction.commands import frozen_sites

MIN_SCORE = 0.002  # of boxes that the lines are fitted on: more of them than are given
CUT = 0.5  # of calibrated scores: from here on a box is shown


@dataclass(frozen=True, eq=False)
class Judged:
    """The boxes of a class that one LiDAR has in its frames at a site."""

    site: str
    lidar: str
    name: ObjectClass
    scores: FloatArray  # (n,)
    right: BoolArray  # (n,)
    objects: int  # that are there to be found


def judged(network: Network, site: str, lidar: str, samples: list[SiteSample]) -> Iterator[Judged]:
    """The boxes of each class in its region."""
    detections = []
    for sample in samples:
        network.know(sample.region)
        detections.append(network.predict(sample.points))
    for number, name in enumerate(network.classes):
        parts = [
            right_of(*pair, number, name, METRICS[name])
            for pair in zip(samples, detections, strict=True)
        ]
        scores, right, objects = zip(*parts, strict=True)
        columns = np.concatenate(scores), np.concatenate(right)
        yield Judged(site, lidar, name, *columns, sum(objects))


def right_of(
    sample: SiteSample,
    detections: Detections,
    number: int,
    name: ObjectClass,
    metric: matching.Metric,
    iou: float = matching.IOU,
) -> tuple[FloatArray, BoolArray, int]:
    """Scores of a class's boxes in its region, which are right, and how many objects there are."""
    margin_m = 0.0 if name in VEHICLES else FOOTWAYS_M
    inside = (detections.names == TYPES[name]) & sample.region.holds(detections.boxes, margin_m)
    there = (sample.numbers == number) & sample.region.holds(sample.boxes, margin_m)
    boxes, scores, truth = detections.boxes[inside], detections.scores[inside], sample.boxes[there]
    frames = np.zeros(len(boxes), np.int64), np.zeros(len(truth), np.int64)
    right = matching.hits(frames[0], boxes, scores, frames[1], truth, metric, iou)
    return scores, right, len(truth)


def row(cell: Judged, line: tuple[float, float]) -> dict[str, object]:
    """Precision and recall from the cut on, and what calibrated scores say of them."""
    scores, right = calibration.calibrated(cell.scores, line), cell.right
    shown = scores >= CUT
    return {
        "site": cell.site,
        "lidar": cell.lidar,
        "class": cell.name,
        "objects": cell.objects,
        "boxes": int(shown.sum()),
        "precision": right[shown].mean() if shown.any() else np.nan,
        "precision_said": scores[shown].mean() if shown.any() else np.nan,
        "recall": right[shown].sum() / cell.objects if cell.objects else np.nan,
        "recall_said": scores[shown].sum() / scores.sum() if len(scores) else np.nan,
    }


def line_of(cells: list[Judged], name: ObjectClass) -> tuple[float, float]:
    """Raises ValueError for a class without a right and a wrong box."""
    selected = [cell for cell in cells if cell.name == name]
    columns = (
        np.concatenate([getattr(cell, key) for cell in selected]) for key in ("scores", "right")
    )
    try:
        return calibration.fit(*columns)
    except ValueError as error:
        raise ValueError(f"{name}: {error}") from None


def halved(weights: dict[str, Tensor]) -> dict[str, Tensor]:
    """The weights of layers in half precision; what norms keep stays, as it may be large."""
    return {
        f"network.{name}": tensor.half() if tensor.ndim > 1 else tensor
        for name, tensor in weights.items()
    }


def figures_of(table: pd.DataFrame) -> dict[str, float]:
    """Means over sites and LiDARs; those of people by the name of their class."""
    return {
        key if name in VEHICLES else f"{name}_{key}": round(float(group[key].mean()), 3)
        for name, group in table.groupby("class", sort=False)
        for key in ("precision", "recall")
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("run", type=Path, help="folder of `pyinfra train --sites`")
    parser.add_argument("--sites", type=int, default=60)
    parser.add_argument("--frames", type=int, default=5, help="of each LiDAR; default: 5")
    parser.add_argument("--out", type=Path, default=MODELS / "generalist.safetensors")
    parser.add_argument("--table", type=Path, default=ROOT / "results/generalist_sites.csv")
    args = parser.parse_args()
    loaded = checkpoint.load(model_file(args.run))
    network = fused(loaded.network())
    classes = network.classes
    network.calibration, network.min_score = None, MIN_SCORE
    cells = [
        cell
        for visit in frozen_sites.looked_at("plain", classes, args.sites, args.frames)
        for cell in judged(network, *visit)
    ]
    lines = {name: line_of(cells, name) for name in classes}
    line = tuple(itertools.chain.from_iterable(lines.values()))
    rows = [row(cell, lines[cell.name]) for cell in cells]
    table = pd.DataFrame(rows).assign(
        version=__version__, command="python -m reproduction pack_generalist"
    )
    table.to_csv(args.table, index=False, float_format="%.4g")
    figures = figures_of(table)
    provenance = replace(
        loaded.provenance,
        anywhere=True,
        calibration=line,
        figures={"cut": CUT, "sites": args.sites, **figures},
    )
    args.out.parent.mkdir(exist_ok=True)
    checkpoint.write(args.out, halved(loaded.weights()), provenance)
    print(f"{args.out}: {args.out.stat().st_size / 1e6:.2f} MB, {line}, {figures}")
