"""Makes the table of the stress test over several traffic seeds."""

import numpy as np
import pandas as pd

from pyinfra.core.arrays import FloatArray
from pyinfra.experiments.stress.stressors import NONE, STRESSORS, Stressor
from pyinfra.experiments.stress.summary import BEYOND, FALL, crossing
from pyinfra.metrics.comparison import over_replicates
from reproduction.tables.common import LIDARS, markdown, mean_of_ap, results, signed
from reproduction.tables.verdicts import SETUPS


def stress() -> str:
    """Returns a table of stress test results, with a column per LiDAR and detector.

    Rows of stressors with numeric severities have the severity at which the mean AP has fallen by
    FALL, and the least and largest such severity of a single seed. Rows of named severities have
    the change of AP, paired by seed, with its 95 % interval.
    """
    table = results("stress_seeds")
    columns = dict(list(table.groupby(["lidar", "setup"], sort=False)))
    columns = {(a, b): columns[a, b] for a in LIDARS for b in SETUPS if (a, b) in columns}
    unstressed = {key: _aps(part, NONE.name, "0") for key, part in columns.items()}
    rows = [["AP (R1000) without stress", *(mean_of_ap(ap) for ap in unstressed.values())]]
    for stressor in (STRESSORS[name] for name in table.stressor.unique() if name in STRESSORS):
        if stressor.named:
            for severity in table[table.stressor == stressor.name].severity.unique():
                cells = [
                    _change(_aps(part, stressor.name, severity) - unstressed[key])
                    for key, part in columns.items()
                ]
                rows.append([f"{stressor.name}: {severity}, change of AP", *cells])
        else:
            cells = [_fall(part, stressor, unstressed[key]) for key, part in columns.items()]
            rows.append([f"{stressor.name}, {stressor.unit}", *cells])
    return markdown(["stressor", *(f"{LIDARS[a]}: {SETUPS[b]}" for a, b in columns)], rows)


def _aps(part: pd.DataFrame, stressor: str, severity: str) -> pd.Series:
    """Returns the AP by seed; empty if the stressor does not apply to the LiDAR."""
    rows = part[(part.stressor == stressor) & (part.severity.astype(str) == severity)]
    return rows.set_index("seed").ap_r1000


def _change(values: pd.Series) -> str:
    """Formats a mean difference; returns "" if the stressor does not apply to the LiDAR."""
    known = values.dropna().to_list()
    return signed(over_replicates(known)) if known else ""


def _fall(part: pd.DataFrame, stressor: Stressor, unstressed: pd.Series) -> str:
    """Returns the severity at which AP has fallen by FALL, and its range over the seeds."""
    rows = part[part.stressor == stressor.name]
    if rows.empty:
        return ""
    at, aps = _by_severity(rows, stressor, unstressed)
    of_mean, *of_seeds = (crossing(at, ap, ap[0] - FALL) for ap in (aps.mean(axis=0), *aps))
    ends = f"{_severity(min(of_seeds))} to {_severity(max(of_seeds))}"
    return _severity(of_mean) + (f" [{ends}]" if min(of_seeds) < np.inf else "")


def falls(stressor: str) -> dict[tuple[str, str], float]:
    """Returns the severity at which the mean AP has fallen by FALL, by LiDAR and detector.

    It is infinite if AP does not fall that far.
    """
    table = results("stress_seeds")
    found = {}
    for (lidar, setup), part in table.groupby(["lidar", "setup"], sort=False):
        rows = part[part.stressor == stressor]
        if len(rows):
            at, aps = _by_severity(rows, STRESSORS[stressor], _aps(part, NONE.name, "0"))
            mean = aps.mean(axis=0)
            found[str(lidar), str(setup)] = float(crossing(at, mean, mean[0] - FALL))
    return found


def _by_severity(
    rows: pd.DataFrame, stressor: Stressor, unstressed: pd.Series
) -> tuple[FloatArray, FloatArray]:
    """Returns the severities, and the AP by seed and severity, beginning without stress."""
    aps = rows.assign(at=rows.severity.astype(float)).pivot(
        index="seed", columns="at", values="ap_r1000"
    )
    aps.insert(0, float(stressor.severities[0]), unstressed)
    return aps.columns.to_numpy(float), aps.to_numpy(float)


def _severity(at: float) -> str:
    return f"{at:.0f}" if 100 <= at < np.inf else f"{at:.2g}" if at < np.inf else BEYOND
