"""Small results that change only on purpose: a frame, resolved configurations, an AP table.

`GOLDEN=write make test` writes them again. Add a line to the history that gives the reason.
"""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from pyinfra.dataset import simulation
from pyinfra.metrics import ap

ROOT = Path(__file__).resolve().parents[2]
GOLDEN = ROOT / "tests/golden"
SCENES = ROOT / "configs/scenes"
EVERY = 200  # every 200th point of a frame is kept
# maximum number of points of a frame that exist only with Embree 3 (Debian 12) or Embree 4 (Debian
# 13), which may differ in the last digits. `datasheet` compares a random sample with the power of a
# return.
LOST = 3


def golden(name: str, text: str) -> str:
    """Returns the stored text. When goldens are written, stores and returns the new text."""
    file = GOLDEN / name
    if os.environ.get("GOLDEN") == "write":
        GOLDEN.mkdir(exist_ok=True)
        file.write_text(text)
    return file.read_text()


@pytest.mark.parametrize("name", ["scenes/curve", "lidars/livox_avia", "lidars/pandar_64"])
def test_resolved_configuration(name: str, infrasim: Callable[..., object]) -> None:
    text = infrasim("check", f"configs/{name}.yaml").stdout  # type: ignore[attr-defined]
    assert text == golden(f"{Path(name).name}.yaml", text)


def frame_tables(preset: str) -> dict[str, pd.DataFrame]:
    """Returns the points of one frame of two LiDARs at the curve, 30 frames after the start."""
    short = {"duration_s": 4, "traffic.warm_up_s": 10}
    world = simulation.load_scene(SCENES / "curve.yaml", preset=preset, set=short)
    names = ["livox_avia", "helios_16"]
    lidars = [simulation.load_lidar(ROOT / f"configs/lidars/{name}.yaml", preset) for name in names]
    ((_, frames),) = simulation.simulate(world, lidars, [30])
    tables = {}
    for name, frame in zip(names, frames, strict=True):
        table = pd.DataFrame(frame.xyz, columns=["x", "y", "z"])
        table["intensity"], table["ring"] = frame.intensity, frame.ring
        table["object_id"], table["time"] = frame.object_id, frame.time
        tables[name] = table
    return tables


@pytest.mark.parametrize("preset", ["paper", "datasheet"])
def test_frame(preset: str) -> None:
    tables = frame_tables(preset)
    name = f"frame_{preset}.csv"
    some = [
        table.iloc[::EVERY].assign(lidar=lidar, points=len(table))
        for lidar, table in tables.items()
    ]  # fmt: skip
    golden(name, pd.concat(some).to_csv(index=False, float_format="%.9g"))
    lost, missed = (LOST, 1) if preset == "datasheet" else (0, 0)
    for lidar, kept in pd.read_csv(GOLDEN / name).groupby("lidar"):
        now = tables[str(lidar)]
        assert abs(len(now) - kept.points.iloc[0]) <= lost
        missing = [row for row in kept.itertuples() if not is_there(row, now)]
        assert len(missing) <= missed, missing


def is_there(point: Any, table: pd.DataFrame) -> bool:
    """Returns whether a ray with the same time and ring has the same return."""
    rays = table[(table.ring == point.ring) & np.isclose(table.time, point.time, rtol=0, atol=1e-8)]
    near = np.abs(rays[["x", "y", "z"]] - [point.x, point.y, point.z]).max(axis=1) < 1e-3
    same = (rays.object_id == point.object_id) & (abs(rays.intensity - point.intensity) < 1e-3)
    return bool((near & same).any())


def test_ap_table() -> None:
    """The detector misses vehicles at random, and has false positives and equal scores."""
    draw = np.random.default_rng(7)
    rows = []
    for objects in (10, 41, 500):
        hit = draw.random(objects) < 0.8
        scores = np.round(draw.random(objects) * 0.7 + 0.3, 2)[hit]
        ghosts = np.round(draw.random(objects // 5) * 0.8, 2)
        both = np.concatenate([scores, ghosts])
        true = np.concatenate([np.ones(len(scores), bool), np.zeros(len(ghosts), bool)])
        ranking = ap.rank(both, true, objects)
        kinds = {
            "r40": ap.average_precision(ranking),
            "r11": ap.average_precision(ranking, 11),
            "kitti": ap.kitti_average_precision(ranking),
        }
        rows.append({"objects": objects} | {name: v.item() for name, v in kinds.items()})
    text = pd.DataFrame(rows).to_csv(index=False, float_format="%.6f")
    assert text == golden("ap.csv", text)


def test_goldens_are_all_used() -> None:
    used = {"curve.yaml", "livox_avia.yaml", "pandar_64.yaml", "ap.csv"}
    used |= {"frame_paper.csv", "frame_datasheet.csv"}
    assert {file.name for file in GOLDEN.iterdir()} == used
