"""Price and performance: AP per dollar and similar ratios, and dominated options."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from pyinfra.core.config import ruled
from pyinfra.dataset.windows import REGION_M, WINDOW_M, WINDOW_STEP_M
from pyinfra.metrics.evaluation_tables import HIGH_QUALITY, LANES
from pyinfra.metrics.row_selection import EXPERIMENT, each_road_once, with_whole

KEY = [*EXPERIMENT, "seed"]
RIVALS = ["scene", "preset", "tier", "seed"]  # columns that must be equal in compared options
MOUNTS = "mounts"  # column with the number of mounts, for scenes whose frames are fused
SITE_ITEMS = ("computer_usd", "pole_usd", "installation_usd", "energy_usd")


@dataclass(frozen=True)
class Costs:
    """Costs of a site without its LiDARs, given by the user; 0 by default."""

    pole_usd: float = ruled(0.0, 0, 1e7)  # price of a pole; each mount needs one
    installation_usd: float = ruled(0.0, 0, 1e7)  # work and permits for each mount
    computer_usd: float = ruled(0.0, 0, 1e7)  # price of the computer that runs the detector
    power_w: float = ruled(0.0, 0, 1e5)  # power of LiDAR and computer, which run all day
    usd_per_kwh: float = ruled(0.0, 0, 100)  # price of energy
    years: float = ruled(0.0, 0, 100)  # years of energy to include

    def of_mounts(self, mounts: int) -> Costs:
        """Returns the costs of a site with this number of mounts.

        `pole_usd` and `installation_usd` are the sums over all mounts.
        """
        return replace(
            self, pole_usd=mounts * self.pole_usd, installation_usd=mounts * self.installation_usd
        )

    @property
    def energy_usd(self) -> float:
        return self.power_w / 1000 * 24 * 365.25 * self.years * self.usd_per_kwh

    @property
    def site_usd(self) -> float:
        return sum(self.items().values())

    def items(self) -> dict[str, float]:
        """Returns the items whose sum is `site_usd`, by column of the table."""
        return {name: getattr(self, name) for name in SITE_ITEMS}


def value_table(tables: dict[str, pd.DataFrame], costs: Costs) -> pd.DataFrame:
    """Returns a row for each finished experiment.

    tables: `experiments`, `areas`, `distance`, `lidars` and `hits` of a benchmark. The price is the
    mean of the LiDAR's low and high price, times the number of mounts, plus the costs of the site.
    High-quality areas and metres of road use the ground truth of `with_whole`, so that the same
    vehicles count for every LiDAR. Options of the same scene, preset, tier and seed are compared.
    An option is dominated if another option has no higher price and no lower AP (R1000) with this
    ground truth, and is better in at least one of the two. An option without this AP is neither
    dominated nor in column `pareto`.
    """
    experiments = with_whole(tables["experiments"].dropna(subset=["ap"]))
    truth = "all" if experiments.empty else str(experiments.whole.iloc[0])
    experiments = experiments[
        [*KEY, "ap", "ap_r1000", "ap_all", "ap_all_r1000", "ap_whole", "ap_whole_r1000"]
    ]
    price = tables["lidars"].assign(lidar_usd=lambda t: (t.price_low_usd + t.price_high_usd) / 2)[
        ["lidar", "preset", "lidar_usd"]
    ]
    areas = each_road_once(tables["areas"])
    areas = areas[areas.ground_truth == truth].groupby(KEY, as_index=False)[["n_hqda"]].sum()
    of_hits = [name for name in ("vehicle_points_per_frame", MOUNTS) if name in tables["hits"]]
    hits = tables["hits"][["scene", "preset", "lidar", *of_hits]]
    t = experiments.merge(price, on=["lidar", "preset"])
    t = of_mounts(t, mounts_of(t.merge(hits, how="left")), costs)
    road = covered(tables["distance"], truth=truth)
    t = t.merge(areas, on=KEY, how="left").merge(road, on=KEY, how="left")
    t = t.merge(hits, on=["scene", "preset", "lidar"], how="left")
    usd = t.lidar_usd + t.site_usd
    t.insert(len(KEY), "price_usd", usd)
    t["ap_per_1000_usd"] = 1000 * t.ap_r1000 / usd
    t["ap_all_per_1000_usd"] = 1000 * t.ap_all_r1000 / usd
    t["usd_per_hq_area"] = (usd / t.n_hqda).replace(np.inf, np.nan)
    t["usd_per_m_road"] = (usd / t.covered_m).replace(np.inf, np.nan)
    t["points_per_1000_usd"] = 1000 * t.vehicle_points_per_frame / usd
    t["dominated_by"] = (
        pd.concat(
            [rivals.apply(best_rival, axis=1, rivals=rivals) for _, rivals in t.groupby(RIVALS)]
        )
        if len(t)
        else ""
    )
    t.insert(len(t.columns) - 1, "pareto", (t.dominated_by == "") & t.ap_whole_r1000.notna())
    return t


def of_mounts(table: pd.DataFrame, mounts: pd.Series, costs: Costs) -> pd.DataFrame:
    """Returns the table with the costs of LiDARs and site for each row's number of mounts."""
    table["lidar_usd"] *= mounts
    sites = [costs.of_mounts(n) for n in mounts]
    items = {item: [site.items()[item] for site in sites] for item in SITE_ITEMS}
    return table.assign(site_usd=[site.site_usd for site in sites], **items)


def mounts_of(table: pd.DataFrame) -> pd.Series:
    """Returns the number of mounts of each row; 1 where the table does not give it."""
    if MOUNTS not in table:
        return pd.Series(1, index=table.index)
    return pd.to_numeric(table[MOUNTS]).fillna(1).astype(int)


def covered(
    distance: pd.DataFrame,
    above: float = HIGH_QUALITY,
    within_m: float = REGION_M,
    truth: str = "all",
) -> pd.DataFrame:
    """Returns the metres of road that are covered, in column `covered_m`, for each experiment.

    Road is covered inside windows whose AP with ground truth `truth` is higher than `above`. A
    road extends from the middle of its first window to the middle of its last window. The outer
    halves of these two windows do not count. within_m: only road within this distance from the foot
    of the sensor counts, along the road in both directions. The value is NaN for a site of lanes,
    which has no windows along a road.
    """
    at_once = distance.road == LANES  # rows whose column s is not a distance along a road
    lanes = distance[at_once][KEY].drop_duplicates().assign(covered_m=np.nan)
    distance = distance[~at_once]
    windows = distance[distance.ground_truth == truth]
    ends = windows.groupby([*KEY, "road"], as_index=False).s.agg(begin="min", end="max")
    good = windows[windows.ap_r1000 > above]
    steps = round(WINDOW_M / WINDOW_STEP_M)
    pieces = pd.concat(
        [
            good[[*KEY, "road"]].assign(piece=good.s + WINDOW_STEP_M * (i - steps / 2))
            for i in range(steps)
        ]
    ).drop_duplicates()
    pieces = pieces.merge(ends, on=[*KEY, "road"])
    begin = pieces.piece.clip(lower=pieces.begin.clip(lower=-within_m))
    end = (pieces.piece + WINDOW_STEP_M).clip(upper=pieces.end.clip(upper=within_m))
    pieces["covered_m"] = (end - begin).clip(lower=0)
    experiments = distance[KEY].drop_duplicates()
    metres = pieces.groupby(KEY).covered_m.sum()
    merged = experiments.merge(metres.reset_index(), on=KEY, how="left")
    merged = merged.fillna({"covered_m": 0.0})
    return merged if lanes.empty else pd.concat([merged, lanes], ignore_index=True)


def best_rival(option: pd.Series, rivals: pd.DataFrame) -> str:
    """Returns the name of the dominating option with the highest AP; empty if there is none."""
    as_cheap, cheaper = (rivals.price_usd <= option.price_usd, rivals.price_usd < option.price_usd)
    as_good, better = (
        rivals.ap_whole_r1000 >= option.ap_whole_r1000,
        rivals.ap_whole_r1000 > option.ap_whole_r1000,
    )
    superior = rivals[as_cheap & as_good & (cheaper | better)]
    if superior.empty:
        return ""
    best = superior.loc[superior.ap_whole_r1000.idxmax()]
    return f"{best.lidar} {best.detector}"
