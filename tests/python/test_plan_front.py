"""The front of a plan: the options that are best for some budget, poles and LiDARs."""

import itertools
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from pyinfra.experiments.planner import detectability as laws
from pyinfra.experiments.planner.choice import Choice, Units
from pyinfra.experiments.planner.costs import open_lidars, read_costs
from pyinfra.experiments.planner.front import front_options
from pyinfra.experiments.planner.request import Area, Goal, Request, goals_of, with_objects
from pyinfra.experiments.planner.site import open_site

COUNT, OBJECTS = 9, 30


@pytest.fixture(scope="module")
def units() -> Units:
    """Nine units of three LiDARs on five poles, two of which exist."""
    rng = np.random.default_rng(5)
    lidars = open_lidars(["helios_16", "hesai_xt32", "livox_avia"], open_site("crossroad", 1))
    place = np.arange(COUNT) // 2
    return Units(
        probability=rng.uniform(0, 0.8, (COUNT, OBJECTS)).astype(np.float32),
        weight=np.ones(OBJECTS),
        place=place,
        existing=place < 2,
        lidars=[lidars[u % 3] for u in range(COUNT)],
        costs=read_costs(None, 5, laws.read_detectability("generalist")),
    )


def every_option(units: Units, request: Request) -> list[tuple[int, ...]]:
    sets = [*itertools.combinations(range(COUNT), 1), *itertools.combinations(range(COUNT), 2)]
    return [one for one in sets if allowed(units, one, request)]


def allowed(units: Units, one: tuple[int, ...], request: Request) -> bool:
    poles = [int(units.place[u]) for u in one]
    return len(set(poles)) <= request.poles and max(map(poles.count, poles)) <= (
        request.lidars_per_pole
    )


def best(units: Units, options: list[tuple[int, ...]], **limits: object) -> float:
    """The largest value within a budget, a number of poles, and LiDARs that are allowed."""
    return max(
        (
            units.value(one)
            for one in options
            if units.price(one).middle <= limits["budget"]
            and len({int(units.place[u]) for u in one}) <= limits["poles"]
            and {units.lidars[u].name for u in one} <= limits["lidars"]
        ),
        default=0.0,
    )


@pytest.mark.parametrize(("most_poles", "per_pole"), [(2, 1), (1, 2)])
def test_the_front_holds_the_best_option_for_every_budget_pole_and_lidar(
    units: Units, most_poles: int, per_pole: int
) -> None:
    request = Request(20_000, poles=most_poles, lidars_per_pole=per_pole)
    rng = np.random.default_rng(1)
    counted = [np.ones(OBJECTS, bool), rng.uniform(size=OBJECTS) < 0.4]
    goals = [Goal(f"recall_{k}", "vehicles", 60.0, one) for k, one in enumerate(counted)]
    front = [one.units for one in front_options(units, goals, request)]
    every = every_option(units, request)
    assert len(front) < len(every)
    names = sorted({one.name for one in units.lidars})
    for mask in counted:
        part = replace(units, weight=mask.astype(float))
        for count in (1, 2, 3):
            for some in itertools.combinations(names, count):
                for budget in (6000, 8000, 11_000, 14_000, 20_000):
                    for poles in (1, 2):
                        limits = {"budget": budget, "poles": poles, "lidars": set(some)}
                        assert best(part, front, **limits) == pytest.approx(
                            best(part, every, **limits), abs=1e-6
                        )


def test_more_than_two_lidars_are_of_the_front_within_the_budget(units: Units) -> None:
    goal = Goal("recall", "vehicles", 60.0, np.ones(OBJECTS, bool))
    request = Request(40_000, poles=4)
    front: list[Choice] = front_options(units, [goal], request)
    assert max(len(one.units) for one in front) == 4
    assert all(one.price.middle <= 40_000 for one in front)
    assert all(allowed(units, one.units, request) for one in front)


def test_goals_are_classes_within_distances_and_areas() -> None:
    """Two cars are 20 m and 70 m from the centre, and a pedestrian is 40 m from it."""
    table = pd.DataFrame(
        {"x": [20.0, 70.0, 0.0], "y": [0.0, 0.0, 40.0], "person": [False, False, True]}
    )
    stop = Area("stop", 70, 0, 5)
    site = replace(open_site("crossroad", 1), centre=np.zeros(2))
    law = laws.read_detectability("generalist")
    goals = goals_of(site, table, law, Request(9000, within_m=60, areas=(stop,)))
    assert [(one.column, one.counted.tolist()) for one in goals] == [
        ("recall", [True, False, False]),
        ("people_recall", [False, False, True]),
        ("recall_within_90_m", [True, True, False]),
        ("people_recall_within_90_m", [False, False, True]),
        ("recall_stop", [False, True, False]),
    ]
    others = table.iloc[[2, 1, 1]]
    again = with_objects(goals, site, others, law, Request(9000, within_m=60, areas=(stop,)))
    assert [(one.column, one.counted.tolist()) for one in again] == [
        ("recall", [False, False, False]),
        ("people_recall", [True, False, False]),
        ("recall_within_90_m", [False, True, True]),
        ("people_recall_within_90_m", [True, False, False]),
        ("recall_stop", [False, True, True]),
    ]
    blind = laws.read_detectability("background")
    assert {one.what for one in goals_of(site, table, blind, Request(9000))} == {"vehicles"}
