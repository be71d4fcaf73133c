"""The data of a plan's page. Every figure comes from the plan; the page only chooses options."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from pyinfra.core.version import __version__
from pyinfra.experiments.planner.front import CELL_M, Cells, Front
from pyinfra.experiments.planner.plan import Plan
from pyinfra.experiments.planner.predict import SIMULATED
from pyinfra.experiments.planner.request import distances
from pyinfra.viz.plan_page.site_map import site_map, window_of

FORMAT = 4  # version of the format of the data
LEVELS = 50  # number of steps in which a cell's share of found vehicles is stored
FIRST_CODE = 48  # code of the character that stores the share 0
COSTS = {
    "lidar_usd": "LiDARs",
    "pole_usd": "new poles",
    "installation_usd": "installation",
    "cable_usd": "cables",
    "computer_usd": "computers",
    "power_usd": "power",
    "upkeep_usd": "upkeep",
}
POWER = ("lidar_w", "computer_w", "usd_per_kwh")  # items that the page combines as `power`

Row = Mapping[str, Any]


def plan_data(plan: Plan) -> dict[str, Any]:
    """Returns the data of the page of a plan, in types that JSON supports."""
    front, request, site = plan.front, plan.request, plan.site
    table = front.table
    cells = front.cells
    poles = plan.candidates[["x_m", "y_m"]].to_numpy(float)
    window = window_of(np.concatenate([cells.corner_m, cells.corner_m + CELL_M, poles]))
    return {
        "format": FORMAT,
        "version": __version__,
        "site": site.name,
        "asked": plan.answer.lines[0],
        "lines": [*plan.answer.lines[1:], *plan.answer.notes],
        "verdict": plan.answer.verdict,
        "signed": list(plan.answer.lines),
        "request": {
            "budget": request.budget_usd,
            "find": round(100 * request.find, 6),
            "poles": request.poles,
            "within": request.within_m,
            "years": request.years,
            "most_false": limit(request.most_false),
            "has_weights": bool(request.people or any(one.weight for one in request.areas)),
            "false_per_minute": limit(request.false_per_minute),
        },
        "centre": [round(float(value), 1) for value in site.centre],
        "frames": front.frames,
        "pilot": front.pilot,
        "unconfirmed": unconfirmed(front),
        "distances": distances(front.goals),
        "goals": [{"what": one.what, "within": one.within_m} for one in front.goals],
        "lidars": sorted(set(table.lidar)),
        "above_budget": {name: round(usd) for name, usd in sorted(plan.above_budget.items())},
        "costs": list(COSTS.values()),
        "cell_m": CELL_M,
        "cells": [[*map(int, at)] for at in cells.corner_m],
        "vehicles": [int(count) for count in cells.vehicles],
        "options": _options(front, table, cells),
        "left_out": left_out(plan.candidates),
        "map_ratio": round(float(window.size[0] / window.size[1]), 3),
        "map": site_map(site, window, plan.candidates, request.areas),
    }


def limit(value: float) -> float | None:
    """Returns a limit, or None if it is infinite."""
    return value if math.isfinite(value) else None


def unconfirmed(front: Front) -> list[str]:
    """Returns the names of the LiDARs and cost items whose price is unconfirmed."""
    names = ["power" if name in POWER else COSTS.get(name, name) for name in front.unconfirmed]
    return list(dict.fromkeys(names))


def _options(front: Front, table: pd.DataFrame, cells: Cells) -> list[dict[str, Any]]:
    costs = dict(tuple(front.costs.groupby("option")))
    options = []
    for (number, rows), share, text in zip(
        table.groupby("option"), cells.recall, front.sentences, strict=True
    ):
        first = rows.iloc[0].to_dict()
        lines = costs[number].set_index("item")
        options.append(
            {
                "number": int(number),
                "units": [_unit(row) for row in rows.to_dict("records")],
                "poles": int(first["poles"]),
                "price": _rounded([first[f"price_usd{end}"] for end in ("", "_low", "_high")], 2),
                "weighted": _rounded([first["weighted"]], 3)[0],
                "source": str(first["source"]),
                "shares": [_deciding(first, goal.column) for goal in front.goals],
                "predicted": _interval(first, "recall"),
                "false": _false(first),
                "false_predicted": _interval(first, "false_per_frame"),
                "ap": _interval(first, "ap_simulated" if _is_done(first) else "ap_predicted"),
                "ap_predicted": _interval(first, "ap_predicted"),
                "position": _rounded([first["position_m_simulated"]], 2)[0],
                "rain": _rounded([first.get("recall_in_rain", math.nan)])[0],
                "method": str(first["method"]),
                "text": list(text),
                "costs": [
                    _rounded([lines.low_usd[item], lines.high_usd[item]], 2) for item in COSTS
                ],
                "cells": "".join(chr(FIRST_CODE + round(LEVELS * one)) for one in share),
            }
        )
    return options


def _unit(row: Row) -> dict[str, Any]:
    names = ("x_m", "y_m", "z_m", "height_m", "yaw_deg", "pitch_deg")
    return {
        "lidar": row["lidar"],
        "existing": bool(row["existing"]),
        **{name: round(float(row[name]), 2) for name in names},
    }


def _is_done(row: Row) -> bool:
    return bool(row["source"] == SIMULATED)


def _deciding(row: Row, column: str) -> list[float | None]:
    """Returns the share of a goal with its interval: simulated if known, else predicted."""
    done = math.isfinite(row.get(f"{column}_simulated", math.nan))
    return _interval(row, f"{column}_simulated" if done else column)


def _false(row: Row) -> list[float | None]:
    """Returns the false boxes per frame with their interval: simulated if known, else predicted.

    If no score keeps the requested rate, the interval begins at the predicted rate.
    """
    if _is_done(row):
        return _interval(row, "false_per_frame_simulated")
    value, low, high = _interval(row, "false_per_frame")
    return [value, low if row["keeps_false"] else value, high]


def _interval(row: Row, column: str, digits: int = 3) -> list[float | None]:
    return _rounded([row[f"{column}{end}"] for end in ("", "_low", "_high")], digits)


def _rounded(values: Sequence[float], digits: int = 1) -> list[float | None]:
    return [round(float(one), digits) if math.isfinite(one) else None for one in values]


def left_out(candidates: pd.DataFrame) -> list[dict[str, Any]]:
    """Returns the numbers of left-out poses and pairs by reason, the most frequent reason first."""
    some = candidates[candidates.left_out != ""]
    what = np.where(some.lidar == "", "pose", "pose and LiDAR")
    groups = some.groupby([what, some.left_out], sort=False).size().sort_values(ascending=False)
    return [
        {"what": str(kind), "reason": str(reason), "count": int(count)}
        for (kind, reason), count in groups.items()
    ]
