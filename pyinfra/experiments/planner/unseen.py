"""Observes the options of a plan in frames that the choice has not used.

The share that an option finds in the frames of the choice is too high on average, because the
options were selected for it. In other frames it has no such bias.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from pyinfra.experiments.planner.choice import Choice
from pyinfra.experiments.planner.lidars import PlanLidar
from pyinfra.experiments.planner.observe import observe
from pyinfra.experiments.planner.race import Race, joined, weighted_objects
from pyinfra.experiments.planner.request import Request
from pyinfra.experiments.planner.site import PlanSite

UNSEEN_FRAMES = 48  # frames of the predictions


def observed_again(
    site: PlanSite,
    stayed: pd.DataFrame,
    poses: pd.DataFrame,
    lidars: Sequence[PlanLidar],
    options: Sequence[Choice],
    request: Request,
    *,
    jobs: int = 1,
    folder: Path | None = None,
) -> Race:
    """Observes the units of options in the frames of a site.

    stayed: pose and lidar of each unit. The result has the same numbers of units.
    """
    units = sorted({unit for option in options for unit in option.units})
    wanted = np.zeros((len(poses), len(lidars)), bool)
    wanted[stayed.pose.to_numpy()[units], stayed.lidar.to_numpy()[units]] = True
    rows = observe(site, poses, lidars, wanted, site.frames, jobs=jobs, folder=folder)
    objects = weighted_objects(site, request, site.frames)
    return Race(stayed, joined(rows, stayed, objects), objects)
