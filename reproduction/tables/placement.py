"""Makes tables about the prediction of `pyinfra plan` and about what a place is worth."""

import pandas as pd

from reproduction.tables.common import markdown, results, with_interval_of_ap

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
WORDS = {  # of quantities in placement_summary.csv, in the words of the page
    " less ": " minus ",
    "mean pose": "mean of the poses",
    "see all around": "view 360 degrees",
    "look in one direction": "view one direction",
    "share of poses at which the sign is not that of all poses": "share of poses at which the sign "
    "differs from that of the mean",
    "at which it is best": "at which it has the highest AP",
}


def _cell(row: pd.Series) -> str:
    return with_interval_of_ap(float(row.value), float(row.low), float(row.high))


def predictors() -> str:
    """Returns a table of the correlation and the regret of each predictor, by detector."""
    table = results("detectability_summary").set_index(["detector", "measure", "predictor"])
    rows = []
    for detector in table.index.unique(0):
        for predictor, name in PREDICTORS.items():
            r = table.loc[(detector, "r within a site", predictor)]
            regret = table.loc[(detector, "regret of the best pose, AP", predictor)]
            rows.append([detector, name, _two_digits(r), f"{r['median']:.2f}", _cell(regret)])
    return markdown(["detector", "predictor", "r within a site", "median r", "regret, AP"], rows)


def by_traffic() -> str:
    """Returns a table of the correlation of each predictor at sites with less and more traffic."""
    table = results("detectability_summary").set_index(["detector", "measure", "predictor"])
    rows = [
        [
            detector,
            name,
            *(
                _two_digits(
                    table.loc[(detector, f"r within a site with {part} traffic", predictor)]
                )
                for part in ("less", "more")
            ),
        ]
        for detector in table.index.unique(0)
        for predictor, name in list(PREDICTORS.items())[:-1]
    ]
    return markdown(["detector", "predictor", "r, less traffic", "r, more traffic"], rows)


def _two_digits(row: pd.Series) -> str:
    return f"{row.value:.2f} [{row.low:.2f}, {row.high:.2f}]"


def errors() -> str:
    """Returns a table of the mean errors of predicted AP and recall, by detector.

    A row names what is compared with which measurement.
    """
    table = results("detectability_summary").set_index(["detector", "measure"])
    rows = []
    for detector in table.index.unique(0):
        for measure, name in ERRORS.items():
            cells = [
                _cell(table.loc[(detector, f"{measure}, {figure}")]) for figure in ("ap", "recall")
            ]
            rows.append([detector, name, *cells])
    return markdown(["detector", "comparison", "AP", "recall, percent"], rows)


def reliability() -> str:
    """Returns a table of predicted and measured shares of detected objects."""
    table = results("detectability_reliability")
    rows = [
        [
            row.detector,
            row.object_class,
            f"{row.objects:,}",
            f"{row.predicted_percent:.0f}",
            with_interval_of_ap(row.measured_percent, row.measured_low, row.measured_high),
        ]
        for row in table.rename(columns={"class": "object_class"}).itertuples()
    ]
    heads = ["detector", "class", "objects", "predicted, percent", "measured, percent"]
    return markdown(heads, rows)


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
    rows = []
    for question, group in results("plans").groupby("question", sort=False):
        for one in group.itertuples():
            share = f"{one.recall:.0f} [{one.recall_low:.0f}, {one.recall_high:.0f}]"
            price = f"{one.price_usd:,.0f} [{one.price_usd_low:,.0f}, {one.price_usd_high:,.0f}]"
            ap = f"{one.ap_predicted:.0f}, {one.ap_simulated:.0f}"
            where = f"{one.lidars}, {one.heights_m} m"
            found = f"{one.recall_simulated:.0f}"
            rows.append([question, str(one.option), where, share, found, ap, price])
    heads = ["question", "option", "LiDAR, height", "found of 100, predicted"]
    heads += ["found of 100, simulated", "AP: predicted, simulated", "price, USD"]
    return markdown(heads, rows)


def plan_coverage() -> str:
    """Returns how often the intervals of plans contain the mean of further traffic seeds."""
    table = results("plan_coverage_summary").query("lidar == 'all'")
    names = {
        "recall": "vehicles found, of 100",
        "people_recall": "pedestrians found, of 100",
        "false_per_frame": "false boxes per frame",
        "ap": "AP",
    }
    rows = [
        [
            names[row.figure],
            row.source,
            str(row.options),
            f"{row.inside_percent:.0f}",
            f"{row.agree_percent:.0f}",
            f"{row.half_width:.1f}",
            f"{row.mean_half_width:.1f}",
            f"{row.bias:+.1f}",
        ]
        for row in table.itertuples()
    ]
    heads = ["quantity", "source", "options", "mean inside, %", "difference within both, %"]
    return markdown([*heads, "half-width", "half-width of the mean", "bias"], rows)


def plan_times() -> str:
    """Returns the number of poses of each question and the processor time of its plan."""
    table = results("plans").drop_duplicates("question")
    rows = [
        [one.question, *(f"{n:,.0f}" for n in (one.poses, one.pairs, one.race_cpu_s, one.cpu_s))]
        for one in table.itertuples()
    ]
    heads = [
        "question",
        "poses",
        "pairs of pose and LiDAR",
        "comparison, CPU s",
        "whole plan, CPU s",
    ]
    return markdown(heads, rows)
