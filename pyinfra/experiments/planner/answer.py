"""The answer of a plan in words: at most ten lines, and notes with further details.

Every figure is one of the tables of the plan.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import pandas as pd

from pyinfra.dataset import simulation
from pyinfra.dataset.frames_version import other_frames
from pyinfra.experiments.fairness import caveat
from pyinfra.experiments.planner.choice import Choice, Units
from pyinfra.experiments.planner.costs import CORES
from pyinfra.experiments.planner.detectability import Detectability
from pyinfra.experiments.planner.notes import few_positions, how_chosen, left_out, usd
from pyinfra.experiments.planner.observe import Setting
from pyinfra.experiments.planner.predict import PREDICTED, SIMULATED, Standing
from pyinfra.experiments.planner.request import Request
from pyinfra.experiments.planner.sensitivity import PERCENT, RAIN, Move
from pyinfra.experiments.planner.simulate import Counting
from pyinfra.experiments.planner.site import PlanSite
from pyinfra.experiments.planner.verdict import (
    LISTED,
    Compared,
    Standings,
    Verdict,
    conditions,
    frames_needed,
    verdict,
)
from pyinfra.experiments.requirements import unlike
from pyinfra.metrics.comparison import UNKNOWN, Interval
from pyinfra.scenes.maps.site_traffic import lacking_traffic

FOOT_M = 0.3048
FEET_M = 12.0  # heights above 12 m may have been given in feet
MOST_FRAMES = 2000  # maximum number of frames of a proposed simulation
Option = tuple[Choice, Standing]


@dataclass(frozen=True)
class Answer:
    """The sentences of a plan.

    Attributes
    ----------
    verdict : whether the first option meets what was asked: met, not met, or not known
    lines : the answer, ten lines at most
    notes : how the choice was made, and what was left out
    """

    verdict: Verdict
    lines: tuple[str, ...]
    notes: tuple[str, ...]


def answer_of(
    compared: Compared,
    setting: Setting,
    rows: pd.DataFrame,
    every: pd.DataFrame,
    moves: Sequence[Move],
    sensitivity: pd.DataFrame,
    counting: Counting | None,
    cheaper: str = "",
) -> Answer:
    """Makes the sentences of a plan.

    rows: table of options. every: table of candidates. cheaper: sentence on a cheaper option.
    """
    site, request, units = setting.site, setting.request, compared.units
    options = compared.stands[: compared.listed]
    frames = len(site.other_frames(setting.effort.check_frames))
    held, *then = verdict_lines(options, request, frames)
    lines = [
        f"{asked(site, request)} {caveat(rows.lidar, setting.law.gains)}".rstrip(),
        held,
        " ".join(filter(None, [*then, cheaper])),
        *(
            f"{i}. {sentence(one, rows[rows.option == i], request)}"
            for i, one in enumerate(options[:LISTED], start=1)
        ),
        f"{price_line(moves, compared.options, units, compared.standings)} "
        f"{few_positions(setting.poses, request)}".rstrip(),
        change_line(sensitivity),
        count_line(counting, setting.effort.count or 0) if counting else "",
        " ".join(doubts(options[0], request, setting.law, units, site, every)),
    ]
    notes = [
        "The shares are those of an hour of other traffic at this site. Their intervals include "
        "the uncertainty of the traffic, the frames and, where shares are predicted, unseen sites; "
        "they do not include the difference between simulation and reality.",
        *how_chosen(options, rows, request, units),
        *left_out(every),
    ]
    return Answer(verdict(options[0][1], request), tuple(filter(None, lines)), tuple(notes))


def asked(site: PlanSite, request: Request) -> str:
    """Returns a text with the centre of the site and the request."""
    x, y = map(round, site.centre.tolist())
    most = request.false_per_minute
    false = f", at most {most:g} false boxes a minute" if math.isfinite(most) else ""
    poles = f"{request.poles} pole{'s' if request.poles > 1 else ''}"
    if request.lidars_per_pole > 1:
        poles += f" of at most {request.lidars_per_pole} LiDARs each"
    weights = [f"a pedestrian {request.people:g}"] if request.people else []
    weights += [f"an object at {one.name} {one.weight:g}" for one in request.areas if one.weight]
    weights = list(dict.fromkeys(weights))
    weighed = f" Weights in the choice: {', '.join(weights)}; other vehicles 1." if weights else ""
    return (
        f"{site.name}, centre ({x}, {y}) m, preset {site.preset}, detector "
        f"{request.detector}: {100 * request.find:g} of 100 vehicles within {request.within_m:g} m "
        f"of the centre in a frame{false}; at most {usd(request.budget_usd)} over "
        f"{request.years:g} years and {poles}.{weighed}"
    )


def verdict_lines(options: Sequence[Option], request: Request, frames: int) -> Iterator[str]:
    """Yields the verdict and, unless the request is met, a sentence on what may change it."""
    standing = options[0][1]
    share, wanted = standing.recall, 100 * request.find
    if not share.is_known:
        yield f"Not known: no vehicle is within {request.within_m:g} m in other traffic."
        return
    first = (
        f"option 1 finds {unlike(100 * share.value, wanted, 0)} of 100 vehicles "
        f"{ends(share, 100)}, {standing.source}"
    )
    first += f" in {frames} frames of other traffic" if standing.source == SIMULATED else ""
    rate, per_minute = standing.false_per_frame, request.frames_per_minute
    if math.isfinite(request.false_per_minute):
        first += (
            f", with {per_minute * rate.value:.0f} false boxes a minute {ends(rate, per_minute)}"
        )
    few = f"at most {request.false_per_minute:g} false boxes a minute"
    held = verdict(standing, request)
    deciding = [name for name, one in conditions(standing, request).items() if one == held]
    also = f" with {few}" if "false_per_minute" in deciding else ""
    match held:
        case "met":
            yield f"Met: {first}."
        case "not known":
            found, rare = f"{wanted:g} of 100 are found{also}", f"there are {few}"
            yield f"Not known whether {found if 'find' in deciding else rare}: {first}."
            yield settled_by(standing, request, frames)
        case "not met":
            yield f"Not met: {wanted:g} of 100{also} were asked for, and {first}."
            least, most = math.floor(100 * share.low) / 100, math.ceil(per_minute * rate.high)
            few = f"at most {most} false boxes a minute"
            values = {"find": f"a requested share of {least}", "false_per_minute": few}
            missed = " and ".join(values[name] for name in deciding)
            yield f"A higher budget or more poles may help; {missed} would be met."


def settled_by(standing: Standing, request: Request, frames: int) -> str:
    """Returns a sentence on the frames that are needed to decide a verdict that is not known."""
    if standing.source != SIMULATED:
        return "A simulation in full, of 30 frames or more, gives a narrower interval."
    most, name = max((n, name) for name, n in frames_needed(standing, request, frames).items())
    if most > MOST_FRAMES:
        figure = "share" if name == "find" else "number of false boxes"
        return f"The {figure} is too close to the requirement for a practical simulation."
    return (
        f"About {math.ceil(most / 10 - 1e-9) * 10:,} simulated frames may answer this; a recording "
        "at the site would."
    )


def sentence(option: Option, rows: pd.DataFrame, request: Request) -> str:
    """Returns a sentence that describes an option."""
    price, standing = option[0].price, option[1]
    where = " and ".join(
        f"{row.lidar} at ({row.x_m:.1f}, {row.y_m:.1f}), {row.height_m:.1f} m above the road, yaw "
        f"{row.yaw_deg:.0f} (compass {(90 - row.yaw_deg) % 360:.0f}) and pitch {row.pitch_deg:.0f} "
        f"degrees{carrier(row.kind, existing=row.existing)}"
        for row in rows.itertuples()
    )
    shares = (("vehicles", standing.recall), ("pedestrians", standing.people))
    found = ", ".join(f"{of_hundred(share)} {name}" for name, share in shares if share.value >= 0)
    areas = "".join(
        f", {of_hundred(share)} at {name}"
        for name in dict.fromkeys(area.name for area in request.areas)
        if (share := standing.shares.get(f"recall_{name}", UNKNOWN)).value >= 0
    )
    ap = f"; AP of all vehicles {with_ends(standing.ap)}" if standing.ap.value >= 0 else ""
    return (
        f"{where}: {f'finds {found}' if found else 'no object is'} within {request.within_m:g} m "
        f"in a frame{areas}, {standing.source}; {false_boxes(standing.false_per_frame.value)}; "
        f"about {rows.latency_ms.iloc[0]:.0f} ms a frame on one core; "
        f"{usd(price.middle)} ({price.low:,.0f} to {price.high:,.0f}) over {request.years:g} "
        f"years{ap}."
    )


def carrier(kind: str, *, existing: bool) -> str:
    """Returns a text on the support of a LiDAR, empty for a new pole."""
    if kind == "arm":
        return f" on an arm of {'an existing' if existing else 'a new'} mast"
    return " on an existing mast or wall" if existing else ""


def ends(figure: Interval, factor: float = 1.0) -> str:
    return f"[{factor * figure.low:.0f} to {factor * figure.high:.0f}]"


def with_ends(figure: Interval) -> str:
    """Returns a figure with its interval, if that is known."""
    return f"{figure.value:.0f}{f' {ends(figure)}' if figure.is_known else ''}"


def of_hundred(share: Interval) -> str:
    known = f" {ends(share, 100)}" if share.is_known else ""
    return f"{100 * share.value:.0f} of 100{known}"


def false_boxes(per_frame: float) -> str:
    if per_frame <= 0:
        return "no false box"
    if per_frame >= 1:
        return f"{per_frame:.1f} false boxes a frame"
    frames = f"{1 / max(per_frame, 1e-9):,.0f}"
    return "about one false box a frame" if frames == "1" else f"one false box in {frames} frames"


def doubts(
    option: Option,
    request: Request,
    law: Detectability,
    units: Units,
    site: PlanSite,
    every: pd.DataFrame,
) -> Iterator[str]:
    """Yields sentences on what is uncertain about the first option. every: table of candidates."""
    (choice, standing), costs = option, units.costs
    latency_ms, high_m = units.latency_ms(choice.units), every.height_m.max()
    lidars = [units.lidars[u] for u in choice.units]
    doubtful = dict.fromkeys(one.name for one in lidars if not one.confirmed)
    unsourced = [*costs.without_source, *(one.name for one in lidars if not one.source)]
    fitted = f"The detectability of {law.detector}"
    every_doubt = (
        (
            request.people and not standing.people.value >= 0,
            f"No pedestrian is within {request.within_m:g} m in the frames of the prediction, so "
            "the answer has no share of pedestrians",
        ),
        (
            choice.price.high > request.budget_usd,
            f"The first option may cost up to {usd(choice.price.high)}, more than the budget",
        ),
        (
            latency_ms > costs.frame_ms,
            f"The detector takes {latency_ms:.0f} ms for a frame, and a frame comes every "
            f"{costs.frame_ms:g} ms. It needs {math.ceil(latency_ms / costs.frame_ms)} cores to "
            f"keep up, of the {CORES} of a computer; the price has enough computers",
        ),
        (doubtful, f"The price of {', '.join(doubtful)} is unconfirmed"),
        (
            costs.unconfirmed,
            f"Unconfirmed costs: {', '.join(costs.unconfirmed)}; your own table replaces them",
        ),
        (unsourced, f"Without a source: the prices of {', '.join(dict.fromkeys(unsourced))}"),
        (True, lacking_traffic(site.file.parent)),
        (
            high_m > FEET_M,
            f"Poses are up to {round(high_m, 1):g} m above the road. If these are feet, "
            f"{round(high_m, 1):g} feet are {FOOT_M * round(high_m, 1):.1f} m",
        ),
        (True, other_frames(fitted, law.frames_version, str(simulation.frames_version()))),
        (
            law.pilot,
            f"The detectability is a pilot: it was fitted on {law.sites} sites, and its intervals "
            "may be too narrow",
        ),
    )
    return (f"{text}." for holds, text in every_doubt if holds and text)


def price_line(
    moves: Sequence[Move], options: Sequence[Choice], units: Units, at: Standings
) -> str:
    """Returns sentences on how the choice changes with prices."""
    number = {one.units: k for k, one in enumerate(options, start=1)}
    same = [one for one in moves if one.choice and number[one.choice.units] == 1]
    if len(same) == len(moves):
        kinds = list(dict.fromkeys(one.prices for one in moves))
        return (
            f"The choice stays the same if {', '.join(kinds[:-1])} or {kinds[-1]} rise or fall by "
            f"{max(PERCENT)} %."
        )
    texts = []
    for move in [one for one in moves if one not in same]:
        then = "no option is within the budget"
        if (one := move.choice) is not None:
            then = (
                f"the choice is option {number[one.units]} ({' and '.join(units.names(one.units))})"
                f", which finds {100 * at[one.units].recall.value:.0f} of 100 for "
                f"{usd(one.price.middle)}"
            )
        rise = "rise" if move.percent > 0 else "fall"
        texts.append(f"If {move.prices} {rise} by {abs(move.percent)} %, {then}.")
    if same:
        texts.append(
            f"With the other price changes of {max(PERCENT)} %, the choice stays the same."
        )
    return " ".join(texts)


def change_line(table: pd.DataFrame) -> str:
    """Returns a sentence on what the first option finds if a LiDAR fails or conditions change."""
    lost = table[table.case.str.endswith(" lost") & (table.recall > 0)]
    texts = [
        f"{row.recall:.0f} of 100 without {row.case.removesuffix(' lost')} ({row.source})"
        for row in lost.itertuples()
    ]
    texts += [
        f"{row.recall:.0f} in {row.case} ({row.source})"
        for row in table[(table.case == RAIN) & (table.source == PREDICTED)].itertuples()
    ]
    done = table[(table.source == SIMULATED) & table.change.notna() & ~table.index.isin(lost.index)]
    texts += [
        f"{row.recall:.0f} with {row.case} ({row.change:+.0f} [{row.change_low:+.0f} to "
        f"{row.change_high:+.0f}])"
        for row in done.itertuples()
    ]
    return f"The first option finds {', '.join(texts)}." if texts else ""


def count_line(found: Counting, wanted: float) -> str:
    """Returns a line on counted passages. wanted: share of the passages that must be counted."""
    if not found.has_lines:
        return "Counts: no line can be drawn across the roads of the site."
    if not found.passages:
        return f"Counts: no vehicle passes a line in {found.seconds:g} s of traffic."
    share, error = found.share, found.speed_error_km_h
    speeds = f"; speeds within {error:.1f} km/h (median)" if math.isfinite(error) else ""
    met = "met" if share.low >= wanted else "not met" if share.high < wanted else "not known"
    return (
        f"Counts: {found.counted} of {found.passages} passages in {found.seconds:g} s of other "
        f"traffic ({100 * share.value:.0f} %, {100 * share.low:.0f} to {100 * share.high:.0f}), "
        f"{found.extra} without a vehicle{speeds}. {100 * wanted:g} % counted: {met}."
    )
