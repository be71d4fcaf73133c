"""How the choice of a plan changes with prices, and what it finds when something else changes.

Prices and failures are computed from the shares that decide. With `what_if`, the first option is
simulated again in the same frames with a changed mast, traffic, weather or sensor, and the
differences are paired.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import pandas as pd

from pyinfra.core.arrays import FloatArray
from pyinfra.dataset.loading import with_meshes
from pyinfra.experiments.planner.check import (
    Found,
    Parts,
    near_vehicles,
    paired,
    share,
    simulate_option,
)
from pyinfra.experiments.planner.choice import Choice, Units
from pyinfra.experiments.planner.decide import PERCENT, Move
from pyinfra.experiments.planner.predict import UNKNOWN, Prediction
from pyinfra.experiments.planner.site import PlanSite
from pyinfra.experiments.planner.tables import Standings, ends
from pyinfra.experiments.planner.verdict import PREDICTED, SIMULATED
from pyinfra.metrics.comparison import Interval

AS_ASKED = "as asked"
COLUMNS = [
    "case", "option", "chosen", "lidars", "poles", "price_usd",
    "recall", "recall_low", "recall_high", "change", "change_low", "change_high", "source",
]  # fmt: skip
NOTHING_DETECTED = Interval(0.0, 0.0, 0.0)
RAIN_MM_PER_H = 25.0  # heavy rain
FURTHER_M, LOWER_M, TILT_DEG, YAW_DEG = 2.0, 0.5, 0.5, 0.5
WITH_WEATHER = "datasheet"  # the preset whose LiDARs detect by received power
LANE_M = 3.5
LORRY_SIZE_M = (12.0, 2.55, 4.0)  # largest lorry of two or three axles in the EU (96/53/EC)
CLEARANCE_M = 0.3  # below its body
LORRY_M = 9.0  # from the middle of the lorry
BOX_FACES = [  # of the corners of a box: the lower four, then the upper four
    (0, 2, 1), (0, 3, 2), (4, 5, 6), (4, 6, 7), (0, 1, 5), (0, 5, 4),
    (1, 2, 6), (1, 6, 5), (2, 3, 7), (2, 7, 6), (3, 0, 4), (3, 4, 7),
]  # fmt: skip
DENSITY = "traffic.vehicles_per_km_lane"

Predict = Callable[[tuple[int, ...]], Prediction]


@dataclass(frozen=True)
class Case:
    """A change of the first option. `move` changes a pose (x y z yaw pitch), `scene` the scene."""

    name: str
    move: Callable[[FloatArray], FloatArray] = lambda pose: pose
    scene: Mapping[str, object] = field(default_factory=dict)
    lost: int | None = None  # number of a LiDAR that fails
    yaw_error_deg: float = 0.0
    without: tuple[float, float] | None = None  # x y; objects within LORRY_M of it do not count


def cases_of(site: PlanSite, parts: Parts) -> list[Case]:
    """Returns the cases of `what_if` that a site and an option allow."""

    def further(pose: FloatArray) -> FloatArray:
        away = pose[:2] - site.centre
        step = FURTHER_M * away / max(float(np.hypot(*away)), 1e-9)
        return np.concatenate([pose[:2] + step, pose[2:]])

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
    if not site.recorded and (density := density_of(site)):
        cases.append(Case("twice the traffic", scene={DENSITY: min(100.0, 2 * density)}))
    if site.preset == WITH_WEATHER:
        cases.append(Case(RAIN, scene={"weather.rain_mm_per_h": RAIN_MM_PER_H}))
        cases.append(Case("night", scene={"weather.sunlight_klux": 0}))
    if len(parts) > 1:
        cases += [Case(f"LiDAR {k + 1} lost", lost=k) for k in range(len(parts))]
    return cases


def standing_lorry(site: PlanSite, mast: FloatArray) -> Case:
    """Returns the case of a lorry that stands in the lane between a mast (x y) and the centre.

    The lorry is a static box. Vehicles near it do not count, because recorded traffic drives
    through it.
    """
    middle = (mast + site.centre) / 2
    road = min(site.roads, key=lambda one: np.hypot(*(one.xy - middle).T).min())
    k = int(np.hypot(*(road.xy - middle).T).argmin())
    left = np.array([-np.sin(road.heading[k]), np.cos(road.heading[k])])
    aside = max(0.0, float(road.half_width[k]) - LANE_M / 2)
    at = road.xy[k] + left * aside * np.sign((mast - road.xy[k]) @ left)
    along = np.array([np.cos(road.heading[k]), np.sin(road.heading[k])])
    length, width, height = LORRY_SIZE_M
    foot = [
        at + a * length / 2 * along + b * width / 2 * left
        for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))
    ]
    z = float(road.z[k])
    corners = [[*xy, z + h] for h in (CLEARANCE_M, height) for xy in foot]
    meshes = with_meshes(site.file, [("structure", corners, BOX_FACES)])
    return Case("a lorry standing in a lane", scene={"meshes": meshes}, without=(at[0], at[1]))


def away_from(found: Found, at: tuple[float, float] | None) -> Found:
    """Returns what was found without the objects within LORRY_M of a place."""
    if at is None:
        return found
    away = np.hypot(found.objects.x - at[0], found.objects.y - at[1])
    return replace(found, objects=found.objects[away > LORRY_M].reset_index(drop=True))


RAIN = f"rain {RAIN_MM_PER_H:g} mm/h"


def density_of(site: PlanSite) -> float:
    """Returns the vehicles per km and lane of the scene; 0 if it has none."""
    traffic = site.keys.get("traffic") or {}
    return float(traffic.get("vehicles_per_km_lane") or 0)


def changed_rows(
    site: PlanSite,
    parts: Parts,
    detector: str,
    within_m: float,
    cut: float,
    before: Found,
    frames: int,
    cases: Sequence[Case],
    progress: Callable[[str], None],
) -> Iterator[dict[str, object]]:
    """Yields a row for each case, simulated in the frames of `before`.

    before: the first option as it was simulated, by `simulate_option`.
    """
    for case in cases:
        kept = [one for k, one in enumerate(parts) if k != case.lost]
        moved = [(case.move(np.array(pose, float)).tolist(), lidar) for pose, lidar in kept]
        found = simulate_option(
            site, moved, detector, cut, frames,
            scene=case.scene, yaw_error_deg=case.yaw_error_deg,
        )  # fmt: skip
        found, same = away_from(found, case.without), away_from(before, case.without)
        counted = near_vehicles(found, site, within_m)
        change = paired(same, found, site, within_m)
        row = {"case": case.name, "option": 1, "chosen": "yes", "source": SIMULATED}
        yield row | ends("recall", share(found, counted), 100) | ends("change", change, 100)
        progress(f"what if: {case.name}")


def table_of(
    options: Sequence[Choice],
    standings: Standings,
    moves: Sequence[Move],
    units: Units,
    predicted: Predict,
) -> pd.DataFrame:
    """Returns a row for each case and option: other prices, and the loss of LiDARs and poles.

    `chosen` is yes for the option that is chosen in a case. Recall in percent of the vehicles
    within the distance of the request; of a loss, the predicted share.
    """
    first = options[0]
    number = {one.units: k for k, one in enumerate(options, start=1)}

    def row(case: str, choice: Choice, recall: Interval, source: str) -> dict[str, object]:
        return {
            "case": case,
            "option": number[choice.units],
            "chosen": "yes",
            "lidars": " + ".join(units.lidars[u].name for u in choice.units),
            "poles": len({int(units.place[u]) for u in choice.units}),
            "price_usd": choice.price.middle,
            **ends("recall", recall, 100),
            **ends("change", UNKNOWN),
            "source": source,
        }

    now = standings[first.units]
    rows = [row(AS_ASKED, first, now.recall, now.source)]
    for move in moves:
        case = f"{move.prices} {move.percent:+d} %"
        if move.choice is None:
            rows.append({"case": case, "option": math.nan, "chosen": "no"})
        else:
            then = standings[move.choice.units]
            rows.append(row(case, move.choice, then.recall, then.source))
    for case, lost in losses(first, units).items():
        left = tuple(u for u in first.units if u not in lost)
        recall = predicted(left).recall if left else NOTHING_DETECTED
        rows.append(row(case, first, recall, PREDICTED))
    return pd.DataFrame(rows, columns=COLUMNS)


def losses(first: Choice, units: Units) -> dict[str, set[int]]:
    """Returns the units that are lost in each case: each LiDAR, and each pole of several."""
    cases = {f"LiDAR {k} lost": {u} for k, u in enumerate(first.units, start=1)}
    poles = list(dict.fromkeys(int(units.place[u]) for u in first.units))
    for k, pole in enumerate(poles, start=1):
        lost = {u for u in first.units if int(units.place[u]) == pole}
        if len(lost) > 1:
            cases[f"pole {k} lost"] = lost
    return cases


def with_rows(table: pd.DataFrame, rows: Sequence[dict[str, object]]) -> pd.DataFrame:
    """Returns the table with rows of the first option, which get its LiDARs and price.

    A case that was simulated replaces the same case that was predicted.
    """
    if not rows:
        return table
    first = table.iloc[0][["lidars", "poles", "price_usd"]].to_dict()
    more = pd.DataFrame([row | first for row in rows], columns=COLUMNS)
    return pd.concat([table[~table.case.isin(more.case)], more], ignore_index=True)


def rain_rows(shares: Sequence[Interval]) -> list[dict[str, object]]:
    """Returns the row of the first option in rain, if its predicted share is known."""
    row = {"case": RAIN, "option": 1, "chosen": "yes", "source": PREDICTED}
    return [row | ends("recall", share, 100) for share in shares[:1]]


def price_line(
    moves: Sequence[Move], options: Sequence[Choice], units: Units, at: Standings
) -> str:
    """Returns how the choice changes with prices."""
    number = {one.units: k for k, one in enumerate(options, start=1)}
    same = [one for one in moves if one.choice and number[one.choice.units] == 1]
    if len(same) == len(moves):
        kinds = list(dict.fromkeys(one.prices for one in moves))
        return (
            f"The choice stays the same if {', '.join(kinds[:-1])} or {kinds[-1]} rise or fall by "
            f"{max(PERCENT)} %."
        )
    texts = []
    for move in moves:
        if move in same:
            continue
        start = (
            f"If {move.prices} {'rise' if move.percent > 0 else 'fall'} by {abs(move.percent)} %,"
        )
        if move.choice is None:
            texts.append(f"{start} no option is within the budget.")
            continue
        names = " and ".join(units.lidars[u].name for u in move.choice.units)
        texts.append(
            f"{start} the choice is option {number[move.choice.units]} ({names}), which finds "
            f"{100 * at[move.choice.units].recall.value:.0f} of 100 for "
            f"US$ {move.choice.price.middle:,.0f}."
        )
    if same:
        texts.append(
            f"With the other price changes of {max(PERCENT)} %, the choice stays the same."
        )
    return " ".join(texts)


def change_line(table: pd.DataFrame) -> str:
    """Returns what the first option finds when a LiDAR fails or something else changes."""
    lost = table[table.case.str.endswith(" lost") & (table.recall > 0)]
    texts = [
        f"{row.recall:.0f} of 100 without {row.case.removesuffix(' lost')} ({row.source})"
        for row in lost.itertuples()
    ]
    others = table[table.case.isin([RAIN]) & (table.source == PREDICTED)]
    texts += [f"{row.recall:.0f} in {row.case} ({row.source})" for row in others.itertuples()]
    done = table[(table.source == SIMULATED) & table.change.notna() & ~table.index.isin(lost.index)]
    texts += [
        f"{row.recall:.0f} with {row.case} ({row.change:+.0f} [{row.change_low:+.0f} to "
        f"{row.change_high:+.0f}])"
        for row in done.itertuples()
    ]
    return f"The first option finds {', '.join(texts)}." if texts else ""
