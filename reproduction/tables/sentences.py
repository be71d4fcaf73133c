"""Writes the answers of the pages of results from the tables: numbers, orders and "only".

In a page, an answer is between `<!-- text NAME -->` and `<!-- end -->`. A statement without a
number is made by `known`, which raises Error if the tables contradict it.
"""

import math
from collections.abc import Iterable, Mapping, Sequence

import pandas as pd

from pyinfra.core.errors import Error
from pyinfra.metrics.comparison import Interval
from reproduction.claims.two_detectors import (
    BOTH,
    CHEAPER,
    FAILS_ABOVE,
    FAILS_BELOW,
    HOLDS,
    NOT_KNOWN,
    ONE,
    PRIMARY,
    TOO_FEW,
    UNDECIDED,
)
from reproduction.commands.experiments import at_catalogue_law
from reproduction.tables import findings, verdicts
from reproduction.tables.common import results, rows_with, tenth

WIDE, AVIA = "ruby_plus", "livox_avia"
NAMES = {"pointpillars": "PointPillars", "pv-rcnn": "PV-RCNN", "dsvt": "DSVT"}
NETWORKS = [(PRIMARY[1][0], name) for name in NAMES]  # training and detector
POOR = (PRIMARY[1][0], "pointrcnn")
SCENES = {"highway": "on the highway", "curve": "on the curve", "crossroad": "at the crossroad"}
SETTINGS = {"paper": "the settings of the study", "datasheet": "the settings of the data sheets"}
NUMBERS = ("no", "one", "two", "three", "four", "five", "six")
OPEN = (UNDECIDED, NOT_KNOWN)


def known(condition: bool, sentence: str) -> str:
    """Returns a sentence that the tables support. Raises Error if they do not."""
    if not condition:
        raise Error(f"results/: correct this sentence, which the values contradict: {sentence}")
    return sentence


def span(values: Iterable[float], digits: int = 0) -> str:
    """Returns the least and greatest value with `digits` decimals; one number if they are equal."""
    least, most = (f"{end(values):.{digits}f}" for values in [list(values)] for end in (min, max))
    return least if least == most else f"{least} to {most}"


def joined(parts: Sequence[str], word: str = "and") -> str:
    return f" {word} ".join([", ".join(parts[:-1]), parts[-1]] if len(parts) > 1 else parts)


def within(changes: Iterable[Interval]) -> str:
    """Returns the smallest x, with one decimal, for which all intervals lie in -x to x."""
    far = max(max(abs(change.low), abs(change.high)) for change in changes)
    return f"{math.ceil(10 * far - 1e-9) / 10:g}"


def rows_of(claim: str, training: str = "fine-tuned", subset: str = "captured") -> pd.DataFrame:
    """Returns the rows of a claim with labels at scan time, by scene and preset."""
    table = at_catalogue_law(results("claims"))
    rows = rows_with(table, claim=claim, training=training, subset=subset, label_time="scan")
    return rows.set_index(["scene", "preset"])


def where(rows: pd.DataFrame, word: str = "and") -> str:
    """Returns the scenes and settings of rows in words, by settings.

    word: "or" for a sentence with "not"
    """
    every = {"and": "in all three scenes", "or": "in any of the three scenes"}[word]
    parts: list[str] = []
    for preset, settings in SETTINGS.items():
        scenes = [SCENES[s] for s in SCENES if (s, preset) in rows.index]
        if scenes:
            words = settings.replace("the settings", "those") if parts else settings
            places = every if len(scenes) == len(SCENES) else joined(scenes, word)
            parts.append(f"{places} with {words}")
    return f", {word} ".join(parts)


def by_verdict(claim: str, heads: Mapping[str, str]) -> str:
    """Returns a sentence for each verdict of the fine-tuned detector and each of the settings.

    The claim holds if a difference lies above or below 0, so that an interval of an open verdict
    contains 0. heads: the sentence of each decided verdict, without the scenes and settings. A last
    sentence says how many verdicts both detectors give.
    """
    rows = rows_of(claim)
    parts = [
        *(s for key, head in heads.items() for s in of_settings(head, rows[rows.verdict == key])),
        *of_settings("The difference is not significant", rows[rows.verdict.isin(OPEN)], "or"),
    ]
    if unnamed := set(rows.verdict) - {*heads, *OPEN, TOO_FEW}:
        raise Error(
            f"{claim}: expected a sentence for each verdict, got none for {', '.join(unnamed)}"
        )
    return " ".join([*parts, of_both(claim)])


def of_settings(head: str, rows: pd.DataFrame, word: str = "and") -> list[str]:
    """Returns a sentence on the scenes of rows for each of the settings that occur."""
    presets = rows.index.get_level_values("preset")
    return [f"{head} {where(rows[presets == p], word)}." for p in SETTINGS if p in presets]


def of_both(claim: str) -> str:
    """Returns a sentence on the verdicts of both detectors that decide."""
    rows = rows_of(claim, BOTH)
    count = (rows.verdict != ONE).sum()
    decided = rows[~rows.verdict.isin([ONE, *OPEN])]
    start = "These results are for the fine-tuned detector."
    second = "the [second detector](../verdict_rules.md#detectors-that-decide)"
    if not count:
        return f"{start} PointPillars, {second} on which a verdict is based, was not measured."
    listed = (f"`{verdict}` {where(part)}" for verdict, part in decided.groupby("verdict"))
    verdict = f"The verdict of both detectors is {'; '.join(listed)}."
    end = verdict if len(decided) else "No difference is significant with both detectors."
    cases = f"{NUMBERS[count]} of {NUMBERS[len(rows)]} cases"
    return (
        f"{start} A verdict is also based on PointPillars, {second}, which was measured in "
        f"{cases}. {end}"
    )


def far_points() -> pd.DataFrame:
    """Returns the rows on the points of vehicles within the range of all LiDARs, by preset."""
    far = findings.rows_of(results("scanning_claims"), "far-range", " common,")
    return far.set_index("preset")


def areas() -> str:
    share = "share of high-quality areas"
    rows = rows_of("areas")
    undecided = rows[rows.verdict.isin(OPEN)]
    halves = span((undecided.high - undecided.low) / 2)
    text = by_verdict(
        "areas",
        {
            FAILS_BELOW: f"The Avia has a lower {share} than the Ruby Plus",
            HOLDS: f"The Avia has a higher {share} than the Ruby Plus",
        },
    )
    return (
        f"{text} The intervals of differences that are not significant have half-widths of "
        f"{halves} percentage points."
    )


def of_pointpillars() -> pd.Series:
    """Returns the verdict on `comparable` of PointPillars, trained as in the study."""
    rows = rows_of("comparable", PRIMARY[1][0]).loc[[("highway", "paper")]]
    return rows.set_index("detector").loc["pointpillars"]


def trained_once() -> None:
    """Checks what the pages say of the networks other than PointPillars."""
    rows = results("claims").dropna(subset="lidar")
    known(bool((rows.replicates == 1).all()), "PV-RCNN, DSVT and PointRCNN were trained once")


def difference(row: pd.Series) -> str:
    return f"{row.value:.1f} AP (interval {row.low:.1f} to {row.high:.1f})"


def comparable() -> str:
    captured, common = (rows_of("comparable", subset=s) for s in ("captured", "common"))
    lower = {
        (name, preset): span(-part.value.xs(preset, level="preset"), digits)
        for name, part, digits in (("captured", captured, 0), ("common", common, 1))
        for preset in SETTINGS
    }
    every = known(bool((captured.value < 0).all() & (common.value < 0).all()), "lower")
    return (
        f"After fine-tuning, the Avia's AP is {every} than that of the Ruby Plus (128 lines). The "
        f"difference is {lower['captured', 'paper']} AP with the settings of the study. With the "
        f"settings of the data sheets, the difference is {lower['captured', 'datasheet']} AP. For "
        f"vehicles that all LiDARs can see, the difference is {lower['common', 'paper']} AP with "
        "the settings of the study. For the same vehicles and the settings of the data sheets, the "
        f"difference is {lower['common', 'datasheet']} AP. With PointPillars, trained from scratch "
        "on the highway, the Avia's AP minus that of the Ruby Plus is "
        f"{difference(of_pointpillars())} with the settings of the study."
    )


def detector_decides() -> str:
    row = of_pointpillars()
    aps, _, _ = verdicts.means_of_detectors("highway", "paper")
    once = (aps[AVIA] - aps[WIDE]).loc[NETWORKS[1:]]
    trained_once()
    return (
        "**The difference depends on the detector.** PointPillars was trained from scratch at the "
        "scene, as in the study, on the highway with the settings of the study. With this network, "
        f"the Avia's AP minus that of the Ruby Plus is {difference(row)}. The verdict on the claim "
        f"`comparable` is `{row.verdict}`. PV-RCNN and DSVT were trained once. With "
        f"these networks, the difference is {joined([tenth(value) for value in once])} AP, without "
        "an interval. The page on [detectors](detectors.md) compares these networks."
    )


def lines_64() -> str:
    return by_verdict(
        "64-below",
        {
            HOLDS: "As in the study, the AP with the Pandar64 (64 lines) is lower than the Avia's",
            FAILS_ABOVE: "The AP with the Pandar64 (64 lines) is higher than the Avia's",
        },
    )


def distance() -> str:
    heads = {
        HOLDS: "The Avia's AP decreases less with distance than that of the best spinning LiDAR",
        FAILS_BELOW: "The Avia's AP decreases more than that of the best spinning LiDAR",
    }
    return (
        f"{by_verdict('gentle', heads)} A smaller decrease does not mean a higher AP: within "
        "60 m, the Avia can have the lower AP. At the crossroad, five Avias are used instead of "
        "one."
    )


def value() -> str:
    rows = rows_of("value", subset="present")
    single = rows.drop(index="crossroad", level="scene")
    five = rows.loc[["crossroad"]]
    known(bool((single.verdict == FAILS_BELOW).all()), "a single Avia does not reach AP 80")
    known(
        bool((five.verdict == CHEAPER).all()), "five Avias reach AP 80, and so does a cheaper one"
    )
    return (
        "A single Avia does not reach an AP of 80 on the highway or on the curve. The AP includes "
        "the vehicles on both sides of the pole, but the Avia covers only one side. At the "
        "crossroad, five Avias reach an AP of 80 under both presets, but a cheaper LiDAR also "
        "reaches this AP. These results are for the fine-tuned detector. The tables show which "
        "LiDARs reach an AP of 80, by price."
    )


def detectors() -> str:
    aps, seconds, times = verdicts.means_of_detectors("highway", "paper")
    tuned, background = ("fine-tuned", "generalist"), ("background", "background")
    others = aps.drop(index=[POOR, background])[WIDE]
    only = known(
        aps[WIDE][POOR] < aps[WIDE][background] < others.min(),
        "With the Ruby Plus, only PointRCNN has a lower AP than Background.",
    )
    fast, *slow = (times[network] for network in NETWORKS)
    known(fast < min(slow), "PointPillars is the fastest of them")
    known(times[background] < fast, "Background takes the least time")
    known(seconds[tuned] < seconds[PRIMARY[1]], "fine-tuning takes less time")
    known(aps[AVIA][tuned] < aps[AVIA][NETWORKS].min(), "fine-tuned AP is lower with the Avia")
    return (
        "PointPillars, PV-RCNN and DSVT, trained from scratch on the highway, have an AP of "
        f"{span(aps.loc[NETWORKS].to_numpy().ravel())} with the Ruby Plus (128 lines) and with the "
        "Avia. PointPillars takes less time per frame than PV-RCNN and DSVT. Fine-tuning the "
        "pretrained detector takes less time than training these networks, but gives a lower AP "
        "with the Avia. Background needs no labels, and takes the least time per frame. "
        f"{only} These results are for the settings of the study."
    )


def claims_of_detectors() -> str:
    aps, _, _ = verdicts.means_of_detectors("highway", "paper")
    trained_once()
    networks = aps.loc[NETWORKS, [WIDE, AVIA]]
    behind = networks.max() - aps.loc[POOR, [WIDE, AVIA]]
    spread = networks.max() - networks.min()
    known(bool((spread < 5).all()), "the three networks are within 5 AP")
    known(behind[WIDE] > 20 > behind[AVIA] > 0, "PointRCNN is far behind with the Ruby Plus")
    return (
        f"In these trainings, the AP of the three networks differs by {span(spread, 1)} at most. "
        f"As in the study, the AP of PointRCNN with the Ruby Plus is {behind[WIDE]:.0f} lower than "
        f"the highest of the three. With the Avia, the AP of PointRCNN is {behind[AVIA]:.0f} lower."
    )


def points() -> str:
    """Returns the ratio of points on far vehicles under each preset, with its interval."""
    rows = far_points()
    low = known(
        bool(rows.low["paper"] > 1 and (rows.high[["equal", "datasheet"]] < 1).all()),
        "fewer",
    )
    return (
        f"With the settings of the study, the Livox Avia has {rows.value['paper']:.1f} times as "
        "many points on far vehicles as the best other LiDAR. In these settings, the Avia alone "
        "has a long range and no random loss of returns (drop-off). If all ranges are equal, the "
        f"Avia has {low} points than the best other LiDAR: {rows.value['equal']:.2f} times as "
        f"many. With the settings of the data sheets, the Avia has {rows.value['datasheet']:.2f} "
        "times as many points."
    )


def motor() -> str:
    table = results("deskew")
    changes = table[~table.statement.str.contains(AVIA)].set_index("cut_angle_deg")
    known(set(changes.verdict[0]) == {"fails"}, "without a turn, `deskew` fails")
    known(set(changes.verdict[180]) == {"holds"}, "turned by half a turn, `deskew` holds")
    return (
        "The verdict on `deskew` depends on the cut angle. With the settings of the study, "
        "spinning LiDARs scan the road ahead at mid-frame, which is the label time of the boxes. "
        "The claim then fails for spinning LiDARs. If the cut angle is turned by 180 degrees, "
        f"the motion of vehicles moves {span(-changes.value[180])} % of the points of a spinning "
        "LiDAR out of the box. The claim then holds."
    )


def seeds() -> str:
    halves = verdicts.half_widths()
    tuned = halves["fine-tuned"]
    known(bool((halves["background"] > tuned).all()), "Background needs more replicates")
    return (
        "With a fine-tuned detector and five replicates, the 95 % interval of the AP difference "
        f"between two LiDARs has a half-width of {tuned[5]:.1f} AP. With three replicates, the "
        f"half-width is {tuned[3]:.1f} AP. The detector Background needs more replicates: the "
        f"half-width is {halves['background'][5]:.1f} AP with five."
    )
