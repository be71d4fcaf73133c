"""What the options of a plan find in rain."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
import pandas as pd

from pyinfra.dataset import simulation
from pyinfra.experiments.planner.choice import Choice
from pyinfra.experiments.planner.detectability import Detectability
from pyinfra.experiments.planner.lidars import PlanLidar
from pyinfra.experiments.planner.observe import observe
from pyinfra.experiments.planner.predict import predict
from pyinfra.experiments.planner.race import Race, joined, weighted_objects
from pyinfra.experiments.planner.request import Request
from pyinfra.experiments.planner.site import PlanSite
from pyinfra.metrics.comparison import Interval

RAIN_MM_PER_H = 25.0  # heavy rain
FRAMES = 24
WITH_WEATHER = "datasheet"  # the preset whose LiDARs detect by received power


def recall_in_rain(
    site: PlanSite,
    stayed: pd.DataFrame,
    poses: pd.DataFrame,
    lidars: Sequence[PlanLidar],
    options: Sequence[Choice],
    law: Detectability,
    request: Request,
) -> list[Interval]:
    """Returns the share of the vehicles within the distance that each option finds in rain.

    stayed: pose and lidar of each unit. The rain takes points from the LiDARs; the detectability
    of an object with the same points is that of dry air.
    """
    frames = site.frames[:FRAMES]
    observer = simulation.load_observer(
        site.file,
        frames,
        preset=site.preset,
        seed=site.seed,
        mount=site.mount,
        set={"weather.rain_mm_per_h": RAIN_MM_PER_H},
    )
    rainy = replace(site, observer=observer, frames=frames)
    units = sorted({unit for option in options for unit in option.units})
    wanted = np.zeros((len(poses), len(lidars)), bool)
    wanted[stayed.pose.to_numpy()[units], stayed.lidar.to_numpy()[units]] = True
    rows = observe(rainy, poses, lidars, wanted, frames)
    objects = weighted_objects(rainy, request, frames)
    wet = Race(stayed, joined(rows, stayed, objects), objects)
    return [predict(wet, option.units, law, request).recall for option in options]


def rain_lines(recalls: Sequence[Interval]) -> Iterator[str]:
    """Yields what the first option finds in rain, and which other one finds more."""
    first, best = recalls[0].value, int(np.argmax([one.value for one in recalls]))
    text = f"In rain of {RAIN_MM_PER_H:g} mm/h the first option finds {100 * first:.0f} of 100"
    more = recalls[best].value
    if round(100 * more) > round(100 * first):
        text += f"; option {best + 1} finds most then, {100 * more:.0f}"
    yield f"{text}."
