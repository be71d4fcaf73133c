"""Selects the rows and AP columns that represent each experiment in a table of results."""

import numpy as np
import pandas as pd

from pyinfra.core.vocabulary import PRESETS

EXPERIMENT = (
    "scene",
    "lidar",
    "preset",
    "detector",
    "tier",
)  # columns that identify an experiment, without the seed
CURVE = ("scene", "lidar", "preset", "detector")  # columns that identify a curve of a stress test
# Columns of AP (R40) and AP (R1000) of each ground truth, with the ends of their intervals.
AP_OF = {"captured": "ap", "common": "ap_common", "all": "ap_all", "present": "ap_present"}
AP_ENDS = ("", "_low", "_high", "_r1000", "_r1000_low", "_r1000_high")
AP_COLUMNS = tuple(f"{name}{end}" for name in AP_OF.values() for end in AP_ENDS)
OFF_REGION = (
    "off_region_per_min"  # column: boxes of score 0.5 or more outside the region, per minute
)
AP_R1000, AP_R40 = "AP (R1000)", "AP (R40)"  # names of the measures in texts and figures


# Description of the vehicles that ap_whole includes, by ground-truth subset (see `with_whole`).
COUNTED = {"present": "every vehicle", "all": "all visible vehicles"}


def with_whole(experiments: pd.DataFrame) -> pd.DataFrame:
    """Adds the columns used to compare LiDARs, poles and sites.

    Column `whole` is the name of a ground-truth subset. Columns ap_whole* are the AP of this subset
    and the ends of its interval (AP_ENDS). The subset is `present`, which has the same vehicles for
    all LiDARs and mounts. Rows of version 0.3 have no AP of `present`. If any finished row lacks
    it, the subset of all rows is `all`, the vehicles that are visible from the mount.
    """
    done = experiments.ap.notna()
    r1000 = experiments.get("ap_present_r1000")
    has_present = r1000 is not None and bool(done.any()) and bool(r1000[done].notna().all())
    truth = "present" if has_present else "all"
    names = {end: f"{AP_OF[truth]}{end}" for end in AP_ENDS}
    columns = {
        f"ap_whole{end}": experiments[name] for end, name in names.items() if name in experiments
    }
    return experiments.assign(whole=truth, **columns)


def hidden_share(experiments: pd.DataFrame) -> pd.Series:
    """Returns the share of the region's vehicles that are hidden from the mount; NaN if unknown."""
    if not {"objects_all", "objects_present"} <= set(experiments):
        return pd.Series(np.nan, index=experiments.index)
    return 1 - experiments.objects_all / experiments.objects_present.where(
        experiments.objects_present > 0
    )


def common_seeds(rows: pd.DataFrame) -> list[float]:
    """Returns the seeds that all experiments of one scene and preset have, ascending.

    If the experiments have no seed in common, the result is the lowest of all seeds.
    """
    seed = pd.to_numeric(rows.seed)
    of_each = seed.groupby([rows[name] for name in EXPERIMENT], dropna=False).agg(set)
    return sorted(set.intersection(*of_each)) or [float(seed.min())]


def first_seed(rows: pd.DataFrame) -> pd.DataFrame:
    """Returns the rows of the lowest seed that all experiments of a scene and preset have.

    Experiments are then compared on the same traffic. Without a common seed, each experiment has
    the rows of its own lowest seed.
    """
    if rows.empty:
        return rows
    every, rows = rows, rows.reset_index(drop=True)  # joined tables can have an index value twice
    seed = pd.to_numeric(rows.seed)
    own = seed.groupby([rows[name] for name in EXPERIMENT], dropna=False).transform("min")
    first = pd.Series(np.nan, index=rows.index)
    for _, part in rows.groupby(["scene", "preset"], dropna=False):
        first[part.index] = common_seeds(part)[0]
    has_first = (seed == first).groupby([rows[name] for name in EXPERIMENT], dropna=False)
    chosen = seed == first.where(has_first.transform("any"), own)
    return every[chosen.to_numpy()]


def first_stress(rows: pd.DataFrame) -> pd.DataFrame:
    """Returns the rows of the first run, seed and frames of each curve (columns CURVE)."""
    run_key = rows[["run", "seed", "frames"]].astype(str).agg(" ".join, axis=1)
    return rows[run_key == run_key.groupby([rows[name] for name in CURVE]).transform("first")]


def each_road_once(areas: pd.DataFrame) -> pd.DataFrame:
    """Removes the rows of road `all` from scenes with several roads.

    These rows are sums over the roads, so areas would be counted twice.
    """
    truth = [areas[name] for name in (*EXPERIMENT, "seed", "ground_truth")]
    has_several_roads = areas.groupby(truth).road.transform("nunique") > 1
    return areas[~((areas.road == "all") & has_several_roads)]


def preset_of_answers(rows: pd.DataFrame) -> str:
    """Returns the last preset of PRESETS that has results of two LiDARs or more.

    If no preset has two LiDARs, returns the preset of the first row. Later presets of PRESETS are
    closer to real LiDARs. The function skips a preset with only one detector if another preset has
    several detectors, because the benchmark of the first preset is not complete. rows: rows of one
    scene, with columns preset, lidar and detector.
    """
    counts = rows.groupby("preset")[["lidar", "detector"]].nunique()
    enough = (counts.lidar >= 2) & (counts.detector >= min(2, counts.detector.max()))
    for preset in reversed(PRESETS):
        if enough.get(preset, False):
            return preset
    return str(rows.preset.iloc[0])
