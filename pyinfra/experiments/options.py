"""The options of a benchmark: finished experiments with their price and the road they cover."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

from pyinfra.core.errors import Error
from pyinfra.dataset.frames_version import LEARNT, MAY_BE_BETTER, other_frames
from pyinfra.dataset.windows import REGION_M
from pyinfra.experiments.benchmark.replicates import ExperimentReplicates
from pyinfra.experiments.coverage import coverage
from pyinfra.experiments.option import Option, mean_option
from pyinfra.experiments.requirements import FRAME_MS, Requirements
from pyinfra.experiments.result_tables import Results, check_tier, hardly_learnt, read_results
from pyinfra.experiments.value import KEY, MOUNTS, SITE_ITEMS, mounts_of
from pyinfra.metrics.comparison import Interval
from pyinfra.metrics.replicates import bootstrapped_of, measure_of
from pyinfra.metrics.row_selection import (
    AP_OF,
    OFF_REGION,
    common_seeds,
    first_seed,
    hidden_share,
    preset_of_answers,
    with_whole,
)


def read_options(
    folder: Path, tier: str, scene: str, preset: str, requirements: Requirements
) -> list[Option]:
    """Returns the result of `options_of` for the tables of a folder.

    Raises FileNotFoundError if a table is missing.
    """
    return options_of(read_tables(folder, tier), scene, preset, requirements)


def options_of(
    results: Results, scene: str, preset: str, requirements: Requirements
) -> list[Option]:
    """Returns the finished experiments of a scene, ordered by AP of all vehicles, then by price.

    Only the seeds that all options have are used. If there are several, figures are those of
    `mean_option`, and prices and latencies are those of the first seed. preset: by default the
    result of `preset_of_answers`. Raises Error for an invalid table, for a scene or preset without
    results, and for a table in which experiments are missing.
    """
    done = results.finished()
    if done.empty:
        file = file_of(results, "experiments")
        raise Error(f"{file}: expected one or more finished experiments, got none")
    scene, preset = chosen(done, scene, preset)
    rows = done[(done.scene == scene) & (done.preset == preset)]
    seed, seeds = pd.to_numeric(rows.seed), common_seeds(rows)
    parts = [first_seed(rows)] if len(seeds) == 1 else [rows[seed == number] for number in seeds]
    by_name = [{o.name: o for o in _of_seed(results, part, requirements)} for part in parts]
    names = [name for name in by_name[0] if all(name in options for options in by_name)]
    options = [mean_option([options[name] for options in by_name]) for name in names]
    options = with_replicates(options, results.table("until"))
    return sorted(options, key=lambda o: (-np.nan_to_num(o.ap_whole.value), o.price_usd))


def with_replicates(options: Sequence[Option], until: pd.DataFrame) -> list[Option]:
    """Returns the options; `replicated` has the difference of those that table `until` compares.

    It is the difference of the AP of the whole region. Options with a shorter range get none.
    """
    named, first = {f"{o.lidar} {o.detector}": o for o in options}, options[0]
    rows = until[(until.scene == first.scene) & (until.preset == first.preset)]
    for _, row in rows[rows.subset == first.whole].iterrows():
        if first.range_m < REGION_M or not {row["first"], row["second"]} <= named.keys():
            continue
        one, two = named[row["first"]], named[row["second"]]
        named[row["first"]] = replace(
            one, replicated={two.name: Interval(row.difference, row.low, row.high)}
        )
        named[row["second"]] = replace(
            two, replicated={one.name: Interval(-row.difference, -row.high, -row.low)}
        )
    return list(named.values())


def _of_seed(
    results: Results, experiments: pd.DataFrame, requirements: Requirements
) -> list[Option]:
    """Returns the options of one seed of a scene and preset."""
    scene, preset = str(experiments.scene.iloc[0]), str(experiments.preset.iloc[0])
    experiments = experiments.assign(hardly_learnt=hardly_learnt(experiments))
    experiments = within(with_whole(experiments), results.table("ranges"), requirements)
    experiments = experiments.assign(hidden=hidden_share(experiments))
    truth = str(experiments.whole.iloc[0])
    table = joined(experiments, prices(results), file_of(results, "value"))
    distance, squares = (
        rows[(rows.scene == scene) & (rows.preset == preset)]
        for rows in (results.table("distance"), results.table("squares"))
    )
    covering = coverage(distance, squares, requirements, truth)
    table = joined(table, covering, file_of(results, "distance"))
    replicates = ExperimentReplicates(results.table("replicates"))
    return [option(row, replicates) for _, row in table.iterrows()]


def read_tables(folder: Path, tier: str) -> Results:
    """Reads tables with `read_results`, and checks that they suffice for a recommendation.

    Raises FileNotFoundError for a missing table, and Error for a table of LiDARs without presets.
    """
    for suffix in ("", "_value", "_distance"):
        file = folder / f"{tier}{suffix}.csv"
        if not file.is_file():
            check_tier(folder, tier)
            raise FileNotFoundError(
                2, "The table does not exist; `pyinfra benchmark` writes it", str(file)
            )
    results = read_results(folder, tier)
    lidars = results.table("lidars")
    if len(lidars) and "preset" not in lidars:
        raise Error(
            f"{file_of(results, 'lidars')}:1: expected the column preset of a table of `pyinfra "
            "benchmark`, got none"
        )
    return results


def file_of(results: Results, table: str) -> Path:
    return results.folder / results.file(table)


def chosen(done: pd.DataFrame, scene: str, preset: str) -> tuple[str, str]:
    """Returns the scene and preset to use. Raises Error if they are not in the table."""
    scenes = sorted(set(done.scene))
    if scene not in scenes:
        if scene or len(scenes) != 1:
            got = f"'{scene}'" if scene else "none"
            raise Error(f"scene: expected one of the scenes {', '.join(scenes)}; got {got}")
        (scene,) = scenes
    of_scene = done[done.scene == scene]
    presets = sorted(set(of_scene.preset))
    if preset and preset not in presets:
        raise Error(f"preset: expected one of the presets {', '.join(presets)}; got '{preset}'")
    return scene, preset or preset_of_answers(of_scene)


def joined(experiments: pd.DataFrame, more: pd.DataFrame, file: Path) -> pd.DataFrame:
    """Returns the experiments with the columns of another table, which was read from `file`.

    Raises Error, which names the file, if experiments are missing in the other table.
    """
    table = experiments.merge(more, on=KEY)
    if len(table) < len(experiments):
        raise Error(
            f"{file}: expected rows of all {len(experiments)} experiments, got rows of "
            f"{len(table)}; run `pyinfra benchmark` again to write them"
        )
    return table


def prices(results: Results) -> pd.DataFrame:
    """Returns the prices of LiDAR and site, their source, and the site's costs.

    The result has a row for each experiment. If the table of LiDARs has no row for the
    experiment, low and high are equal to the price, and the source is empty.
    """
    columns = [*KEY, "price_usd", "site_usd", *SITE_ITEMS]
    value = results.table("value").dropna(subset="price_usd")
    value = value[columns].assign(**{MOUNTS: mounts_of(value)})
    lidars = results.table("lidars")
    if lidars.empty:
        price = value.price_usd
        return value.assign(
            price_low_usd=price, price_high_usd=price, price_source="", frame_ms=FRAME_MS
        )
    ends = ["price_low_usd", "price_high_usd"]
    lidars = lidars.assign(frame_ms=1000 * lidars["period_s"])
    columns = ["lidar", "preset", "price_source", "frame_ms", *ends]
    value = value.merge(lidars[columns], on=["lidar", "preset"], how="left")
    value = value.assign(
        price_source=value.price_source.fillna("").astype(str),
        frame_ms=value.frame_ms.fillna(FRAME_MS),
    )
    totals = {end: value[end] * value[MOUNTS] + value.site_usd for end in ends}
    return value.assign(**{end: usd.fillna(value.price_usd) for end, usd in totals.items()})


def within(
    experiments: pd.DataFrame, ranges: pd.DataFrame, requirements: Requirements
) -> pd.DataFrame:
    """Returns the experiments with AP, recall and counts within the required range, and range_m.

    In tables of earlier versions, an experiment has no rows in the table of ranges. Its AP is then
    the AP of the whole region, and column range_m is NaN. Raises Error for a range that was not
    measured.
    """
    by_range = ranges.merge(experiments[[*KEY, "whole"]], on=KEY)
    if by_range.empty or len(by_range[KEY].drop_duplicates()) < len(experiments):
        return experiments.assign(
            range_m=math.nan, recall=math.nan, recall_low=math.nan, recall_high=math.nan
        )
    measured_m = sorted(set(by_range.range_m))
    if requirements.range_m not in measured_m:
        allowed = ", ".join(f"{range_m:g}" for range_m in measured_m)
        raise Error(f"range_m: expected one of {allowed} m, got {requirements.range_m:g}")
    by_range = by_range[by_range.range_m == requirements.range_m]
    merged = experiments[KEY].assign(range_m=requirements.range_m)
    for truth, name in (*AP_OF.items(), ("whole", "ap_whole")):
        is_counted = by_range.ground_truth == (by_range.whole if truth == "whole" else truth)
        columns = {f"ap_r1000{end}": f"{name}_r1000{end}" for end in ("", "_low", "_high")}
        columns |= {"objects": f"objects_{truth}"}
        if truth == "whole":
            columns |= {name: name for name in ("recall", "recall_low", "recall_high")}
        rows = by_range[is_counted][[*KEY, *columns]].rename(columns=columns)
        merged = merged.merge(rows, on=KEY, how="left")
    others = [name for name in experiments if name not in merged or name in KEY]
    return experiments[others].merge(merged, on=KEY)


def other_frames_of(row: pd.Series) -> str:
    """Returns a remark if a detector learnt from frames of a different frames_version."""
    learnt, used = (str(row.get(name, "")) for name in (LEARNT, "frames_version"))
    return other_frames(str(row.detector), learnt, used, MAY_BE_BETTER)


def option(row: pd.Series, replicates: ExperimentReplicates) -> Option:
    recall = replicates.row(row, row.whole, "recall")
    ap = replicates.row(row, row.whole, *(measure_of(m) for m in [row.range_m] if m >= 0))
    return Option(
        scene=row.scene,
        preset=row.preset,
        lidar=row.lidar,
        detector=row.detector,
        ap_whole=Interval(row.ap_whole_r1000, row.ap_whole_r1000_low, row.ap_whole_r1000_high),
        ap_visible=Interval(row.ap_all_r1000, row.ap_all_r1000_low, row.ap_all_r1000_high),
        hidden=row.hidden,
        ap=Interval(row.ap_r1000, row.ap_r1000_low, row.ap_r1000_high),
        price_usd=row.price_usd,
        price_low_usd=row.price_low_usd,
        price_high_usd=row.price_high_usd,
        price_source=row.price_source,
        site_usd=row.site_usd,
        site_items={item: row[item] for item in SITE_ITEMS if math.isfinite(row[item])},
        covered_m=Interval(row.covered_m, row.low_m, row.high_m),
        road_m=row.road_m,
        latency_ms=row.latency_p50_ms,
        latency_low_ms=row.latency_low_ms,
        latency_p95_ms=row.latency_p95_ms,
        frame_ms=row.frame_ms,
        machine=str(row.get("latency_machine", "")),
        other_cores=row.latency_other_cores,
        replicates=() if ap is None else (ap,),
        range_m=row.range_m,
        recall=Interval(row.recall, row.recall_low, row.recall_high),
        covered_in=row.covered_in,
        no_interval=row.no_interval,
        detected=None if recall is None else bootstrapped_of(recall).measured(),
        whole=row.whole,
        mounts=int(row[MOUNTS]),
        off_region_per_min=row[OFF_REGION],
        hardly_learnt=bool(row.hardly_learnt),
        other_frames=other_frames_of(row),
    )
