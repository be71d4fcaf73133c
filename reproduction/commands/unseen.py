"""Measures the AP of pretrained detectors at unseen sites, by class, site type and pose error.

The command `frozen_sites` wrote the sites as files: 60 generated sites, and 20 sites with much
street furniture. Each site has four LiDARs with preset `datasheet` and up to five frames per LiDAR.

Vehicles are matched by a BEV IoU of 0.5. Pedestrians and cyclists are matched in two ways: by an
IoU of 0.25, and by a centre distance of 0.5 m. For them an IoU of 0.5 is too strict: a box of 0.6 m
may be displaced by only 0.2 m. The class `vulnerable road user` has pedestrians and cyclists. Its
boxes may have either of the two classes.

A condition is an error of the known pose. Intervals (Student's t) are computed from 1,000 bootstrap
replicates of whole sites. The table also has paired differences to the first model, and the AP that
each condition costs. The command writes out/unseen.csv:

    python -m reproduction unseen version_2.safetensors generalist
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from pyinfra.core.arrays import BoolArray, FloatArray, IntArray, Points
from pyinfra.core.vocabulary import VEHICLES, ObjectClass
from pyinfra.dataset.regions import FOOTWAYS_M
from pyinfra.experiments.stress import clouds
from pyinfra.metrics import intervals, matching
from pyinfra.metrics.ap import average_precision, rank
from pyinfra.models.detectors import Detections
from pyinfra.models.detectors.classes import TYPES
from pyinfra.models.detectors.fuse_batchnorm import fused
from pyinfra.models.detectors.network import Network
from pyinfra.models.inference.detect import model_file
from pyinfra.models.training import checkpoint
from pyinfra.models.training.samples import SiteSample, lifted
from pyinfra.scenes.generator.layout import Keys
from pyinfra.scenes.generator.ranges import RANGES
from reproduction import provenance
from reproduction.arguments import Out, command
from reproduction.commands import frozen_sites

FINE = 1000  # number of recall levels of the AP
REPLICATES = 1000
CUT = 0.5  # smallest calibrated score of an unmatched box that counts as a false positive
CLASSES: tuple[ObjectClass, ...] = ("vehicle", "pedestrian", "cyclist")
# The classes of boxes that may match each kind of object.
OBJECTS: dict[str, tuple[ObjectClass, ...]] = {
    **{name: (name,) for name in CLASSES},
    "vulnerable road user": ("pedestrian", "cyclist"),
}
# A way to match boxes: name, metric and threshold.
Measure = tuple[str, matching.Metric, float]
OF_VEHICLES: list[Measure] = [("BEV IoU 0.5", "bev", 0.5)]
OF_PEOPLE: list[Measure] = [("BEV IoU 0.25", "bev", 0.25), ("centre 0.5 m", "centre", 0.5)]
AS_KNOWN = "as known"
RANDOM = np.random.default_rng(0)  # required argument; the pose errors use no random numbers
Fault = Callable[[Points], Points]
CONDITIONS: dict[str, Fault] = {
    AS_KNOWN: lambda points: points,
    "height 0.25 m wrong": partial(clouds.height_error, height_m=0.25, _=RANDOM),
    "pitch 0.5 deg wrong": partial(clouds.pitch_error, pitch_deg=0.5, _=RANDOM),
}
KINDS: dict[str, Callable[[Keys], bool]] = {
    "all": lambda keys: True,
    "with a roundabout": lambda keys: any("roundabout" in j for j in keys.get("junctions", ())),
    "with signals": lambda keys: any("signal" in j for j in keys.get("junctions", ())),
    "without a junction": lambda keys: "junctions" not in keys,
    "with people": lambda keys: "people" in keys,
    "many motorcycles": lambda keys: many(keys, "Motorcycle"),
    "many buses": lambda keys: many(keys, "Bus"),
}


def many(keys: Keys, name: str) -> bool:
    """Returns True if a rare class has a large share of a site's traffic."""
    return bool(keys["traffic"]["class_shares"].get(name, 0) >= RANGES.fleet_weight[0])


@dataclass(frozen=True, eq=False)
class Boxes:
    """A model's boxes for one kind of object at all sites of a set, matched by one measure."""

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

    def recall_at_half(self, chosen: BoolArray) -> float:
        """Returns the highest recall at the chosen sites at which the precision is at least 0.5."""
        mask = chosen[self.slot]
        right = self.right[mask][np.argsort(-self.scores[mask], kind="stable")]
        true_positives = np.cumsum(right)
        precise = true_positives >= 0.5 * np.arange(1, len(right) + 1)
        return float(true_positives[precise].max(initial=0) / max(1, self.objects[chosen].sum()))


@dataclass
class Parts:
    """Collects the arrays of a Boxes object, one sample at a time."""

    sites: int
    boxes: list[tuple[IntArray, FloatArray, BoolArray]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.objects, self.frames = (np.zeros(self.sites, np.int64) for _ in range(2))

    def add(self, slot: int, scores: FloatArray, right: BoolArray, objects: int) -> None:
        self.boxes.append((np.full(len(scores), slot), scores, right))
        self.objects[slot] += objects
        self.frames[slot] += 1

    def whole(self) -> Boxes:
        slot, scores, right = (np.concatenate(column) for column in zip(*self.boxes, strict=True))
        return Boxes(slot, scores, right, self.objects, self.frames)


Key = tuple[str, int, str, str]  # condition, model, kind of object and measure of a result


def scored_boxes(
    sample: SiteSample, detections: Detections, names: tuple[ObjectClass, ...], measure: Measure
) -> tuple[FloatArray, BoolArray, int]:
    """Returns scores (n,) and correctness (n,) of boxes, and the number of objects.

    Only boxes and objects of the classes `names` are used.
    """
    _, metric, limit = measure
    margin_m = 0.0 if names == VEHICLES else FOOTWAYS_M
    types, numbers = [TYPES[name] for name in names], [CLASSES.index(name) for name in names]
    inside = np.isin(detections.names, types) & sample.region.holds(detections.boxes, margin_m)
    counted = np.isin(sample.numbers, numbers) & sample.region.holds(sample.boxes, margin_m)
    boxes, scores, truth = (
        detections.boxes[inside],
        detections.scores[inside],
        sample.boxes[counted],
    )
    frames = np.zeros(len(boxes), np.int64), np.zeros(len(truth), np.int64)
    right = matching.true_positives(frames[0], boxes, scores, frames[1], truth, metric, limit)
    return scores, right, len(truth)


def gathered(
    name: str, sites: int, frames: int, networks: list[Network], conditions: dict[str, Fault]
) -> dict[Key, Boxes]:
    parts: dict[Key, Parts] = {}
    slots: dict[str, int] = {}
    for site, _, samples in frozen_sites.looked_at(name, CLASSES, sites, frames):
        slot = slots.setdefault(site, len(slots))
        for sample in samples:
            for condition, fault in conditions.items():
                points = lifted(fault(lifted(sample.points, -sample.height_m)), sample.height_m)
                for model, network in enumerate(networks):
                    network.know(sample.region)
                    detections = network.predict(points)
                    for kind, names in OBJECTS.items():
                        if not set(names) <= set(network.classes):
                            continue
                        for measure in OF_VEHICLES if names == VEHICLES else OF_PEOPLE:
                            key = (condition, model, kind, measure[0])
                            part = parts.setdefault(key, Parts(sites))
                            part.add(slot, *scored_boxes(sample, detections, names, measure))
    return {key: part.whole() for key, part in parts.items()}


def rows(
    pooled: dict[Key, Boxes], names: list[str], kinds: dict[str, BoolArray]
) -> Iterator[dict[str, object]]:
    random = np.random.default_rng(1)
    for kind, chosen in kinds.items():
        if not chosen.any():
            continue
        count = int(chosen.sum())
        counts = random.multinomial(count, np.ones(count) / count, REPLICATES)
        weights = np.zeros((1 + REPLICATES, len(chosen)), np.int64)
        weights[0, chosen], weights[1:, chosen] = 1, counts
        every = {key: boxes.ap(weights) for key, boxes in pooled.items()}
        for (condition, model, name, measure), boxes in pooled.items():
            ap = every[(condition, model, name, measure)]
            first = every.get((condition, 0, name, measure))
            less = ap - first if model and first is not None else None
            as_known = every[(AS_KNOWN, model, name, measure)]
            cost = as_known - ap if condition != AS_KNOWN else None
            false = boxes.false_per_frame(weights)
            yield {
                "model": names[model],
                "condition": condition,
                "class": name,
                "measure": measure,
                "sites": kind,
                "count": count,
                "objects": int(boxes.objects[chosen].sum()),
                **with_ends("ap_r1000", ap, count),
                **with_ends("difference", less, count),
                **with_ends("cost", cost, count),
                "recall_at_half": boxes.recall_at_half(chosen),
                **with_ends("false_per_frame", false, count),
            }


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


def tested(
    networks: list[Network], names: list[str], sites: int | None, frames: int
) -> Iterator[dict[str, object]]:
    """Yields the rows of both sets of sites.

    Pose errors and site types are measured on the set `plain` only.
    """
    for name, conditions in (
        ("plain", CONDITIONS),
        ("cluttered", {AS_KNOWN: CONDITIONS[AS_KNOWN]}),
    ):
        keys = [keys for keys, _ in frozen_sites.read_visits(name)][:sites]
        kinds = {kind: np.array([holds(item) for item in keys]) for kind, holds in KINDS.items()}
        pooled = gathered(name, len(keys), frames, networks, conditions)
        all_of = {"all": kinds.pop("all")}
        yield from ({"set": name, **row} for row in rows(pooled, names, all_of))
        if name == "plain":
            as_known = {key: item for key, item in pooled.items() if key[0] == AS_KNOWN}
            yield from ({"set": name, **row} for row in rows(as_known, names, kinds))


@command
def main(
    models: Sequence[Path],
    *,
    sites: int | None = None,
    frames: int = 5,
    out: Out = Path("unseen.csv"),
) -> None:
    """
    Parameters
    ----------
    models : names, model files or run folders
    sites : number of sites per set (default: all)
    frames : frames per LiDAR, at most 5 (default: 5)
    """
    networks = [fused(checkpoint.load(model_file(model)).network()) for model in models]
    names = [model.stem for model in models]
    table = pd.DataFrame(tested(networks, names, sites, frames)).assign(
        **provenance(
            f"unseen {' '.join(map(str, models))} --frames {frames}"
            + (f" --sites {sites}" if sites else "")
        )
    )
    table.to_csv(out, index=False, float_format="%.4g")
    print(table[table.sites == "all"].iloc[:, :-3].to_string(index=False))
