"""The request of a plan in its folder, so that another plan does not replace its tables."""

from __future__ import annotations

import dataclasses
import hashlib
from pathlib import Path
from typing import Any

import pandas as pd
import yaml

from pyinfra.core.errors import Error
from pyinfra.core.files import write
from pyinfra.dataset.frames import PERIOD_S
from pyinfra.experiments.planner.costs import Costs
from pyinfra.experiments.planner.lidars import PlanLidar
from pyinfra.experiments.planner.request import Request
from pyinfra.experiments.planner.site import PlanSite
from pyinfra.formats.yaml_file import read_keys

FILE = "plan.yaml"


def described(
    site: PlanSite,
    request: Request,
    lidars: list[PlanLidar],
    poses: pd.DataFrame,
    costs: Costs,
    check_frames: int,
) -> dict[str, Any]:
    """Returns everything on which the tables of a plan depend. Keys are those of `plan`."""
    asked = dataclasses.asdict(request)
    areas = asked.pop("areas")
    period_s = asked.pop("period_s")
    periods = {} if period_s == PERIOD_S else {"period_s": str(period_s)}
    return {
        "scene": f"{site.name}, {_digest(site.keys)}",
        **{name: str(value) for name, value in asked.items()},
        "seed": str(site.seed),
        "centre_m": ", ".join(f"{value:g}" for value in site.centre),
        "lidars": ", ".join(
            f"{one.name} at {one.price_low_usd:g} to {one.price_high_usd:g}" for one in lidars
        ),
        "poses": f"{len(poses)}, {_digest(poses.to_csv())}",
        "areas": f"{len(areas)}, {_digest(areas)}",
        "costs": _digest(costs.lines),
        "check_frames": str(check_frames),
        **periods,
    }


def keep_request(folder: Path, asked: dict[str, Any]) -> None:
    """Writes the request to the folder of a plan.

    Raises Error if the folder has the tables of another request. An unfinished plan is replaced.
    """
    file = folder / FILE
    if folder.exists() and not folder.is_dir():
        raise Error(f"out: expected a folder, got the file {folder}")
    if (folder / "options.csv").exists():
        if not file.is_file():
            raise Error(f"out: expected a new folder, got {folder} with options.csv and no {FILE}")
        before = read_keys(file)
        names = [name for name, value in asked.items() if before.get(name) != value]
        if names:
            changed = [f"{name} {before.get(name)}, now {asked[name]}" for name in names[:3]]
            raise Error(
                f"out: expected a new folder or that of the same plan, got {folder} with another "
                f"({'; '.join(changed)})"
            )
    folder.mkdir(parents=True, exist_ok=True)
    write(file, yaml.safe_dump(asked, sort_keys=False))


def _digest(value: object) -> str:
    return hashlib.sha256(repr(value).encode()).hexdigest()[:12]
