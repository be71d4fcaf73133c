"""Match results: which predictions are true positives, false positives or ignored.

All vehicles take part in the matching, with the boxes of their labels. Whether a vehicle is in the
region depends on its box at mid-frame. For pedestrians and cyclists the region includes a strip
beside the carriageway.

- A vehicle that is not in the ground-truth subset, or is outside the region, is ignored.
  A prediction that is matched with an ignored vehicle is also ignored.
- An unmatched prediction is a false positive if its centre is inside the region. For ground truth
  `common` its centre must also be in the common field of view. Otherwise the prediction is ignored.

Two kinds of unmatched predictions are false positives even outside the region: a vehicle box on a
labelled pedestrian or cyclist, and a second box on a pedestrian or cyclist that is evaluated.
"""

import typing
from dataclasses import dataclass

import numpy as np

from pyinfra.core.arrays import BoolArray, FloatArray, IntArray, NameArray
from pyinfra.core.vocabulary import Subset
from pyinfra.dataset.roads import Places
from pyinfra.metrics import ap, intervals
from pyinfra.metrics.intervals import Blocks
from pyinfra.metrics.match_input import MatchInput
from pyinfra.metrics.matching import LEAST_OVERLAP, TIE, reaches, threshold_of
from pyinfra.metrics.settings import Protocol, Settings

CAUSES = ("background", "duplicate", "localisation")


class Part(typing.Protocol):
    """A part of the region: a window of a road, a grid cell, a ring around the sensor."""

    def holds(self, places: Places) -> BoolArray:
        """Returns which positions lie in the part: (n,) bool."""
        ...


@dataclass(frozen=True, eq=False)
class MatchResult:
    """The match result of all predictions and vehicles, for one ground truth and threshold.

    A prediction that is neither a true nor a false positive is ignored.
    """

    match_input: MatchInput
    matches: IntArray  # (p,) index of the matched vehicle, -1 for none
    counted: BoolArray  # (v,) whether a vehicle is in the subset and region
    true_positive: BoolArray  # (p,) whether a prediction is a true positive
    false_positive: BoolArray  # (p,) whether a prediction is a false positive
    blocks: Blocks

    @property
    def objects(self) -> int:
        return int(np.count_nonzero(self.counted))

    def ranking(self, window: Part | None = None) -> ap.Ranking:
        """Returns the counted predictions and objects of the region, or of a part of it.

        A true positive belongs to the part that contains its vehicle. A false positive belongs to
        the part that contains the centre of its box.
        """
        match_input, counted = self.match_input, self.counted
        true_positive, false_positive = self.true_positive, self.false_positive
        if window is not None:
            in_window = window.holds(match_input.vehicle_places)
            counted = counted & in_window
            true_positive = true_positive & np.append(in_window, False)[self.matches]
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
        """Counts how many of the frame indices (n,) lie in each slot: (slots,)."""
        blocks = self.blocks
        return np.bincount(blocks.slot[frame], minlength=blocks.replicates.shape[1]).astype(
            np.int64
        )

    def known(self, replicates: FloatArray, objects: IntArray) -> FloatArray:
        """Returns the replicates (d, ...) of a figure, all NaN if too few blocks have objects.

        objects: (slots,) number of objects that the figure is computed from.
        """
        firsts = np.arange(0, len(objects), self.blocks.length)
        if np.count_nonzero(np.add.reduceat(objects, firsts)) < intervals.MIN_BLOCKS:
            return np.full(replicates.shape, np.nan)
        return replicates

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
        computed from. The ends are NaN if too few blocks have objects.
        """
        low, high = intervals.interval(
            np.asarray(value), self.known(replicates, objects), self.blocks.count
        )
        return np.maximum(low, 0), np.minimum(high, most)


def count_matches(
    match_input: MatchInput, which: Subset, matches: IntArray, min_points: int
) -> MatchResult:
    """Returns the match result for a ground truth. matches: the result of MatchInput.match()."""
    counted = match_input.truth.counted(
        which, match_input.vehicles, match_input.vehicle_places, min_points
    )
    true_positive = np.append(counted, False)[matches]  # index -1, no match, gives False
    # Boxes that are false positives if they are unmatched.
    false_if_unmatched = match_input.prediction_places.inside | match_input.on_people
    if match_input.of_people:
        pairs = match_input.pairs
        of_detected = np.isin(pairs.vehicle, matches[true_positive])
        false_if_unmatched[pairs.prediction[of_detected]] = True
    false_positive = (matches < 0) & false_if_unmatched
    if which == "common":
        false_positive &= match_input.truth.in_common_view(match_input.predictions.boxes)
    blocks = match_input.present_blocks if which == "present" else match_input.blocks
    return MatchResult(match_input, matches, counted, true_positive, false_positive, blocks)


def primary_results(one: MatchInput, settings: Settings) -> dict[Subset, MatchResult]:
    """Returns the match result of each ground-truth subset, for the first threshold."""
    matches = one.match(threshold_of(one.metric, settings.ious[0]), strict=False)
    return {
        which: count_matches(one, which, matches, settings.min_points)
        for which in settings.ground_truths
    }


def precision(ranking: ap.Ranking, protocol: Protocol, weights: IntArray | None) -> FloatArray:
    """Returns AP of each replicate by the rules of a protocol, (replicates,).

    If `weights` is None, the result has one element, the AP of all frames.
    """
    if protocol == "kitti":
        return ap.kitti_average_precision(ranking, weights)
    return ap.average_precision(ranking, 11 if protocol == "r11" else 40, weights)


def causes(match_result: MatchResult, iou: float, *, strict: bool) -> NameArray:
    """Returns the cause of each false positive: (false positives,).

    - `duplicate`: the prediction reaches the threshold with a vehicle, but another prediction is
      matched with that vehicle
    - `localisation`: the highest overlap is LEAST_OVERLAP or more, but does not reach the threshold
    - `background`: the overlap with each vehicle is below LEAST_OVERLAP
    """
    best = match_result.match_input.best_overlap[match_result.false_positive]
    names = np.full(len(best), "background", dtype="<U12")
    names[best >= LEAST_OVERLAP - TIE] = "localisation"
    names[reaches(best, iou, strict=strict)] = "duplicate"
    return names
