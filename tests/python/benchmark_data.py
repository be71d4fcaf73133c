"""A made-up table of experiments with known answers."""

import re

import numpy as np
import pandas as pd

from pyinfra.experiments.value import KEY

PRICES = {"ruby_plus": 24000, "livox_avia": 2000, "pandar_64": 6000, "helios_16": 1000}
AP = {  # AP of each LiDAR, by detector
    "pointpillars": (93.0, 94.0, 88.0, 60.0),
    "pv-rcnn": (94.0, 94.0, 90.0, 62.0),
    "dsvt": (84.0, 80.0, 80.0, 55.0),
    "pointrcnn": (50.0, 70.0, 40.0, 30.0),
}


def with_r1000(table: pd.DataFrame) -> pd.DataFrame:
    """Adds AP (R1000) with the values and intervals of AP (R40)."""
    columns = {r1000_name(name): table[name] for name in table if r1000_name(str(name))}
    return table.assign(**columns)


def r1000_name(name: str) -> str:
    """Returns the name of the column of AP (R1000); empty for a column that is not an AP (R40)."""
    parts = re.fullmatch(r"(ap(?:_common|_all|_present|_whole)?)(_low|_high|)", name)
    return f"{parts[1]}_r1000{parts[2]}" if parts else ""


def key_of(lidar: str, detector: str) -> dict[str, object]:
    return dict(zip(KEY, ("road", lidar, "paper", detector, "quick", 1), strict=True))


def experiments(half: float = 1.0) -> pd.DataFrame:
    """Returns experiments of every LiDAR with every detector. The interval of each AP extends
    `half` to either side."""
    rows = [
        key_of(lidar, detector)
        | {"ap": ap, "ap_low": ap - half, "ap_high": ap + half}
        | {"ap_all": ap, "ap_all_low": ap - half, "ap_all_high": ap + half}
        | {"latency_p50_ms": 50.0, "version": "1"}
        for detector, aps in AP.items()
        for lidar, ap in zip(PRICES, aps, strict=True)
    ]
    return with_r1000(pd.DataFrame(rows))


def replicates_of(
    rows: pd.DataFrame, value: str, half: float, ground_truth: str = "captured", **more: object
) -> pd.DataFrame:
    """Returns independent replicates of experiments. The interval of `value` extends `half` to
    either side."""
    same = {
        "vehicles_digest": "w",
        "version": "1",
        "label_time": "frame",
        "frames": 180,
        "block_s": 10.0,
    }
    same |= {"blocks": 1e6, "replicates": 200, "replicates_seed": 1, "measure": "ap_r1000"}
    records = []
    for i, row in enumerate(rows.to_dict("records")):
        # orthogonal for different i
        wave = np.sin(2 * np.pi * (i + 1) * (np.arange(200) + 0.5) / 200)
        drawn = row[value] + wave * half / 1.96 / wave.std(ddof=1)
        key = {name: row[name] for name in KEY}
        numbers = {f"replicate_{k + 1}": one for k, one in enumerate(drawn)}
        records.append(key | same | {"ground_truth": ground_truth, "value": row[value]} | numbers)
    return pd.DataFrame(records).assign(**more)


def values() -> pd.DataFrame:
    rows = [
        key_of(lidar, detector) | {"price_usd": price, "n_hqda": 10}
        for detector in AP
        for lidar, price in PRICES.items()
    ]
    return with_r1000(pd.DataFrame(rows))
