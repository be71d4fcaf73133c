"""Makes the table of AP with stacked frames."""

import pandas as pd

from pyinfra.metrics.comparison import Interval
from reproduction.tables.common import LIDARS, interval, markdown, mean_of_ap, results, signed

PERIOD_S = 0.1
LABELS_AT = {"newest": ", label of the last frame", "middle": ", label of the middle frame"}
SINGLE = (1, "newest")  # values of accumulate and label_at for single frames


def aps(subset: str) -> dict[tuple[int, str], pd.DataFrame]:
    """Returns AP (R1000) by seed and stack (accumulate, label_at), for each speed and LiDAR."""
    table = results("integration").query("subset == @subset")
    return {
        (int(speed), str(lidar)): part.pivot(
            index="seed", columns=["accumulate", "label_at"], values="ap_r1000"
        )
        for (speed, lidar), part in table.groupby(["speed_km_h", "lidar"], sort=False)
    }


def change(of_seeds: pd.DataFrame, stack: tuple[int, str]) -> Interval:
    """Returns the change of AP by a stack of frames, paired by seed."""
    return interval(of_seeds[stack] - of_seeds[SINGLE])


def name_of(stack: tuple[int, str]) -> str:
    frames, label_at = stack
    return f"{PERIOD_S * frames:g} s{LABELS_AT[label_at]}"


def integration(subset: str = "captured") -> str:
    """Returns AP (R1000) with single frames, and its change with stacked frames.

    Values are means over traffic seeds.
    """
    cases = aps(subset)
    longer = list(dict.fromkeys(s for of_seeds in cases.values() for s in of_seeds if s != SINGLE))
    rows = [
        [
            f"{speed} km/h",
            LIDARS[lidar],
            mean_of_ap(of_seeds[SINGLE]),
            *(signed(change(of_seeds, s)) if s in of_seeds else "" for s in longer),
        ]
        for (speed, lidar), of_seeds in cases.items()
    ]
    heads = [f"change, {name_of(stack)}" for stack in longer]
    return markdown(["speed", "LiDAR", f"AP, {PERIOD_S:g} s", *heads], rows)
