"""Scanning statistics of data sets: statistics of points, which need no detector.

They include returns per frame, points per vehicle and the coverage of the field of view.
scanning_tables.py computes the statistics of vehicles. scan_patterns.py computes the statistics of
rays. This module combines their tables. The definitions are in the section
"Scanning statistics" of docs/conventions/evaluation.md.
"""

import itertools
from collections.abc import Sequence
from pathlib import Path
from typing import cast

import numpy as np
import pandas as pd

from pyinfra.core.errors import FormatError
from pyinfra.core.progress import track
from pyinfra.core.vocabulary import PERSON_TYPES
from pyinfra.dataset.data_set import DataSet, read_data_set
from pyinfra.dataset.trajectories import between_rows, existing, read_rows
from pyinfra.metrics import scanning_tables as statistics_tables
from pyinfra.metrics.intervals import Blocks
from pyinfra.metrics.observations import (
    Observations,
    accumulated,
    blocks_of,
    ends_of_runs,
    hit_counts,
    read_observations,
)

Tables = dict[str, pd.DataFrame]


def sets_of(vehicles: Observations) -> dict[str, Observations]:
    """Returns the sets of vehicles for which statistics are computed, by name."""
    return {
        "common": vehicles.select(vehicles.common()),
        "view": vehicles.select(vehicles.view()),
    }


def vehicle_tables(vehicles: Observations, blocks: Blocks) -> Tables:
    """Returns points_per_vehicle, quality, only_one, decay and box_points, with a column `set`."""
    tables: dict[str, list[pd.DataFrame]] = {}
    for name, chosen in sets_of(vehicles).items():
        for table, function in (
            ("points_per_vehicle", statistics_tables.points_per_vehicle),
            ("quality", statistics_tables.quality),
            ("only_one", statistics_tables.only_one),
            ("decay", statistics_tables.decay),
            ("box_points", statistics_tables.box_points),
        ):
            rows = function(chosen, blocks)
            rows.insert(0, "set", name)
            tables.setdefault(table, []).append(rows)
    return {name: pd.concat(parts, ignore_index=True) for name, parts in tables.items()}


def speed_table(data: DataSet) -> pd.DataFrame:
    """Returns the speeds of all vehicles at the starts of the frames, from trajectories.csv.

    Raises FormatError with file and line.
    """
    rows = _speeds(data.folder / "trajectories.csv")
    rows = rows[~rows["class"].isin(PERSON_TYPES)].sort_values(["id", "t"], kind="stable")
    starts = np.array(data.frames) * data.period_s
    seen = existing(rows, starts, starts)
    speed = between_rows(rows[["speed"]].to_numpy(np.float64), seen.start)[:, 0]
    return statistics_tables.speed_distribution(rows.id.to_numpy()[seen.row], speed)


def _speeds(file: Path) -> pd.DataFrame:
    rows = read_rows(file, ["t", "id", "class", "speed"])
    for name, most in (("t", 1e6), ("id", 2**31 - 1), ("speed", 1000)):
        bad = np.flatnonzero(~rows[name].between(0, most))
        if len(bad) > 0:
            problem = f"{file}:{rows.index[bad[0]] + 2}: {name}: expected 0 to {most:g}"
            raise FormatError(f"{problem}, got {rows[name].iloc[bad[0]]:g}")
    return rows


def pattern_tables(data: DataSet) -> Tables:
    """Returns lit_share and angular_density of the LiDARs whose scan pattern is known.

    Raises ImportError if the compiled extension is not installed.
    """
    from pyinfra.metrics import scan_patterns

    tables: dict[str, list[pd.DataFrame]] = {"lit_share": [], "angular_density": []}
    for lidar in data.lidars:
        file = data.lidar_folder(lidar.name) / "lidar.yaml"
        if not scan_patterns.has_pattern(file):
            continue
        rays = scan_patterns.read_rays(file, scan_patterns.FIELD_S, data.period_s)
        tables["lit_share"].append(scan_patterns.lit_share(rays).assign(lidar=lidar.name))
        tables["angular_density"].append(
            scan_patterns.angular_density(rays).assign(lidar=lidar.name)
        )
    return {name: pd.concat(parts, ignore_index=True) for name, parts in tables.items() if parts}


def data_set_tables(
    data: DataSet, vehicles: Observations, *, above_road: bool, accumulate: int = 1
) -> Tables:
    """Returns all tables of one data set except the tables of scan patterns.

    The first columns of each table identify the data set. Recordings and data sets of `frames.save`
    have no trajectories.csv, and no table of speeds; a run, which has summary.csv, must have it.
    accumulate: number of consecutive frames that are merged into one. Raises Error if there are not
    that many consecutive frames.
    """
    ends = ends_of_runs(data.frames, accumulate)
    blocks = blocks_of(data, vehicles, ends)
    tables = vehicle_tables(accumulated(vehicles, data.frames, accumulate), blocks)
    counts = {}
    for lidar in data.lidars:
        returns = hit_counts(data, lidar, above_road=above_road)
        run_returns = np.convolve(
            returns, np.ones(accumulate, np.int64), "valid"
        )  # runs of frames with gaps are removed below
        last = np.array(data.frames)[accumulate - 1 :]
        counts[lidar.name] = run_returns[np.isin(last, ends)]
    tables["hit_points"] = statistics_tables.hit_points(counts, blocks)
    if any((data.folder / name).is_file() for name in ("trajectories.csv", "summary.csv")):
        tables["speed"] = speed_table(data)
    named = {name: described(data, rows, above_road) for name, rows in tables.items()}
    if accumulate == 1:
        return named
    return {name: rows.assign(accumulate=accumulate) for name, rows in named.items()}


def aggregation_table(
    data_sets: Sequence[DataSet], vehicles: Sequence[Observations], *, above_road: bool = False
) -> pd.DataFrame:
    """Returns the change in the number of points from another aggregation mode to `exact`.

    The vehicles are those of set `common`.

    Data sets are paired if they have the same scene, preset, seed and LiDARs. A pair is compared on
    the frames that both data sets have. The table is empty if there is no pair.
    """
    rows = []
    pairs = itertools.permutations(zip(data_sets, vehicles, strict=True), 2)
    for (before, a), (after, b) in pairs:
        same = all(getattr(before, k) == getattr(after, k) for k in ("scene", "preset", "seed"))
        frames = np.intersect1d(before.frames, after.frames)
        if not same or after.aggregation != "exact" or before.aggregation == "exact":
            continue
        if before.names != after.names or len(frames) == 0:
            continue
        blocks = blocks_of(after, b, frames.astype(np.int64))
        change = statistics_tables.aggregation_change(
            a.select(a.common()), b.select(b.common()), blocks
        )
        rows.append(described(before, change, above_road))
    return pd.concat(rows, ignore_index=True) if rows else pd.DataFrame()


def described(data: DataSet, rows: pd.DataFrame, above_road: bool) -> pd.DataFrame:
    """Returns rows with the added first columns scene, preset, aggregation, seed, above_road."""
    key = {
        "scene": data.scene,
        "preset": data.preset,
        "aggregation": data.aggregation,
        "seed": data.seed,
        "above_road": "above road" if above_road else "all points",
    }
    return cast(
        pd.DataFrame, pd.concat([pd.DataFrame([key] * len(rows), index=rows.index), rows], axis=1)
    )


def statistics(
    folders: Sequence[Path],
    *,
    above_road: bool = False,
    patterns: bool = True,
    accumulate: int = 1,
) -> Tables:
    """Returns all tables by name, each with the rows of all data sets.

    accumulate: number of consecutive frames that are merged into one, as in `accumulated`. If it is
    more than 1, there is no table `aggregation`. patterns: whether to compute the tables of rays.

    Raises the exceptions of read_data_set and read_observations. With `patterns`, also raises
    ImportError if the compiled extension is not installed.
    """
    data_sets = [read_data_set(folder) for folder in folders]
    vehicles = [
        read_observations(data, above_road=above_road) for data in track(data_sets, "data set")
    ]
    parts = [
        data_set_tables(data, v, above_road=above_road, accumulate=accumulate)
        for data, v in zip(data_sets, vehicles, strict=True)
    ]
    tables = _joined(parts)
    if accumulate == 1:
        change = aggregation_table(data_sets, vehicles, above_road=above_road)
        if len(change) > 0:
            tables["aggregation"] = change
    if patterns:
        tables |= _patterns_once(data_sets, above_road)
    return tables


def _patterns_once(data_sets: Sequence[DataSet], above_road: bool) -> Tables:
    """Returns the tables of patterns, once for each preset and set of LiDARs."""
    first_data_sets: dict[tuple[str, tuple[str, ...]], DataSet] = {}
    for data in data_sets:
        first_data_sets.setdefault((data.preset, data.names), data)
    return _joined(
        [
            {name: described(data, rows, above_road) for name, rows in pattern_tables(data).items()}
            for data in first_data_sets.values()
        ]
    )


def _joined(parts: Sequence[Tables]) -> Tables:
    """Concatenates tables of the same name."""
    names = list(dict.fromkeys(name for part in parts for name in part))
    return {
        name: pd.concat([part[name] for part in parts if name in part], ignore_index=True)
        for name in names
    }
