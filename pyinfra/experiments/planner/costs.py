"""What an option costs over some years. Each line is a range that is carried to the sum."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pyinfra.core.errors import FormatError
from pyinfra.dataset.catalogue import configs
from pyinfra.dataset.frames import PERIOD_S
from pyinfra.experiments.planner.detectability import Detectability
from pyinfra.experiments.planner.lidars import PlanLidar
from pyinfra.formats.csv_table import read_csv

ITEMS = (
    "pole_usd", "installation_usd", "cable_usd", "computer_usd", "upkeep_usd",
    "lidar_w", "computer_w", "usd_per_kwh",
)  # fmt: skip
HOURS_A_YEAR = 8766
CORES = 4  # cores of the computer of the table


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
class Costs:
    """The lines of a table of costs, years of use, and what one computer can run."""

    lines: dict[str, Range]
    sources: dict[str, str]
    years: float
    latency_ms: float  # time of a frame of one LiDAR on one core
    frame_ms: float = 1000 * PERIOD_S  # frame period of the LiDARs

    @property
    def unconfirmed(self) -> list[str]:
        return [item for item, source in self.sources.items() if "unconfirmed" in source]

    @property
    def without_source(self) -> list[str]:
        return [item for item, source in self.sources.items() if not source]

    def computers(self, lidars: int) -> int:
        return math.ceil(max(1e-9, lidars * self.latency_ms) / (CORES * self.frame_ms))

    def parts(self, lidars: Sequence[PlanLidar], new_poles: int, poles: int) -> dict[str, Range]:
        """Returns the ranges whose sum is the price of an option, by name.

        new_poles: poles that must be set up. poles: all, with existing masts.
        """
        line, count = self.lines, sum(lidar.units for lidar in lidars)
        computers = self.computers(count)
        watts = line["lidar_w"] * count + line["computer_w"] * computers
        kwh = watts * (HOURS_A_YEAR * self.years / 1000)
        price = Range(
            sum(one.price_low_usd for one in lidars), sum(one.price_high_usd for one in lidars)
        )
        return {
            "lidar_usd": price,
            "pole_usd": line["pole_usd"] * new_poles,
            "installation_usd": line["installation_usd"] * poles,
            "cable_usd": line["cable_usd"] * count,
            "computer_usd": line["computer_usd"] * computers,
            "power_usd": kwh * line["usd_per_kwh"],
            "upkeep_usd": line["upkeep_usd"] * (poles * self.years),
        }

    def price(self, lidars: Sequence[PlanLidar], new_poles: int, poles: int) -> Range:
        return sum(self.parts(lidars, new_poles, poles).values(), NOTHING)


def read_costs(file: Path | None, years: float, detectability: Detectability) -> Costs:
    """Reads a table of costs, by default that of the package.

    Columns: item, per, low, high, source; one row for each of ITEMS. Raises FormatError.
    """
    file = file or configs() / "planner/costs.csv"
    table = read_csv(file, {"item", "per", "source"})
    for name in ("item", "low", "high", "source"):
        if name not in table:
            raise FormatError(f"{file}:1: expected the column {name}, got {', '.join(table)}")
    for row, one in enumerate(table.itertuples(), start=2):
        if one.item not in ITEMS:
            raise FormatError(f"{file}:{row}: item: expected {', '.join(ITEMS)}, got '{one.item}'")
        if one.item in set(table["item"][: row - 2]):
            raise FormatError(f"{file}:{row}: item: expected each item once, got {one.item} twice")
        if not (np.isfinite([one.low, one.high]).all() and 0 <= one.low <= one.high):
            raise FormatError(
                f"{file}:{row}: low, high: expected 0 <= low <= high, got {one.low:g}, {one.high:g}"
            )
    missing = [item for item in ITEMS if item not in set(table["item"])]
    if missing:
        raise FormatError(f"{file}: item: expected a row for {missing[0]}, got none")
    lines = {one.item: Range(one.low, one.high) for one in table.itertuples()}
    sources = {one.item: str(one.source or "") for one in table.fillna("").itertuples()}
    return Costs(lines, sources, years, detectability.latency_ms)
