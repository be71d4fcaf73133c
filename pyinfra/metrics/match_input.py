"""The vehicles and predictions of one class, ready for matching, and their blocks of time."""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pyinfra.core.arrays import BoolArray, FloatArray, IntArray
from pyinfra.core.vocabulary import PERSON_TYPES
from pyinfra.dataset.data_set import MIN_VISIBILITY
from pyinfra.dataset.frame_tables import Predictions, Vehicles
from pyinfra.dataset.frames import usual_step
from pyinfra.dataset.regions import FOOTWAYS_M
from pyinfra.dataset.roads import Places
from pyinfra.dataset.windows import Window
from pyinfra.metrics import intervals
from pyinfra.metrics.ground_truth import GroundTruth
from pyinfra.metrics.intervals import Blocks
from pyinfra.metrics.matching import (
    LEAST_OVERLAP,
    TIE,
    Metric,
    Pairs,
    best_overlap,
    holding_centres,
    in_order,
    match,
    overlapping_pairs,
)
from pyinfra.metrics.settings import Settings


def are_people(types: Iterable[str]) -> bool:
    """Returns whether all types are pedestrians or cyclists, which have special rules."""
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
    people: Vehicles  # labelled pedestrians and cyclists; vehicle boxes on them are false positives

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
        """Overlapping pairs of a prediction and a vehicle, in the order of matching."""
        v, p = self.vehicles, self.predictions
        pairs = overlapping_pairs(p.frame, p.boxes, v.frame, v.boxes, self.metric)
        return in_order(pairs, p.scores, p.boxes, v.boxes)

    @cached_property
    def best_overlap(self) -> FloatArray:
        return best_overlap(self.pairs, len(self.predictions))

    @cached_property
    def on_people(self) -> BoolArray:
        """Which predictions contain the centre of a person and overlap no vehicle: (p,) bool."""
        p, who = self.predictions, self.people
        on = holding_centres(p.frame, p.boxes, who.frame, who.boxes)
        return on & (self.best_overlap < LEAST_OVERLAP - TIE)

    def match(self, iou: float, *, strict: bool, within: Window | None = None) -> IntArray:
        """Returns the vehicle that each prediction is matched with: (p,), -1 for none.

        iou: threshold of the overlap. strict: as in `matching.match`. within: if given, only boxes
        in this window are matched.
        """
        pairs = self.pairs
        if within is not None:
            v, p = within.holds(self.vehicle_places), within.holds(self.prediction_places)
            pairs = pairs.select(v[pairs.vehicle] & p[pairs.prediction])
        return match(pairs, len(self.predictions), len(self.vehicles), iou, strict=strict)


def match_input(
    truth: GroundTruth, predictions: Predictions, name: str, settings: Settings, metric: Metric
) -> MatchInput:
    """Returns the vehicles and predictions of the class `name`.

    Predictions with a score below `min_score` are left out. The name of a prediction can be the
    class, or one of the types of the class.
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

    By default the length is computed from the stay of visible vehicles. present: compute it from
    the stay of all vehicles in the region, which is the same for all mounts.
    """
    frames = np.array(truth.frames, dtype=np.int64)
    people = are_people([t for group in settings.classes.values() for t in group])
    block_s = settings.block_s or block_seconds(truth, people=people, present=present)
    return intervals.time_blocks(
        frames, truth.period_s, block_s=block_s, replicates=settings.replicates, seed=settings.seed
    )


def block_seconds(truth: GroundTruth, *, people: bool = False, present: bool = False) -> float:
    """Returns the block length: the stay of visible vehicles, or UNKNOWN_BLOCK_S without ids.

    people: whether to use the stay of pedestrians and cyclists only. Otherwise pedestrians and
    cyclists beside the carriageway are left out, because they stay longer. present: whether to use
    all vehicles of the region, visible or not.
    """
    if not truth.has_objects:
        return intervals.UNKNOWN_BLOCK_S
    if present:
        beside_m = FOOTWAYS_M if people else 0.0
        vehicles = truth.vehicles.select(truth.places(truth.vehicles.mid_frame, beside_m).inside)
    else:
        vehicles = truth.vehicles.select(truth.vehicles.visibility >= MIN_VISIBILITY)
    on_foot = np.isin(vehicles.names, PERSON_TYPES)
    if people:
        vehicles = vehicles.select(on_foot)
    elif on_foot.any():
        vehicles = vehicles.select(~on_foot | truth.places(vehicles.mid_frame).inside)
    apart_s = usual_step(truth.frames) * truth.period_s
    return intervals.block_seconds(vehicles.frame, vehicles.ids, apart_s)
