"""Summary of a stress test: where AP falls, which error causes it, and a ranking of detectors."""

import math
from collections.abc import Iterator

import numpy as np
import pandas as pd

from pyinfra.core.arrays import FloatArray
from pyinfra.experiments.stress.score import ERRORS
from pyinfra.experiments.stress.stressors import NONE, STRESSORS, UNSTRESSED, Stressor

# Columns that, together with `stressor`, identify a curve.
CURVE = "detector run lidar preset scene seed frames".split()
FALL = 10.0  # decrease in AP that counts as a failure
LEAST_SHARE = 0.2  # minimum share of the decrease for which an error counts as its cause
BEYOND = "beyond"
COLUMNS = [
    *CURVE,
    *"stressor unit severities ap_none ap_least severity_least falls_by_10 falls_to_half".split(),
    *"fails_first largest_blame share_of_fall gentleness".split(),
]
# Columns whose values are equal within a ranking of detectors.
GROUP = "lidar preset scene seed frames".split()
RANKING = [*GROUP, "rank", "detector", "run", "gentleness", "stressors"]


def curves(table: pd.DataFrame) -> Iterator[tuple[dict[str, str], Stressor, pd.DataFrame]]:
    """Yields the key, the stressor and the rows of each curve, ordered by severity.

    The first row of a curve is the row without stress. Column `at` is the severity, or the index of
    a severity that is a name. Rows with less stress than the first row are left out, such as a
    training with more frames. Curves that have no AP without stress, or no other row, are left out.
    """
    for key, rows in table.groupby(CURVE, sort=False):
        base = rows[rows.stressor == NONE.name]
        for name, part in rows[rows.stressor != NONE.name].groupby("stressor", sort=False):
            if base.ap_r1000.notna().sum() == 1 and name in STRESSORS:
                stressor = STRESSORS[str(name)]
                unstressed = base.assign(
                    severity=_unstressed_severity(stressor, base), stressor=name
                )
                curve = _ordered(pd.concat([unstressed, part], ignore_index=True), stressor)
                if len(curve) > 1:
                    yield dict(zip(CURVE, key, strict=True)), stressor, curve


def _unstressed_severity(stressor: Stressor, base: pd.DataFrame) -> str:
    if stressor.name == "training_frames":
        return f"{base.trained_frames.iloc[0]:g}"
    return f"{stressor.severities[0]:g}" if not stressor.named else UNSTRESSED


def _ordered(curve: pd.DataFrame, stressor: Stressor) -> pd.DataFrame:
    if stressor.named:
        known = list(map(str, stressor.severities))
        order = [*known, *(severity for severity in curve.severity if severity not in known)]
        at = curve.severity.map(order.index).astype(np.float64)
        return curve.assign(at=at).sort_values("at", ignore_index=True)
    curve = curve.assign(at=curve.severity.astype(float))
    # A training with fewer frames has the higher severity.
    sign = -1 if stressor.name == "training_frames" else 1
    curve = curve[sign * curve["at"] >= sign * curve["at"].iloc[0]]
    return curve.sort_values("at", ascending=sign > 0, ignore_index=True, kind="stable")


def crossing(at: FloatArray, ap: FloatArray, level: float) -> float:
    """Returns the severity at which AP first falls to `level`, interpolated linearly.

    The result is inf if AP stays above the level.
    """
    known = ~np.isnan(ap)
    at, ap = at[known], ap[known]
    if len(ap) > 0 and ap[0] <= level:
        return float(at[0])
    for i in range(1, len(ap)):
        if ap[i] <= level:
            share = (ap[i - 1] - level) / (ap[i - 1] - ap[i])
            return float(at[i - 1] + share * (at[i] - at[i - 1]))
    return math.inf


def fallen(curve: pd.DataFrame, stressor: Stressor, level: float) -> str:
    """Returns the severity at which AP falls to a level, as text.

    If the severities of a stressor are names, the text lists all names whose AP is not above the
    level.
    """
    if stressor.named:
        return " ".join(curve.severity[curve.ap_r1000 <= level]) or BEYOND
    at = crossing(curve["at"].to_numpy(), curve.ap_r1000.to_numpy(float), level)
    return f"{at:.3g}" if math.isfinite(at) else BEYOND


def first_failure(curve: pd.DataFrame) -> tuple[str, str, float]:
    """Returns the kind of the first failure, the kind with the largest cost, and the cost's share.

    The function looks at the first severity at which AP has decreased by FALL or more. The share is
    the cost divided by the decrease of AP. If it is LEAST_SHARE or more, the kind with the largest
    cost fails first. Otherwise the first text is `mixed`. Both texts are empty, and the share is
    NaN, if AP does not decrease by FALL.
    """
    base = curve.iloc[0]
    down = curve[curve.ap_r1000 <= base.ap_r1000 - FALL]
    if len(down) == 0:
        return "", "", math.nan
    row = down.iloc[0]
    blame = {
        e: (row[f"forgiven_{e}"] - base[f"forgiven_{e}"]) / (base.ap_r1000 - row.ap_r1000)
        for e in ERRORS
    }
    worst = max(blame, key=lambda error: blame[error])
    return (worst if blame[worst] >= LEAST_SHARE else "mixed"), worst, float(blame[worst])


def gentleness(curve: pd.DataFrame, stressor: Stressor) -> float:
    """Returns the mean ratio of the AP under stress to the AP without stress.

    The mean is over the severities, scaled to 0 to 1. It is NaN if AP without stress is 0, or if an
    AP is undefined.
    """
    if curve.ap_r1000.iloc[0] == 0:
        return math.nan
    ratio = curve.ap_r1000.to_numpy(float) / curve.ap_r1000.iloc[0]
    if stressor.named:
        return float(ratio[1:].mean())
    at = curve["at"].to_numpy(float)
    return float(np.trapezoid(ratio, (at - at[0]) / (at[-1] - at[0])))


def summary(table: pd.DataFrame) -> pd.DataFrame:
    """Returns a row for each curve."""
    rows = []
    for key, stressor, curve in curves(table):
        base, worst = curve.ap_r1000.iloc[0], curve.loc[curve.ap_r1000.idxmin()]
        failure, worst_error, share = first_failure(curve)
        rows.append(
            {
                **key,
                "stressor": stressor.name,
                "unit": stressor.unit,
                "severities": len(curve),
                "ap_none": base,
                "ap_least": worst.ap_r1000,
                "severity_least": worst.severity,
                "falls_by_10": fallen(curve, stressor, base - FALL),
                "falls_to_half": fallen(curve, stressor, base / 2),
                "fails_first": failure,
                "largest_blame": worst_error,
                "share_of_fall": share,
                "gentleness": gentleness(curve, stressor),
            }
        )
    return pd.DataFrame(rows, columns=COLUMNS)


def ranking(table: pd.DataFrame) -> pd.DataFrame:
    """Ranks the detectors of each LiDAR by their mean gentleness.

    The mean is over the stressors with which all detectors were tested at the same severities. A
    LiDAR is left out if there is no such stressor. A detector is left out if its AP without stress
    is 0.
    """
    training = [name for name, stressor in STRESSORS.items() if stressor.acts_on == "training"]
    rows = summary(table)
    rows["severities"] = [" ".join(curve.severity) for _, _, curve in curves(table)]
    rows = rows[~rows.stressor.isin(training)].dropna(subset="gentleness")
    ranks = []
    for key, part in rows.groupby(GROUP, sort=False):
        by_run = part.pivot(
            index=["detector", "run"], columns="stressor", values=["gentleness", "severities"]
        )
        is_common = by_run["severities"].notna().all() & (by_run["severities"].nunique() == 1)
        common = by_run["gentleness"].loc[:, is_common].astype(float)
        if common.shape[1] == 0:
            continue
        mean = common.mean(axis=1).sort_values(ascending=False)
        for rank, ((detector, run), value) in enumerate(mean.items(), start=1):
            row = {"rank": rank, "detector": detector, "run": run, "gentleness": value}
            names = dict(zip(GROUP, key, strict=True))
            ranks.append({**names, **row, "stressors": common.shape[1]})
    return pd.DataFrame(ranks, columns=RANKING)
