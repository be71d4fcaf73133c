"""Scanning statistics as tidy tables: one row a figure, with its vehicles and 95 % interval.

The rules (sets of vehicles, blocks of the bootstrap, decay) stand in docs/conventions.md.
In every table ci_low and ci_high are the ends of the interval, NaN where there is none.
"""

import itertools
import math

import numpy as np
import pandas as pd

from pyinfra.core.arrays import AnyArray, BoolArray, FloatArray, IntArray
from pyinfra.core.errors import Error
from pyinfra.metrics.intervals import Blocks, Estimate, ratio
from pyinfra.metrics.observations import Sightings, moving, same_rows

EDGES_M = np.arange(30.0, 121.0, 5.0)
FAR_M = 90.0
QUALITIES = ("missed", "low", "medium", "high")
MIN_VEHICLES_FOR_DECAY = 20
MIN_BINS_FOR_DECAY = 3
POSITIVE, PERCENT = (0.0, math.inf), (0.0, 100.0)
SPEED_EDGES_KM_H = np.arange(0.0, 81.0, 2.0)


def hit_points(counts: dict[str, IntArray], blocks: Blocks) -> pd.DataFrame:
    """Mean returns per frame of each LiDAR; counts: by LiDAR, (f,) in the order of the frames."""
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
    vehicles: Sightings, blocks: Blocks, edges: FloatArray = EDGES_M
) -> pd.DataFrame:
    """Average Points per Vehicle in bins of distance, over all of the vehicles and the hit ones.

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
            second = {f"{k}_hit": v for k, v in _cells("apv", hit, (j, i)).items()}
            rows.append(
                {
                    "lidar": lidar,
                    **span,
                    "vehicles": int(total[j, i, 1]),
                    **_cells("apv", mean, (j, i)),
                    "vehicles_hit": int(total[j, i, 2]),
                    **second,
                }
            )
    return pd.DataFrame(rows)


def quality(vehicles: Sightings, blocks: Blocks, edges: FloatArray = EDGES_M) -> pd.DataFrame:
    """Shares of vehicles that are missed, low, medium and high, and hit at all, by distance.

    Columns: lidar, from_m, to_m, quality, vehicles (of the bin), share_percent, ci_low, ci_high;
    the last bin is the whole reach.
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


def only_one(vehicles: Sightings, blocks: Blocks, from_m: float = FAR_M) -> pd.DataFrame:
    """Vehicles from a distance on that one LiDAR alone hit, and those that all others alone hit.

    Columns: lidar, from_m, vehicles, hit_alone, share_percent (of the vehicles), ci_low, ci_high,
    hit_by_another_only (by some other LiDAR, not by this one).
    """
    far = vehicles.select(vehicles.distance >= from_m)
    alone, another = alone_and_another(far)
    ones = np.ones_like(alone)
    sums = blocks.sums(far.frame, np.stack([alone, another, ones], axis=2))
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


def alone_and_another(vehicles: Sightings) -> tuple[IntArray, IntArray]:
    """1 where a LiDAR alone hit a vehicle, and where some other did and it did not: (n, L)."""
    hit = vehicles.points > 0
    hits = hit.sum(axis=1, keepdims=True)
    return (hit & (hits == 1)).astype(np.int64), (~hit & (hits > 0)).astype(np.int64)


def decay(vehicles: Sightings, blocks: Blocks, edges: FloatArray = EDGES_M) -> pd.DataFrame:
    """Exponent k of APV = c d^-k for each LiDAR.

    Columns: lidar, from_m, to_m, bins, vehicles (in the bins of the fit), exponent, ci_low,
    ci_high, r_squared; NaN with fewer than MIN_BINS_FOR_DECAY bins.
    """
    sums = vehicle_sums(vehicles, blocks, edges)
    fit = blocks.estimate(sums, decay_exponent)
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


def decay_exponent(sums: FloatArray) -> FloatArray:
    """The first of decay_lines."""
    return decay_lines(sums)[0]


def decay_lines(sums: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Exponents of weighted straight lines, log of APV on log of mean distance, and their R^2.

    R^2 is the share of the logs' weighted variance that lies on the line. All draws at once: a fit
    of each by a library takes 150 times as long.

    sums: (..., bins, L, 4) points, vehicles, hit vehicles, distances; returns (..., L) of each.
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


def vehicle_sums(vehicles: Sightings, blocks: Blocks, edges: FloatArray = EDGES_M) -> FloatArray:
    """(b, bins, L, 4) points, vehicles, hit vehicles, sum of distances, by block and distance."""
    points = vehicles.points
    distance = np.broadcast_to(vehicles.distance[:, None], points.shape)
    values = np.stack([points, np.ones_like(points), points > 0, distance], axis=2)
    return _binned(vehicles, blocks, edges, values)


def speed_distribution(
    ids: IntArray, speed: FloatArray, edges_km_h: FloatArray = SPEED_EDGES_KM_H
) -> pd.DataFrame:
    """Histogram of speeds; the last row, to infinity, is what lies beyond the axis.

    ids, speed: (n,) a vehicle at a time, m/s. Columns: from_km_h, to_km_h, samples,
    share_percent, vehicles (with a sample in the bin).
    """
    km_h = 3.6 * speed
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


def box_points(vehicles: Sightings, blocks: Blocks) -> pd.DataFrame:
    """Points on moving vehicles and those of them outside the box at the middle of the frame.

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


def aggregation_change(before: Sightings, after: Sightings, blocks: Blocks) -> pd.DataFrame:
    """Change of the points on, and inside the boxes of, the moving vehicles in both tables.

    Draws are paired: both tables hold the same frames. Columns: lidar, counted (points or
    points_in_box), vehicles, before, after (per vehicle), change_percent, ci_low, ci_high.
    Raises Error if the LiDARs differ.
    """
    if before.lidars != after.lidars:
        raise Error(f"found LiDARs {before.lidars} and {after.lidars}, allowed the same")
    a, b = (t.select(m) for t, m in zip((before, after), same_rows(before, after), strict=True))
    a, b = a.select(moving(a)), b.select(moving(a))
    rows = []
    for name in ("points", "points_in_box"):
        pair = np.stack([getattr(a, name), getattr(b, name)], axis=2)
        sums = blocks.sums(a.frame, pair)
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
    """Bins that the fit of the decay uses: (..., bins, L) of sums (..., bins, L, 4)."""
    return np.asarray((sums[..., 1] >= MIN_VEHICLES_FOR_DECAY) & (sums[..., 0] > 0))


def _binned(vehicles: Sightings, blocks: Blocks, edges: FloatArray, values: AnyArray) -> FloatArray:
    """Sums of values (n, ...) by block and bin of distance: (b, bins, ...)."""
    number = np.searchsorted(edges, vehicles.distance, side="right") - 1
    bins = []
    for i in range(len(edges) - 1):
        inside = number == i
        bins.append(blocks.sums(vehicles.frame[inside], values[inside]))
    return np.stack(bins, axis=1)


def _spans(edges: FloatArray) -> list[dict[str, float]]:
    return [{"from_m": float(a), "to_m": float(b)} for a, b in itertools.pairwise(edges)]


def _cells(name: str, estimate: Estimate, at: tuple[int, ...] = ()) -> dict[str, float]:
    return {
        name: float(estimate.value[at]),
        "ci_low": float(estimate.low[at]),
        "ci_high": float(estimate.high[at]),
    }
