"""The options of a benchmark as a table: their figures, and whether they meet requirements."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import pandas as pd

from pyinfra.core.errors import Error
from pyinfra.core.names import path_of
from pyinfra.core.public import public
from pyinfra.core.vocabulary import Tier
from pyinfra.experiments.option import Option
from pyinfra.experiments.options import read_options
from pyinfra.experiments.requirements import Requirements, checked_requirements, unlike
from pyinfra.metrics.comparison import Interval, columns_of
from pyinfra.metrics.row_selection import COUNTED, OFF_REGION


@dataclass(frozen=True)
class Shortfall:
    """A requirement that an option does not meet."""

    of: Literal["price", "ap", "latency"]
    reason: str
    relax: str  # budget, AP or latency that the option would meet; empty if there is none
    share: float  # how far the option misses the requirement, as a share of the requirement


@public()
def recommend(
    results: str | os.PathLike[str],
    *,
    budget_usd: float = math.inf,
    min_ap: float = Requirements.min_ap,
    range_m: float = Requirements.range_m,
    latency_ms: float | None = None,
    scene: str = "",
    preset: str = "",
    tier: Tier = "quick",
) -> pd.DataFrame:
    """Ranks the LiDARs and detectors of a benchmark, and checks them against requirements.

    Parameters
    ----------
    results : folder of a benchmark's tables
    budget_usd : highest price of LiDAR and site
    min_ap : lowest AP of all vehicles in the region, 1 to 100
    range_m : range within which AP, recall and coverage are computed, up to 100; along a road it
        is measured to either side of the sensor; with 100, AP and recall are of the whole region
    latency_ms : longest median time per frame; by default the frame period of the LiDAR
    scene : name of the scene; required if the tables have several
    preset : preset of the LiDARs; by default the first of `datasheet`, `equal` and `paper` that
        has two LiDARs or more
    tier : tier of the benchmark: `smoke`, `quick` or `full`

    Returns
    -------
    DataFrame : a row for each option. Options that meet the requirements come first. Within each
        group rows are ordered by AP. Columns:

        - `lidar`, `detector`, `scene`, `preset`
        - `ap_r1000`: AP (R1000) of all vehicles, with the 95 % interval `ap_r1000_low`,
          `ap_r1000_high`; further columns have the AP of visible and of captured vehicles
        - `off_region_per_min`: boxes outside the region per minute, of score 0.5 or more; NaN in
          tables of earlier versions
        - prices in USD, latency in ms per frame, covered road in m
        - `meets`: whether the option meets all requirements
        - `reason`, `relax`: which requirements the option misses, and how to change them
        - `difference`: AP of the first row minus AP of this row, paired, with its interval
        - `share_over`: how far price and AP miss the requirements, as a sum of shares; inf if the
          option misses the requirements with any budget and AP

    Raises
    ------
    Error : for a number out of range, an unknown scene or preset, or a wrong table

    Examples
    --------
    >>> import tempfile
    >>> import pyinfra as pi
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = pi.benchmark("example", f"{folder}/out", work=f"{folder}/work", tier="smoke")
    ...     table = pi.recommend(f"{folder}/out", tier="smoke", budget_usd=3000, min_ap=20)
    >>> table[["lidar", "detector", "meets"]].values.tolist()
    [['helios_16', 'background', True]]
    """
    requirements = checked_requirements(budget_usd, min_ap, range_m, latency_ms)
    folder = path_of(results, "results")
    try:
        options = read_options(folder, tier, scene, preset, requirements)
    except FileNotFoundError as error:
        raise Error(f"results: {error.filename}: {error.strerror}") from None
    table = option_table(options, requirements)
    order = [*table.index[table.meets], *table.index[~table.meets]]
    return table.loc[order].reset_index(drop=True)


def option_table(options: Sequence[Option], requirements: Requirements) -> pd.DataFrame:
    """Returns a row for each option, in the same order.

    Column `difference` is relative to the first option that meets the requirements. If no option
    does, it is relative to the first option.
    """
    broken = [shortfalls(option, requirements) for option in options]
    good = [option for option, missed in zip(options, broken, strict=True) if not missed]
    first = good[0] if good else options[0]
    return pd.DataFrame(
        [
            _row(option, missed, first, requirements)
            for option, missed in zip(options, broken, strict=True)
        ]
    )


def _row(
    option: Option, broken: Sequence[Shortfall], first: Option, requirements: Requirements
) -> dict[str, object]:
    over = {missed.of: missed for missed in broken}
    hard = [missed for missed in broken if missed.of != "latency"]
    can_be_met = all(missed.relax for missed in hard)
    first_over = sum(missed.share for missed in hard) if can_be_met else math.inf
    return {
        "lidar": option.lidar,
        "detector": option.detector,
        **columns_of("ap_r1000", option.ap_whole),
        "price_usd": option.price_usd,
        "latency_ms": option.latency_ms,
        "meets": not broken,
        "reason": ", ".join(missed.reason for missed in broken),
        "relax": relaxation(broken, requirements.limit_ms(option.frame_ms)),
        "meets_price": "price" not in over,
        "meets_ap": "ap" not in over,
        "meets_latency": "latency" not in over,
        "share_over": first_over,
        "latency_over": over["latency"].share if "latency" in over else 0.0,
        **columns_of("difference", Interval(0, 0, 0) if option is first else first.less(option)),
        **columns_of("ap_visible_r1000", option.ap_visible),
        **columns_of("ap_captured_r1000", option.ap),
        **columns_of("recall", option.recall),
        **columns_of("covered_m", option.covered_m),
        "road_m": option.road_m,
        OFF_REGION: option.off_region_per_min,
        "price_low_usd": option.price_low_usd,
        "price_high_usd": option.price_high_usd,
        "site_usd": option.site_usd,
        "latency_p95_ms": option.latency_p95_ms,
        "scene": option.scene,
        "preset": option.preset,
        "ground_truth": option.whole,
    }


def shortfalls(option: Option, requirements: Requirements) -> list[Shortfall]:
    """Returns the requirements that an option does not meet; empty if it meets all."""
    missed = []
    if option.price_usd > requirements.budget_usd:
        over = option.price_usd / requirements.budget_usd - 1
        relax = f"a budget of {math.ceil(option.price_usd)} USD"
        missed.append(Shortfall("price", f"costs {price(option, requirements)}", relax, over))
    ap, counted = option.ap_whole.value, COUNTED[option.whole]
    if not ap >= requirements.min_ap:
        relax = f"a minimum AP of {math.floor(10 * ap) / 10:g}" if ap >= 2 else ""
        shown = unlike(ap, requirements.min_ap, 1)
        reason = f"AP {shown} of {counted}" if math.isfinite(ap) else f"no AP of {counted}"
        missed.append(Shortfall("ap", reason, relax, 1 - ap / requirements.min_ap))
    limit_ms = requirements.limit_ms(option.frame_ms)
    if not option.least_latency_ms <= limit_ms:
        known = math.isfinite(option.latency_ms)
        relax = f"a latency of {math.ceil(option.latency_ms)} ms" if known else ""
        share = option.latency_ms / limit_ms - 1 if known else math.inf
        missed.append(Shortfall("latency", latency(option, requirements), relax, share))
    return missed


def relaxation(broken: Sequence[Shortfall], limit_ms: float) -> str:
    """Returns as text how to change the requirements so that an option would meet them.

    If no change of a requirement helps, the text asks for a measured latency.
    """
    words = [missed.relax for missed in broken if missed.relax]
    if len(words) < len(broken):
        words.append(f"a measured latency of {limit_ms:g} ms or less")
    return " and ".join(words)


def latency(option: Option, requirements: Requirements) -> str:
    if math.isnan(option.latency_ms):
        return "no latency was measured"
    return f"{against(option.latency_ms, requirements.limit_ms(option.frame_ms))} ms a frame"


def against(value: float, limit: float) -> str:
    """Returns a number as text, with more digits if it is above the limit and would round to it."""
    return unlike(value, limit, 0) if value > limit else f"{value:,.0f}"


def price(option: Option, requirements: Requirements) -> str:
    """Returns the price as text, with its range and the LiDAR's part if these are known.

    A remark is added if the price is above the budget but the low end of its range is not.
    """
    text = f"{against(option.price_usd, requirements.budget_usd)} USD"
    noun = f"{option.mounts} LiDARs" if option.mounts > 1 else "LiDAR"
    lidar = f"{noun} {option.price_usd - option.site_usd:,.0f}" if option.site_usd else ""
    span = ""
    if option.price_low_usd != option.price_high_usd:
        span = price_range(option)
        if option.price_low_usd <= requirements.budget_usd < option.price_usd:
            span += ": may be within the budget"
    remark = "; ".join(word for word in (span, lidar) if word)
    return f"{text} ({remark})" if remark else text


def price_range(option: Option) -> str:
    return f"{option.price_low_usd:,.0f} to {option.price_high_usd:,.0f}"
