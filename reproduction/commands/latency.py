"""Measures the latency of the study's detectors on one thread.

The detectors are those of `reproduction experiments`: replicate 1 on the highway with preset
`paper`. A detector that has no trained model in the working folder is trained first. The latency is
the time from points to boxes. Run the command on an idle machine:

    python -m reproduction latency --work data/experiments --out results/latency.csv
"""

import itertools
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import pandas as pd

from pyinfra.experiments import store
from pyinfra.experiments.benchmark.measure import timed_alone
from reproduction import provenance, shared_frames
from reproduction.arguments import Out, Work, command
from reproduction.commands.experiments import (
    SETUPS,
    TEST_FRAMES,
    Replicate,
    Trained,
    model_of,
    simulated,
)

LIDARS = ("ruby_plus", "livox_avia")
REPLICATE = Replicate("highway", "paper", "scan", 1)
KEY = ["scene", "preset", "lidar", "detector", "training"]


@command
def main(
    *,
    work: Work,
    out: Out = Path("latency.csv"),
    setups: Annotated[Sequence[str], {"choices": SETUPS}] = tuple(SETUPS),
    lidars: Annotated[Sequence[str], {"choices": LIDARS}] = tuple(LIDARS),
) -> None:
    """
    Parameters
    ----------
    work : working folder for frames, about 3 GB
    setups : detectors and their trainings (default: all)
    lidars : names of the LiDARs (default: all)
    """
    with shared_frames.in_use(work, REPLICATE.name):
        test = simulated(REPLICATE, REPLICATE.test_seeds[0], TEST_FRAMES, work)
        for setup, lidar in itertools.product(setups, lidars):
            trained = Trained(setup, REPLICATE, lidar)
            model, _ = model_of(trained, work)
            columns, load = timed_alone(model, test / lidar, "cpu", every=2)
            row = pd.DataFrame([{**trained.key, **columns}])[[*KEY, *columns]]
            made_by = provenance(f"latency --setups {setup}")
            columns_of_row = {key: made_by[key] for key in ("frames_version", "command")}
            store.put(out, row.assign(**columns_of_row), KEY)
            print(trained.name, columns["latency_p50_ms"], "ms;", load.text, flush=True)
