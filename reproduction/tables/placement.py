"""Makes tables about the predictions of `pyinfra plan`, and about the gain by a good pose."""

from typing import Any

import pandas as pd

from reproduction.tables.common import (
    Rows,
    markdown,
    of_rows,
    results,
    with_heads,
    with_interval_of_ap,
)

PREDICTORS = {
    "ap_predicted": "AP predicted by the detectability",
    "ten_points_percent": "share of vehicles with ten points",
    "information_bits": "information of an empty scene (EGVS)",
    "coverage_percent": "coverage of an empty scene",
    "another seed": "AP measured with another traffic seed",
}
ERRORS = {
    "mean error": "prediction from other traffic, with the mean of three seeds",
    "mean error with the same traffic": "prediction from the traffic of a seed, with that seed",
    "mean error of another seed": "measurement with one seed, with the mean of the other two",
}
WORDS = {  # maps words of placement_summary.csv to those of the page
    " less ": " minus ",
    "mean pose": "mean of the poses",
    "see all around": "view 360 degrees",
    "look in one direction": "view one direction",
    "share of poses at which the sign is not that of all poses": "share of poses with the sign "
    "opposite to the mean",
    "at which it is best": "at which it has the highest AP",
}

TWO_DIGITS = "{value:.2f} [{low:.2f}, {high:.2f}]"
FIGURES = {  # maps names in plan_coverage_summary.csv to those of the page
    "recall": "vehicles found, of 100",
    "people_recall": "pedestrians found, of 100",
    "false_per_frame": "false boxes per frame",
    "ap": "AP",
}


def _cell(row: pd.Series) -> str:
    return with_interval_of_ap(float(row.value), float(row.low), float(row.high))


@with_heads("detector", "predictor", "r within a site", "median r", "regret, AP")
def predictors() -> Rows:
    """Returns a table of the correlation and the regret of each predictor, by detector."""
    table = results("detectability_summary").set_index(["detector", "measure", "predictor"])
    for detector in table.index.unique(0):
        for predictor, name in PREDICTORS.items():
            r = table.loc[(detector, "r within a site", predictor)]
            regret = table.loc[(detector, "regret of the best pose, AP", predictor)]
            yield [detector, name, TWO_DIGITS.format_map(r), f"{r['median']:.2f}", _cell(regret)]


def by_traffic() -> str:
    """Returns a table of the correlation of each predictor at sites with less and more traffic."""
    table = results("detectability_summary").set_index(["detector", "measure", "predictor"])
    rows = [
        [
            detector,
            name,
            *(
                TWO_DIGITS.format_map(
                    table.loc[(detector, f"r within a site with {part} traffic", predictor)]
                )
                for part in ("less", "more")
            ),
        ]
        for detector in table.index.unique(0)
        for predictor, name in list(PREDICTORS.items())[:-1]
    ]
    return markdown(["detector", "predictor", "r, less traffic", "r, more traffic"], rows)


@with_heads("detector", "comparison", "AP", "recall, percent")
def errors() -> Rows:
    """Returns a table of the mean errors of predicted AP and recall, by detector.

    A row names what is compared with which measurement.
    """
    table = results("detectability_summary").set_index(["detector", "measure"])
    for detector in table.index.unique(0):
        for measure, name in ERRORS.items():
            cells = [
                _cell(table.loc[(detector, f"{measure}, {figure}")]) for figure in ("ap", "recall")
            ]
            yield [detector, name, *cells]


def reliability() -> str:
    """Returns a table of predicted and measured shares of detected objects."""
    ends = ("measured_percent", "measured_low", "measured_high")
    return of_rows(
        results("detectability_reliability"),
        {
            "detector": "{detector}",
            "class": "{class}",
            "objects": "{objects:,}",
            "predicted, percent": "{predicted_percent:.0f}",
            "measured, percent": lambda row: with_interval_of_ap(*(row[name] for name in ends)),
        },
    )


def placement(question: str) -> str:
    """Returns a table of one question of `python -m reproduction placement`."""
    table = results("placement_summary")
    rows = [
        [_quantity(str(row.quantity)), str(row.sites), _cell(row)]
        for _, row in table[table.question == question].iterrows()
    ]
    return markdown(["quantity, mean over sites", "sites", "value"], rows)


def _quantity(text: str) -> str:
    for words, others in WORDS.items():
        text = text.replace(words, others)
    return text


def plans() -> str:
    """Returns the options that were simulated in full for each question, the chosen one first."""
    return of_rows(
        results("plans"),
        {
            "question": "{question}",
            "option": "{option}",
            "LiDAR, height": "{lidars}, {heights_m} m",
            "found of 100, predicted": "{recall:.0f} [{recall_low:.0f}, {recall_high:.0f}]",
            "found of 100, simulated": "{recall_simulated:.0f}",
            "AP: predicted, simulated": "{ap_predicted:.0f}, {ap_simulated:.0f}",
            "price, USD": "{price_usd:,.0f} [{price_usd_low:,.0f}, {price_usd_high:,.0f}]",
        },
    )


def answers() -> str:
    """Returns the choice of the plan for each question, and what it finds when it is simulated."""

    def found(row: dict[str, Any]) -> str:
        text = "{recall_simulated:.0f} of 100 vehicles"
        more = ", {people_recall_simulated:.0f} of 100 pedestrians" if row["people"] else ""
        return f"{text}{more}".format_map(row)

    return of_rows(
        results("plans").query("option == 1"),
        {
            "question": "{question}",
            "budget, USD": "{budget_usd:,.0f}",
            "requested": "{find_percent:.0f} of 100 vehicles",
            "choice": "{lidars}, {heights_m} m",
            "found, simulated": found,
        },
    )


def plan_coverage() -> str:
    """Returns how often the intervals of plans contain the mean of further traffic seeds."""
    return of_rows(
        results("plan_coverage_summary").query("lidar == 'all'"),
        {
            "quantity": lambda row: FIGURES[row["figure"]],
            "source": "{source}",
            "options": "{options}",
            "mean inside, %": "{inside_percent:.0f}",
            "difference within both, %": "{agree_percent:.0f}",
            "half-width": "{half_width:.1f}",
            "half-width of the mean": "{mean_half_width:.1f}",
            "bias": "{bias:+.1f}",
        },
    )


def plan_times() -> str:
    """Returns the number of poses of each question and the processor time of its plan."""
    return of_rows(
        results("plans").drop_duplicates("question"),
        {
            "question": "{question}",
            "poses": "{poses:,.0f}",
            "pairs of pose and LiDAR": "{pairs:,.0f}",
            "comparison, CPU s": "{race_cpu_s:,.0f}",
            "whole plan, CPU s": "{cpu_s:,.0f}",
        },
    )
