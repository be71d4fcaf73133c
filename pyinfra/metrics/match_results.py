"""Predictions held against the vehicles of a LiDAR's frames: what is right, wrong and ignored.

Every vehicle in reach takes part in the matching, with the box of its label; where it belongs is
decided by that of mid-frame; people count beside the carriageway too. One that is not counted
(another ground truth, or outside the evaluation region) and the prediction that took it are
ignored. A prediction that took none is wrong, unless its centre lies outside the region or, for
`common`, outside the common field of view: then it is ignored too. So a vehicle at the border is
judged with the box that found it.

People are the exception. A vehicle's box on a labelled person is wrong outside the region too, and
so is a second box on a person who counts.
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
from pyinfra.dataset.regions import FOOTWAYS_M, Places, Window
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

# definition: 40 recalls. r11: 11 recalls. kitti: the devkit's sampling and strict threshold.
Protocol = Literal["definition", "r11", "kitti"]
PROTOCOLS: tuple[Protocol, ...] = get_args(Protocol)
CAUSES = ("ghost", "duplicate", "localisation")
LABELS_BLOCK_S = 20.0  # as on a motorway: without objects no one knows how long a vehicle stays


@dataclass(frozen=True)
class Settings:
    """What is evaluated; of each list the first one is primary."""

    classes: Mapping[str, tuple[str, ...]] = field(
        default_factory=lambda: {"vehicle": OBJECT_CLASSES["vehicle"]}
    )  # by name: the KITTI types that count
    ground_truths: tuple[Subset, ...] = ("captured", "all")
    ious: tuple[float, ...] = (IOU,)
    protocols: tuple[Protocol, ...] = ("definition",)
    metrics: tuple[Metric, ...] = ("bev",)
    min_score: float = 0.0  # from here on a prediction counts
    min_points: int = 1  # of a vehicle that is captured
    min_objects: int = 20  # of an area that counts
    cut_first: bool = False  # also match within each window alone
    block_s: float | None = None  # of the bootstrap; by default as long as a vehicle stays
    draws: int = 200
    seed: int = 1

    def __post_init__(self) -> None:
        for name in ("classes", "ground_truths", "ious", "protocols", "metrics"):
            if not getattr(self, name):
                raise Error(f"{name}: found none, allowed one or more")
        for which in self.ground_truths:
            if which not in SUBSETS:
                near = suggestion(which, SUBSETS)
                raise Error(f"ground_truths: expected names of them, got '{which}'{near}")
        for iou in self.ious:
            if not 0.1 <= iou < 1:
                raise Error(f"iou: found {iou:g}, allowed 0.1 to below 1")
        if self.block_s is not None and not 0 < self.block_s <= 1e6:
            raise Error(f"block_s: found {self.block_s:g}, allowed above 0 to 1e6")
        if not 0 <= self.min_score <= 1:
            raise Error(f"min_score: found {self.min_score:g}, allowed 0 to 1")
        for name, least in (("min_points", 1), ("min_objects", 1), ("draws", 1), ("seed", 0)):
            if (value := getattr(self, name)) < least:
                raise Error(f"{name}: found {value}, allowed {least} or more")

    def ious_of(self, metric: Metric) -> tuple[float, ...]:
        """Of the rows of a metric; one that is not known where centres decide."""
        return (math.nan,) if metric == "centre" else self.ious

    @property
    def types(self) -> list[str]:
        """Names of vehicles and predictions that are evaluated, each once."""
        every = (t for name, types in self.classes.items() for t in (*types, name))
        return list(dict.fromkeys(every))


def are_people(types: Iterable[str]) -> bool:
    """Whether all of some types are of people, who are found and counted by rules of their own."""
    return set(types) <= set(PERSON_TYPES)


@dataclass(frozen=True, eq=False)
class Contest:
    """Vehicles and predictions of one class, and which of them overlap."""

    truth: GroundTruth
    vehicles: Vehicles
    predictions: Predictions
    blocks: Blocks
    present_blocks: Blocks  # of ground truth `present`, the same for all mounts
    metric: Metric
    of_people: bool  # a class of them, who count beside the carriageway too
    people: Vehicles  # of other classes, labelled: no box of the class may stand on them

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
        """In the order of matching."""
        v, p = self.vehicles, self.predictions
        pairs = overlapping_pairs(p.frame, p.boxes, v.frame, v.boxes, self.metric)
        return in_order(pairs, p.scores, p.boxes, v.boxes)

    @cached_property
    def best_overlap(self) -> FloatArray:
        return best_overlap(self.pairs, len(self.predictions))

    @cached_property
    def on_people(self) -> BoolArray:
        """(p,) predictions that hold the centre of one of the people and overlap no vehicle."""
        p, who = self.predictions, self.people
        on = holding_centres(p.frame, p.boxes, who.frame, who.boxes)
        return on & (self.best_overlap < LEAST_OVERLAP - TIE)

    def on_detected(self, detected: BoolArray) -> BoolArray:
        """(p,) predictions that overlap one of some vehicles (v,)."""
        on = np.zeros(len(self.predictions), dtype=np.bool_)
        on[self.pairs.prediction[detected[self.pairs.vehicle]]] = True
        return on

    def match(self, iou: float, *, strict: bool, within: Window | None = None) -> IntArray:
        """The vehicle that each prediction took, -1 for none; within: cut to a window first."""
        pairs = self.pairs
        if within is not None:
            v, p = within.holds(self.vehicle_places), within.holds(self.prediction_places)
            pairs = pairs.select(v[pairs.vehicle] & p[pairs.prediction])
        return match(pairs, len(self.predictions), len(self.vehicles), iou, strict=strict)


class Part(typing.Protocol):
    """A part of the region: a window of a road, a cell, a ring around the sensor."""

    def holds(self, places: Places) -> BoolArray:
        """(n,) bool: which of the places lie in it."""
        ...


@dataclass(frozen=True, eq=False)
class Judgement:
    """What became of every prediction and vehicle under one ground truth and threshold."""

    contest: Contest
    matches: IntArray  # (p,) vehicle, -1 for none
    counted: BoolArray  # (v,) vehicles to be found
    hit: BoolArray  # (p,) right
    wrong: BoolArray  # (p,) the rest is ignored
    blocks: Blocks

    @property
    def objects(self) -> int:
        return int(np.count_nonzero(self.counted))

    def ranking(self, window: Part | None = None) -> ap.Ranking:
        """All, or of a window or cell: hits and misses with their vehicle, others alone."""
        contest, hit, wrong, counted = self.contest, self.hit, self.wrong, self.counted
        if window is not None:
            in_window = window.holds(contest.vehicle_places)
            counted = counted & in_window
            hit = hit.copy()
            hit[hit] = in_window[self.matches[hit]]
            wrong = wrong & window.holds(contest.prediction_places)
        use = np.flatnonzero(hit | wrong)
        return ap.rank(
            contest.predictions.scores[use],
            hit[use],
            self.per_slot(contest.vehicles.frame[counted]),
            self.blocks.slot[contest.predictions.frame[use]],
        )

    @property
    def weights(self) -> IntArray:
        """How often each draw takes each slot: (draws, slots); no draws of a short time."""
        return self.blocks.draws

    def per_slot(self, frame: IntArray) -> IntArray:
        """How many of the frames (n,) are in each slot."""
        blocks = self.blocks
        return np.bincount(blocks.slot[frame], minlength=blocks.draws.shape[1]).astype(np.int64)

    def interval(
        self,
        value: FloatArray | float,
        draws: FloatArray,
        objects: IntArray,
        *,
        most: float = 100.0,
    ) -> tuple[FloatArray, FloatArray]:
        """Ends of the 95 % intervals of figures (...) of 0 to `most` from their draws (d, ...).

        objects: (slots,), what they rest on; NaN if they are in too few blocks.
        """
        blocks = self.blocks
        held = np.count_nonzero(np.add.reduceat(objects, np.arange(0, len(objects), blocks.length)))
        few = held < intervals.MIN_BLOCKS
        low, high = intervals.interval(np.asarray(value), draws[: 0 if few else None], blocks.count)
        return np.maximum(low, 0), np.minimum(high, most)


def contest(
    truth: GroundTruth, predictions: Predictions, name: str, settings: Settings, metric: Metric
) -> Contest:
    """The vehicles and predictions of a class, these from the lowest score on that counts.

    A prediction may be named by one of the class's types or by the class itself.
    """
    types = settings.classes[name]
    is_vehicle = np.isin(truth.vehicles.names, types)
    people = () if set(types) & set(PERSON_TYPES) else PERSON_TYPES
    is_person = np.isin(truth.vehicles.names, people) & (truth.vehicles.points > 0)
    named = np.isin(predictions.names, (*types, name))
    return Contest(
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
    """Of one length for all LiDARs of a mount, by the vehicles that can be seen from there.

    present: by every vehicle of the region, so that the length is the same for all mounts too.
    """
    frames = np.array(truth.frames, dtype=np.int64)
    types = [t for group in settings.classes.values() for t in group]
    people = are_people(types)
    block_s = settings.block_s or block_seconds(truth, people=people, present=present)
    return intervals.time_blocks(
        frames, truth.period_s, block_s=block_s, draws=settings.draws, seed=settings.seed
    )


def block_seconds(truth: GroundTruth, *, people: bool = False, present: bool = False) -> float:
    """As long as a visible vehicle stays; LABELS_BLOCK_S where vehicles have no ids.

    people: as long as those do; else people beside the carriageway are left out, who stay longer.
    present: as long as any vehicle of the region does, visible or not.
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


def judge(contest: Contest, which: Subset, matches: IntArray, min_points: int) -> Judgement:
    """Counts under a ground truth what Contest.match() found."""
    counted = contest.truth.counted(which, contest.vehicles, contest.vehicle_places, min_points)
    matched = matches >= 0
    amiss = contest.prediction_places.inside | contest.on_people  # where a box costs something
    if contest.of_people:
        detected = np.zeros(len(counted), dtype=np.bool_)
        detected[matches[matched]] = counted[matches[matched]]
        amiss |= contest.on_detected(detected)
    wrong = ~matched & amiss
    if which == "common":
        wrong &= contest.truth.in_common_view(contest.predictions.boxes)
    hit = matched.copy()
    hit[matched] = counted[matches[matched]]
    blocks = contest.present_blocks if which == "present" else contest.blocks
    return Judgement(contest, matches, counted, hit, wrong, blocks)


def precision(ranking: ap.Ranking, protocol: Protocol, weights: IntArray | None) -> FloatArray:
    """AP of each draw; of the frames as they are without weights."""
    if protocol == "kitti":
        return ap.kitti_average_precision(ranking, weights)
    return ap.average_precision(ranking, 11 if protocol == "r11" else 40, weights)


def causes(judgement: Judgement, iou: float, *, strict: bool) -> NameArray:
    """Why each wrong prediction is wrong, (wrong ones,).

    duplicate: another took the vehicle that it overlaps enough; localisation: it overlaps one by
    0.1 or more, but not enough; ghost: no vehicle is there.
    """
    best = judgement.contest.best_overlap[judgement.wrong]
    names = np.full(len(best), "ghost", dtype="<U12")
    names[best >= LEAST_OVERLAP - TIE] = "localisation"
    names[reaches(best, iou, strict=strict)] = "duplicate"
    return names
