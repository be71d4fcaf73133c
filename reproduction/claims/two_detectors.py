"""Combines the verdicts of the two detectors that are trained for each LiDAR.

docs/verdict_rules.md, "Detectors that decide", has the rule.
"""

from collections.abc import Iterator, Sequence

import pandas as pd

# Value of the column `training`, and detector, for both detectors that decide a claim.
PRIMARY = (("fine-tuned", "generalist"), ("from scratch", "pointpillars"))
BOTH = "both"  # value of the column `training` in a combined row
HOLDS, FAILS_ABOVE, FAILS_BELOW = "holds", "fails above", "fails below"
UNDECIDED, NOT_KNOWN = "undecided", "not known"
TOO_FEW = "too few replicates"
CHEAPER = "fails, as a cheaper LiDAR reaches it"
DEPENDS = "depends on the detector"
ONE = "one detector only"
FAILS = "fails"
FAR_FROM_LEVEL = {FAILS_BELOW, CHEAPER}  # both verdicts mean that the claim `value` fails
CASE = ["claim", "scene", "preset", "label_time", "subset", "law_exponent"]


def combined(verdicts: Sequence[str]) -> str:
    """Returns the combined verdict of both detectors.

    If both verdicts are decided and differ, the result is DEPENDS. If one of them is not decided,
    the result is `undecided` if further replicates may decide it, else `not known`.

    verdicts: one verdict of each detector that was measured
    """
    known = [verdict for verdict in verdicts if verdict != TOO_FEW]
    if len(known) < len(PRIMARY):
        return ONE
    if UNDECIDED in known:
        return UNDECIDED
    if NOT_KNOWN in known:
        return NOT_KNOWN
    if set(known) == FAR_FROM_LEVEL:
        return FAILS
    return known[0] if len(set(known)) == 1 else DEPENDS


def of_both(rows: pd.DataFrame) -> Iterator[dict[str, object]]:
    """Yields a row with the combined verdict for each case (columns CASE).

    `replicates` is the smaller number of the two detectors. rows: claims of single detectors.
    """
    primary = rows[rows.primary]
    for key, part in primary.groupby(CASE, sort=False):
        yield {
            **dict(zip(CASE, key, strict=True)),
            "training": BOTH,
            "primary": False,
            "replicates": part.replicates.min(),
            "verdict": combined(part.verdict.to_list()),
        }


def undecided(rows: pd.DataFrame) -> Iterator[str]:
    """Yields the options of `reproduction experiments` for each row without a decided verdict.

    rows: claims of single detectors
    """
    setups = {PRIMARY[0]: PRIMARY[0][0], PRIMARY[1]: PRIMARY[1][1]}
    open_rows = rows[rows.primary & (rows.verdict == UNDECIDED)]
    keys = ["scene", "preset", "label_time", "training", "detector", "law_exponent"]
    for key, part in open_rows.groupby(keys, sort=False):
        scene, preset, label_time, training, detector, exponent = key
        yield (
            f"--scenes {scene} --presets {preset} --label-times {label_time} "
            f"--setups {setups[training, detector]} --law-exponents {exponent:g}: "
            f"{part.replicates.max()} replicates, undecided: "
            f"{', '.join(dict.fromkeys(part.claim))}"
        )
