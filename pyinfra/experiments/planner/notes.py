"""The notes of a plan in words: how its first option was chosen, and what was left out."""

from collections.abc import Iterator, Sequence

import pandas as pd

from pyinfra.experiments.planner.candidates import POSE
from pyinfra.experiments.planner.choice import Choice, Units, most_units
from pyinfra.experiments.planner.predict import SIMULATED, Standing
from pyinfra.experiments.planner.request import Request

REASONS = 4  # maximum number of listed reasons why poses are left out


def usd(value: float) -> str:
    return f"US$ {value:,.0f}"


def how_chosen(
    options: Sequence[tuple[Choice, Standing]], rows: pd.DataFrame, request: Request, units: Units
) -> Iterator[str]:
    """Yields sentences on how the first option was chosen."""
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
            "The search for one and two LiDARs is exact over all pairs of pose and LiDAR that were "
            "not left out. The search for more LiDARs is greedy, so a better set may exist."
        )
    else:
        yield "The search is exact over all pairs of pose and LiDAR that were not left out."
    if not any(one.source == SIMULATED for _, one in options):
        yield "No option was simulated in full, so the choice rests on predicted shares."


def number_of_poles(rows: pd.DataFrame) -> Iterator[str]:
    """Yields a sentence on the best option of each number of poles, unless there is only one."""
    order = rows.drop_duplicates("option").sort_values("share", ascending=False)
    best = order.drop_duplicates("poles").sort_values("poles")
    if len(best) < 2:
        return
    texts = [
        f"{row.poles} {'poles find' if row.poles > 1 else 'pole finds'} {row.share:.0f} of 100 "
        f"for {usd(row.price_usd)} ({row.source})"
        for row in best.itertuples()
    ]
    yield f"Most vehicles by number of poles: {'; '.join(texts)}."


def left_out(every: pd.DataFrame) -> Iterator[str]:
    """Yields sentences on the compared LiDARs, and on left-out poses and pairs by reason."""
    pairs = every[every.lidar != ""]
    yield f"LiDARs within the budget: {', '.join(sorted(pairs.lidar.unique()))}."
    faults = every[every.lidar == ""].left_out.value_counts()
    if len(faults):
        shown = [f"{reason} ({count})" for reason, count in faults.head(REASONS).items()]
        if len(faults) > REASONS:
            shown.append(f"other reasons ({faults.iloc[REASONS:].sum()})")
        yield f"{faults.sum()} poses are not possible: {'; '.join(shown)}."
    raced = pairs.left_out[pairs.left_out != ""].value_counts()
    if len(raced):
        texts = "; ".join(f"{count} {reason}" for reason, count in raced.items())
        yield f"{raced.sum()} of {len(pairs)} pairs of pose and LiDAR were left out: {texts}."


def few_positions(poses: pd.DataFrame, request: Request) -> str:
    """Returns a sentence if fewer positions are possible than poles are requested, else ""."""
    count = len(poses.drop_duplicates(POSE[:2]))
    if count >= request.poles:
        return ""
    return (
        f"Only {count} {'position is' if count == 1 else 'positions are'} possible, fewer than the "
        f"{request.poles} poles of the request."
    )
