"""AP and recall of vehicles within 10, 20 ... 100 m of the sensor."""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from pyinfra.dataset.windows import REGION_M, Near
from pyinfra.metrics import ap, intervals
from pyinfra.metrics.comparison import Bootstrapped
from pyinfra.metrics.evaluation_tables import ap_r1000_of, r1000_columns
from pyinfra.metrics.ground_truth import GroundTruth
from pyinfra.metrics.match_results import MatchResult

STEP_M = 10
RANGES_M = tuple(range(STEP_M, int(REGION_M) + 1, STEP_M))


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
