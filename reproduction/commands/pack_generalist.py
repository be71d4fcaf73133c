"""Calibrates the scores of a pretrained detector, and writes the model file.

    python -m reproduction pack_generalist generalist-3

The calibration fits a line to the logits of each class at generated sites that neither the training
nor a test uses. A calibrated score is the expected share of correct boxes. A box of a pedestrian or
a cyclist is correct if it matches either, so that both scores are comparable.

The command writes two files:

- out/generalist.safetensors has the layers in half precision. Its header has the calibration lines
  and the precision and recall.
- out/generalist_sites.csv has the precision and recall of the boxes with a score of at least 0.5 at
  the test sites, by site, LiDAR and class, and the values that the scores predict.
"""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np
import pandas as pd

from pyinfra.core.arrays import BoolArray, FloatArray
from pyinfra.core.vocabulary import VEHICLES, ObjectClass
from pyinfra.dataset import simulation
from pyinfra.models.detectors import calibration
from pyinfra.models.detectors.classes import METRICS
from pyinfra.models.detectors.fuse_batchnorm import fused
from pyinfra.models.detectors.network import Network
from pyinfra.models.inference.detect import model_file
from pyinfra.models.training import checkpoint
from pyinfra.models.training.samples import SiteSample
from reproduction import frozen_sites, provenance
from reproduction.arguments import Out, command
from reproduction.site_boxes import scored_boxes

MIN_SCORE = 0.002  # minimum score of a box in the calibration, which also uses scores below CUT
PEOPLE = "vulnerable road user"  # a pedestrian or a cyclist
CUT = 0.5  # smallest calibrated score of a shown box


@dataclass(frozen=True, eq=False)
class ScoredBoxes:
    """The boxes of a class that a network detects in the frames of one LiDAR at a site."""

    site: str
    lidar: str
    name: ObjectClass
    scores: FloatArray  # (n,) score of each box
    right: BoolArray  # (n,) whether each box is a true positive
    objects: int  # number of vehicles, or of people, in the ground truth


def boxes_at(
    network: Network, site: str, lidar: str, samples: Sequence[SiteSample]
) -> Iterator[ScoredBoxes]:
    """Yields, for each class, the boxes in the region that counts for the class.

    Boxes and objects of people are matched together: the number of objects is that of all people.
    """
    detections = []
    for sample in samples:
        network.know(sample.region)
        detections.append(network.predict(sample.points))
    for name in network.classes:
        kinds = tuple(c for c in network.classes if (c in VEHICLES) == (name in VEHICLES))
        parts = [
            scored_boxes(*pair, kinds, METRICS[name], (name,))
            for pair in zip(samples, detections, strict=True)
        ]
        scores, right, objects = zip(*parts, strict=True)
        columns = np.concatenate(scores), np.concatenate(right)
        yield ScoredBoxes(site, lidar, name, *columns, sum(objects))


def rows_of(
    experiments: Sequence[ScoredBoxes], lines: Mapping[ObjectClass, tuple[float, float]]
) -> Iterator[dict[str, object]]:
    """Yields precision and recall of the shown boxes: measured, and predicted by the scores.

    There is a row for the vehicles and one for the people of each site and LiDAR.
    """
    groups: dict[tuple[str, str, str], list[ScoredBoxes]] = {}
    for one in experiments:
        kind = "vehicle" if one.name in VEHICLES else PEOPLE
        groups.setdefault((one.site, one.lidar, kind), []).append(one)
    for (site, lidar, kind), parts in groups.items():
        each = [calibration.calibrated(one.scores, lines[one.name]) for one in parts]
        scores, right = np.concatenate(each), np.concatenate([one.right for one in parts])
        objects, shown = parts[0].objects, scores >= CUT
        yield {
            "site": site,
            "lidar": lidar,
            "class": kind,
            "objects": objects,
            "boxes": int(shown.sum()),
            "precision": right[shown].mean() if shown.any() else np.nan,
            "precision_predicted": scores[shown].mean() if shown.any() else np.nan,
            "recall": right[shown].sum() / objects if objects else np.nan,
            "recall_predicted": scores[shown].sum() / scores.sum() if len(scores) else np.nan,
        }


def line_of(experiments: list[ScoredBoxes], name: ObjectClass) -> tuple[float, float]:
    """Fits the calibration line of a class.

    Raises ValueError if the class has no correct boxes or no incorrect boxes.
    """
    selected = [experiment for experiment in experiments if experiment.name == name]
    columns = (
        np.concatenate([getattr(experiment, key) for experiment in selected])
        for key in ("scores", "right")
    )
    try:
        return calibration.fit(*columns)
    except ValueError as error:
        raise ValueError(f"{name}: {error}") from None


def figures_of(table: pd.DataFrame) -> dict[str, float]:
    """Returns the mean precision and recall over sites and LiDARs.

    The keys for people begin with "people".
    """
    return {
        key if name in VEHICLES else f"people_{key}": round(float(group[key].mean()), 3)
        for name, group in table.groupby("class", sort=False)
        for key in ("precision", "recall")
    }


@command
def main(
    run: Path,
    *,
    sites: int = 60,
    frames: int = 5,
    out: Annotated[Path, {"recorded": "pyinfra/models/generalist.safetensors"}] = Path(
        "generalist.safetensors"
    ),
    table: Out = Path("generalist_sites.csv"),
) -> None:
    """
    Parameters
    ----------
    run : model file, name, or output folder of `pyinfra train --sites`
    sites : sites of the calibration and of the test (default: 60)
    frames : frames per LiDAR (default: 5)
    """
    loaded = checkpoint.load(model_file(run))
    network = fused(loaded.network())
    classes = network.classes
    network.calibration = None
    network.min_score = MIN_SCORE
    calibration_sites = frozen_sites.calibration_visits(sites)
    test_sites = itertools.islice(frozen_sites.read_visits("plain"), sites)
    fitted, experiments = (
        [
            experiment
            for keys, visits in chosen
            for lidar, samples in frozen_sites.tested_at(keys, visits, classes, frames)
            for experiment in boxes_at(network, keys["name"], lidar, samples)
        ]
        for chosen in (calibration_sites, test_sites)
    )
    lines = {name: line_of(fitted, name) for name in classes}
    line = tuple(itertools.chain.from_iterable(lines.values()))
    rows = pd.DataFrame(rows_of(experiments, lines)).assign(
        **provenance(f"pack_generalist {run} --sites {sites} --frames {frames}")
    )
    rows.to_csv(table, index=False, float_format="%.4g")
    figures = figures_of(rows)
    described = replace(
        loaded.provenance,
        anywhere=True,
        frames_version=str(simulation.frames_version()),
        calibration=line,
        figures={"cut": CUT, "sites": sites, **figures},
    )
    # Parameters of normalisation layers can exceed the range of half precision.
    weights = {
        f"network.{name}": tensor.half() if tensor.ndim > 1 else tensor
        for name, tensor in loaded.weights().items()
    }
    checkpoint.write(out, weights, described)
    print(f"{out}: {out.stat().st_size / 1e6:.2f} MB, {line}, {figures}")
