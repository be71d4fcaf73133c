"""The tables of a plan: its options with the figures that decide, and the poses considered."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from pyinfra.dataset import simulation
from pyinfra.experiments.planner.candidates import POSE
from pyinfra.experiments.planner.choice import Choice, Units
from pyinfra.experiments.planner.lidars import PlanLidar
from pyinfra.experiments.planner.predict import UNKNOWN, Prediction
from pyinfra.experiments.planner.request import Request
from pyinfra.experiments.planner.verdict import SIMULATED, Standing, verdict
from pyinfra.metrics.comparison import Interval

Standings = Mapping[tuple[int, ...], Standing]


def ends(name: str, value: Interval, factor: float = 1.0) -> dict[str, float]:
    return {
        name: factor * value.value,
        f"{name}_low": factor * value.low,
        f"{name}_high": factor * value.high,
    }


def option_table(
    options: Sequence[Choice],
    predictions: Mapping[tuple[int, ...], Prediction],
    standings: Standings,
    stayed: pd.DataFrame,
    poses: pd.DataFrame,
    lidars: Sequence[PlanLidar],
    units: Units,
    request: Request,
) -> pd.DataFrame:
    """Returns a row for each unit of each option; the columns of the option are repeated.

    Shares are in percent. `share` decides, and is that of `recall_simulated` where it exists and
    that of `recall` elsewhere.
    """
    rows = []
    for number, choice in enumerate(options, start=1):
        one = {
            "poles": len({int(units.place[u]) for u in choice.units}),
            "price_usd": choice.price.middle,
            "price_usd_low": choice.price.low,
            "price_usd_high": choice.price.high,
            **figures(predictions[choice.units], standings[choice.units], request),
            "latency_ms": units.latency_ms(choice.units),
            "gap": 100 * choice.gap,
            "method": choice.method,
        }
        for k, unit in enumerate(choice.units, start=1):
            pose = poses.iloc[int(stayed.pose[unit])]
            rows.append(
                {
                    "option": number,
                    "unit": k,
                    **{name: pose[name] for name in POSE},
                    "height_m": pose.height_m,
                    "existing": bool(pose.existing),
                    "kind": pose.kind,
                    "lidar": lidars[int(stayed.lidar[unit])].name,
                }
                | one
            )
    return pd.DataFrame(rows)


def figures(before: Prediction, now: Standing, request: Request) -> dict[str, object]:
    """Returns the columns of what an option finds: what decides, predicted and simulated."""
    done = now.source == SIMULATED
    nothing = dict.fromkeys(now.shares, UNKNOWN)
    columns: dict[str, object] = {
        "verdict": verdict(now, request),
        **ends("share", now.recall, 100),
        "source": now.source,
        "weighted": 100 * now.weighted,
        **ends("recall", before.recall, 100),
        **ends("people_recall", before.people, 100),
    }
    shares = before.shares | {f"recall_{name}": one for name, one in before.areas.items()}
    for name, value in shares.items():
        columns |= ends(name, value, 100)
    columns |= ends("false_per_frame", before.false_per_frame)
    columns |= {"score": before.cut, "keeps_false": before.keeps_false}
    columns |= ends("ap_predicted", before.ap)
    measured = {
        "recall": now.recall if done else UNKNOWN,
        "people_recall": now.people if done else UNKNOWN,
        **(dict(now.shares) if done else nothing),
    }
    for name, value in measured.items():
        columns |= ends(f"{name}_simulated", value, 100)
    columns |= ends("false_per_frame_simulated", now.false_per_frame if done else UNKNOWN)
    columns |= ends("ap_simulated", now.ap if done else UNKNOWN)
    return columns | {"position_m_simulated": now.position_m if done else math.nan}


def candidate_table(
    table: pd.DataFrame, pairs: pd.DataFrame, poses: pd.DataFrame, lidars: Sequence[PlanLidar]
) -> pd.DataFrame:
    """Returns a row for each observed pair of pose and LiDAR, and one for each pose with a fault.

    `recall` is the share (percent) of the weighted objects that the pair finds, in `frames` frames.
    """
    columns = ["kind", "existing", *POSE, "height_m"]
    observed = poses[columns].iloc[pairs.pose].reset_index(drop=True)
    observed["lidar"] = [lidars[i].name for i in pairs.lidar]
    observed["frames"], observed["recall"] = pairs.frames, 100 * pairs.recall
    observed["left_out"] = pairs.left_out
    order = observed.sort_values("recall", ascending=False, kind="stable")
    faulty = table[table.fault != ""]
    others = faulty[columns].assign(lidar="", frames=0, recall=np.nan, left_out=faulty.fault)
    return pd.concat([part for part in (order, others) if len(part)], ignore_index=True)


def units_at(
    options: pd.DataFrame, number: int, lidars: Sequence[PlanLidar]
) -> list[tuple[list[float], simulation.Lidar]]:
    """Returns pose and LiDAR of each unit of an option of the table."""
    units = {lidar.name: lidar.unit for lidar in lidars}
    rows = options[options.option == number]
    return [(list(row[POSE].to_numpy(float)), units[row.lidar]) for _, row in rows.iterrows()]
