"""Tables of a match result: each prediction and object, and AP by ring and by range."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from pyinfra.core.arrays import BoolArray
from pyinfra.dataset.object_rows import BOX
from pyinfra.dataset.roads import Places
from pyinfra.dataset.windows import REGION_M, Near
from pyinfra.metrics import ap, intervals
from pyinfra.metrics.comparison import Bootstrapped
from pyinfra.metrics.evaluation_tables import ap_r1000_of, r1000_columns
from pyinfra.metrics.ground_truth import GroundTruth
from pyinfra.metrics.match_results import MatchResult

RING_M = 20.0
STEP_M = 10
RANGES_M = tuple(range(STEP_M, int(REGION_M) + 1, STEP_M))


@dataclass(frozen=True)
class Ring:
    """The area whose horizontal distance from the sensor is from `low_m` to below `high_m`."""

    x: float  # position of the sensor, in the frame of `Places.xy`
    y: float
    low_m: float
    high_m: float

    def holds(self, places: Places) -> BoolArray:
        """Returns which positions lie in the ring and in the region: (n,) bool."""
        distance = np.hypot(places.xy[:, 0] - self.x, places.xy[:, 1] - self.y)
        return np.asarray(places.inside & (distance >= self.low_m) & (distance < self.high_m))


def rings(result: MatchResult) -> Iterator[tuple[dict[str, float], Bootstrapped]]:
    """Yields a row for each ring up to the farthest counted object, and the replicates of its AP.

    A row has the middle of the ring in metres, AP (R1000) with its interval, and counts. AP is NaN
    for a ring without objects.
    """
    truth = result.match_input.truth
    pose = truth.lidar.T_world_levelled if truth.lidar is not None and truth.roads else None
    x, y = (pose.x, pose.y) if pose else (0.0, 0.0)
    places = result.match_input.vehicle_places
    distance = np.hypot(places.xy[:, 0] - x, places.xy[:, 1] - y)[result.counted]
    for i in range(int(distance.max(initial=0) // RING_M) + 1):
        ranking = result.ranking(Ring(x, y, i * RING_M, (i + 1) * RING_M))
        r1000 = ap_r1000_of(result, ranking)
        yield (
            {
                "distance_m": (i + 0.5) * RING_M,
                **r1000_columns(result, r1000, ranking),
                "objects": int(ranking.objects.sum()),
                "predictions": len(ranking.slot),
            },
            r1000,
        )


def match_table(result: MatchResult) -> pd.DataFrame:
    """Returns a row for each prediction, and a row for each missed object."""
    predictions, vehicles = result.match_input.predictions, result.match_input.vehicles
    numbers = np.array(result.match_input.truth.frames, dtype=np.int64)
    outcome = np.full(len(predictions), "ignored", dtype=object)
    outcome[result.true_positive], outcome[result.false_positive] = (
        "true positive",
        "false positive",
    )
    matched = (
        np.where(result.matches >= 0, vehicles.ids[result.matches], -1) if len(vehicles) else -1
    )
    rows = pd.DataFrame({"frame": numbers[predictions.frame], "outcome": outcome})
    rows["type"] = predictions.names.astype(object)
    rows[BOX] = predictions.boxes
    rows["score"], rows["object_id"] = predictions.scores, matched
    taken = np.zeros(len(vehicles), np.bool_)
    taken[result.matches[result.matches >= 0]] = True
    missed = np.flatnonzero(result.counted & ~taken)
    missed_rows = pd.DataFrame({"frame": numbers[vehicles.frame[missed]], "outcome": "missed"})
    missed_rows["type"] = vehicles.names[missed].astype(object)
    missed_rows[BOX] = vehicles.boxes[missed]
    missed_rows["score"], missed_rows["object_id"] = np.nan, vehicles.ids[missed]
    parts = [part for part in (rows, missed_rows) if len(part) > 0] or [rows]
    joined = pd.concat(parts, ignore_index=True)
    return joined.sort_values(["frame", "score"], ascending=[True, False], ignore_index=True)


def sensor_of(truth: GroundTruth) -> tuple[float, float] | None:
    """Returns x, y of the sensor in the world frame, in metres, for a site of lanes.

    At other sites ranges are measured along the roads, so the result is None. The result is also
    None if the pose of the sensor is unknown.
    """
    if not truth.of_lanes or truth.lidar is None:
        return None
    pose = truth.lidar.T_world_levelled
    return pose.x, pose.y


def by_range(match_result: MatchResult) -> Iterator[tuple[dict[str, Any], Bootstrapped]]:
    """Yields a row for each range, and the replicates of its AP.

    A row has AP (R1000), the recall in percent of all counted predictions, and counts.
    """
    centre = sensor_of(match_result.match_input.truth)
    for range_m in RANGES_M:
        ranking = match_result.ranking(Near(range_m, centre))
        r1000 = ap_r1000_of(match_result, ranking)
        yield (
            {
                "range_m": range_m,
                **r1000_columns(match_result, r1000, ranking),
                **recall(match_result, ranking),
                "objects": int(ranking.objects.sum()),
                "predictions": len(ranking.slot),
            },
            r1000,
        )


def recall(match_result: MatchResult, ranking: ap.Ranking) -> dict[str, float]:
    """Returns the recall of all counted predictions in percent, with its 95 % interval."""
    true_positives = np.bincount(ranking.true_positive_slot, minlength=len(ranking.objects)).astype(
        np.float64
    )
    objects = ranking.objects.astype(np.float64)
    value = 100 * true_positives.sum() / objects.sum() if objects.sum() else math.nan
    weights = match_result.weights
    replicates = 100 * intervals.ratio(weights @ true_positives, weights @ objects)
    low, high = match_result.interval(value, replicates, ranking.objects)
    return {"recall": float(value), "recall_low": float(low), "recall_high": float(high)}
