"""An option of a benchmark: a finished experiment with its price and the road it covers."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import pandas as pd

from pyinfra.experiments.coverage import ROAD
from pyinfra.experiments.requirements import FRAME_MS
from pyinfra.metrics.comparison import UNKNOWN, Interval, clipped, over_replicates
from pyinfra.metrics.replicates import bootstrapped_of, difference, over_seeds


@dataclass(frozen=True)
class Option:
    """A finished experiment.

    Prices include LiDAR and site. "All vehicles" are the vehicles of ground truth `whole`. Road is
    covered inside windows whose AP of all vehicles is above the required AP. For the low end of
    `covered_m`, the AP of each window is replaced by the low end of its interval; for the high end,
    by the high end. A window without an interval counts at the high end only. At a site of lanes,
    squares are counted instead of metres of road.
    """

    scene: str
    preset: str
    lidar: str
    detector: str
    ap_whole: Interval  # AP (R1000) of all vehicles, 0 to 100
    ap_visible: Interval  # AP (R1000) of the vehicles that are visible from the mount
    hidden: float  # share of the vehicles that are hidden from the mount; NaN if unknown
    ap: Interval  # AP (R1000) of the vehicles that the LiDAR captured
    price_usd: float  # mean of the low and the high price
    price_low_usd: float
    price_high_usd: float
    price_source: str  # source of the LiDAR's price; empty if unknown
    site_usd: float  # part of the price that is not for LiDARs
    site_items: Mapping[str, float]  # items whose sum is site_usd; empty if unknown
    covered_m: Interval  # length of covered road; `no_interval` says why it has no interval
    road_m: float  # length of evaluated road within the required range; NaN if unknown
    latency_ms: float  # median time per frame on one core; NaN if it was not measured
    latency_low_ms: float  # low end of the latency's interval; NaN in tables of earlier versions
    latency_p95_ms: float
    machine: str  # computer on which the latency was measured; empty if unknown
    other_cores: float  # cores used by other processes while latency was measured; NaN if unknown
    # Bootstrap replicates of ap_whole for each seed; empty if the tables lack them for a seed.
    replicates: tuple[pd.Series, ...]
    range_m: float = math.nan  # range within which AP was computed; NaN for the whole region
    recall: Interval = UNKNOWN  # percent of vehicles within range_m that a box of any score matches
    covered_in: str = ROAD  # unit of covered_m and road_m: metres of road or squares
    no_interval: str = ""  # reason why covered_m has no interval; empty if it has one
    frame_ms: float = FRAME_MS  # frame period of the LiDAR
    # Percent of all vehicles of the region that a box of any score matches.
    detected: Interval | None = None
    whole: str = "present"  # ground-truth subset from which ap_whole is computed
    mounts: int = 1  # number of LiDARs whose frames are fused
    off_region_per_min: float = math.nan  # boxes with score 0.5 or more outside the region
    hardly_learnt: bool = False  # whether the detector is a network trained in the smoke tier
    # AP of this option minus AP of another option, by the name of the other option
    replicated: Mapping[str, Interval] = field(default_factory=dict)
    other_frames: str = ""  # remark if the detector learnt from frames of a different version

    @property
    def name(self) -> str:
        return f"{self.lidar} with {self.detector}"

    @property
    def least_latency_ms(self) -> float:
        """The low end of the latency's interval, or the latency if the table has no interval."""
        return self.latency_low_ms if self.latency_low_ms >= 0 else self.latency_ms

    def less(self, other: Option) -> Interval:
        """Returns the paired difference of the AP of all vehicles, this option minus the other.

        If a benchmark compared the two in replicates, the result is that difference. Otherwise the
        difference has no interval if one of the options has no bootstrap replicates. Raises Error
        for replicates of different blocks of time.
        """
        if other.name in self.replicated:
            return self.replicated[other.name]
        if not self.replicates or not other.replicates:
            return Interval(self.ap_whole.value - other.ap_whole.value, math.nan, math.nan)
        pairs = zip(self.replicates, other.replicates, strict=True)
        return over_seeds([difference(a, b) for a, b in pairs], self.replicates)


def mean_option(options: Sequence[Option]) -> Option:
    """Returns one option with the mean figures of `options`, which differ in the seed only.

    The seeds of a benchmark are trainings on the same traffic, so intervals are those of one seed:
    for `ap_whole` from the mean of the bootstrap replicates, for other figures from the mean of the
    ends, which is at least as wide. If the replicates show that seeds have different traffic, the
    intervals are Student's t intervals over the traffic.
    """
    first, rows = options[0], tuple(row for one in options for row in one.replicates)
    if len(options) == 1:
        return first
    rows = rows if len(rows) == len(options) else ()
    traffic = [str(row.get("vehicles_digest")) for row in rows] or [""] * len(options)
    ap, ap_visible, captured, recall, covered = (
        _mean([getattr(one, name) for one in options], traffic)
        for name in ("ap_whole", "ap_visible", "ap", "recall", "covered_m")
    )
    if rows:
        values = [one.ap_whole.value for one in options]
        figures = [
            replace(bootstrapped_of(row), value=value)
            for row, value in zip(rows, values, strict=True)
        ]
        ap = over_seeds(figures, rows)
    covered = clipped(covered, 0, first.road_m)
    no_interval = next((one.no_interval for one in options if one.no_interval), "")
    if covered.low > 0 or covered.high < first.road_m:
        no_interval = ""
    else:
        covered = replace(UNKNOWN, value=covered.value)
        no_interval = no_interval or "it would include all possible values"
    return replace(
        first,
        ap_whole=clipped(ap, 0, 100),
        ap_visible=clipped(ap_visible, 0, 100),
        ap=clipped(captured, 0, 100),
        recall=clipped(recall, 0, 100),
        covered_m=covered,
        no_interval=no_interval,
        replicates=rows,
    )


def _mean(figures: Sequence[Interval], traffic: Sequence[str]) -> Interval:
    """Returns the mean of a figure over seeds. traffic: the key of each seed's traffic."""
    ends = np.array([(one.value, one.low, one.high) for one in figures])
    means = [ends[np.array(traffic) == key].mean(0).tolist() for key in dict.fromkeys(traffic)]
    return Interval(*means[0]) if len(means) == 1 else over_replicates([m[0] for m in means])
