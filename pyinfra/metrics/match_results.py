"""Match results: which predictions are true positives, false positives or ignored.

All vehicles take part in the matching, with the boxes of their labels. Whether a vehicle is in the
region depends on its box at mid-frame. For pedestrians and cyclists the region includes a strip
beside the carriageway.

- A vehicle that does not count (not in the ground-truth subset, or outside the region) is ignored,
  and so is the prediction that is matched with it.
- An unmatched prediction is a false positive if its centre is inside the region; for ground truth
  `common` it must also be in the common field of view. Otherwise it is ignored.

There are two exceptions, which also hold outside the region. A vehicle's box on a labelled
pedestrian or cyclist is a false positive, and so is a second box on a pedestrian or cyclist that
counts.
"""

from __future__ import annotations

import math
import typing
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal, get_args

import numpy as np

from pyinfra.core.arrays import BoolArray, FloatArray, IntArray, NameArray
from pyinfra.core.errors import Error
from pyinfra.core.names import suggestion
from pyinfra.core.vocabulary import OBJECT_CLASSES, PERSON_TYPES, SUBSETS, Subset
from pyinfra.dataset.data_set import MIN_VISIBILITY
from pyinfra.dataset.frame_tables import Predictions, Vehicles
from pyinfra.dataset.regions import FOOTWAYS_M
from pyinfra.dataset.roads import Places
from pyinfra.dataset.windows import Window
from pyinfra.metrics import ap, intervals
from pyinfra.metrics.ground_truth import GroundTruth
from pyinfra.metrics.intervals import Blocks
from pyinfra.metrics.matching import (
    IOU,
    LEAST_OVERLAP,
    TIE,
    Metric,
    Pairs,
    best_overlap,
    holding_centres,
    in_order,
    match,
    overlapping_pairs,
    reaches,
)

# definition: AP at 40 and at 1,000 recalls. r11: 11 recalls. kitti: 40 recalls, with the sampling
# and the strict threshold of KITTI's devkit.
Protocol = Literal["definition", "r11", "kitti"]
PROTOCOLS: tuple[Protocol, ...] = get_args(Protocol)
CAUSES = ("background", "duplicate", "localisation")
# Block length if vehicles have no ids, so that their stay is unknown; it suits a motorway.
LABELS_BLOCK_S = 20.0


@dataclass(frozen=True)
class Settings:
    """Settings of an evaluation; the first element of each list is the primary one."""

    classes: Mapping[str, tuple[str, ...]] = field(
        default_factory=lambda: {"vehicle": OBJECT_CLASSES["vehicle"]}
    )  # names of classes and the KITTI types that they include
    ground_truths: tuple[Subset, ...] = ("captured", "all")
    ious: tuple[float, ...] = (IOU,)
    protocols: tuple[Protocol, ...] = ("definition",)
    metrics: tuple[Metric, ...] = ("bev",)
    min_score: float = 0.0  # least score of a prediction that counts
    min_points: int = 1  # least number of points on a captured vehicle
    min_objects: int = 20  # least number of objects in an area that gets a quality
    cut_first: bool = False  # whether to compute AP with windows cut out before matching, too
    block_s: float | None = None  # block length of the bootstrap; default: the stay of a vehicle
    replicates: int = 200  # number of bootstrap replicates
    seed: int = 1

    def __post_init__(self) -> None:
        for name in ("classes", "ground_truths", "ious", "protocols", "metrics"):
            if not getattr(self, name):
                raise Error(f"{name}: expected one or more, got none")
        for which in self.ground_truths:
            if which not in SUBSETS:
                near = suggestion(which, SUBSETS)
                raise Error(f"ground_truths: expected names of them, got '{which}'{near}")
        for iou in self.ious:
            if not 0.1 <= iou < 1:
                raise Error(f"iou: expected 0.1 to below 1, got {iou:g}")
        if self.block_s is not None and not 0 < self.block_s <= 1e6:
            raise Error(f"block_s: expected above 0 to 1e6, got {self.block_s:g}")
        if not 0 <= self.min_score <= 1:
            raise Error(f"min_score: expected 0 to 1, got {self.min_score:g}")
        for name, least in (("min_points", 1), ("min_objects", 1), ("replicates", 1), ("seed", 0)):
            if (value := getattr(self, name)) < least:
                raise Error(f"{name}: expected {least} or more, got {value}")

    def ious_of(self, metric: Metric) -> tuple[float, ...]:
        """Returns the IoU thresholds of a metric; one NaN for metric `centre`."""
        return (math.nan,) if metric == "centre" else self.ious

    @property
    def types(self) -> list[str]:
        """The names of vehicles and predictions that are evaluated, each once."""
        every = (t for name, types in self.classes.items() for t in (*types, name))
        return list(dict.fromkeys(every))


def are_people(types: Iterable[str]) -> bool:
    """Returns whether all types are pedestrians or cyclists, which have their own rules."""
    return set(types) <= set(PERSON_TYPES)


@dataclass(frozen=True, eq=False)
class MatchInput:
    """The vehicles and predictions of one class, ready for matching."""

    truth: GroundTruth
    vehicles: Vehicles
    predictions: Predictions
    blocks: Blocks
    present_blocks: Blocks  # blocks for ground truth `present`, the same for all mounts
    metric: Metric
    of_people: bool  # whether the class is pedestrians or cyclists
    people: Vehicles  # labelled pedestrians and cyclists, on which a vehicle's box is wrong

    @property
    def beside_m(self) -> float:
        return FOOTWAYS_M if self.of_people else 0.0

    @cached_property
    def vehicle_places(self) -> Places:
        return self.truth.places(self.vehicles.mid_frame, self.beside_m)

    @cached_property
    def prediction_places(self) -> Places:
        return self.truth.places(self.predictions.boxes, self.beside_m)

    @cached_property
    def pairs(self) -> Pairs:
        """Overlapping pairs in the order of matching."""
        v, p = self.vehicles, self.predictions
        pairs = overlapping_pairs(p.frame, p.boxes, v.frame, v.boxes, self.metric)
        return in_order(pairs, p.scores, p.boxes, v.boxes)

    @cached_property
    def best_overlap(self) -> FloatArray:
        return best_overlap(self.pairs, len(self.predictions))

    @cached_property
    def on_people(self) -> BoolArray:
        """(p,) whether a box contains the centre of one of `people` and overlaps no vehicle."""
        p, who = self.predictions, self.people
        on = holding_centres(p.frame, p.boxes, who.frame, who.boxes)
        return on & (self.best_overlap < LEAST_OVERLAP - TIE)

    def on_detected(self, detected: BoolArray) -> BoolArray:
        """Returns which predictions overlap a vehicle of the mask `detected` (v,): (p,)."""
        on = np.zeros(len(self.predictions), dtype=np.bool_)
        on[self.pairs.prediction[detected[self.pairs.vehicle]]] = True
        return on

    def match(self, iou: float, *, strict: bool, within: Window | None = None) -> IntArray:
        """Returns the vehicle that each prediction is matched with: (p,), -1 for none.

        strict: as in `matching.match`. within: only boxes in this window are matched.
        """
        pairs = self.pairs
        if within is not None:
            v, p = within.holds(self.vehicle_places), within.holds(self.prediction_places)
            pairs = pairs.select(v[pairs.vehicle] & p[pairs.prediction])
        return match(pairs, len(self.predictions), len(self.vehicles), iou, strict=strict)


class Part(typing.Protocol):
    """A part of the region: a window of a road, a grid cell, a ring around the sensor."""

    def holds(self, places: Places) -> BoolArray:
        """Returns which of n positions lie in the part: (n,) bool."""
        ...


@dataclass(frozen=True, eq=False)
class MatchResult:
    """The match result of all predictions and vehicles, for one ground truth and threshold.

    A prediction that is neither in `hit` nor in `wrong` is ignored.
    """

    match_input: MatchInput
    matches: IntArray  # (p,) matched vehicle, -1 for none
    counted: BoolArray  # (v,) vehicles that count
    true_positive: BoolArray  # (p,) true positives
    false_positive: BoolArray  # (p,) false positives
    blocks: Blocks

    @property
    def objects(self) -> int:
        return int(np.count_nonzero(self.counted))

    def ranking(self, window: Part | None = None) -> ap.Ranking:
        """Returns the counted predictions and objects of the region, or of a part of it.

        A true positive belongs to the part that its vehicle is in; a false positive belongs to the
        part that its own centre is in.
        """
        match_input, true_positive, false_positive, counted = (
            self.match_input,
            self.true_positive,
            self.false_positive,
            self.counted,
        )
        if window is not None:
            in_window = window.holds(match_input.vehicle_places)
            counted = counted & in_window
            true_positive = true_positive.copy()
            true_positive[true_positive] = in_window[self.matches[true_positive]]
            false_positive = false_positive & window.holds(match_input.prediction_places)
        use = np.flatnonzero(true_positive | false_positive)
        return ap.rank(
            match_input.predictions.scores[use],
            true_positive[use],
            self.per_slot(match_input.vehicles.frame[counted]),
            self.blocks.slot[match_input.predictions.frame[use]],
        )

    @property
    def weights(self) -> IntArray:
        """How often each replicate contains each slot: (replicates, slots)."""
        return self.blocks.replicates

    def per_slot(self, frame: IntArray) -> IntArray:
        """Counts the frames (n,) in each slot: (slots,)."""
        blocks = self.blocks
        return np.bincount(blocks.slot[frame], minlength=blocks.replicates.shape[1]).astype(
            np.int64
        )

    def interval(
        self,
        value: FloatArray | float,
        replicates: FloatArray,
        objects: IntArray,
        *,
        most: float = 100.0,
    ) -> tuple[FloatArray, FloatArray]:
        """Returns the ends of the 95 % intervals of figures (...), clipped to 0 to `most`.

        replicates: replicates (d, ...). objects: (slots,) number of objects that the figure is
        computed from. The ends are NaN if these are in too few blocks.
        """
        blocks = self.blocks
        held = np.count_nonzero(np.add.reduceat(objects, np.arange(0, len(objects), blocks.length)))
        few = held < intervals.MIN_BLOCKS
        low, high = intervals.interval(
            np.asarray(value), replicates[: 0 if few else None], blocks.count
        )
        return np.maximum(low, 0), np.minimum(high, most)


def match_input(
    truth: GroundTruth, predictions: Predictions, name: str, settings: Settings, metric: Metric
) -> MatchInput:
    """Returns the vehicles and predictions of a class, without predictions below `min_score`.

    The name of a prediction may be a type of the class or the class itself.
    """
    types = settings.classes[name]
    is_vehicle = np.isin(truth.vehicles.names, types)
    people = () if set(types) & set(PERSON_TYPES) else PERSON_TYPES
    is_person = np.isin(truth.vehicles.names, people) & (truth.vehicles.points > 0)
    named = np.isin(predictions.names, (*types, name))
    return MatchInput(
        truth=truth,
        vehicles=truth.vehicles.select(is_vehicle),
        predictions=predictions.select(named & (predictions.scores >= settings.min_score)),
        blocks=blocks_of(truth, settings),
        present_blocks=blocks_of(truth, settings, present=True),
        metric=metric,
        of_people=are_people(types),
        people=truth.vehicles.select(is_person),
    )


def blocks_of(truth: GroundTruth, settings: Settings, *, present: bool = False) -> Blocks:
    """Returns the bootstrap blocks, whose length is the same for all LiDARs of a mount.

    The length follows from the stay of visible vehicles. present: it follows from all vehicles of
    the region, and so is the same for all mounts.
    """
    frames = np.array(truth.frames, dtype=np.int64)
    types = [t for group in settings.classes.values() for t in group]
    people = are_people(types)
    block_s = settings.block_s or block_seconds(truth, people=people, present=present)
    return intervals.time_blocks(
        frames, truth.period_s, block_s=block_s, replicates=settings.replicates, seed=settings.seed
    )


def block_seconds(truth: GroundTruth, *, people: bool = False, present: bool = False) -> float:
    """Returns the block length: the stay of visible vehicles, or LABELS_BLOCK_S without ids.

    people: use the stay of pedestrians and cyclists only. Otherwise those beside the carriageway
    are left out, because they stay longer. present: use all vehicles of the region, visible or not.
    """
    if not truth.has_objects:
        return LABELS_BLOCK_S
    if present:
        beside_m = FOOTWAYS_M if people else 0.0
        there = truth.vehicles.select(truth.places(truth.vehicles.mid_frame, beside_m).inside)
    else:
        there = truth.vehicles.select(truth.vehicles.visibility >= MIN_VISIBILITY)
    on_foot = np.isin(there.names, PERSON_TYPES)
    if people:
        there = there.select(on_foot)
    elif on_foot.any():
        there = there.select(~on_foot | truth.places(there.mid_frame).inside)
    apart = float(np.median(np.diff(truth.frames))) if len(truth.frames) > 1 else 1.0
    return intervals.block_seconds(there.frame, there.ids, apart * truth.period_s)


def count_matches(
    match_input: MatchInput, which: Subset, matches: IntArray, min_points: int
) -> MatchResult:
    """Returns the match result for a ground truth, from the matches of Contest.match()."""
    counted = match_input.truth.counted(
        which, match_input.vehicles, match_input.vehicle_places, min_points
    )
    matched = matches >= 0
    # An unmatched box at these positions is a false positive.
    amiss = match_input.prediction_places.inside | match_input.on_people
    if match_input.of_people:
        detected = np.zeros(len(counted), dtype=np.bool_)
        detected[matches[matched]] = counted[matches[matched]]
        amiss |= match_input.on_detected(detected)
    false_positive = ~matched & amiss
    if which == "common":
        false_positive &= match_input.truth.in_common_view(match_input.predictions.boxes)
    true_positive = matched.copy()
    true_positive[matched] = counted[matches[matched]]
    blocks = match_input.present_blocks if which == "present" else match_input.blocks
    return MatchResult(match_input, matches, counted, true_positive, false_positive, blocks)


def precision(ranking: ap.Ranking, protocol: Protocol, weights: IntArray | None) -> FloatArray:
    """Returns AP of each replicate; without weights, the AP of all frames."""
    if protocol == "kitti":
        return ap.kitti_average_precision(ranking, weights)
    return ap.average_precision(ranking, 11 if protocol == "r11" else 40, weights)


def causes(match_result: MatchResult, iou: float, *, strict: bool) -> NameArray:
    """Returns the cause of each false positive: (false positives,).

    duplicate: it overlaps a vehicle enough, but another prediction is matched with that vehicle.
    localisation: it overlaps a vehicle by LEAST_OVERLAP or more, but not enough. ghost: it overlaps
    no vehicle.
    """
    best = match_result.match_input.best_overlap[match_result.false_positive]
    names = np.full(len(best), "background", dtype="<U12")
    names[best >= LEAST_OVERLAP - TIE] = "localisation"
    names[reaches(best, iou, strict=strict)] = "duplicate"
    return names
