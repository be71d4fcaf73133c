"""Boxes of a detector at the frozen sites, matched with the objects, and their figures."""

from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import TypeVar

import numpy as np

from pyinfra.core.arrays import BoolArray, FloatArray, IntArray
from pyinfra.core.vocabulary import VEHICLES, ObjectClass
from pyinfra.dataset.regions import FOOTWAYS_M
from pyinfra.metrics import intervals, matching
from pyinfra.metrics.ap import average_precision, rank
from pyinfra.models.detectors import Detections
from pyinfra.models.detectors.classes import TYPES
from pyinfra.models.training.samples import SiteSample
from reproduction import frozen_sites

FINE = 1000  # number of recall levels of the AP
REPLICATES = 1000
CUT = 0.5  # smallest calibrated score of an unmatched box that counts as a false positive
CLASSES: tuple[ObjectClass, ...] = ("vehicle", "pedestrian", "cyclist")
# For each kind of object: the classes of boxes that may match, and the metric.
KINDS: dict[str, tuple[tuple[ObjectClass, ...], matching.Metric]] = {
    "vehicle": (("vehicle",), "bev"),
    "pedestrian": (("pedestrian",), "centre"),
    "cyclist": (("cyclist",), "centre"),
    "vulnerable road user": (("pedestrian", "cyclist"), "centre"),
}
# Scores (n,) and correctness (n,) of the boxes in a frame, and the number of objects.
Matches = tuple[FloatArray, BoolArray, int]
Key = TypeVar("Key", bound=Hashable)


@dataclass(frozen=True, eq=False)
class Boxes:
    """A model's boxes for one kind of object at all sites of a set."""

    slot: IntArray  # (n,) index of the site of each box
    scores: FloatArray
    right: BoolArray
    objects: IntArray  # (sites,) number of objects at each site
    frames: IntArray  # (sites,) number of frames at each site

    def ap(self, weights: IntArray) -> FloatArray:
        """Returns the AP (R1000) of each bootstrap replicate from weights (replicates, sites)."""
        return average_precision(
            rank(self.scores, self.right, self.objects, self.slot), FINE, weights
        )

    def false_per_frame(self, weights: IntArray) -> FloatArray:
        """Returns false positives per frame for weights (replicates, sites)."""
        false = self.slot[~self.right & (self.scores >= CUT)]
        return (weights @ np.bincount(false, minlength=len(self.frames))) / (weights @ self.frames)

    def recalls_at_half(self, weights: IntArray) -> FloatArray:
        """Returns the highest recall at a precision of 0.5 or more, for each row of weights."""
        order = np.argsort(-self.scores, kind="stable")
        slot, right = self.slot[order], self.right[order]
        recalls = []
        for row in weights:
            boxes = row[slot]
            true = np.cumsum(boxes * right)
            precise = true >= 0.5 * np.cumsum(boxes)
            recalls.append(true[precise].max(initial=0) / max(1, row @ self.objects))
        return np.array(recalls)


def boxes_of(sites: Sequence[Sequence[Matches]]) -> Boxes:
    """Returns the boxes at all sites. sites: the matches in each frame of each site."""
    each = [(slot, *matches) for slot, frames in enumerate(sites) for matches in frames]
    slots, scores, right, counts = zip(*each, strict=True)
    of_boxes = np.repeat(slots, [len(part) for part in scores])
    objects = np.bincount(slots, counts, len(sites)).astype(np.int64)
    frames = np.bincount(slots, minlength=len(sites))
    return Boxes(of_boxes, np.concatenate(scores), np.concatenate(right), objects, frames)


def scored_boxes(
    sample: SiteSample,
    detections: Detections,
    names: tuple[ObjectClass, ...],
    metric: matching.Metric,
    shown: Iterable[ObjectClass] = (),
) -> Matches:
    """Returns scores (n,) and correctness (n,) of boxes, and the number of objects.

    Only boxes and objects of the classes `names` are used. shown: classes of the returned boxes;
    all of `names` if empty.
    """
    margin_m = 0.0 if names == VEHICLES else FOOTWAYS_M
    numbers = [CLASSES.index(name) for name in names]
    inside = of_classes(detections, names) & sample.region.holds(detections.boxes, margin_m)
    counted = np.isin(sample.numbers, numbers) & sample.region.holds(sample.boxes, margin_m)
    boxes, scores, truth = (
        detections.boxes[inside],
        detections.scores[inside],
        sample.boxes[counted],
    )
    frames = np.zeros(len(boxes), np.int64), np.zeros(len(truth), np.int64)
    right = matching.true_positives(frames[0], boxes, scores, frames[1], truth, metric)
    kept = of_classes(detections, shown or names)[inside]
    return scores[kept], right[kept], len(truth)


def of_classes(detections: Detections, names: Iterable[ObjectClass]) -> BoolArray:
    """Returns which boxes are of the classes: (n,)."""
    return np.isin(detections.names, [TYPES[name] for name in names])


def gathered(
    name: str,
    sites: int | None,
    frames: int,
    measured: Callable[[Sequence[frozen_sites.TestSample]], Mapping[Key, Sequence[Matches]]],
) -> dict[Key, Boxes]:
    """Returns the boxes at the sites of a set, by key.

    Parameters
    ----------
    sites : maximum number of sites; None for all sites
    frames : maximum number of frames per LiDAR
    measured : returns the matches in each frame of a site, by key
    """
    of_sites: dict[Key, list[Sequence[Matches]]] = {}
    for keys, visits in islice(frozen_sites.read_visits(name), sites):
        visited = frozen_sites.tested_at(keys, visits, CLASSES, frames)
        samples = [sample for _, of_lidar in visited for sample in of_lidar]
        for key, matches in measured(samples).items():
            of_sites.setdefault(key, []).append(matches)
        print(name, keys["name"], len(samples), "frames", flush=True)
    return {key: boxes_of(matches) for key, matches in of_sites.items()}


def with_ends(name: str, values: FloatArray | None, sites: int) -> dict[str, float]:
    """Returns a value and the ends of its interval.

    Parameters
    ----------
    values : the value, followed by its bootstrap replicates over sites; None gives NaN
    """
    keys = (name, f"{name}_low", f"{name}_high")
    if values is None:
        return dict.fromkeys(keys, np.nan)
    ends = intervals.interval(values[0], values[1:], sites)
    return dict(zip(keys, (float(values[0]), *map(float, ends)), strict=True))
