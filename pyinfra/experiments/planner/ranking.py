"""Orders the options of a plan, and says which are listed and which are of the front alone."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from pyinfra.experiments.planner.answer import LISTED
from pyinfra.experiments.planner.choice import Choice, Units, upper_bound
from pyinfra.experiments.planner.predict import Prediction
from pyinfra.experiments.planner.request import Request

Predicted = tuple[Choice, Prediction]


def ranked(
    options: Sequence[Choice],
    front: Sequence[Choice],
    units: Units,
    request: Request,
    predict: Callable[[Choice], Prediction],
) -> tuple[list[Predicted], list[Predicted]]:
    """Returns the options that are listed, the chosen one first, and the others of the front.

    options: those that are listed in any case. The best options of the front are listed too.
    """
    listed = {_key(one): one for one in options}
    every = {_key(one): with_bound(one, options, units, request) for one in front} | listed
    order = in_order([(one, predict(one)) for one in every.values()], request)
    first = [k < LISTED or _key(choice) in listed for k, (choice, _) in enumerate(order)]
    return (
        [one for one, is_listed in zip(order, first, strict=True) if is_listed],
        [one for one, is_listed in zip(order, first, strict=True) if not is_listed],
    )


def with_bound(one: Choice, options: Sequence[Choice], units: Units, request: Request) -> Choice:
    """Returns an option of the front with its value for the plan's weights, and their bound."""
    value, count = units.value(one.units), len(one.units)
    bounds = [other.bound for other in options if len(other.units) == count]
    bound = bounds[0] if bounds else upper_bound(units, [*one.units], request.budget_usd, count)
    return replace(one, value=value, bound=bound)


def in_order(options: Sequence[Predicted], request: Request) -> list[Predicted]:
    """Returns the options, the chosen one first.

    Options that find enough come first, the cheapest first. The others follow, ordered by the
    share that they find.
    """

    def key(one: Predicted) -> tuple[float, float, float]:
        choice, prediction = one
        if prediction.recall.value >= request.find and prediction.keeps_false:
            return 0, choice.price.middle, -prediction.recall.value
        return 1, -prediction.recall.value, choice.price.middle

    return sorted(options, key=key)


def _key(one: Choice) -> tuple[int, ...]:
    return tuple(sorted(one.units))
