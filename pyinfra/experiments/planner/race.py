"""Racing: a few frames for every pose and LiDAR, and many for those that may be the best.

After each stage a pair of pose and LiDAR is left out if it is worse than the best pair of its
LiDAR, by a one-sided interval of the paired difference per frame. If an option may have several
LiDARs, a pair also stays if the pair and its best partner may be as good as the best two pairs. The
best pair at each position that the user gave always stays.
"""

import numpy as np
import pandas as pd
from scipy import special

from pyinfra.core.arrays import BoolArray, Float32Array, FloatArray, IntArray
from pyinfra.experiments.planner.candidates import given_places
from pyinfra.experiments.planner.observe import (
    Objects,
    Observed,
    Setting,
    joined,
    observe,
    weighted_objects,
)
from pyinfra.experiments.planner.predict import detection_probabilities
from pyinfra.experiments.planner.request import Request

FIRST_FRAMES = 6
LEAST_PER_LIDAR = 3  # number of best pairs of each LiDAR that are never left out as worse


def race(setting: Setting, possible: BoolArray) -> Observed:
    """Observes the possible pairs (poses, lidars) of pose and LiDAR, in stages."""
    site, request, effort = setting.site, setting.request, setting.effort
    at = np.argwhere(possible)
    pairs = pd.DataFrame({"pose": at[:, 0], "lidar": at[:, 1], "frames": 0, "left_out": ""})
    pairs["spinning"] = np.array([lidar.spinning for lidar in setting.lidars])[at[:, 1]]
    given = given_places(setting.poses)[at[:, 0]]
    alive = np.ones(len(pairs), bool)
    seen = pd.DataFrame()
    ends = stages(min(request.frames, len(site.frames)))
    for start, end in zip([0, *ends], ends, strict=False):
        wanted = np.zeros_like(possible)
        wanted[tuple(at[alive].T)] = True
        rows = observe(
            site, setting.poses, setting.lidars, wanted, site.frames[start:end],
            jobs=effort.jobs, folder=effort.observations,
        )  # fmt: skip
        objects = weighted_objects(site, request, setting.law, site.frames[:end])
        seen = pd.concat([seen, joined(rows, pairs, objects)], ignore_index=True)
        seen = seen[alive[seen.pair]]
        pairs.loc[alive, "frames"] = end
        probability = detection_probabilities(seen, pairs, objects, setting.law, request)
        per_frame = frame_sums(probability, objects)
        pairs.loc[alive, "recall"] = per_frame[alive].sum(1) / objects.total
        effort.tell(f"{alive.sum()} pairs of pose and LiDAR, {end} frames")
        if end == ends[-1]:
            break
        always = best_given(given, pairs, alive)
        stay = contenders(probability, per_frame, pairs, alive, objects, request) | always
        pairs.loc[alive & ~stay, "left_out"] = f"worse after {end} frames"
        limited = limit(stay, pairs, request.most, end) | always
        pairs.loc[stay & ~limited, "left_out"] = f"over the limit of pairs after {end} frames"
        alive = limited
    number = np.cumsum(alive) - 1  # new number of each remaining pair
    seen = seen[alive[seen.pair]].assign(pair=lambda t: number[t.pair]).reset_index(drop=True)
    return Observed(pairs, seen, objects)


def stages(most: int) -> list[int]:
    """Returns the total number of frames after each stage. It doubles from stage to stage."""
    ends = [min(FIRST_FRAMES, most)]
    while ends[-1] < most:
        ends.append(min(2 * ends[-1], most))
    return ends


def frame_sums(probability: Float32Array, objects: Objects) -> FloatArray:
    """Returns the weighted number of found objects in each frame: (pairs, frames)."""
    weights = np.zeros((len(objects.weight), objects.frames), np.float32)
    weights[np.arange(len(objects.weight)), objects.frame] = objects.weight
    return np.asarray(probability @ weights, float)


def contenders(
    probability: Float32Array,
    per_frame: FloatArray,
    pairs: pd.DataFrame,
    alive: BoolArray,
    objects: Objects,
    request: Request,
) -> BoolArray:
    """Returns which pairs may be the best pair of their LiDAR, or the best with a partner."""
    stay = np.zeros(len(pairs), bool)
    for lidar in np.unique(pairs.lidar[alive]):
        rows = np.flatnonzero(alive & (pairs.lidar == lidar).to_numpy())
        order = rows[np.argsort(-per_frame[rows].sum(1), kind="stable")]
        stay[order[:LEAST_PER_LIDAR]] = True
        stay[rows[~is_worse(per_frame[rows], per_frame[order[0]], request.keep)]] = True
    if request.units > 1:
        rows = np.flatnonzero(alive)
        sums = partner_sums(probability[rows], objects)
        stay[rows[~is_worse(sums, sums[sums.sum(1).argmax()], request.keep)]] = True
    return stay


def partner_sums(probability: Float32Array, objects: Objects) -> FloatArray:
    """Returns the weighted number of objects that each pair and its best partner find per frame.

    Shape (pairs, frames).
    """
    missed = 1 - probability
    both = (missed * objects.weight.astype(np.float32)) @ missed.T
    return frame_sums(1 - missed * missed[both.argmin(1)], objects)


def is_worse(sums: FloatArray, best: FloatArray, confidence: float) -> BoolArray:
    """Returns which rows (n, frames) are significantly below `best` (frames,), one-sided."""
    gap, frames = best - sums, len(best)
    if frames < 2:
        return np.zeros(len(sums), bool)
    error = gap.std(1, ddof=1) / np.sqrt(frames)
    return np.asarray(gap.mean(1) > special.stdtrit(frames - 1, confidence) * error + 1e-12)


def best_given(given: IntArray, pairs: pd.DataFrame, alive: BoolArray) -> BoolArray:
    """Returns which pairs are the best remaining pairs at the positions that the user gave.

    given: number of the position of each pair, -1 for poses that were made
    """
    best = np.zeros(len(pairs), bool)
    some = pairs[alive & (given >= 0)]
    best[some.groupby(given[some.index]).recall.idxmax().to_numpy(int)] = True
    return best


def limit(stay: BoolArray, pairs: pd.DataFrame, first: int, frames: int) -> BoolArray:
    """Returns `stay` with a limited number of pairs, which decreases with the number of frames.

    first: limit after FIRST_FRAMES frames.
    """
    most = max(int(first * FIRST_FRAMES / frames), LEAST_PER_LIDAR)
    if stay.sum() <= most:
        return stay
    # Each LiDAR keeps equally many pairs, so that none is left out before its best pose is known.
    rank = pairs.recall.where(stay).groupby(pairs.lidar).rank(ascending=False, method="first")
    order = np.lexsort((-pairs.recall.fillna(-1).to_numpy(), rank.fillna(1e9).to_numpy()))
    return stay & np.isin(np.arange(len(stay)), order[:most])
