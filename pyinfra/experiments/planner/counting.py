"""Counts the vehicles of an option from tracks of consecutive frames, and compares with the truth.

A share of vehicles that are found in a frame says little about counts: a vehicle that is missed in
some frames is counted if its track continues. Here the option is simulated without gaps, its boxes
are tracked, and passages over the lines of the site's roads are matched with the true ones.
"""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass

from pyinfra.core.errors import Error
from pyinfra.dataset.fused import fused
from pyinfra.experiments.planner.check import Parts
from pyinfra.experiments.planner.measure import detector_for, frames_at
from pyinfra.experiments.planner.predict import UNKNOWN, Z95
from pyinfra.experiments.planner.site import PlanSite
from pyinfra.metrics.comparison import Interval
from pyinfra.models.inference.boxes_table import detect
from pyinfra.tracking.evaluation import evaluate_tracks
from pyinfra.tracking.lines import lines_of
from pyinfra.tracking.tracks import track

SECONDS = 30.0  # of simulated traffic
WITHIN_M = 80.0  # largest distance of the vehicles whose speeds are compared


@dataclass(frozen=True)
class Counting:
    """Passages of an option that were counted, and how exact its speeds are."""

    seconds: float
    passages: int  # true passages over all lines
    counted: int  # of them, with a passage of a track
    extra: int  # passages of tracks without a true one
    speed_error_km_h: float  # median

    @property
    def share(self) -> Interval:
        """The share of the passages that is counted, with a Wilson interval of 95 %."""
        if not self.passages:
            return UNKNOWN
        n, share, z2 = self.passages, self.counted / self.passages, Z95**2
        middle = (share + z2 / (2 * n)) / (1 + z2 / n)
        half = Z95 * math.sqrt(share * (1 - share) / n + z2 / (4 * n * n)) / (1 + z2 / n)
        return Interval(share, max(0.0, middle - half), min(1.0, middle + half))


def count_option(site: PlanSite, parts: Parts, detector: str, seconds: float = SECONDS) -> Counting:
    """Simulates an option without gaps and counts its vehicles over the lines of the site's roads.

    The traffic is that of a seed that neither the choice nor the predictions have used or, for
    recorded traffic, its last part.
    """
    frames = max(2, min(round(seconds / site.period_s), site.every_frame))
    first = site.every_frame - frames if site.recorded else 0
    numbers = range(first, first + frames)
    seed = site.other_seed if site.recorded else site.other_seed + 1
    alone = [frames_at(site, pose, lidar, numbers, seed=seed) for pose, lidar in parts]
    sequence = fused(alone)
    try:
        lines = lines_of(sequence)
    except Error:
        return Counting(frames * site.period_s, 0, 0, 0, math.nan)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", ".* used on frames")  # the answer says it once
        tracks = track(detect(detector_for(sequence, detector), sequence), sequence)
    result = evaluate_tracks(sequence, tracks, within_m=WITHIN_M, lines=lines)
    extra = int((result.passages.true_id < 0).sum())
    counted = len(result.passages) - extra
    return Counting(
        frames * site.period_s,
        counted + len(result.missed),
        counted,
        extra,
        float(result.measures.speed_error_km_h),
    )


def count_line(found: Counting, wanted: float) -> str:
    """Returns the line of an answer. wanted: share of the passages that must be counted."""
    if not found.passages:
        return f"Counts: no vehicle passes a line in {found.seconds:g} s of traffic."
    share = found.share
    text = (
        f"Counts: {found.counted} of {found.passages} passages in {found.seconds:g} s of other "
        f"traffic ({100 * share.value:.0f} %, {100 * share.low:.0f} to {100 * share.high:.0f}), "
        f"{found.extra} without a vehicle"
    )
    if math.isfinite(found.speed_error_km_h):
        text += f"; speeds within {found.speed_error_km_h:.1f} km/h (median)"
    judged = "met" if share.low >= wanted else "not met" if share.high < wanted else "not known"
    return f"{text}. {100 * wanted:g} % counted: {judged}."
