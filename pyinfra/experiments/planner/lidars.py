"""The LiDARs of a plan: price, and whether they see all around."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import yaml

from pyinfra.core.errors import Error
from pyinfra.core.names import StrPath, file_or_name
from pyinfra.dataset import simulation
from pyinfra.dataset.frames import PERIOD_S
from pyinfra.dataset.lidars import UNCONFIRMED, catalogue_files, presets_of, sum_source
from pyinfra.experiments.planner.site import PlanSite
from pyinfra.formats import kitti

ALL_AROUND_DEG = 350.0


@dataclass(frozen=True, eq=False)
class PlanLidar:
    """A LiDAR under the preset of a plan."""

    name: str
    unit: simulation.Lidar
    price_low_usd: float
    price_high_usd: float
    source: str
    all_around: bool  # whether its yaw does not matter
    units: int  # number of LiDARs in a bundle, else 1

    @property
    def confirmed(self) -> bool:
        return UNCONFIRMED not in self.source

    @property
    def price_usd(self) -> float:
        return (self.price_low_usd + self.price_high_usd) / 2

    def with_price(self, factor: float) -> PlanLidar:
        """Returns the LiDAR at a multiple of its price."""
        low, high = factor * self.price_low_usd, factor * self.price_high_usd
        return replace(self, price_low_usd=low, price_high_usd=high)


def open_lidars(names: Sequence[StrPath], site: PlanSite) -> list[PlanLidar]:
    """Opens LiDARs by name or file; without names, all of the catalogue that have the preset."""
    world = simulation.load_scene(site.file, preset=site.preset, mount=site.mount)
    lidars = [_open(file, site.preset, world) for file in _files(names, site.preset)]
    if len({lidar.name for lidar in lidars}) < len(lidars):
        raise Error("lidars: expected each LiDAR once, got one twice")
    return lidars


def common_period_s(names: Sequence[StrPath], preset: str) -> float:
    """Returns the frame period of LiDARs, as in `open_lidars`. Raises Error if periods differ."""
    units = [simulation.load_lidar(file, preset) for file in _files(names, preset)]
    for unit in units:
        if unit.period_s != units[0].period_s:
            raise Error(
                f"lidars: expected one frame period in a plan, got {units[0].name} with "
                f"{units[0].period_s:g} s and {unit.name} with {unit.period_s:g} s"
            )
    return units[0].period_s if units else PERIOD_S


def _files(names: Sequence[StrPath], preset: str) -> list[Path]:
    files = {file.stem: file for file in catalogue_files()}
    if not names:
        names = [name for name, file in files.items() if preset in presets_of(file)]
    return [file_or_name(name, files, "lidars") for name in names]


def _open(file: Path, preset: str, world: simulation.World) -> PlanLidar:
    unit = simulation.load_lidar(file, preset)
    described, _ = kitti.parse_lidar(world.lidar_yaml(unit), f"{file.name}: lidar.yaml")
    low, high = described.price_usd
    if not (math.isfinite(low) and math.isfinite(high) and low > 0):
        raise Error(
            f"lidars: expected a price, got none for {unit.name}; "
            f"`price_usd: {{low: 2000, high: 3000}}` in {file.name} sets it"
        )
    views = [unit.azimuth[1] - unit.azimuth[0] for unit in described.field_of_view]
    around = min(360.0, sum(math.degrees(view) for view in views)) >= ALL_AROUND_DEG
    return PlanLidar(unit.name, unit, low, high, _source(file), around, len(views))


def _source(file: Path) -> str:
    """Returns where the price of a LiDAR comes from; for a bundle, that of all its units."""
    keys = yaml.safe_load(file.read_text(encoding="utf-8"))
    if "price_usd" in keys:
        return str(keys["price_usd"].get("source", ""))
    units = [unit for unit in keys.get("bundle", []) if "lidar" in unit]
    return sum_source(_source(file.parent / unit["lidar"]) for unit in units)
