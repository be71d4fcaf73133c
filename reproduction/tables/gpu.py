"""Makes tables about training and detection on a GPU, from results/gpu.csv."""

import itertools
from collections import Counter

import pandas as pd
import yaml

from reproduction import ROOT
from reproduction.tables.common import DETECTORS as NAMES
from reproduction.tables.common import (
    Columns,
    Rows,
    markdown,
    number,
    of_rows,
    results,
    rows_with,
    tenth,
    with_heads,
)

DETECTORS = ("centerpoint-pillar", "pointpillars", "dsvt", "pv-rcnn", "pointrcnn")
AP_STEPS = 100  # number of training steps of tier `quick` before the AP is measured
MATRIX = ROOT / "configs/benchmarks/paper.yaml"
STEPS = 40_000  # number of steps of a training of tier `full`
OPEN = "not measured"


def _measured(tier: str) -> pd.DataFrame:
    """Returns the measured values of a tier; one row per device, detector and setting."""
    table = rows_with(results("gpu"), tier=tier)
    return table.pivot_table("value", ["device", "detector", "setting"], "measure", sort=False)


def _rates(table: pd.DataFrame) -> pd.DataFrame:
    return table[table.steps_per_s.notna()].reset_index()


@with_heads("device", "detector", "setting", "steps/s", "GPU waits", "memory (GB)", "40,000 steps")
def rates() -> Rows:
    """Returns a table of the training rates of the tier `full` on a GPU."""
    for row in _rates(_measured("full")).itertuples():
        figures = [number(row.steps_per_s), f"{100 * row.waits:.0f} %", tenth(row.memory_gb)]
        time = f"{STEPS / row.steps_per_s / 3600:.1f} h"
        yield [row.device, NAMES[row.detector], row.setting, *figures, time]


def rates_of_cpu() -> str:
    """Returns a table of the rates of the tier `quick`, on one thread of a CPU."""
    rows = [
        [row.device, NAMES[row.detector], number(row.steps_per_s), f"{row.latency_ms:.0f} ms"]
        for row in _rates(_measured("quick")).itertuples()
    ]
    return markdown(["device", "detector", "steps/s", "latency"], rows)


@with_heads("device", "detector", "latency")
def detection() -> Rows:
    """Returns a table of the latency of the tier `full` on a GPU, from points to boxes."""
    table = _measured("full").reset_index()
    for row in table[table.latency_ms.notna()].itertuples():
        yield [row.device, NAMES[row.detector], f"{tenth(row.latency_ms)} ms"]


def accuracy() -> str:
    """Returns a table of the AP after a fixed number of steps, by device."""
    table = _measured("quick").reset_index()
    values = table.pivot_table("ap_r1000", "detector", "device", sort=False)
    rows = [
        [NAMES[str(name)], *(OPEN if pd.isna(value) else tenth(value) for value in row)]
        for name, row in zip(values.index, values.to_numpy(), strict=True)
    ]
    heads = [f"AP after {AP_STEPS} steps: {device}" for device in values.columns]
    return markdown(["detector", *heads], rows)


def batches() -> str:
    """Returns a table of the batches per second by the number of workers."""
    table = rows_with(results("gpu"), measure="batches_per_s")
    columns: Columns = {
        "device": "{device}",
        "processes that make batches": lambda row: str(row["setting"].split()[0]),
        "batches/s": lambda row: number(row["value"]),
    }
    return of_rows(table, columns)


@with_heads("detector", "trainings", "GPU hours with the fastest setting")
def hours() -> Rows:
    """Returns a table of the GPU hours of the study's matrix with the tier `full`."""
    axes, each = ("detectors", "scenes", "lidars", "presets", "seeds"), list[tuple[object, ...]]()
    for part in yaml.safe_load(MATRIX.read_text(encoding="utf-8"))["matrix"]:
        each += itertools.product(*(part.get(name, [1]) for name in axes))
    count = Counter(str(one[0]) for one in dict.fromkeys(each))  # each experiment counts once
    table = _rates(_measured("full"))
    best = table.groupby("detector").steps_per_s.max()
    for name, trainings in count.items():
        network = "pointrcnn" if name == "pointrcnn-remedied" else name
        if network in DETECTORS:
            time = f"{trainings * STEPS / best[network] / 3600:.0f}"
            yield [NAMES[name], str(trainings), time]
