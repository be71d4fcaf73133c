"""The LiDARs of a plan with their prices, what an option costs, and what the budget can pay for."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import yaml

from pyinfra.core.arrays import BoolArray
from pyinfra.core.errors import Error, FormatError
from pyinfra.core.names import StrPath, file_or_name, repeated
from pyinfra.dataset import simulation
from pyinfra.dataset.catalogue import configs, shipped
from pyinfra.dataset.frames import PERIOD_S
from pyinfra.dataset.lidars import UNCONFIRMED, presets_of, price_source
from pyinfra.experiments.planner.detectability import Detectability
from pyinfra.experiments.planner.site import PlanSite
from pyinfra.experiments.stress.lidar import spins
from pyinfra.formats import kitti
from pyinfra.formats.csv_table import expect, read_csv

ALL_AROUND_DEG = 350.0
ITEMS = (
    "pole_usd", "installation_usd", "cable_usd", "computer_usd", "upkeep_usd",
    "lidar_w", "computer_w", "usd_per_kwh",
)  # fmt: skip
HOURS_A_YEAR = 8766
CORES = 4  # cores of the computer in the table of costs


@dataclass(frozen=True)
class Range:
    """A low and a high value."""

    low: float
    high: float

    @property
    def middle(self) -> float:
        return (self.low + self.high) / 2

    def __add__(self, other: Range) -> Range:
        return Range(self.low + other.low, self.high + other.high)

    def __mul__(self, factor: float | Range) -> Range:
        other = factor if isinstance(factor, Range) else Range(factor, factor)
        return Range(self.low * other.low, self.high * other.high)


NOTHING = Range(0, 0)


@dataclass(frozen=True, eq=False)
class PlanLidar:
    """A LiDAR under the preset of a plan."""

    name: str
    unit: simulation.Lidar
    price_usd: Range
    source: str  # source of the price
    all_around: bool  # whether the LiDAR's yaw does not matter
    units: int  # number of LiDARs in a bundle, else 1
    spinning: bool  # whether a unit of the LiDAR spins

    @property
    def confirmed(self) -> bool:
        return UNCONFIRMED not in self.source


def open_lidars(names: Sequence[StrPath], site: PlanSite) -> list[PlanLidar]:
    """Opens LiDARs by name or file; without names, those of the catalogue that have the preset."""
    world = simulation.load_scene(site.file, preset=site.preset, mount=site.mount)
    return [_open(file, site.preset, world) for file in _files(names, site.preset)]


def common_period_s(names: Sequence[StrPath], preset: str) -> float:
    """Returns the frame period of the LiDARs that `open_lidars` would open.

    Raises Error if periods differ, for a LiDAR without a price, and for a LiDAR given twice.
    """
    files = _files(names, preset)
    units = [simulation.load_lidar(file, preset) for file in files]
    if twice := repeated([unit.name for unit in units]):
        raise Error(f"lidars: expected each LiDAR once, got {twice} twice")
    for file, unit in zip(files, units, strict=True):
        _price(file, unit)
    for unit in units:
        if unit.period_s != units[0].period_s:
            raise Error(
                f"lidars: expected the same frame period for all LiDARs, got {units[0].name} with "
                f"{units[0].period_s:g} s and {unit.name} with {unit.period_s:g} s"
            )
    return units[0].period_s if units else PERIOD_S


def _files(names: Sequence[StrPath], preset: str) -> list[Path]:
    files = shipped("lidars")
    if not names:
        names = [name for name, file in files.items() if preset in presets_of(file)]
    return [file_or_name(name, files, "lidars") for name in names]


def _price(file: Path, unit: simulation.Lidar) -> Range:
    keys = yaml.safe_load(unit.dump())["price_usd"]
    price = Range(float(keys["low"]), float(keys["high"]))
    if not (math.isfinite(price.middle) and price.low > 0):
        raise Error(
            f"lidars: expected a price of {unit.name}, got none; set it in {file.name}, such as "
            "`price_usd: {low: 2000, high: 3000}`"
        )
    return price


def _open(file: Path, preset: str, world: simulation.World) -> PlanLidar:
    unit = simulation.load_lidar(file, preset)
    described, _ = kitti.parse_lidar(world.lidar_yaml(unit), f"{file.name}: lidar.yaml")
    price = _price(file, unit)
    views = [unit.azimuth[1] - unit.azimuth[0] for unit in described.field_of_view]
    around = min(360.0, sum(math.degrees(view) for view in views)) >= ALL_AROUND_DEG
    spinning = spins(yaml.safe_load(unit.dump()))
    return PlanLidar(unit.name, unit, price, price_source(file), around, len(views), spinning)


@dataclass(frozen=True, eq=False)
class Costs:
    """A table of costs, the years of use, and the load of one LiDAR on a computer."""

    lines: dict[str, Range]
    sources: dict[str, str]
    years: float
    latency_ms: float  # time of a frame of one LiDAR on one core
    frame_ms: float  # frame period of the LiDARs

    @property
    def unconfirmed(self) -> list[str]:
        return [item for item, source in self.sources.items() if UNCONFIRMED in source]

    @property
    def without_source(self) -> list[str]:
        return [item for item, source in self.sources.items() if not source]

    def computers(self, lidars: int) -> int:
        return math.ceil(max(1e-9, lidars * self.latency_ms) / (CORES * self.frame_ms))

    def parts(self, lidars: Sequence[PlanLidar], new_poles: int, poles: int) -> dict[str, Range]:
        """Returns the ranges whose sum is the price of an option, by name.

        new_poles: number of poles that must be set up. poles: number of all poles, including
        existing masts.
        """
        line, count = self.lines, sum(lidar.units for lidar in lidars)
        computers = self.computers(count)
        watts = line["lidar_w"] * count + line["computer_w"] * computers
        hours = HOURS_A_YEAR * self.years
        return {
            "lidar_usd": sum((one.price_usd for one in lidars), NOTHING),
            "pole_usd": line["pole_usd"] * new_poles,
            "installation_usd": line["installation_usd"] * poles,
            "cable_usd": line["cable_usd"] * count,
            "computer_usd": line["computer_usd"] * computers,
            "power_usd": watts * (hours / 1000) * line["usd_per_kwh"],
            "upkeep_usd": line["upkeep_usd"] * (poles * self.years),
        }

    def price(self, lidars: Sequence[PlanLidar], new_poles: int, poles: int) -> Range:
        return sum(self.parts(lidars, new_poles, poles).values(), NOTHING)


def read_costs(
    file: Path | None, years: float, law: Detectability, period_s: float = PERIOD_S
) -> Costs:
    """Reads a table of costs, by default that of the package. period_s: frame period.

    Columns: item, per, low, high, source; one row for each of ITEMS. Raises FormatError.
    """
    file = file or configs() / "planner/costs.csv"
    table = read_csv(file, {"item", "per", "source"}, ("item", "low", "high", "source"))
    expect(file, table["item"], table["item"].isin(ITEMS), ", ".join(ITEMS))
    twice = table["item"][table["item"].duplicated()]
    if len(twice):
        raise FormatError(
            f"{file}:{twice.index[0] + 2}: item: expected each item once, got {twice.iloc[0]} twice"
        )
    for row, one in enumerate(table.itertuples(), start=2):
        if not (math.isfinite(one.high) and 0 <= one.low <= one.high):
            raise FormatError(
                f"{file}:{row}: low, high: expected 0 <= low <= high, got {one.low:g}, {one.high:g}"
            )
    missing = [item for item in ITEMS if item not in set(table["item"])]
    if missing:
        raise FormatError(f"{file}: item: expected a row for {missing[0]}, got none")
    return Costs(
        {one.item: Range(one.low, one.high) for one in table.itertuples()},
        dict(zip(table["item"], table.source.fillna("").astype(str), strict=True)),
        years,
        law.latency_ms,
        1000 * period_s,
    )


def affordable(lidars: list[PlanLidar], costs: Costs, budget_usd: float) -> list[PlanLidar]:
    """Returns the LiDARs that the budget can pay for. Raises Error if there is none."""
    prices = {one.name: costs.price([one], 0, 1).middle for one in lidars}
    good = [one for one in lidars if prices[one.name] <= budget_usd]
    if not good:
        cheapest = min(prices, key=prices.__getitem__)
        raise Error(
            f"budget_usd: expected {math.ceil(prices[cheapest]):,} or more, the price of "
            f"{cheapest} on an existing mast, got {budget_usd:,.0f}"
        )
    return good


def lowest_prices(
    lidars: Sequence[PlanLidar], poses: pd.DataFrame, costs: Costs
) -> dict[str, float]:
    """Returns by LiDAR the price of one unit, on an existing pole if there is one."""
    return {
        one.name: costs.price([one], 0 if poses.existing.any() else 1, 1).middle for one in lidars
    }


def possible(
    poses: pd.DataFrame, lidars: Sequence[PlanLidar], costs: Costs, budget_usd: float
) -> BoolArray:
    """Returns which pairs of pose and LiDAR the plan shall observe, shape (poses, lidars).

    These pairs are within the budget. A LiDAR that sees all around needs no second yaw at a place.
    Raises Error if there is no such pair.
    """
    prices = np.array([[costs.price([one], new, 1).middle for one in lidars] for new in (1, 0)])[
        poses.existing.to_numpy(int)
    ]  # shape (poses, lidars)
    if prices.min() > budget_usd:
        raise Error(
            f"budget_usd: expected {math.ceil(prices.min()):,} or more for a pole with a LiDAR, "
            f"got {budget_usd:,.0f}; an existing mast costs less"
        )
    needless = np.outer(poses.turn != 0, [one.all_around for one in lidars])
    return np.asarray((prices <= budget_usd) & ~needless)
