"""The answer of a plan: tables, and sentences that are made of them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from pyinfra.dataset import simulation
from pyinfra.dataset.frames_version import other_frames
from pyinfra.experiments.planner.candidates import POSE
from pyinfra.experiments.planner.choice import Choice, Units, most_units
from pyinfra.experiments.planner.costs import CORES, Costs, Range
from pyinfra.experiments.planner.detectability import Detectability
from pyinfra.experiments.planner.lidars import PlanLidar
from pyinfra.experiments.planner.predict import Prediction
from pyinfra.experiments.planner.request import Request
from pyinfra.experiments.planner.site import PlanSite
from pyinfra.experiments.requirements import unlike
from pyinfra.metrics.comparison import Interval

LISTED = 3  # options that are described in full
REASONS = 4  # reasons of left-out poses that are listed
Options = Sequence[tuple[Choice, Prediction]]
LATER = "in the last third of the recorded traffic"
SAME = (
    "These shares are predicted in the frames of the choice and are too high on average, because "
    "no other frame has traffic."
)
OTHER = "in traffic of another seed"


def option_table(
    options: Options,
    stayed: pd.DataFrame,
    poses: pd.DataFrame,
    lidars: Sequence[PlanLidar],
    units: Units,
    in_choice: Sequence[Prediction],
) -> pd.DataFrame:
    """Returns a row for each unit of each option; the columns of the option are repeated.

    in_choice: what each option finds in the frames of the choice.
    """
    rows = []
    for number, (choice, prediction) in enumerate(options, start=1):
        latency_ms = units.latency_ms(choice.units)
        for k, unit in enumerate(choice.units, start=1):
            pose = poses.iloc[int(stayed.pose[unit])]
            rows.append(
                {
                    "option": number,
                    "unit": k,
                    **{name: pose[name] for name in POSE},
                    "height_m": pose.height_m,
                    "existing": bool(pose.existing),
                    "kind": pose.kind,
                    "lidar": lidars[int(stayed.lidar[unit])].name,
                    "poles": len({int(units.place[u]) for u in choice.units}),
                    "price_usd": choice.price.middle,
                    "price_usd_low": choice.price.low,
                    "price_usd_high": choice.price.high,
                    **ends("recall", prediction.recall, 100),
                    "recall_in_choice": 100 * in_choice[number - 1].recall.value,
                    "weighted_in_choice": 100 * in_choice[number - 1].weighted,
                    "latency_ms": latency_ms,
                    **ends("people_recall", prediction.people, 100),
                    **{
                        f"recall_{name}": 100 * share.value
                        for name, share in prediction.areas.items()
                    },
                    **ends("false_per_frame", prediction.false_per_frame),
                    "score": prediction.cut,
                    "keeps_false": prediction.keeps_false,
                    "keeps_false_in_choice": in_choice[number - 1].keeps_false,
                    **ends("ap_predicted", prediction.ap),
                    "ap_simulated": math.nan,
                    "ap_simulated_low": math.nan,
                    "ap_simulated_high": math.nan,
                    "recall_simulated": math.nan,
                    "people_recall_simulated": math.nan,
                    "false_per_frame_simulated": math.nan,
                    "position_m_simulated": math.nan,
                    "gap": 100 * choice.gap,
                    "method": choice.method,
                }
            )
    return pd.DataFrame(rows)


def ends(name: str, value: Interval, factor: float = 1.0) -> dict[str, float]:
    return {
        name: factor * value.value,
        f"{name}_low": factor * value.low,
        f"{name}_high": factor * value.high,
    }


def candidate_table(
    table: pd.DataFrame, pairs: pd.DataFrame, poses: pd.DataFrame, lidars: Sequence[PlanLidar]
) -> pd.DataFrame:
    """Returns a row for each observed pair of pose and LiDAR, and one for each pose with a fault.

    `recall` is the share (percent) of the weighted objects that the pair finds, in `frames` frames.
    """
    columns = ["kind", "existing", *POSE, "height_m"]
    observed = poses[columns].iloc[pairs.pose].reset_index(drop=True)
    observed["lidar"] = [lidars[i].name for i in pairs.lidar]
    observed["frames"], observed["recall"] = pairs.frames, 100 * pairs.recall
    observed["left_out"] = pairs.left_out
    order = observed.sort_values("recall", ascending=False, kind="stable")
    faulty = table[table.fault != ""]
    others = faulty[columns].assign(lidar="", frames=0, recall=np.nan, left_out=faulty.fault)
    return pd.concat([part for part in (order, others) if len(part)], ignore_index=True)


@dataclass(frozen=True)
class Answer:
    """The sentences of a plan."""

    meets: bool  # whether the first option finds what was asked for
    lines: tuple[str, ...]

    @staticmethod
    def of(
        site: PlanSite,
        request: Request,
        law: Detectability,
        costs: Costs,
        options: Options,
        rows: pd.DataFrame,
        every: pd.DataFrame,
        units: Units,
        moved: Sequence[str],
        *,
        is_unseen: bool,
    ) -> Answer:
        """Makes the sentences.

        moved: those on how the choice changes. is_unseen: whether the predictions are for frames
        that were not used for the choice.
        """
        lines = [asked(site, request)]
        if not meets(options[0], request):
            lines.append(nearest(options, request))
        kept = options[:LISTED]
        lines += [
            f"{i}. {sentence(one, rows[rows.option == i], request)}"
            for i, one in enumerate(kept, start=1)
        ]
        lines.append(where_predicted(site, rows) if is_unseen else SAME)
        lines += notes(options, rows, request, law, costs, units)
        lines += moved
        lines += left_out(every)
        return Answer(meets(options[0], request), tuple(lines))


def asked(site: PlanSite, request: Request) -> str:
    x, y = site.centre
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
        f"{site.name}, preset {site.preset}, detector {request.detector}: "
        f"{100 * request.find:g} of 100 vehicles within {request.within_m:g} m of ({x:.0f}, "
        f"{y:.0f}) in a frame{false}; at most {usd(request.budget_usd)} over "
        f"{request.years:g} years and {poles}.{weighed}"
    )


def where_predicted(site: PlanSite, rows: pd.DataFrame) -> str:
    return (
        f"These shares are predicted {LATER if site.recorded else OTHER}, which was not used for "
        f"the choice. The first option finds {rows.recall_in_choice.iloc[0]:.0f} of 100 in the "
        "frames of the choice."
    )


def meets(option: tuple[Choice, Prediction], request: Request) -> bool:
    """Returns whether an option finds what was asked for."""
    prediction = option[1]
    return prediction.recall.value >= request.find and prediction.keeps_false


def nearest(options: Options, request: Request) -> str:
    """Returns what the first option lacks, and what would have to be asked instead."""
    prediction = options[0][1]
    found = prediction.recall.value
    least = request.frames_per_minute * prediction.false_per_frame.value
    share_found = unlike(100 * found, 100 * request.find, 0)
    others = [k for k, one in enumerate(options, start=1) if meets(one, request)]
    if others:
        k = min(others, key=lambda k: options[k - 1][0].price.middle)
        share, price_usd = options[k - 1][1].recall.value, options[k - 1][0].price.middle
        lacks = [f"it finds {share_found} of 100"] if found < request.find else []
        if not prediction.keeps_false:
            lacks.append(f"no score keeps its false boxes below {math.ceil(least)} a minute")
        return (
            f"The chosen option may miss this: {' and '.join(lacks)} in other traffic. "
            f"Option {k} finds {100 * share:.0f} of 100 for {usd(price_usd)}."
        )
    reasons = []
    if found < request.find:
        reasons.append(
            f"the chosen one finds {share_found} of 100; a higher budget or more poles "
            f"may help, and `find` {math.floor(100 * found) / 100:g} would do"
        )
    if not prediction.keeps_false:
        reasons.append(
            f"no score keeps false boxes that rare; `false_per_minute` {math.ceil(least)} would do"
        )
    return f"No option meets this: {'; '.join(reasons)}."


def sentence(option: tuple[Choice, Prediction], rows: pd.DataFrame, request: Request) -> str:
    """Returns an option in an engineer's words."""
    choice, prediction = option
    where = " and ".join(
        f"{row.lidar} at ({row.x_m:.1f}, {row.y_m:.1f}), {row.height_m:.1f} m above the road, yaw "
        f"{row.yaw_deg:.0f} and pitch {row.pitch_deg:.0f} degrees"
        f"{' on an existing mast or wall' if row.existing else ''}"
        for row in rows.itertuples()
    )
    shares = {"vehicles": prediction.recall, "pedestrians": prediction.people}
    found = ", ".join(f"{of_hundred(s)} {name}" for name, s in shares.items() if s.value >= 0)
    areas = "".join(
        f", {of_hundred(share)} at {name}"
        for name, share in prediction.areas.items()
        if math.isfinite(share.value)
    )
    return (
        f"{where}: {f'finds {found}' if found else 'no object is'} within {request.within_m:g} m "
        f"in a frame{areas}, "
        f"{false_boxes(prediction.false_per_frame.value)}; about {rows.latency_ms.iloc[0]:.0f} ms "
        f"a frame on one core; {price(choice.price)} over {request.years:g} years; AP of all "
        f"vehicles {prediction.ap.value:.0f} [{prediction.ap.low:.0f} to {prediction.ap.high:.0f}]."
    )


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


def notes(
    options: Options,
    rows: pd.DataFrame,
    request: Request,
    law: Detectability,
    costs: Costs,
    units: Units,
) -> Iterator[str]:
    choice, prediction = options[0]
    if prediction.recall.low < request.find <= prediction.recall.value:
        yield (
            f"The interval of the first option begins below {100 * request.find:g} of 100, so it "
            "may miss the requirement."
        )
    if request.people and not prediction.people.value >= 0:
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
    yield from number_of_poles(options, rows)
    if choice.method == "greedy":
        yield (
            f"The search for {len(choice.units)} LiDARs is greedy: in the frames of the choice, no "
            f"other set finds more than {100 * choice.bound:.1f} of 100; the gap is "
            f"{100 * choice.gap:.1f}."
        )
    elif min(request.units, most_units(units, request.budget_usd)) > 2:
        yield (
            "The choice is exact for one and two LiDARs over all candidates that stayed in the "
            "race. The search for more LiDARs is greedy, so a better set may exist."
        )
    else:
        yield "The choice is exact over all pairs of pose and LiDAR that were not left out."
    lidars = [units.lidars[u] for u in choice.units]
    doubtful = list(dict.fromkeys(one.name for one in lidars if not one.confirmed))
    if doubtful:
        yield f"The price of {', '.join(doubtful)} is unconfirmed."
    if costs.unconfirmed:
        yield f"Unconfirmed costs: {', '.join(costs.unconfirmed)}; your own table replaces them."
    used = str(simulation.frames_version())
    name = f"The detectability of {law.detector}"
    if text := other_frames(name, law.frames_version, used):
        yield f"{text}."
    if law.pilot:
        yield (
            f"The detectability is a pilot: it was fitted on {law.sites} sites, and its intervals "
            "may be too narrow."
        )


def number_of_poles(options: Options, rows: pd.DataFrame) -> Iterator[str]:
    """Yields the best option of each number of poles, if there are several."""
    first = rows.drop_duplicates("option").sort_values("recall", ascending=False)
    best = first.drop_duplicates("poles").sort_values("poles")
    if len(best) < 2:
        return
    texts = [
        f"{row.poles} {'poles find' if row.poles > 1 else 'pole finds'} {row.recall:.0f} of 100 "
        f"for {usd(row.price_usd)}"
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
