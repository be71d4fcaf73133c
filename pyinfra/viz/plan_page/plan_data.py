"""The data of a plan's page. Every figure comes from the plan; the page only chooses options."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from pyinfra.core.version import __version__
from pyinfra.experiments.planner.front import CELL_M, Cells, Front, distances, with_columns_of
from pyinfra.experiments.planner.plan import Plan
from pyinfra.viz.plan_page.site_map import site_map, window_of

FORMAT = 3  # of the file of the data
LEVELS = 50  # steps in which the share of a cell is stored
FIRST_CODE = 48  # character code of the share 0
COSTS = {
    "lidar_usd": "LiDARs",
    "pole_usd": "new poles",
    "installation_usd": "installation",
    "cable_usd": "cables",
    "computer_usd": "computers",
    "power_usd": "power",
    "upkeep_usd": "upkeep",
}
POWER = ("lidar_w", "computer_w", "usd_per_kwh")  # items of the line of power

Row = Mapping[str, Any]


def plan_data(plan: Plan) -> dict[str, Any]:
    """Returns the data of the page of a plan, which JSON can hold."""
    front, request, site = plan.front, plan.request, plan.site
    table = with_columns_of(front.table, plan.options)
    cells = front.cells
    poles = plan.candidates[["x_m", "y_m"]].to_numpy(float)
    window = window_of(np.concatenate([cells.corner_m, cells.corner_m + CELL_M, poles]))
    return {
        "format": FORMAT,
        "version": __version__,
        "site": site.name,
        "asked": plan.answer.lines[0],
        "lines": list(plan.answer.lines[1:]),
        "request": {
            "budget": request.budget_usd,
            "find": round(100 * request.find, 6),
            "poles": request.poles,
            "within": request.within_m,
            "years": request.years,
            "has_weights": bool(request.people or any(one.weight for one in request.areas)),
            "false_per_minute": request.false_per_minute
            if math.isfinite(request.false_per_minute)
            else None,
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


def unconfirmed(front: Front) -> list[str]:
    """Returns the LiDARs and the lines of a price that are unconfirmed."""
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
                "by": _rounded([first[f"{goal.column}_in_choice"] for goal in front.goals], 3),
                "weighted": _rounded([first["weighted_in_choice"]], 3)[0],
                "shares": [_interval(first, goal.column) for goal in front.goals],
                "false": _interval(first, "false_per_frame"),
                "keeps_false": bool(first["keeps_false"]),
                "keeps_false_in_choice": bool(first["keeps_false_in_choice"]),
                "ap": _interval(first, "ap_predicted"),
                "rain": _rounded([first.get("recall_in_rain", math.nan)])[0],
                "simulated": _simulated(first),
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


def _simulated(row: Row) -> dict[str, float | None] | None:
    """Returns the measured figures of an option, or None if it was not simulated."""
    if not math.isfinite(row.get("recall_simulated", math.nan)):
        return None
    names = ("ap", "recall", "people_recall", "false_per_frame", "position_m")
    keys = {name: f"{name}_simulated" for name in names}
    keys |= {"ap_low": "ap_simulated_low", "ap_high": "ap_simulated_high"}
    return {name: _rounded([row[key]], 2)[0] for name, key in keys.items()}


def _interval(row: Row, column: str, digits: int = 3) -> list[float | None]:
    return _rounded([row[f"{column}{end}"] for end in ("", "_low", "_high")], digits)


def _rounded(values: Sequence[float], digits: int = 1) -> list[float | None]:
    return [round(float(one), digits) if math.isfinite(one) else None for one in values]


def left_out(candidates: pd.DataFrame) -> list[dict[str, Any]]:
    """Returns what was left out and how often, grouped by reason; most frequent first."""
    some = candidates[candidates.left_out != ""]
    what = np.where(some.lidar == "", "pose", "pose and LiDAR")
    groups = some.groupby([what, some.left_out], sort=False).size().sort_values(ascending=False)
    return [
        {"what": str(kind), "reason": str(reason), "count": int(count)}
        for (kind, reason), count in groups.items()
    ]
