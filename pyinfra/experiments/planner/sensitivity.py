"""How the choice of a plan changes with prices, failures, rain and a wrong yaw of the mounts."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence

import pandas as pd

from pyinfra.experiments.planner.check import YAW_ERROR_DEG, YawError
from pyinfra.experiments.planner.choice import Choice, Units
from pyinfra.experiments.planner.decide import PERCENT, Move
from pyinfra.experiments.planner.predict import Prediction
from pyinfra.experiments.planner.rain import RAIN_MM_PER_H
from pyinfra.metrics.comparison import Interval

AS_ASKED = "as asked"
COLUMNS = [
    "case", "option", "chosen", "lidars", "poles", "price_usd",
    "recall", "recall_low", "recall_high", "source",
]  # fmt: skip
NOTHING_DETECTED = Interval(0.0, 0.0, 0.0)
Predict = Callable[[tuple[int, ...]], Prediction]


def table_of(
    options: Sequence[Choice], moves: Sequence[Move], units: Units, predicted: Predict
) -> pd.DataFrame:
    """Returns a row for each case and option: other prices, and the loss of LiDARs and poles.

    `chosen` is yes for the option that is chosen in a case, and no for option 1 beside it. Recall
    in percent of the vehicles within the distance of the request.
    """
    first = options[0]
    number = {frozenset(one.units): k for k, one in enumerate(options, start=1)}
    rows = [row(AS_ASKED, 1, first, units, predicted(first.units).recall)]
    for move in moves:
        case = f"{move.prices} {move.percent:+d} %"
        if move.choice is None:
            rows.append({"case": case, "option": math.nan, "chosen": "no"})
            continue
        k = number.get(frozenset(move.choice.units), math.nan)
        rows.append(row(case, k, move.choice, units, predicted(move.choice.units).recall))
    for case, lost in losses(first, units).items():
        left = tuple(u for u in first.units if u not in lost)
        recall = predicted(left).recall if left else NOTHING_DETECTED
        rows.append(row(case, 1, first, units, recall))
    return pd.DataFrame(rows, columns=COLUMNS)


def row(
    case: str,
    option: float,
    choice: Choice,
    units: Units,
    recall: Interval,
    *,
    chosen: bool = True,
    source: str = "predicted",
) -> dict[str, object]:
    return {
        "case": case,
        "option": option,
        "chosen": "yes" if chosen else "no",
        "lidars": " + ".join(units.lidars[u].name for u in choice.units),
        "poles": len({int(units.place[u]) for u in choice.units}),
        "price_usd": choice.price.middle,
        "recall": 100 * recall.value,
        "recall_low": 100 * recall.low,
        "recall_high": 100 * recall.high,
        "source": source,
    }


def losses(first: Choice, units: Units) -> dict[str, set[int]]:
    """Returns the units that are lost in each case: each LiDAR, and each pole of several."""
    cases = {f"LiDAR {k} lost": {u} for k, u in enumerate(first.units, start=1)}
    poles = list(dict.fromkeys(int(units.place[u]) for u in first.units))
    for k, pole in enumerate(poles, start=1):
        lost = {u for u in first.units if int(units.place[u]) == pole}
        if len(lost) > 1:
            cases[f"pole {k} lost"] = lost
    return cases


def with_rain(
    table: pd.DataFrame,
    options: Sequence[Choice],
    wet: Sequence[Prediction],
    units: Units,
    find: float,
) -> pd.DataFrame:
    """Returns the table with the option that is chosen in rain, and option 1 if it is another."""
    enough = [k for k, one in enumerate(wet) if one.recall.value >= find and one.keeps_false]
    if enough:
        best = min(enough, key=lambda k: options[k].price.middle)
    else:
        best = max(range(len(wet)), key=lambda k: wet[k].weighted)
    case = f"rain {RAIN_MM_PER_H:g} mm/h"
    rows = [
        row(case, k + 1, options[k], units, wet[k].recall, chosen=k == best)
        for k in dict.fromkeys((best, 0))
    ]
    return pd.concat([table, pd.DataFrame(rows, columns=COLUMNS)], ignore_index=True)


def price_lines(
    moves: Sequence[Move], options: Sequence[Choice], units: Units, predicted: Predict
) -> Iterator[str]:
    """Yields how the choice changes with prices."""
    number = {frozenset(one.units): k for k, one in enumerate(options, start=1)}
    same = [one for one in moves if one.choice and number.get(frozenset(one.choice.units)) == 1]
    if len(same) == len(moves):
        kinds = list(dict.fromkeys(one.prices for one in moves))
        yield (
            f"The choice stays the same if {', '.join(kinds[:-1])} or {kinds[-1]} rise or fall by "
            f"{max(PERCENT)} %."
        )
        return
    for move in moves:
        if move in same:
            continue
        way = "rise" if move.percent > 0 else "fall"
        start = f"If {move.prices} {way} by {abs(move.percent)} %,"
        if move.choice is None:
            yield f"{start} no option is within the budget."
            continue
        names = " and ".join(units.lidars[u].name for u in move.choice.units)
        k = number.get(frozenset(move.choice.units))
        today = units.price(move.choice.units).middle
        which = f"option {k} ({names})" if k else f"an option of US$ {today:,.0f} today ({names})"
        yield (
            f"{start} the choice is {which}, which finds "
            f"{100 * predicted(move.choice.units).recall.value:.0f} of 100 for "
            f"US$ {move.choice.price.middle:,.0f}."
        )
    if same:
        yield f"With the other price changes of {max(PERCENT)} %, the choice stays the same."


def loss_lines(table: pd.DataFrame) -> Iterator[str]:
    """Yields what is left of an option of several LiDARs when one of them or a pole fails."""
    lost = table[table.case.str.endswith(" lost")]
    if len(lost) > 1:
        texts = [
            f"{row.recall:.0f} without {row.case.removesuffix(' lost')}"
            for row in lost.itertuples()
        ]
        yield f"Of 100 vehicles, the first option finds {', '.join(texts)}."


def with_yaw_errors(
    table: pd.DataFrame, options: pd.DataFrame, errors: Sequence[YawError]
) -> pd.DataFrame:
    """Returns the table with the options that were simulated with an error of the yaw."""
    rows = []
    for error in errors:
        units = options[options.option == error.option]
        rows.append(
            {
                "case": f"yaw error {YAW_ERROR_DEG:g} deg",
                "option": error.option,
                "chosen": "yes" if error.option == 1 else "no",
                "lidars": " + ".join(units.lidar),
                "poles": units.poles.iloc[0],
                "price_usd": units.price_usd.iloc[0],
                "recall": error.with_error,
                "source": "measured",
            }
        )
    return pd.concat([table, pd.DataFrame(rows, columns=COLUMNS)], ignore_index=True)


def yaw_lines(errors: Sequence[YawError]) -> Iterator[str]:
    """Yields a sentence with the measured recall of each option with and without a yaw error.

    It adds whether the last option then finds more than the first one.
    """
    known = [one for one in errors if math.isfinite(one.without)]
    if not known:
        return
    texts = [
        f"option {one.option} finds {one.with_error:.0f} of 100 ({one.without:.0f} without)"
        for one in known
    ]
    text = f"With a yaw error of {YAW_ERROR_DEG:g} degrees, {' and '.join(texts)}"
    first, last = known[0], known[-1]
    if first.without >= last.without and round(first.with_error) < round(last.with_error):
        text += f"; option {last.option} finds more then"
    yield f"{text}."
