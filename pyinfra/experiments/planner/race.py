"""Racing: a few frames for every pose and LiDAR, and many for those that may be the best.

After each stage a pair of pose and LiDAR is left out if it is worse than the best pair of its
LiDAR, by a one-sided interval of the paired difference per frame. Where an option may have several
LiDARs, it stays too if, with its best partner, it may be as good as the best two. The best pair at
each position that the user gave always stays.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from scipy import special

from pyinfra.core.arrays import BoolArray, Float32Array, FloatArray, IntArray
from pyinfra.experiments.planner.areas import weighted
from pyinfra.experiments.planner.candidates import given_places
from pyinfra.experiments.planner.detectability import (
    CUT,
    Detectability,
    detection_probability,
    highest_recall_cut,
    object_terms,
)
from pyinfra.experiments.planner.lidars import PlanLidar
from pyinfra.experiments.planner.observe import observe
from pyinfra.experiments.planner.request import Request
from pyinfra.experiments.planner.site import PlanSite

FIRST_FRAMES = 6
LEAST_PER_LIDAR = 3  # pairs of each LiDAR that always stay


@dataclass(frozen=True, eq=False)
class Objects:
    """The objects of some frames, in the order of `PlanSite.present`, and their weights."""

    table: pd.DataFrame
    weight: FloatArray  # (n,) 0 for an object that does not count
    near: BoolArray  # (n,) whether it lies within the distance of the request
    frame: IntArray  # (n,) index of the frame
    frames: int  # number of frames, with those that have no object

    @property
    def near_vehicles(self) -> BoolArray:
        """Which objects are vehicles within the distance of the request: (n,)."""
        return np.asarray(self.near & ~self.table.person.to_numpy(bool))


@dataclass(frozen=True, eq=False)
class Race:
    """The result of a race: the pairs of pose and LiDAR, and what those that stayed see."""

    pairs: pd.DataFrame  # pose, lidar, frames, recall, low, high, left_out
    seen: pd.DataFrame  # observations of the pairs that stayed, with `pair` and `object`
    objects: Objects

    @property
    def stayed(self) -> pd.DataFrame:
        """The pairs that were not left out, numbered as `pair` in `seen`."""
        return self.pairs[self.pairs.left_out == ""].reset_index(drop=True)


def weighted_objects(site: PlanSite, request: Request, frames: Sequence[int]) -> Objects:
    """Returns the objects of some frames. Those farther than asked for have weight 0."""
    table = site.present[site.present.frame.isin(frames)].reset_index(drop=True)
    away = np.hypot(table.x - site.centre[0], table.y - site.centre[1])
    near = np.asarray(away <= request.within_m)
    weight = np.where(table.person, request.people, 1.0) * near
    weight = weighted(table, np.asarray(weight, float), request.areas)
    order = pd.Series(range(len(frames)), index=list(frames))
    return Objects(table, weight, near, order[table.frame].to_numpy(), len(frames))


def detection_probabilities(
    seen: pd.DataFrame,
    pairs: int,
    objects: Objects,
    law: Detectability,
    request: Request,
) -> Float32Array:
    """Returns the probability (pairs, objects) that each pair finds each object.

    Boxes count from a score of CUT or, if the request limits false boxes, from the lowest score of
    the pair that keeps them that rare.
    """
    out = np.zeros((pairs, len(objects.table)), np.float32)
    cuts = np.full(pairs, CUT)
    pair, at = seen.pair.to_numpy(), seen.object.to_numpy()
    person = objects.table.person.to_numpy()[at]
    if np.isfinite(request.false_per_minute):
        per_frame = np.bincount(pair[~person], minlength=pairs) / max(objects.frames, 1)
        most = request.false_per_minute / request.frames_per_minute
        false = law.vehicles.false[0]
        cuts = np.array([highest_recall_cut(false, float(n), most)[0] for n in per_frame])
    terms = object_terms(seen)
    for is_person in (False, True):
        one = law.law(person=is_person)
        rows = np.flatnonzero(person == is_person)
        if one is None or not len(rows):
            continue
        for cut in np.unique(cuts):
            some = rows[cuts[pair[rows]] == cut]
            p = detection_probability(one.detection[0], terms[some], float(cut))
            out[pair[some], at[some]] = p
    return out


def race(
    site: PlanSite,
    poses: pd.DataFrame,
    lidars: Sequence[PlanLidar],
    possible: BoolArray,
    request: Request,
    law: Detectability,
    *,
    jobs: int = 1,
    folder: Path | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> Race:
    """Observes the possible pairs (poses, lidars) of pose and LiDAR, in stages."""
    at = np.argwhere(possible)
    pairs = pd.DataFrame({"pose": at[:, 0], "lidar": at[:, 1], "frames": 0, "left_out": ""})
    alive = np.ones(len(pairs), bool)
    seen = pd.DataFrame()
    done = 0
    for end in stages(min(request.frames, len(site.frames))):
        numbers = site.frames[done:end]
        wanted = np.zeros_like(possible)
        wanted[tuple(at[alive].T)] = True
        rows = observe(site, poses, lidars, wanted, numbers, jobs=jobs, folder=folder)
        objects = weighted_objects(site, request, site.frames[:end])
        seen = pd.concat([seen, joined(rows, pairs, objects)], ignore_index=True)
        seen = seen[alive[seen.pair]]
        pairs.loc[alive, "frames"] = end
        done = end
        probability = detection_probabilities(seen, len(pairs), objects, law, request)
        per_frame = frame_sums(probability, objects)
        total = float(objects.weight.sum())
        pairs.loc[alive, "recall"] = per_frame[alive].sum(1) / max(total, 1e-12)
        progress(f"{alive.sum()} pairs of pose and LiDAR, {end} frames")
        if end >= min(request.frames, len(site.frames)):
            break
        stay = contenders(probability, per_frame, pairs, alive, objects, request)
        always = best_given(given_places(poses)[at[:, 0]], pairs, alive)
        stay |= always
        pairs.loc[alive & ~stay, "left_out"] = f"worse after {end} frames"
        limited = limit(stay, pairs, request, end) | always
        pairs.loc[stay & ~limited, "left_out"] = f"over the limit of pairs after {end} frames"
        alive = limited
    stayed = np.flatnonzero(alive)
    number = np.full(len(pairs), -1)
    number[stayed] = np.arange(len(stayed))
    seen = seen[alive[seen.pair]].assign(pair=lambda t: number[t.pair]).reset_index(drop=True)
    return Race(pairs, seen, objects)


def stages(most: int) -> list[int]:
    """Returns the numbers of frames after each stage, each twice the one before."""
    ends = [min(FIRST_FRAMES, most)]
    while ends[-1] < most:
        ends.append(min(2 * ends[-1], most))
    return ends


def joined(rows: pd.DataFrame, pairs: pd.DataFrame, objects: Objects) -> pd.DataFrame:
    """Returns observations with their pair, object, type and speed."""
    index = pd.Series(pairs.index, index=pd.MultiIndex.from_frame(pairs[["pose", "lidar"]]))
    pair = index.reindex(pd.MultiIndex.from_frame(rows[["pose", "lidar"]])).to_numpy()
    table = objects.table[["frame", "id", "type", "speed"]].assign(object=objects.table.index)
    out = rows.assign(pair=pair).merge(table, on=["frame", "id"], how="inner")
    return out.drop(columns=["pose", "lidar"])


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
    """Returns which pairs may be the best alone for their LiDAR, or with a partner."""
    stay = np.zeros(len(pairs), bool)
    for lidar in np.unique(pairs.lidar[alive]):
        rows = np.flatnonzero(alive & (pairs.lidar == lidar).to_numpy())
        order = rows[np.argsort(-per_frame[rows].sum(1), kind="stable")]
        stay[order[:LEAST_PER_LIDAR]] = True
        stay[rows[~is_worse(per_frame[rows], per_frame[order[0]], request.keep)]] = True
    if request.units > 1:
        rows = np.flatnonzero(alive)
        with_partner = partner_sums(probability[rows], objects)
        best = with_partner[with_partner.sum(1).argmax()]
        stay[rows[~is_worse(with_partner, best, request.keep)]] = True
    return stay


def partner_sums(probability: Float32Array, objects: Objects) -> FloatArray:
    """Returns the weighted number of objects that each row finds with its best partner."""
    missed = 1 - probability
    both = (missed * objects.weight.astype(np.float32)) @ missed.T
    partner = both.argmin(1)
    return frame_sums(1 - missed * missed[partner], objects)


def is_worse(sums: FloatArray, best: FloatArray, confidence: float) -> BoolArray:
    """Returns which rows (n, frames) are below `best` (frames,) by a one-sided paired interval."""
    gap = best - sums
    frames = gap.shape[1]
    if frames < 2:
        return np.zeros(len(sums), bool)
    error = gap.std(1, ddof=1) / np.sqrt(frames)
    return np.asarray(gap.mean(1) > special.stdtrit(frames - 1, confidence) * error + 1e-12)


def best_given(given: IntArray, pairs: pd.DataFrame, alive: BoolArray) -> BoolArray:
    """Returns which pairs are the best of those left at a position of the user.

    given: number of the position of each pair, -1 for poses that were made
    """
    best = np.zeros(len(pairs), bool)
    some = pairs[alive & (given >= 0)]
    best[some.groupby(given[some.index]).recall.idxmax().to_numpy(int)] = True
    return best


def limit(stay: BoolArray, pairs: pd.DataFrame, request: Request, frames: int) -> BoolArray:
    """Returns `stay` with at most `request.most` pairs, fewer the more frames each has."""
    most = max(int(request.most * FIRST_FRAMES / frames), LEAST_PER_LIDAR)
    if stay.sum() <= most:
        return stay
    # Each LiDAR keeps its share, so that no LiDAR is left out before its best pose is known.
    kept = np.zeros_like(stay)
    rank = pairs.recall.where(stay).groupby(pairs.lidar).rank(ascending=False, method="first")
    order = np.lexsort((-pairs.recall.fillna(-1).to_numpy(), rank.fillna(1e9).to_numpy()))
    kept[order[:most]] = True
    return kept & stay
