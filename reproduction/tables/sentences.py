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
    TOO_FEW,
    UNDECIDED,
)
from reproduction.commands.experiments import at_catalogue_law
from reproduction.tables import verdicts
from reproduction.tables.common import results

WIDE, AVIA = "ruby_plus", "livox_avia"
FAST, SLOW = ("pointpillars", "centerpoint-pillar"), ("pv-rcnn", "dsvt")
NETWORKS = (*FAST, *SLOW)
SCENES = {"highway": "on the highway", "curve": "on the curve", "crossroad": "at the crossroad"}
SETTINGS = {"paper": "the settings of the study", "datasheet": "the settings of the data sheets"}
NUMBERS = ("no", "one", "two", "three", "four", "five", "six")
OPEN = (UNDECIDED, NOT_KNOWN)


def known(condition: bool, sentence: str) -> str:
    """Returns a sentence that the tables support. Raises Error if they do not."""
    if not condition:
        raise Error(f"results/: expected tables that support this sentence, got others: {sentence}")
    return sentence


def span(values: Iterable[float], digits: int = 0) -> str:
    """Returns the least and greatest value, or one number if both are printed alike."""
    least, most = (f"{end(values):.{digits}f}" for values in [list(values)] for end in (min, max))
    return least if least == most else f"{least} to {most}"


def joined(parts: Sequence[str], word: str = "and") -> str:
    return f" {word} ".join([", ".join(parts[:-1]), parts[-1]] if len(parts) > 1 else parts)


def within(changes: Iterable[Interval]) -> str:
    """Returns the smallest limit, with one decimal, in which all intervals lie."""
    far = max(max(abs(change.low), abs(change.high)) for change in changes)
    return f"{math.ceil(10 * far - 1e-9) / 10:g}"


def rows_of(claim: str, judge: str = "fine-tuned", subset: str = "captured") -> pd.DataFrame:
    """Returns the rows of a claim with labels at scan time, by scene and preset."""
    table = at_catalogue_law(results("claims"))
    keep = (table.claim == claim) & (table["judge"] == judge) & (table.subset == subset)
    return table[keep & (table.label_time == "scan")].set_index(["scene", "preset"])


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
    """Returns a sentence for each verdict of the fine-tuned detector that occurs in a claim.

    The claim holds if a difference lies above or below 0, so that an interval of an open verdict
    contains 0. heads: the sentence of each decided verdict, without the scenes and settings. A last
    sentence says how many verdicts both detectors give.
    """
    rows = rows_of(claim)
    parts = [
        f"{head} {where(rows[rows.verdict == verdict])}."
        for verdict, head in heads.items()
        if (rows.verdict == verdict).any()
    ]
    if rows.verdict.isin(OPEN).any():
        cases = where(rows[rows.verdict.isin(OPEN)], "or")
        parts.append(f"The difference is not significant {cases}.")
    if unnamed := set(rows.verdict) - {*heads, *OPEN, TOO_FEW}:
        raise Error(
            f"{claim}: expected a sentence for each verdict, got none for {', '.join(unnamed)}"
        )
    return " ".join([*parts, of_both(claim)])


def of_both(claim: str) -> str:
    """Returns a sentence on the verdicts of both detectors that decide."""
    rows = rows_of(claim, BOTH)
    count = (rows.verdict != ONE).sum()
    decided = rows[~rows.verdict.isin([ONE, *OPEN])]
    start = "These results were obtained with the fine-tuned detector."
    rules = "[rules](../verdict_rules.md#detectors-that-decide)"
    if not count:
        return f"{start} The second detector of the {rules}, PointPillars, was not measured."
    listed = (f"`{verdict}` {where(part)}" for verdict, part in decided.groupby("verdict"))
    verdict = f"The verdict of both detectors is {'; '.join(listed)}."
    end = verdict if len(decided) else "In none of them is it significant for both detectors."
    cases = f"{NUMBERS[count]} of {NUMBERS[len(rows)]} cases"
    return (
        f"{start} With PointPillars, the second detector of the {rules}, the difference was "
        f"measured in {cases}. {end}"
    )


def areas() -> str:
    share = "share of high-quality areas"
    rows = rows_of("areas")
    undecided = rows[rows.verdict.isin(OPEN)]
    halves = span((undecided.high - undecided.low) / 2)
    text = by_verdict(
        "areas",
        {
            FAILS_BELOW: f"The Avia has a lower {share} than 128 lines",
            HOLDS: f"The Avia has a higher {share} than 128 lines",
        },
    )
    return (
        f"{text} The intervals of differences that are not significant have half-widths of "
        f"{halves} percentage points."
    )


def comparable() -> str:
    captured, common = (rows_of("comparable", subset=s) for s in ("captured", "common"))
    lower = {
        (name, preset): span(-part.value.xs(preset, level="preset"), digits)
        for name, part, digits in (("captured", captured, 0), ("common", common, 1))
        for preset in SETTINGS
    }
    networks = rows_of("comparable", "from nothing").loc[[("highway", "paper")]]
    networks = networks[networks.verdict != TOO_FEW]
    worst, best = networks.low.min(), networks.high.max()
    every = known(bool((captured.value < 0).all() & (common.value < 0).all()), "lower")
    return (
        f"After fine-tuning, the Avia's AP is {every} than that of 128 lines. With the settings of "
        f"the study, it is {lower['captured', 'paper']} lower. With those of the data sheets, it "
        f"is {lower['captured', 'datasheet']} lower. For vehicles that all LiDARs can see, it is "
        f"{lower['common', 'paper']} lower with the settings of the study. With those of the data "
        f"sheets, it is {lower['common', 'datasheet']} lower. "
        "Networks that are trained from scratch give a mean difference of at most "
        f"{networks.value.abs().max():.1f} AP, on the highway with the settings of the study. The "
        f"intervals of this difference lie within {worst:.1f} to {best:.1f}. At the crossroad, "
        "five Avias are used instead of one."
    )


def detector_decides() -> str:
    networks = rows_of("comparable", "from nothing").loc[[("highway", "paper")]]
    networks = networks[networks.verdict != TOO_FEW].set_index("detector")
    names = {"pointpillars": "PointPillars", "pv-rcnn": "PV-RCNN", "dsvt": "DSVT"}
    parts = [
        f"`{verdict}` with {joined([names[str(name)] for name in part.index])}"
        for verdict, part in networks.groupby("verdict", sort=False)
    ]
    return (
        "**The difference depends on the detector.** The study trains its networks from scratch "
        f"at the scene. {joined([names[str(name)] for name in networks.index])} were trained in "
        "this way on the highway, with the settings of the study. On average, the AP of the Avia "
        f"then differs from that of 128 lines by at most {networks.value.abs().max():.1f}. The "
        f"verdict on the claim is {joined(parts)}. The page on [detectors](detectors.md) compares "
        "these networks."
    )


def lines_64() -> str:
    return by_verdict(
        "64-below",
        {
            HOLDS: "The study finds a lower AP with 64 lines than with the Avia. This claim holds",
            FAILS_ABOVE: "The AP with 64 lines is higher than with the Avia",
        },
    )


def distance() -> str:
    heads = {
        HOLDS: "With distance, the Avia's AP decreases less than that of the best spinning LiDAR",
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
        "A single Avia does not reach an AP of 80 on the highway or on the curve. This AP is of "
        "all vehicles on both sides of the pole, and the Avia sees only one side. At the "
        "crossroad, five Avias reach this AP under both presets, but a cheaper LiDAR also reaches "
        "it. These results were obtained with "
        "the fine-tuned detector. The tables show which LiDARs reach this AP, by price."
    )


def detectors() -> str:
    aps, seconds, times = verdicts.means_of_detectors("highway", "paper")
    of_networks = [("from nothing", name) for name in NETWORKS]
    tuned, background = ("fine-tuned", "generalist"), ("background", "background")
    poor = ("from nothing", "pointrcnn")
    others = aps.drop(index=[poor, background])[WIDE]
    only = known(
        aps[WIDE][poor] < aps[WIDE][background] < others.min(),
        "With 128 lines, only PointRCNN has a lower AP than Background.",
    )
    fast, slow = ([times["from nothing", n] for n in names] for names in (FAST, SLOW))
    known(max(fast) < min(slow), "PointPillars and CenterPoint-Pillar are the fastest of them")
    known(times[background] < min(fast), "Background takes the least time")
    known(seconds[tuned] < seconds["from nothing", "pointpillars"], "fine-tuning takes less time")
    known(aps[AVIA][tuned] < aps[AVIA][of_networks].min(), "fine-tuned AP is lower with the Avia")
    return (
        "Four networks that are trained from scratch on the highway have an AP of "
        f"{span(aps.loc[of_networks].to_numpy().ravel())} with 128 lines and with the Avia. They "
        "are PointPillars, CenterPoint-Pillar, PV-RCNN and DSVT; the first two are the fastest. "
        "Fine-tuning the pretrained detector takes less time than training these networks, but "
        "its AP with the Avia is lower than theirs. Background needs no labels, and takes the "
        f"least time per frame. {only} These results are for the settings of the study."
    )


def points() -> str:
    """Returns the ratio of points on far vehicles under each preset, with its interval."""
    table = results("scanning_claims")
    far = table[(table.claim == "far-range") & table.statement.str.contains(" common,")]
    rows = far.set_index("preset")
    low = known(
        bool(rows.low["paper"] > 1 and (rows.high[["equal", "datasheet"]] < 1).all()),
        "fewer",
    )
    return (
        f"With the settings of the study, the Livox Avia has {rows.value['paper']:.1f} times as "
        "many points on far vehicles as the best of the other LiDARs. These settings give it a "
        f"longer range and no drop-off. If all ranges are equal, the Avia has {low} points than "
        f"the best of the others: {rows.value['equal']:.2f} times as many. With the settings of "
        f"the data sheets, it has {rows.value['datasheet']:.2f} times as many."
    )


def motor() -> str:
    table = results("deskew")
    changes = table[~table.statement.str.contains(AVIA)].set_index("cut_angle_deg")
    known(set(changes.verdict[0]) == {"fails"}, "without a turn, `deskew` fails")
    known(set(changes.verdict[180]) == {"holds"}, "turned by half a turn, `deskew` holds")
    return (
        "The verdict on `deskew` depends on the motor. LiDARs with phase-locked motors scan the "
        "road ahead at mid-frame, which is the label time of the boxes, and the claim fails for "
        "spinning LiDARs with the settings of the study. With the motors turned by 180 degrees, "
        f"motion moves {span(-changes.value[180])} % of the points of a spinning LiDAR out of the "
        "box, and the claim holds."
    )


def seeds() -> str:
    halves = verdicts.half_widths()
    tuned = halves["fine-tuned"]
    known(bool((halves["background"] > tuned).all()), "Background needs more replicates")
    return (
        "With a fine-tuned detector and five replicates, the 95 % interval of the AP difference "
        f"between two LiDARs has a half-width of {tuned[5]:.1f} AP. With three replicates, the "
        f"half-width is {tuned[3]:.1f} AP. Background needs more replicates: with five, the "
        f"half-width is {halves['background'][5]:.1f} AP."
    )
