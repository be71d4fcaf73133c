"""Checks the best options of a plan: simulates them in full, and measures what they find."""

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from pyinfra.core.arrays import AnyArray, BoolArray
from pyinfra.experiments.planner.candidates import POSE
from pyinfra.experiments.planner.choice import Choice, first_at_each_place, listed
from pyinfra.experiments.planner.notes import usd
from pyinfra.experiments.planner.observe import Setting
from pyinfra.experiments.planner.predict import SIMULATED, Standing, moved_by_frame
from pyinfra.experiments.planner.request import Request, masks_of, weighted, with_objects
from pyinfra.experiments.planner.simulate import Found, Parts, simulate_option
from pyinfra.experiments.planner.site import PlanSite
from pyinfra.experiments.planner.verdict import LISTED, Compared, in_order, verdict
from pyinfra.metrics.comparison import UNKNOWN, Interval, clipped
from pyinfra.metrics.intervals import student

MOST_SIMULATED = 6  # maximum number of simulated options, plus one with other LiDARs or pole count


def check(setting: Setting, chosen: Compared) -> tuple[Compared, dict[tuple[int, ...], Found]]:
    """Simulates the first LISTED options in full, and one with other LiDARs or pole count.

    Returns the options in their new order with measured figures, and the result of each
    simulation by units.
    """
    site, request, units = setting.site, setting.request, chosen.units
    standings, found = dict(chosen.standings), dict[tuple[int, ...], Found]()

    def measured(one: Choice) -> None:
        found[one.units] = now = simulate(one, chosen, setting)
        goals = with_objects(chosen.goals, site, now.objects, setting.law, request)
        standings[one.units] = standing(now, masks_of(goals), site, request)
        names, share = " and ".join(units.names(one.units)), standings[one.units].recall.value
        setting.effort.tell(f"simulated {names}: finds {100 * share:.0f} of 100")

    def kind(one: Choice) -> tuple[list[str], int]:
        return sorted(units.names(one.units)), len(units.poles(one.units))

    while setting.effort.check_frames and len(found) < MOST_SIMULATED:
        order = in_order(chosen.options, standings, request)
        first = first_at_each_place(order, units)[:LISTED]
        left = [one for one in first if one.units not in found]
        if not left:
            break
        measured(left[0])
    kinds = [kind(one) for one in chosen.options if one.units in found]
    order = in_order(chosen.options, standings, request)
    for other in [one for one in order if found and kind(one) not in kinds][:1]:
        measured(other)
    order = in_order(chosen.options, standings, request)
    order, count = listed(order, chosen.best, units, LISTED)
    return replace(chosen, options=order, listed=count, standings=standings), found


def simulate(one: Choice, compared: Compared, setting: Setting) -> Found:
    """Simulates an option in full."""
    return simulate_option(
        setting.site,
        parts_of(one, compared, setting),
        setting.request.detector,
        compared.predicted(one.units).cut,
        setting.effort.check_frames,
    )


def parts_of(one: Choice, compared: Compared, setting: Setting) -> Parts:
    """Returns the pose and the LiDAR of each unit of an option."""
    poses = setting.poses[POSE].to_numpy(float)[compared.unseen.stayed.pose]
    return [(poses[u].tolist(), compared.units.lidars[u].unit) for u in one.units]


def share(found: Found, counted: AnyArray) -> Interval:
    """Returns the share of the counted objects that is found, with its interval.

    The interval is for the mean over an hour of other traffic. Its variance is that of frames as
    clusters, but at least that of independent objects.
    """
    some = found.objects[counted]
    if some.empty:
        return UNKNOWN
    value, n = float(some.found.mean()), max(found.frames, 2)
    moved = moved_by_frame(some.found, some.frame, found.frames, value)
    clusters = float(moved.var(ddof=1)) * n / len(some) ** 2 if found.frames > 1 else 1.0
    smoothed = (some.found.sum() + 1) / (len(some) + 2)
    variance = max(clusters, float(smoothed * (1 - smoothed)) / len(some))
    return _over_frames(value, variance, n, (0.0, 1.0))


def false_rate(found: Found) -> Interval:
    """Returns the mean number of false boxes per frame, with its interval."""
    value, n = float(found.false.mean()), max(found.frames, 2)
    variance = max(float(found.false.var(ddof=1)) if found.frames > 1 else value, value, 1 / n) / n
    return _over_frames(value, variance, n, (0.0, math.inf))


def _over_frames(
    value: float, variance: float, frames: int, within: tuple[float, float]
) -> Interval:
    """Returns a figure with Student's t interval over frames, clipped to the range `within`."""
    half = student(frames) * math.sqrt(variance)
    return clipped(Interval(value, value - half, value + half), *within)


def near_vehicles(found: Found, site: PlanSite, within_m: float) -> BoolArray:
    """Returns which objects are vehicles within a distance of the centre of the site: (n,)."""
    return np.asarray(site.is_near(found.objects, within_m) & ~found.objects.person)


def standing(
    found: Found, goals: Mapping[str, BoolArray], site: PlanSite, request: Request
) -> Standing:
    """Returns the measured figures of an option. goals: the objects of each share, by column."""
    objects, near = found.objects, site.is_near(found.objects, request.within_m)
    person = objects.person.to_numpy(bool)
    weight = weighted(objects, near, request.people, request.areas)
    return Standing(
        share(found, near & ~person),
        share(found, near & person),
        {name: share(found, counted) for name, counted in goals.items()},
        float((weight * objects.found).sum() / max(weight.sum(), 1e-12)),
        false_rate(found),
        found.ap,
        found.position_m,
        SIMULATED,
    )


def paired(before: Found, after: Found, site: PlanSite, within_m: float) -> Interval:
    """Returns the change of the share of vehicles within a distance that are found, -1 to 1.

    `before` and `after` must be of the same frames. The interval is over the frames. Frames have
    weights proportional to their numbers of vehicles.
    """
    near = [one.objects[near_vehicles(one, site, within_m)] for one in (before, after)]
    if any(some.empty for some in near):
        return UNKNOWN
    n, (first, then) = max(before.frames, 2), (float(some.found.mean()) for some in near)
    a, b = (
        moved_by_frame(some.found, some.frame, before.frames, value) / len(some)
        for some, value in zip(near, (first, then), strict=True)
    )
    return _over_frames(then - first, n * float((b - a).var(ddof=1)), n, (-math.inf, math.inf))


def cheaper_line(
    compared: Compared, found: Mapping[tuple[int, ...], Found], setting: Setting
) -> str:
    """Returns a sentence on the cheapest option whose share does not differ significantly.

    Only listed options that were simulated in the frames of option 1 are compared. The text is
    empty if there is no such option, or if option 1 meets the request.
    """
    first, *others = compared.options[: compared.listed]
    met = verdict(compared.standings[first.units], setting.request) == "met"
    if met or first.units not in found:
        return ""
    for one in sorted(others, key=lambda one: one.price.middle):
        if one.units not in found or one.price.middle >= first.price.middle:
            continue
        pair = found[first.units], found[one.units]
        change = paired(*pair, setting.site, setting.request.within_m)
        if change.is_known and not change.is_significant:
            return (
                f"Option {compared.number(one)} costs {usd(first.price.middle - one.price.middle)} "
                f"less, and its share does not differ significantly from that of option 1 "
                f"({100 * change.value:+.0f} of 100 [{100 * change.low:+.0f} to "
                f"{100 * change.high:+.0f}])."
            )
    return ""
