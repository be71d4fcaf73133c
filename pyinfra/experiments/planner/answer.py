"""The answer of a plan in words: at most ten lines, and notes that hold the rest.

Every figure is one of the tables of the plan.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import pandas as pd

from pyinfra.dataset import simulation
from pyinfra.dataset.frames_version import other_frames
from pyinfra.experiments.fairness import caveat
from pyinfra.experiments.planner.candidates import POSE
from pyinfra.experiments.planner.choice import Choice, Units, most_units
from pyinfra.experiments.planner.costs import CORES, Costs, Range
from pyinfra.experiments.planner.detectability import Detectability
from pyinfra.experiments.planner.request import Request
from pyinfra.experiments.planner.site import PlanSite
from pyinfra.experiments.planner.verdict import (
    SIMULATED,
    Standing,
    Verdict,
    most_false,
    verdict,
)
from pyinfra.experiments.requirements import unlike
from pyinfra.metrics.comparison import Interval
from pyinfra.scenes.maps.site_traffic import lacking_traffic

LISTED = 3  # options that are described in full
REASONS = 4  # reasons of left-out poses that are listed
FOOT_M = 0.3048
FEET_M = 12.0  # height above the road from which a height in metres may be one in feet
MOST_FRAMES = 2000  # frames of a simulation that is proposed
Options = Sequence[tuple[Choice, Standing]]


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
    site: PlanSite,
    request: Request,
    law: Detectability,
    costs: Costs,
    options: Options,
    rows: pd.DataFrame,
    every: pd.DataFrame,
    units: Units,
    changes: Sequence[str],
    frames: int,
) -> Answer:
    """Makes the sentences.

    options: those that are listed. rows, every: the tables of options and candidates. changes: a
    line on prices, and one on failures, rain and yaw. frames: those that were simulated.
    """
    lines = [
        f"{asked(site, request)} {caveat(rows.lidar, law.gains)}".rstrip(),
        *verdict_lines(options, request, frames),
        *(
            f"{i}. {sentence(one, rows[rows.option == i], request)}"
            for i, one in enumerate(options[:LISTED], start=1)
        ),
        *changes,
        " ".join(doubts(options, request, law, costs, units, site, every)),
    ]
    notes = [
        "The shares are those of an hour of other traffic at this site. Their intervals contain "
        "the traffic, the frames and, where they are predicted, the error at unseen sites; not the "
        "difference between simulation and reality.",
        *how_chosen(options, rows, request, units),
        *left_out(every),
    ]
    first = verdict(options[0][1], request)
    return Answer(first, tuple(line for line in lines if line), tuple(notes))


def asked(site: PlanSite, request: Request) -> str:
    """Returns the centre of the site and the request."""
    x, y = map(round, site.centre.tolist())
    false = ""
    if math.isfinite(request.false_per_minute):
        false = f", at most {request.false_per_minute:g} false boxes a minute"
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


def verdict_lines(options: Options, request: Request, frames: int) -> Iterator[str]:
    """Yields the verdict, and what would settle or change it."""
    standing = options[0][1]
    share, wanted = standing.recall, 100 * request.find
    if not share.is_known:
        yield f"Not known: no vehicle is within {request.within_m:g} m in other traffic."
        return
    first = (
        f"option 1 finds {unlike(100 * share.value, wanted, 0)} of 100 vehicles "
        f"[{100 * share.low:.0f} to {100 * share.high:.0f}], {standing.source}"
    )
    first += f" in {frames} frames of other traffic" if standing.source == SIMULATED else ""
    result = verdict(standing, request)
    false = false_texts(standing, request)
    if result == "met":
        yield f"Met: {first}{false}."
        return
    if result == "not known":
        yield f"Not known whether {wanted:g} of 100 are found: {first}{false}."
        yield settled_by(standing, request, frames)
        return
    yield f"Not met: no option within the budget finds {wanted:g} of 100; {first}{false}."
    do = [f"`find` {math.floor(100 * share.low) / 100:g} would be met"]
    if standing.false_per_frame.low > most_false(request):
        least = request.frames_per_minute * standing.false_per_frame.high
        do.append(f"`false_per_minute` {math.ceil(least)} would be met")
    yield f"A higher budget or more poles may help; {' and '.join(do)}."


def false_texts(standing: Standing, request: Request) -> str:
    if not math.isfinite(request.false_per_minute):
        return ""
    rate, per_minute = standing.false_per_frame, request.frames_per_minute
    return (
        f", with {per_minute * rate.value:.0f} false boxes a minute "
        f"[{per_minute * rate.low:.0f} to {per_minute * rate.high:.0f}]"
    )


def settled_by(standing: Standing, request: Request, frames: int) -> str:
    """Returns what would settle a verdict that is not known."""
    share = standing.recall
    if standing.source != SIMULATED:
        return "A simulation in full (`check_frames` of 30 or more) gives a narrower interval."
    away = abs(share.value - request.find)
    half = (share.high - share.low) / 2
    enough = math.inf if away == 0 else frames * (half / away) ** 2
    if enough > MOST_FRAMES:
        return "The share is so close to what is asked that no practical simulation settles it."
    return (
        f"About {math.ceil(enough / 10) * 10:,} simulated frames (`check_frames`) may settle it; a "
        "recording at the site would."
    )


def sentence(option: tuple[Choice, Standing], rows: pd.DataFrame, request: Request) -> str:
    """Returns an option in an engineer's words."""
    choice, standing = option
    where = " and ".join(
        f"{row.lidar} at ({row.x_m:.1f}, {row.y_m:.1f}), {row.height_m:.1f} m above the road, yaw "
        f"{row.yaw_deg:.0f} (compass {compass(row.yaw_deg):.0f}) and pitch {row.pitch_deg:.0f} "
        f"degrees{carrier(row.kind, existing=row.existing)}"
        for row in rows.itertuples()
    )
    shares = {"vehicles": standing.recall, "pedestrians": standing.people}
    found = ", ".join(f"{of_hundred(s)} {name}" for name, s in shares.items() if s.value >= 0)
    areas = "".join(
        f", {of_hundred(share)} at {name}"
        for name, share in (
            (area.name, standing.shares.get(f"recall_{area.name}"))
            for area in {one.name: one for one in request.areas}.values()
        )
        if share is not None and math.isfinite(share.value)
    )
    ap = f"AP of all vehicles {standing.ap.value:.0f}" if math.isfinite(standing.ap.value) else ""
    if ap and standing.ap.is_known:
        ap += f" [{standing.ap.low:.0f} to {standing.ap.high:.0f}]"
    return (
        f"{where}: {f'finds {found}' if found else 'no object is'} within {request.within_m:g} m "
        f"in a frame{areas}, {standing.source}; {false_boxes(standing.false_per_frame.value)}; "
        f"about {rows.latency_ms.iloc[0]:.0f} ms a frame on one core; {price(choice.price)} over "
        f"{request.years:g} years{f'; {ap}' if ap else ''}."
    )


def carrier(kind: str, *, existing: bool) -> str:
    """Returns on what a LiDAR is, if that is not a new pole."""
    if kind == "arm":
        return f" on an arm of {'an existing' if existing else 'a new'} mast"
    return " on an existing mast or wall" if existing else ""


def compass(yaw_deg: float) -> float:
    """Returns the compass bearing of a yaw: 0 is north (y), 90 is east (x)."""
    return (90 - yaw_deg) % 360


def of_hundred(share: Interval) -> str:
    value = f"{100 * share.value:.0f} of 100"
    return f"{value} [{100 * share.low:.0f} to {100 * share.high:.0f}]" if share.is_known else value


def false_boxes(per_frame: float) -> str:
    if per_frame <= 0:
        return "no false box"
    if per_frame >= 1:
        return f"{per_frame:.1f} false boxes a frame"
    frames = f"{1 / max(per_frame, 1e-9):,.0f}"
    return "about one false box a frame" if frames == "1" else f"one false box in {frames} frames"


def usd(value: float) -> str:
    return f"US$ {value:,.0f}"


def price(span: Range) -> str:
    return f"{usd(span.middle)} ({span.low:,.0f} to {span.high:,.0f})"


def doubts(
    options: Options,
    request: Request,
    law: Detectability,
    costs: Costs,
    units: Units,
    site: PlanSite,
    every: pd.DataFrame,
) -> Iterator[str]:
    """Yields what is uncertain or assumed in the first option. every: the table of candidates."""
    choice, standing = options[0]
    if request.people and not standing.people.value >= 0:
        yield (
            f"No pedestrian is within {request.within_m:g} m in the frames of the prediction, so "
            "the answer has no share of pedestrians."
        )
    if choice.price.high > request.budget_usd:
        yield f"The first option may cost up to {usd(choice.price.high)}, more than the budget."
    latency_ms = units.latency_ms(choice.units)
    if latency_ms > costs.frame_ms:
        yield (
            f"The detector takes {latency_ms:.0f} ms for a frame, and a frame comes every "
            f"{costs.frame_ms:g} ms. It needs {math.ceil(latency_ms / costs.frame_ms)} cores to "
            f"keep up, of the {CORES} of a computer; the price has enough computers."
        )
    lidars = [units.lidars[u] for u in choice.units]
    doubtful = list(dict.fromkeys(one.name for one in lidars if not one.confirmed))
    if doubtful:
        yield f"The price of {', '.join(doubtful)} is unconfirmed."
    if costs.unconfirmed:
        yield f"Unconfirmed costs: {', '.join(costs.unconfirmed)}; your own table replaces them."
    unsourced = [*costs.without_source, *(one.name for one in lidars if not one.source)]
    if unsourced:
        yield f"Without a source: the prices of {', '.join(dict.fromkeys(unsourced))}."
    if text := lacking_traffic(site.file.parent):
        yield f"{text}."
    high = sorted({round(height, 1) for height in every.height_m if height > FEET_M})
    if high:
        yield (
            f"Poses are up to {high[-1]:g} m above the road. If these are feet, "
            f"{high[-1]:g} feet are {FOOT_M * high[-1]:.1f} m."
        )
    used = str(simulation.frames_version())
    name = f"The detectability of {law.detector}"
    if text := other_frames(name, law.frames_version, used):
        yield f"{text}."
    if law.pilot:
        yield (
            f"The detectability is a pilot: it was fitted on {law.sites} sites, and its intervals "
            "may be too narrow."
        )


def how_chosen(
    options: Options, rows: pd.DataFrame, request: Request, units: Units
) -> Iterator[str]:
    """Yields how the first option was chosen."""
    choice = options[0][0]
    yield from number_of_poles(rows)
    if choice.method == "greedy":
        yield (
            f"The search for {len(choice.units)} LiDARs is greedy: in the frames of the choice, no "
            f"other set finds more than {100 * choice.bound:.1f} of 100; the gap is "
            f"{100 * choice.gap:.1f}."
        )
    elif min(request.units, most_units(units, request.budget_usd)) > 2:
        yield (
            "The options are exact for one and two LiDARs over all candidates that stayed in the "
            "race. The search for more LiDARs is greedy, so a better set may exist."
        )
    else:
        yield "The options are exact over all pairs of pose and LiDAR that were not left out."
    if not any(one.source == SIMULATED for _, one in options):
        yield "No option was simulated in full, so the predicted shares decide."


def number_of_poles(rows: pd.DataFrame) -> Iterator[str]:
    """Yields the best option of each number of poles, if there are several."""
    first = rows.drop_duplicates("option").sort_values("share", ascending=False)
    best = first.drop_duplicates("poles").sort_values("poles")
    if len(best) < 2:
        return
    texts = [
        f"{row.poles} {'poles find' if row.poles > 1 else 'pole finds'} {row.share:.0f} of 100 "
        f"for {usd(row.price_usd)} ({row.source})"
        for row in best.itertuples()
    ]
    yield f"Most vehicles by number of poles: {'; '.join(texts)}."


def left_out(every: pd.DataFrame) -> Iterator[str]:
    """Yields lines on the LiDARs that were compared, and on what was left out, by reason."""
    names = sorted(every.lidar[every.lidar != ""].unique())
    yield f"LiDARs within the budget: {', '.join(names)}."
    faults = every[every.lidar == ""].left_out.value_counts()
    if len(faults):
        shown = [f"{reason} ({count})" for reason, count in faults.head(REASONS).items()]
        more = faults.iloc[REASONS:].sum()
        rest = f"; other reasons ({more})" if more else ""
        yield f"{faults.sum()} poses are not possible: {'; '.join(shown)}{rest}."
    raced = every[(every.lidar != "") & (every.left_out != "")].left_out.value_counts()
    if len(raced):
        texts = [f"{count} {reason}" for reason, count in raced.items()]
        total = int((every.lidar != "").sum())
        yield f"{raced.sum()} of {total} pairs of pose and LiDAR were left out: {'; '.join(texts)}."


def few_positions(poses: pd.DataFrame, request: Request) -> str:
    """Returns a sentence if fewer positions are possible than poles are asked for."""
    count = len(poses.drop_duplicates(POSE[:2]))
    if count >= request.poles:
        return ""
    are = "position is" if count == 1 else "positions are"
    return f"Only {count} {are} possible, fewer than the {request.poles} poles of the request."
