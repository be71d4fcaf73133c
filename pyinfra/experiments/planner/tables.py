"""The files of a plan's folder: the record of the request, the tables, and the answer."""

import dataclasses
import hashlib
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import yaml

from pyinfra.core.errors import Error
from pyinfra.core.files import write
from pyinfra.dataset import simulation
from pyinfra.dataset.frames import PERIOD_S
from pyinfra.experiments.planner.candidates import POSE
from pyinfra.experiments.planner.costs import PlanLidar
from pyinfra.experiments.planner.observe import Setting
from pyinfra.experiments.planner.predict import SIMULATED, Prediction, Standing
from pyinfra.experiments.planner.request import Request
from pyinfra.experiments.planner.verdict import Compared, verdict
from pyinfra.formats.yaml_file import read_keys
from pyinfra.metrics.comparison import UNKNOWN, Interval, columns_of

REQUEST_FILE = "plan.yaml"


def keep_request(folder: Path, setting: Setting, poses: pd.DataFrame) -> None:
    """Writes everything on which the tables of a plan depend to its folder.

    poses: all poses, with their faults. Raises Error if the folder has the tables of another
    request. The record of an unfinished plan is replaced.
    """
    asked, file = _described(setting, poses), folder / REQUEST_FILE
    if folder.exists() and not folder.is_dir():
        raise Error(f"out: expected a folder, got the file {folder}")
    if (folder / "options.csv").exists():
        if not file.is_file():
            raise Error(
                f"out: expected a new folder, got {folder} with options.csv and no {REQUEST_FILE}"
            )
        before = read_keys(file)
        changed = [
            f"{name} was {before.get(name)}, is now {value}"
            for name, value in asked.items()
            if before.get(name) != value
        ]
        if changed:
            raise Error(
                f"out: expected a new folder or the folder of the same plan, got {folder} with a "
                f"different plan ({'; '.join(changed[:3])})"
            )
    folder.mkdir(parents=True, exist_ok=True)
    write(file, yaml.safe_dump(asked, sort_keys=False))


def _described(setting: Setting, poses: pd.DataFrame) -> dict[str, str]:
    """Returns the request as text, by the names of the arguments of `plan`."""
    site, asked = setting.site, dataclasses.asdict(setting.request)
    areas, period_s = asked.pop("areas"), asked.pop("period_s")
    lidars = [
        f"{one.name} at {one.price_usd.low:g} to {one.price_usd.high:g}" for one in setting.lidars
    ]
    return {
        "scene": f"{site.name}, {_digest(site.keys)}",
        **{name: str(value) for name, value in asked.items()},
        "seed": str(site.seed),
        "centre_m": ", ".join(f"{value:g}" for value in site.centre),
        "lidars": ", ".join(lidars),
        "poses": f"{len(poses)}, {_digest(poses.to_csv())}",
        "areas": f"{len(areas)}, {_digest(areas)}",
        "costs": _digest(setting.costs.lines),
        "check_frames": str(setting.effort.check_frames),
        **({} if period_s == PERIOD_S else {"period_s": str(period_s)}),
    }


def _digest(value: object) -> str:
    return hashlib.sha256(repr(value).encode()).hexdigest()[:12]


def write_tables(folder: Path, **tables: pd.DataFrame) -> None:
    """Writes NAME.csv of each table. `existing` is yes or no, so that rows can be poses."""
    for name, table in tables.items():
        if "existing" in table:
            table = table.assign(existing=np.where(table.existing.to_numpy(bool), "yes", "no"))
        write(folder / f"{name}.csv", table.to_csv(index=False, float_format="%.6g"))


def option_table(compared: Compared, setting: Setting, in_rain: Sequence[Interval]) -> pd.DataFrame:
    """Returns a row for each unit of each option; the columns of the option are repeated.

    Shares are in percent. Options are chosen by `share`. It is `recall_simulated` if the option was
    simulated, else `recall`. in_rain: shares of the first options in rain.
    """
    rows, units, stayed = [], compared.units, compared.unseen.stayed
    for number, (choice, standing) in enumerate(compared.stands, start=1):
        of_option = {
            "poles": len(units.poles(choice.units)),
            "price_usd": choice.price.middle,
            "price_usd_low": choice.price.low,
            "price_usd_high": choice.price.high,
            **_figures(compared.predicted(choice.units), standing, setting.request),
            "latency_ms": units.latency_ms(choice.units),
            "gap": 100 * choice.gap,
            "method": choice.method,
        }
        for k, unit in enumerate(choice.units, start=1):
            pose = setting.poses.iloc[int(stayed.pose[unit])]
            rows.append(
                {
                    "option": number,
                    "unit": k,
                    **{name: pose[name] for name in POSE},
                    "height_m": pose.height_m,
                    "existing": bool(pose.existing),
                    "kind": pose.kind,
                    "lidar": units.lidars[unit].name,
                }
                | of_option
            )
    table = pd.DataFrame(rows)
    if setting.site.has_weather:
        table["recall_in_rain"] = table.option.map(
            {k: 100 * share.value for k, share in enumerate(in_rain, start=1)}
        )
    return table


def _figures(before: Prediction, now: Standing, request: Request) -> dict[str, object]:
    """Returns the figures of an option as columns: verdict, predicted and simulated figures."""
    done = now.source == SIMULATED
    law = before.standing
    shares = {
        "recall": law.recall,
        "people_recall": law.people,
        **law.shares,
        **{f"recall_{name}": one for name, one in before.areas.items()},
    }
    simulated = {"recall": now.recall, "people_recall": now.people, **now.shares}
    return {
        "verdict": verdict(now, request),
        **columns_of("share", now.recall, 100),
        "source": now.source,
        "weighted": 100 * now.weighted,
        **{key: x for name, one in shares.items() for key, x in columns_of(name, one, 100).items()},
        **columns_of("false_per_frame", before.false_per_frame),
        "score": before.cut,
        "keeps_false": before.keeps_false,
        **columns_of("ap_predicted", law.ap),
        **{
            key: x
            for name, one in simulated.items()
            for key, x in columns_of(f"{name}_simulated", one if done else UNKNOWN, 100).items()
        },
        **columns_of("false_per_frame_simulated", now.false_per_frame if done else UNKNOWN),
        **columns_of("ap_simulated", now.ap if done else UNKNOWN),
        "position_m_simulated": now.position_m,
    }


def candidate_table(
    table: pd.DataFrame, pairs: pd.DataFrame, poses: pd.DataFrame, lidars: Sequence[PlanLidar]
) -> pd.DataFrame:
    """Returns a row for each observed pair of pose and LiDAR, and one for each pose with a fault.

    `recall` is the share (percent) of the weighted objects that the pair finds, in `frames` frames.
    """
    columns = ["kind", "existing", *POSE, "height_m"]
    observed = poses[columns].iloc[pairs.pose].reset_index(drop=True)
    observed = observed.assign(
        lidar=[lidars[i].name for i in pairs.lidar],
        frames=pairs.frames,
        recall=100 * pairs.recall,
        left_out=pairs.left_out,
    )
    faulty = table[table.fault != ""]
    parts = (
        observed.sort_values("recall", ascending=False, kind="stable"),
        faulty[columns].assign(lidar="", frames=0, recall=np.nan, left_out=faulty.fault),
    )
    return pd.concat([part for part in parts if len(part)], ignore_index=True)


def units_at(
    options: pd.DataFrame, number: int, lidars: Sequence[PlanLidar]
) -> list[tuple[list[float], simulation.Lidar]]:
    """Returns pose and LiDAR of each unit of an option of the table."""
    units = {lidar.name: lidar.unit for lidar in lidars}
    rows = options[options.option == number].iterrows()
    return [(list(row[POSE].to_numpy(float)), units[row.lidar]) for _, row in rows]
