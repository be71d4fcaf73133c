"""Whether a request can be answered. Each check raises Error before anything is observed."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pandas as pd

from pyinfra.core.arrays import BoolArray
from pyinfra.core.errors import Error
from pyinfra.experiments.planner.areas import check_on_roads
from pyinfra.experiments.planner.costs import Costs
from pyinfra.experiments.planner.detectability import Detectability
from pyinfra.experiments.planner.lidars import PlanLidar
from pyinfra.experiments.planner.race import weighted_objects
from pyinfra.experiments.planner.request import Request
from pyinfra.experiments.planner.site import PlanSite


def check_settings(
    law: Detectability,
    request: Request,
    centre_m: Sequence[float] | None,
    seed: int | None,
    check_frames: int,
    count: float | None,
    jobs: int,
) -> None:
    """Checks what needs no site."""
    for name, value, low, high in (
        ("check_frames", check_frames, 0, 5000),
        ("jobs", jobs, -1, 1000),
        ("seed", seed or 0, 0, 2**31 - 2),
    ):
        if not low <= value <= high or value != int(value):
            raise Error(f"{name}: expected a whole number, {low} to {high}, got {value}")
    if jobs == 0:
        raise Error("jobs: expected 1 or more, or -1 for all cores, got 0")
    if count is not None and not 0 < count <= 1:
        raise Error(f"count: expected above 0 to 1, got {count:g}")
    if centre_m is not None and not (len(centre_m) == 2 and np.isfinite(centre_m).all()):
        raise Error(f"centre_m: expected x and y in metres, got {centre_m}")
    if request.people > 0 and law.people is None:
        raise Error(
            f"people: expected 0 for the detector {law.detector}, which detects no pedestrians, "
            f"got {request.people:g}; generalist detects them"
        )


def check_site(site: PlanSite, request: Request, check_frames: int, *, drawn: bool) -> None:
    """Checks that objects count. drawn: whether the areas are those of the user."""
    if drawn:
        check_on_roads(request.areas, site.roads)
    objects = weighted_objects(site, request, site.frames)
    if objects.weight.sum() == 0 or not objects.near_vehicles.any():
        x, y = site.centre
        vehicles = objects.table[~objects.table.person]
        away = np.hypot(*(vehicles[["x", "y"]].to_numpy() - site.centre).T)
        nearest = f"; the nearest is {away.min():.0f} m away" if len(away) else ""
        raise Error(
            f"within_m: expected vehicles within {request.within_m:g} m of ({x:.0f}, {y:.0f}), "
            f"got none in {len(site.frames)} frames{nearest}"
        )
    left = site.every_frame - len(site.other_frames(check_frames))
    if request.detector == "background" and check_frames and left < 1:
        raise Error(
            f"check_frames: expected below {site.every_frame}, because the detector learns from "
            f"the other frames of the scene, got {check_frames}"
        )


def affordable(lidars: list[PlanLidar], costs: Costs, request: Request) -> list[PlanLidar]:
    """Returns the LiDARs that the budget can pay for. Raises Error if there is none."""
    prices = [costs.price([lidar], 0, 1).middle for lidar in lidars]
    good = [one for one, price in zip(lidars, prices, strict=True) if price <= request.budget_usd]
    if not good:
        cheapest = int(np.argmin(prices))
        raise Error(
            f"budget_usd: expected {math.ceil(prices[cheapest]):,} or more, the price of "
            f"{lidars[cheapest].name} on an existing mast, got {request.budget_usd:,.0f}"
        )
    return good


def lowest_prices(
    lidars: Sequence[PlanLidar], poses: pd.DataFrame, costs: Costs
) -> dict[str, float]:
    """Returns the price of each LiDAR alone, on an existing pole if there is one."""
    new = 0 if poses.existing.any() else 1
    return {one.name: costs.price([one], new, 1).middle for one in lidars}


def possible(
    poses: pd.DataFrame, lidars: Sequence[PlanLidar], costs: Costs, request: Request
) -> BoolArray:
    """Returns which pairs of pose and LiDAR are observed: (poses, lidars).

    Each is within the budget. A LiDAR that sees all around needs no second yaw at the same place.
    Raises Error if there is none.
    """
    first, existing = (poses.turn == 0).to_numpy(), poses.existing.to_numpy(bool)
    columns, least = [], math.inf
    for lidar in lidars:
        new, old = (costs.price([lidar], poles, 1).middle for poles in (1, 0))
        prices = np.where(existing, old, new)
        least = min(least, float(prices.min()))
        within = prices <= request.budget_usd
        columns.append(within & first if lidar.all_around else within)
    if least > request.budget_usd:
        raise Error(
            f"budget_usd: expected {math.ceil(least):,} or more for a pole with a LiDAR, got "
            f"{request.budget_usd:,.0f}; an existing mast costs less"
        )
    return np.stack(columns, 1)
