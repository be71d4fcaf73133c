"""How the choice of a plan changes with prices, and what it finds under other conditions.

The effects of prices and failures are computed from the shares by which options are chosen. With
`what_if`, the first option is simulated again in the same frames with a changed mast, traffic,
weather or sensor, and the differences are paired.
"""

import math
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain, product

import numpy as np
import pandas as pd

from pyinfra.core.arrays import FloatArray
from pyinfra.core.errors import Error, FindingWarning
from pyinfra.dataset.loading import with_meshes
from pyinfra.experiments.planner.check import near_vehicles, paired, share, simulate
from pyinfra.experiments.planner.choice import Choice, Units
from pyinfra.experiments.planner.observe import Setting, observed_again
from pyinfra.experiments.planner.predict import PREDICTED, SIMULATED, predict
from pyinfra.experiments.planner.request import Request
from pyinfra.experiments.planner.simulate import Found, Parts, simulate_option
from pyinfra.experiments.planner.site import PlanSite, other_traffic
from pyinfra.experiments.planner.verdict import Compared, in_order
from pyinfra.metrics.comparison import UNKNOWN, Interval, columns_of

COLUMNS = [
    "case", "option", "chosen", "lidars", "poles", "price_usd",
    "recall", "recall_low", "recall_high", "change", "change_low", "change_high", "source",
]  # fmt: skip
RAIN_MM_PER_H = 25.0  # rate of heavy rain
RAIN = f"rain {RAIN_MM_PER_H:g} mm/h"
IN_RAIN = {"weather.rain_mm_per_h": RAIN_MM_PER_H}
RAIN_FRAMES = 24
FURTHER_M, LOWER_M, TILT_DEG, YAW_DEG = 2.0, 0.5, 0.5, 0.5
LANE_M = 3.5
LORRY_SIZE_M = (12.0, 2.55, 4.0)  # largest lorry of two or three axles in the EU (96/53/EC)
CLEARANCE_M = 0.3  # clearance below the lorry's body
LORRY_M = 9.0  # distance from the lorry's middle within which objects are left out
BOX_FACES = [  # triangles of corner indices; 0 to 3 are the lower corners, 4 to 7 the upper
    (0, 2, 1), (0, 3, 2), (4, 5, 6), (4, 6, 7), (0, 1, 5), (0, 5, 4),
    (1, 2, 6), (1, 6, 5), (2, 3, 7), (2, 7, 6), (3, 0, 4), (3, 4, 7),
]  # fmt: skip
DENSITY = "traffic.vehicles_per_km_lane"
PERCENT = (-20, 20)
PER_POLE = ("pole_usd", "installation_usd", "upkeep_usd")
OTHERS = ("cable_usd", "computer_usd", "usd_per_kwh")
# Groups of prices that change together: whether LiDAR prices are in a group, and its cost items.
PRICES: dict[str, tuple[bool, tuple[str, ...]]] = {
    "LiDAR prices": (True, ()),
    "costs per pole": (False, PER_POLE),
    "all prices": (True, PER_POLE + OTHERS),
}


@dataclass(frozen=True)
class Move:
    """The choice after a change of prices; None if no option is then within the budget."""

    prices: str  # group of changed prices, a key of PRICES
    percent: int  # change of these prices
    choice: Choice | None


@dataclass(frozen=True)
class Case:
    """A change of the first option. `move` changes a pose (x y z yaw pitch), `scene` the scene."""

    name: str
    move: Callable[[FloatArray], FloatArray] = lambda pose: pose
    scene: Mapping[str, object] = field(default_factory=dict)
    lost: int | None = None  # number of a LiDAR that fails
    yaw_error_deg: float = 0.0
    # position x, y of a lorry; objects within LORRY_M of the position are left out
    without: tuple[float, float] | None = None


def cases_of(site: PlanSite, parts: Parts) -> list[Case]:
    """Returns the cases of `what_if` that a site and an option allow."""

    def further(pose: FloatArray) -> FloatArray:
        away = pose[:2] - site.centre
        return np.append(pose[:2] + FURTHER_M * away / max(np.hypot(*away), 1e-9), pose[2:])

    cases = [
        Case(f"mast {FURTHER_M:g} m further from the centre", further),
        Case(f"mast {LOWER_M:g} m lower", lambda pose: pose - np.array([0, 0, LOWER_M, 0, 0])),
        Case(
            f"pitch {TILT_DEG:g} degrees lower",
            lambda pose: pose + np.array([0, 0, 0, 0, TILT_DEG]),
        ),
        Case(f"yaw error {YAW_DEG:g} degrees", yaw_error_deg=YAW_DEG),
        standing_lorry(site, np.array(parts[0][0][:2], float)),
    ]
    density = float((site.keys.get("traffic") or {}).get("vehicles_per_km_lane") or 0)
    if density and not site.recorded:
        cases.append(Case("twice the traffic", scene={DENSITY: min(100.0, 2 * density)}))
    if site.has_weather:
        cases += [Case(RAIN, scene=IN_RAIN), Case("night", scene={"weather.sunlight_klux": 0})]
    if len(parts) > 1:
        cases += [Case(f"LiDAR {k + 1} lost", lost=k) for k in range(len(parts))]
    return cases


def standing_lorry(site: PlanSite, mast: FloatArray) -> Case:
    """Returns the case of a lorry that stands in the lane between a mast (x y) and the centre.

    The lorry is a static box. Vehicles near it are left out, because recorded traffic drives
    through it.
    """
    middle = (mast + site.centre) / 2
    road = min(site.roads, key=lambda one: np.hypot(*(one.xy - middle).T).min())
    k = int(np.hypot(*(road.xy - middle).T).argmin())
    along = np.array([np.cos(road.heading[k]), np.sin(road.heading[k])])
    left = np.array([-along[1], along[0]])
    aside = max(0.0, float(road.half_width[k]) - LANE_M / 2)
    at = road.xy[k] + left * aside * np.sign((mast - road.xy[k]) @ left)
    length, width, height = LORRY_SIZE_M
    foot = [
        at + a * length / 2 * along + b * width / 2 * left
        for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))
    ]
    corners = [[*xy, float(road.z[k]) + h] for h in (CLEARANCE_M, height) for xy in foot]
    scene = {"meshes": with_meshes(site.file, [("structure", corners, BOX_FACES)])}
    return Case("a lorry standing in a lane", scene=scene, without=(at[0], at[1]))


def moves_of(compared: Compared, request: Request) -> list[Move]:
    """Returns the choice among the options for each change of prices."""
    moves = []
    for prices, percent in product(PRICES, PERCENT):
        changed = with_prices(compared.units, prices, 1 + percent / 100)
        again = [replace(one, price=changed.price(one.units)) for one in compared.options]
        within = [one for one in again if one.price.middle <= request.budget_usd]
        then = in_order(within, compared.standings, request)
        moves.append(Move(prices, percent, next(iter(then), None)))
    return moves


def with_prices(units: Units, prices: str, factor: float) -> Units:
    """Returns the units with one kind of prices multiplied by a factor."""
    of_lidars, items = PRICES[prices]
    of_lidar = factor if of_lidars else 1.0
    lidars = [replace(one, price_usd=one.price_usd * of_lidar) for one in units.lidars]
    lines = {
        item: line * factor if item in items else line for item, line in units.costs.lines.items()
    }
    return replace(units, lidars=lidars, costs=replace(units.costs, lines=lines))


def losses(first: Choice, units: Units) -> dict[str, set[int]]:
    """Returns the units that are lost in each case: one LiDAR, or a pole with several LiDARs."""
    cases = {f"LiDAR {k} lost": {u} for k, u in enumerate(first.units, start=1)}
    for k, pole in enumerate(units.poles(first.units), start=1):
        lost = {u for u in first.units if int(units.place[u]) == pole}
        if len(lost) > 1:
            cases[f"pole {k} lost"] = lost
    return cases


def recall_in_rain(compared: Compared, setting: Setting) -> list[Interval]:
    """Returns the predicted share of vehicles of each listed option in rain.

    The list is empty if the preset has no weather or no vehicle is near.
    """
    if not setting.site.has_weather:
        return []
    wet_site = other_traffic(setting.site, min(setting.request.frames, RAIN_FRAMES), IN_RAIN)
    options = [one.units for one in compared.options[: compared.listed]]
    rainy = observed_again(setting, wet_site, compared.unseen.stayed, chain(*options))
    if not rainy.objects.near_vehicles.any():
        return []
    return [predict(rainy, one, setting.law, setting.request).standing.recall for one in options]


Row = dict[str, object]


def sensitivity_table(rows: Sequence[Row]) -> pd.DataFrame:
    """Returns the rows as a table. Of rows with the same case, it has only the last."""
    table = pd.DataFrame(rows, columns=COLUMNS)
    return table.drop_duplicates("case", keep="last", ignore_index=True)


def computed_rows(
    compared: Compared, moves: Iterable[Move], in_rain: Iterable[Interval]
) -> Iterator[Row]:
    """Yields a row for each case: other prices, the loss of LiDARs and poles, and rain.

    `chosen` is yes if an option is chosen in a case. Recall is in percent of the vehicles within
    the distance of the request. For a loss it is the predicted share.
    """
    first = compared.first
    now = compared.standings[first.units]
    yield case_row(compared, "as asked", first, now.recall, now.source)
    for move in moves:
        case = f"{move.prices} {move.percent:+d} %"
        if move.choice is None:
            yield {"case": case, "option": math.nan, "chosen": "no"}
        else:
            then = compared.standings[move.choice.units]
            yield case_row(compared, case, move.choice, then.recall, then.source)
    for case, lost in losses(first, compared.units).items():
        left = tuple(u for u in first.units if u not in lost)
        recall = compared.predicted(left).standing.recall if left else Interval(0.0, 0.0, 0.0)
        yield case_row(compared, case, first, recall, PREDICTED)
    for recall in in_rain:
        yield case_row(compared, RAIN, first, recall, PREDICTED)


def simulated_rows(
    compared: Compared, setting: Setting, parts: Parts, found: Mapping[tuple[int, ...], Found]
) -> Iterator[Row]:
    """Yields a row for each case of `what_if`, simulated in the frames of the check.

    A case that the simulator refuses has no row, and a warning names it.

    found: result of each simulated option, by units.
    """
    first = compared.first
    before = found.get(first.units) or simulate(first, compared, setting)
    site, request, cut = setting.site, setting.request, compared.predicted(first.units).cut
    for case in cases_of(site, parts):
        moved = [
            (case.move(np.array(pose, float)).tolist(), lidar)
            for k, (pose, lidar) in enumerate(parts)
            if k != case.lost
        ]
        try:
            after = simulate_option(
                site, moved, request.detector, cut, setting.effort.check_frames,
                scene=case.scene, yaw_error_deg=case.yaw_error_deg,
            )  # fmt: skip
        except Error as error:  # for example, the mast was moved into a house
            text = f"what if: {case.name}: left out, because the simulator refuses it: {error}"
            warnings.warn(text, FindingWarning, stacklevel=2)
            continue
        now, then = (away_from(one, case.without) for one in (before, after))
        recall = share(then, near_vehicles(then, site, request.within_m))
        change = paired(now, then, site, request.within_m)
        yield case_row(compared, case.name, first, recall, SIMULATED, change)
        setting.effort.tell(f"what if: {case.name}")


def away_from(found: Found, at: tuple[float, float] | None) -> Found:
    """Returns the result of a simulation without the objects within LORRY_M of a position."""
    if at is None:
        return found
    away = np.hypot(found.objects.x - at[0], found.objects.y - at[1])
    return replace(found, objects=found.objects[away > LORRY_M].reset_index(drop=True))


def case_row(
    compared: Compared,
    case: str,
    choice: Choice,
    recall: Interval,
    source: str,
    change: Interval = UNKNOWN,
) -> Row:
    """Returns the row of an option that is chosen in a case."""
    return {
        "case": case,
        "option": compared.number(choice),
        "chosen": "yes",
        "lidars": " + ".join(compared.units.names(choice.units)),
        "poles": len(compared.units.poles(choice.units)),
        "price_usd": choice.price.middle,
        **columns_of("recall", recall, 100),
        **columns_of("change", change, 100),
        "source": source,
    }
