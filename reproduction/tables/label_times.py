"""Makes the tables about the time at which a label holds, and the angle at which a frame begins.

The ground truth is `captured`. The subset `common` has other vehicles at turned cut angles, because
only spinning LiDARs are simulated there.
"""

from collections.abc import Iterator

import pandas as pd
from scipy import stats

from pyinfra.core.arrays import FloatArray
from reproduction.commands.experiments import at_catalogue_law
from reproduction.commands.verdicts import LEAST_REPLICATES
from reproduction.tables.common import (
    LIDARS,
    Rows,
    mean_of_ap,
    results,
    rows_with,
    with_heads,
)
from reproduction.tables.verdicts import SETUPS

LABEL_TIMES = {"scan": "scan time", "frame": "mid-frame"}
ANGLES_DEG = (0, 90, 180, 270)  # cut angles of the tests
WIDE, NARROW = "ruby_plus", "livox_avia"
Aps = dict[tuple[str, str], pd.DataFrame]  # AP (replicates, cut angles) by LiDAR and label time


def _aps() -> Iterator[tuple[tuple[str, str, str], Aps]]:
    """Yields scene, preset and setup, with AP for both label times and several cut angles.

    The AP of all LiDARs and label times is of the same replicates.
    """
    table = at_catalogue_law(results("experiments"))
    table = rows_with(table, subset="captured", training_cut_angle_deg=0)
    table = table[table["training"].isin(SETUPS)]
    for key, part in table.groupby(["scene", "preset", "training"], sort=False):
        aps = {
            (str(lidar), str(label_time)): rows.pivot_table(
                index="replicate", columns="cut_angle_deg", values="ap_r1000"
            ).dropna()
            for (lidar, label_time), rows in part.groupby(["lidar", "label_time"], sort=False)
        }
        if any((WIDE, label_time) not in aps for label_time in LABEL_TIMES):
            continue
        replicates = sorted(set.intersection(*(set(one.index) for one in aps.values())))
        if len(replicates) >= LEAST_REPLICATES:
            scene, preset, setup = map(str, key)
            yield (scene, preset, SETUPS[setup]), {k: one.loc[replicates] for k, one in aps.items()}


def of_setup(setup: str) -> Aps:
    """Returns the AP of one detector on the highway with preset `paper`."""
    return dict(_aps())["highway", "paper", SETUPS[setup]]


@with_heads(
    "scene",
    "preset",
    "detector",
    "LiDAR",
    *(f"labels at {text}" for text in LABEL_TIMES.values()),
    "difference",
)
def label_times() -> Rows:
    """Returns the AP at both label times, as means over cut angles, and the paired difference."""
    for key, aps in _aps():
        for lidar in dict.fromkeys(lidar for lidar, _ in aps):
            both = [aps[lidar, label_time].mean(axis=1) for label_time in LABEL_TIMES]
            cells = [mean_of_ap(one) for one in (*both, both[1] - both[0])]
            yield [*key, LIDARS[lidar], *cells]


@with_heads(
    "scene", "preset", "detector", "LiDAR", "labels at", *(f"{a} degrees" for a in ANGLES_DEG), "p"
)
def cut_angles() -> Rows:
    """Returns the AP of spinning LiDARs at each cut angle, and whether the angles differ.

    `p` is the probability of differences as large or larger if the angle has no effect (F test
    with replicates as blocks).
    """
    for key, aps in _aps():
        for (lidar, label_time), table in aps.items():
            if len(table.columns) == len(ANGLES_DEG):
                means = [f"{table[angle].mean():.1f}" for angle in ANGLES_DEG]
                p = _probability(table.to_numpy(float))
                text = "<0.01" if p < 0.01 else f"{p:.2f}"
                yield [*key, LIDARS[lidar], LABEL_TIMES[label_time], *means, text]


def _probability(table: FloatArray) -> float:
    """Returns the p-value of differences between columns; the rows (replicates) are blocks."""
    blocks, groups = table.shape
    centred = table - table.mean(axis=1, keepdims=True)
    effect = centred.mean(axis=0)
    between = blocks * (effect**2).sum() / (groups - 1)
    within = ((centred - effect) ** 2).sum() / ((groups - 1) * (blocks - 1))
    return float(stats.f.sf(between / within, groups - 1, (groups - 1) * (blocks - 1)))


@with_heads(
    "scene",
    "preset",
    "detector",
    "LiDAR",
    "trained at",
    *(f"tested at {a} degrees" for a in ANGLES_DEG),
)
def training_cut_angles() -> Rows:
    """Returns the AP of detectors that were trained at several cut angles with mid-frame labels.

    Each row is one cut angle of the training, and each column one of the tests. All of them have
    the same replicates.
    """
    table = at_catalogue_law(results("experiments"))
    table = rows_with(table, subset="captured", label_time="frame")
    groups = table.groupby(["scene", "preset", "training", "lidar"], sort=False)
    for (scene, preset, setup, lidar), part in groups:
        angles = sorted(set(part.training_cut_angle_deg))
        if len(angles) > 1:
            columns = ["training_cut_angle_deg", "cut_angle_deg"]
            aps = part.pivot_table(index="replicate", columns=columns, values="ap_r1000").dropna()
            for angle in angles:
                cells = [mean_of_ap(aps[angle, test]) for test in ANGLES_DEG]
                yield [scene, preset, SETUPS[setup], LIDARS[lidar], f"{angle} degrees", *cells]


def trained_at_angles(lidar: str) -> dict[int, pd.Series]:
    """Returns the AP by cut angle of the test, for each cut angle of the training.

    The detector is fine-tuned, with mid-frame labels, on the highway with preset `paper`.
    """
    table = at_catalogue_law(results("experiments"))
    table = rows_with(table, scene="highway", preset="paper", lidar=lidar, training="fine-tuned")
    table = rows_with(table, subset="captured", label_time="frame")
    means = table.groupby(["training_cut_angle_deg", "cut_angle_deg"]).ap_r1000.mean()
    return {int(angle): means[angle] for angle in means.index.unique(0)}


@with_heads(
    "scene",
    "preset",
    "detector",
    "labels at",
    "Avia minus Ruby Plus, AP",
    "range over single cut angles",
)
def comparison() -> Rows:
    """Returns the Avia's AP minus that of the Ruby Plus at each label time and cut angle."""
    for key, aps in _aps():
        for label_time, text in LABEL_TIMES.items():
            avia, wide = aps[NARROW, label_time][0], aps[WIDE, label_time]
            less = wide.mul(-1).add(avia, axis=0)
            ends = f"{less.mean().min():.1f} to {less.mean().max():.1f}"
            yield [*key, text, mean_of_ap(less.mean(axis=1)), ends]
