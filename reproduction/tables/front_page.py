"""Makes the three findings of README, each with its measurement conditions."""

import pandas as pd

from pyinfra.core.vocabulary import PRESETS
from reproduction.commands.verdicts import LEVEL
from reproduction.tables import sentences
from reproduction.tables.common import markdown, number, results, tenth


def findings() -> str:
    return markdown(["finding", "where"], [far_points(), same_vehicles(), right_place()])


def far_points() -> list[str]:
    """Returns the row about points on far vehicles.

    The row has the ratio of the Avia to the best other LiDAR under each of three presets.
    """
    rows = sentences.far_points()
    paper, equal, datasheet = (number(rows.value[preset]) for preset in PRESETS)
    (seeds,) = set(rows.seeds)
    return [
        f"On far vehicles, the Livox Avia has {paper} times the points of the best other LiDAR "
        f"with [the study's settings](docs/quick_start.md#presets), {equal} with equal ranges, "
        f"{datasheet} by data sheets.",
        f"[highway](docs/results/points.md) beyond 90 m; {seeds} seeds",
    ]


def right_place() -> list[str]:
    """Returns the row about the AP of the pose that a plan chooses, at equal price."""
    table = results("placement_summary").set_index("quantity")
    row = table.loc["chosen pose less mean pose, AP"]
    return [
        f"The pose that `pyinfra plan` chooses has an AP {row.value:.0f} higher than the mean of "
        "six poses.",
        "[generated sites](docs/results/placement.md); 95 % interval "
        f"[{row.low:.0f}, {row.high:.0f}]",
    ]


def same_vehicles() -> list[str]:
    """Returns the row about the AP of the Avia and the Ruby Plus, for vehicles that both see.

    The row has the differences under the study's settings and by data sheets.
    """
    rows: pd.DataFrame = sentences.rows_of("comparable", subset="common").loc["highway"]
    paper, datasheet = (f"{rows.value[name]:+.1f}" for name in ("paper", "datasheet"))
    intervals = "; ".join(
        f"[{tenth(rows.low[name])}, {tenth(rows.high[name])}] {words}"
        for name, words in (("paper", "(study)"), ("datasheet", "(data sheets)"))
    )
    counts = dict.fromkeys(str(rows.replicates[name]) for name in ("paper", "datasheet"))
    return [
        "For vehicles visible to all LiDARs, the Avia's average precision (AP) minus that of the "
        f"Ruby Plus is {paper} with the study's settings, {datasheet} by data sheets.",
        f"[highway](docs/results/detection.md), fine-tuned, {'/'.join(counts)} replicates; "
        f"{100 * LEVEL:.1f} % intervals {intervals}",
    ]
