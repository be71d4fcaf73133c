"""Scanning statistics as tidy tables: one row per figure, with its 95 % interval.

docs/conventions/evaluation.md defines the sets of vehicles, the bootstrap blocks and the decay. In
all tables ci_low and ci_high are the ends of the interval. They are NaN if the interval is unknown.
"""

import itertools
import math

import numpy as np
import pandas as pd

from pyinfra.core.arrays import AnyArray, BoolArray, FloatArray, IntArray
from pyinfra.core.vocabulary import KM_H
from pyinfra.metrics.intervals import Blocks, Estimate, ratio
from pyinfra.metrics.observations import Observations, moving, same_rows

EDGES_M = np.arange(30.0, 121.0, 5.0)
FAR_M = 90.0
QUALITIES = ("missed", "low", "medium", "high")
MIN_VEHICLES_FOR_DECAY = 20
MIN_BINS_FOR_DECAY = 3
POSITIVE, PERCENT = (0.0, math.inf), (0.0, 100.0)
SPEED_EDGES_KM_H = np.arange(0.0, 81.0, 2.0)


def hit_points(counts: dict[str, IntArray], blocks: Blocks) -> pd.DataFrame:
    """Returns the mean number of returns per frame for each LiDAR.

    counts: number of returns by LiDAR, (f,) each, in the order of the frames.
    """
    rows = []
    for lidar, per_frame in counts.items():
        values = np.stack([per_frame, np.ones_like(per_frame)], axis=1)
        mean = blocks.estimate(
            blocks.sums(blocks.frames, values),
            lambda s: ratio(s[..., 0], s[..., 1]),
            within=POSITIVE,
        )
        rows.append({"lidar": lidar, "frames": len(per_frame), **_cells("hit_points", mean)})
    return pd.DataFrame(rows)


def points_per_vehicle(
    vehicles: Observations, blocks: Blocks, edges: FloatArray = EDGES_M
) -> pd.DataFrame:
    """Returns the Average Points per Vehicle (APV) in bins of distance.

    APV is computed over all vehicles, and over vehicles with at least one point (columns `*_hit`).
    Columns: lidar, from_m, to_m, vehicles, apv, ci_low, ci_high, vehicles_hit, apv_hit,
    ci_low_hit, ci_high_hit. A bin without vehicles has NaN.
    """
    sums = vehicle_sums(vehicles, blocks, edges)
    mean = blocks.estimate(sums, lambda s: ratio(s[..., 0], s[..., 1]), within=POSITIVE)
    hit = blocks.estimate(sums, lambda s: ratio(s[..., 0], s[..., 2]), within=POSITIVE)
    total = sums.sum(axis=0)
    rows = []
    for i, lidar in enumerate(vehicles.lidars):
        for j, span in enumerate(_spans(edges)):
            rows.append(
                {
                    "lidar": lidar,
                    **span,
                    "vehicles": int(total[j, i, 1]),
                    **_cells("apv", mean, (j, i)),
                    "vehicles_hit": int(total[j, i, 2]),
                    **{f"{k}_hit": v for k, v in _cells("apv", hit, (j, i)).items()},
                }
            )
    return pd.DataFrame(rows)


def quality(vehicles: Observations, blocks: Blocks, edges: FloatArray = EDGES_M) -> pd.DataFrame:
    """Returns the share of vehicles by number of points and by distance.

    Column quality is a class of the number of points on a vehicle: missed (0), low (1 to 4), medium
    (5 to 20), high (more than 20), hit (1 or more).
    Columns: lidar, from_m, to_m, quality, vehicles (in the bin), share_percent, ci_low, ci_high.
    The last bin is the whole range of distances.
    """
    points = vehicles.points[:, :, None]
    classes = [
        points == 0,
        (points >= 1) & (points <= 4),
        (points >= 5) & (points <= 20),
        points > 20,
        points > 0,
        points >= 0,
    ]
    values = np.concatenate(classes, axis=2)
    sums = np.concatenate(
        [_binned(vehicles, blocks, e, values) for e in (edges, edges[[0, -1]])], axis=1
    )
    share = blocks.estimate(sums, lambda s: 100 * ratio(s[..., :5], s[..., 5:]), within=PERCENT)
    total = sums.sum(axis=0)
    return pd.DataFrame(
        [
            {
                "lidar": lidar,
                **span,
                "quality": name,
                "vehicles": int(total[j, i, 5]),
                **_cells("share_percent", share, (j, i, k)),
            }
            for i, lidar in enumerate(vehicles.lidars)
            for j, span in enumerate([*_spans(edges), *_spans(edges[[0, -1]])])
            for k, name in enumerate((*QUALITIES, "hit"))
        ]
    )


def only_one(vehicles: Observations, blocks: Blocks, from_m: float = FAR_M) -> pd.DataFrame:
    """Returns for each LiDAR how many vehicles beyond a distance only this LiDAR hit.

    Columns: lidar, from_m, vehicles, hit_alone (by this LiDAR only), share_percent (hit_alone of
    all vehicles), ci_low, ci_high, hit_by_another_only (by another LiDAR, not by this one).
    """
    far = vehicles.select(vehicles.distance >= from_m)
    alone, another = alone_and_another(far)
    sums = blocks.sums(far.frame, np.stack([alone, another, np.ones_like(alone)], axis=2))
    share = blocks.estimate(sums, lambda s: 100 * ratio(s[..., 0], s[..., 2]), within=PERCENT)
    total = sums.sum(axis=0)
    return pd.DataFrame(
        [
            {
                "lidar": lidar,
                "from_m": from_m,
                "vehicles": len(far),
                "hit_alone": int(total[i, 0]),
                **_cells("share_percent", share, (i,)),
                "hit_by_another_only": int(total[i, 1]),
            }
            for i, lidar in enumerate(far.lidars)
        ]
    )


def alone_and_another(vehicles: Observations) -> tuple[IntArray, IntArray]:
    """Returns whether only this LiDAR, and whether only other LiDARs, hit a vehicle: (n, L) each.

    Entries are 0 or 1. In the first array, 1 means that only this LiDAR hit the vehicle. In the
    second array, 1 means that another LiDAR hit the vehicle, but this LiDAR did not.
    """
    hit = vehicles.points > 0
    hits = hit.sum(axis=1, keepdims=True)
    return (hit & (hits == 1)).astype(np.int64), (~hit & (hits > 0)).astype(np.int64)


def decay(vehicles: Observations, blocks: Blocks, edges: FloatArray = EDGES_M) -> pd.DataFrame:
    """Returns the exponent k of APV = c d^-k for each LiDAR.

    Columns: lidar, from_m, to_m, bins, vehicles (in the bins of the fit), exponent, ci_low,
    ci_high, r_squared; NaN with fewer than MIN_BINS_FOR_DECAY bins.
    """
    sums = vehicle_sums(vehicles, blocks, edges)
    fit = blocks.estimate(sums, lambda parts: decay_lines(parts)[0])
    total = sums.sum(axis=0)
    r_squared = decay_lines(total)[1]
    rows = []
    for i, lidar in enumerate(vehicles.lidars):
        used = _fit_bins(total[:, i])
        at = np.flatnonzero(used)
        ends = {"from_m": edges[at[0]], "to_m": edges[at[-1] + 1]} if len(at) > 0 else {}
        rows.append(
            {
                "lidar": lidar,
                "from_m": np.nan,
                "to_m": np.nan,
                **ends,
                "bins": len(at),
                "vehicles": int(total[used, i, 1].sum()),
                **_cells("exponent", fit, (i,)),
                "r_squared": r_squared[i],
            }
        )
    return pd.DataFrame(rows)


def decay_lines(sums: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Returns the exponents k of APV = c d^-k and the R^2 of the fits, (..., L) each.

    A fit is a weighted least-squares line of log APV over log mean distance; R^2 is weighted too.
    All replicates are fitted together, which is 150 times as fast as single fits by a library.

    sums: (..., bins, L, 4), as `vehicle_sums` returns them.
    """
    used = _fit_bins(sums)
    weight = np.where(used, sums[..., 1], 0)
    x = np.log(np.where(used, ratio(sums[..., 3], sums[..., 1]), 1))
    y = np.log(np.where(used, ratio(sums[..., 0], sums[..., 1]), 1))
    total = weight.sum(axis=-2)[..., None, :]
    dx, dy = (v - ratio((weight * v).sum(axis=-2)[..., None, :], total) for v in (x, y))
    spread = (weight * dx * dx).sum(axis=-2)
    slope = ratio((weight * dx * y).sum(axis=-2), spread)
    r_squared = ratio(slope**2 * spread, (weight * dy * dy).sum(axis=-2))
    enough = used.sum(axis=-2) >= MIN_BINS_FOR_DECAY
    return np.where(enough, -slope, np.nan), np.where(enough, r_squared, np.nan)


def vehicle_sums(vehicles: Observations, blocks: Blocks, edges: FloatArray = EDGES_M) -> FloatArray:
    """Returns sums over vehicles by slot of time and bin of distance: (slots, bins, L, 4).

    The four sums are the numbers of points, vehicles and hit vehicles, and the sum of distances.
    """
    points = vehicles.points
    distance = np.broadcast_to(vehicles.distance[:, None], points.shape)
    values = np.stack([points, np.ones_like(points), points > 0, distance], axis=2)
    return _binned(vehicles, blocks, edges, values)


def speed_distribution(
    ids: IntArray, speed: FloatArray, edges_km_h: FloatArray = SPEED_EDGES_KM_H
) -> pd.DataFrame:
    """Returns a histogram of speeds; its last row counts all speeds above the last edge.

    ids, speed: (n,) samples of vehicles, m/s. Columns: from_km_h, to_km_h, samples,
    share_percent, vehicles (with a sample in the bin).
    """
    km_h = KM_H * speed
    ends = np.append(edges_km_h, np.inf)
    rows = []
    for low, high in itertools.pairwise(ends):
        inside = (km_h >= low) & (km_h < high)
        rows.append(
            {
                "from_km_h": low,
                "to_km_h": high,
                "samples": int(inside.sum()),
                "share_percent": 100 * inside.mean() if len(km_h) > 0 else np.nan,
                "vehicles": len(np.unique(ids[inside])),
            }
        )
    return pd.DataFrame(rows)


def box_points(vehicles: Observations, blocks: Blocks) -> pd.DataFrame:
    """Returns the mean number of points on moving vehicles, and the share outside the box.

    The box is the vehicle's box at mid-frame.

    Columns: lidar, vehicles, apv, apv_in_box, outside_box_percent, ci_low, ci_high.
    """
    rows = vehicles.select(moving(vehicles))
    values = np.stack([rows.points, rows.points_in_box, np.ones_like(rows.points)], axis=2)
    sums = blocks.sums(rows.frame, values)
    outside = blocks.estimate(
        sums, lambda s: 100 * ratio(s[..., 0] - s[..., 1], s[..., 0]), within=PERCENT
    )
    points, in_box, count = np.moveaxis(sums.sum(axis=0), -1, 0)
    return pd.DataFrame(
        [
            {
                "lidar": lidar,
                "vehicles": int(count[i]),
                "apv": points[i] / count[i] if count[i] > 0 else np.nan,
                "apv_in_box": in_box[i] / count[i] if count[i] > 0 else np.nan,
                **_cells("outside_box_percent", outside, (i,)),
            }
            for i, lidar in enumerate(rows.lidars)
        ]
    )


def aggregation_change(before: Observations, after: Observations, blocks: Blocks) -> pd.DataFrame:
    """Returns the change in the number of points on moving vehicles and in their boxes.

    The change is that from `before` to `after`. Replicates are paired, because both tables have the
    same LiDARs and frames. Columns: lidar, counted (points or points_in_box), vehicles, before and
    after (mean per vehicle), change_percent, ci_low, ci_high.
    """
    a, b = (t.select(m) for t, m in zip((before, after), same_rows(before, after), strict=True))
    a, b = a.select(moving(a)), b.select(moving(a))
    rows = []
    for name in ("points", "points_in_box"):
        sums = blocks.sums(a.frame, np.stack([getattr(a, name), getattr(b, name)], axis=2))
        change = blocks.estimate(sums, lambda s: 100 * (ratio(s[..., 1], s[..., 0]) - 1))
        total = sums.sum(axis=0) / max(len(a), 1)
        rows += [
            {
                "lidar": lidar,
                "counted": name,
                "vehicles": len(a),
                "before": total[i, 0],
                "after": total[i, 1],
                **_cells("change_percent", change, (i,)),
            }
            for i, lidar in enumerate(a.lidars)
        ]
    return pd.DataFrame(rows)


def _fit_bins(sums: FloatArray) -> BoolArray:
    """Returns which bins the decay's fit uses: (..., bins, L). sums: as in `decay_lines`."""
    return np.asarray((sums[..., 1] >= MIN_VEHICLES_FOR_DECAY) & (sums[..., 0] > 0))


def _binned(
    vehicles: Observations, blocks: Blocks, edges: FloatArray, values: AnyArray
) -> FloatArray:
    """Sums values (n, ...) by slot of time and bin of distance: (slots, bins, ...)."""
    number = np.searchsorted(edges, vehicles.distance, side="right") - 1
    masks = [number == i for i in range(len(edges) - 1)]
    return np.stack([blocks.sums(vehicles.frame[m], values[m]) for m in masks], axis=1)


def _spans(edges: FloatArray) -> list[dict[str, float]]:
    return [{"from_m": float(a), "to_m": float(b)} for a, b in itertools.pairwise(edges)]


def _cells(name: str, estimate: Estimate, at: tuple[int, ...] = ()) -> dict[str, float]:
    return {
        name: float(estimate.value[at]),
        "ci_low": float(estimate.low[at]),
        "ci_high": float(estimate.high[at]),
    }
