"""Which rows of a table of results stand for a cell where there are several."""

from __future__ import annotations

import numpy as np
import pandas as pd

from pyinfra.core.vocabulary import PRESETS

CELL = ("scene", "lidar", "preset", "detector", "tier")  # and the seed
CURVE = ("scene", "lidar", "preset", "detector")  # of a stress test
# Columns of AP of each ground truth, at 40 recalls and at 1,000, with the ends of their intervals.
AP_OF = {"captured": "ap", "common": "ap_common", "all": "ap_all", "present": "ap_present"}
AP_ENDS = ("", "_low", "_high", "_fine", "_fine_low", "_fine_high")
AP_COLUMNS = tuple(f"{name}{end}" for name in AP_OF.values() for end in AP_ENDS)
AP_R1000, AP_R40 = "AP (R1000)", "AP (R40)"  # what these are called wherever one is shown


def with_fine(cells: pd.DataFrame) -> pd.DataFrame:
    """With AP at 1,000 recalls; where an earlier version measured none, that at 40 stands in.

    Column `recalls` says which of both a row has: see `ap_name`.
    """
    columns = {}
    for name in AP_OF.values():
        existing = cells.get(f"{name}_fine", pd.Series(np.nan, cells.index))
        for end in ("", "_low", "_high"):
            if f"{name}{end}" in cells:
                fine = cells.get(f"{name}_fine{end}", np.nan)
                columns[f"{name}_fine{end}"] = cells[f"{name}{end}"].where(existing.isna(), fine)
    if "ap" in cells and "recalls" not in cells:
        fine = cells.get("ap_fine", pd.Series(np.nan, cells.index))
        recalls = pd.Series(np.where(fine.notna(), 1000.0, 40.0), cells.index)
        columns["recalls"] = recalls.where(cells.ap.notna() | fine.notna())
    return cells.assign(**columns)


def ap_name(rows: pd.DataFrame) -> str:
    """What the column ap_fine of rows (of `with_fine`) is called."""
    recalls = set(rows.recalls.dropna()) if "recalls" in rows else set()
    if recalls == {40.0}:
        return AP_R40
    return "AP (R1000; R40 in rows of version 0.2)" if 40.0 in recalls else AP_R1000


# What the AP of the whole road counts: see `with_whole`.
COUNTED = {"present": "every vehicle", "all": "all visible vehicles"}


def with_whole(cells: pd.DataFrame) -> pd.DataFrame:
    """With columns `whole` and ap_whole (ends as AP_ENDS): what compares LiDARs, poles and sites.

    cells: as of `with_fine`. Of `present`, the same for all; of `all`, which leaves out what a pole
    cannot see, where a finished row has no other, as those of version 0.3.
    """
    done = cells.ap.notna()
    fine = cells.get("ap_present_fine")
    known = fine is not None and bool(done.any()) and bool(fine[done].notna().all())
    truth = "present" if known else "all"
    names = {end: f"{AP_OF[truth]}{end}" for end in AP_ENDS}
    columns = {f"ap_whole{end}": cells[name] for end, name in names.items() if name in cells}
    return cells.assign(whole=truth, **columns)


def hidden_share(cells: pd.DataFrame) -> pd.Series:
    """Of the vehicles in the region, those that the mount cannot see; NaN where it is not known."""
    if not {"objects_all", "objects_present"} <= set(cells):
        return pd.Series(np.nan, index=cells.index)
    return 1 - cells.objects_all / cells.objects_present.where(cells.objects_present > 0)


def first_seed(rows: pd.DataFrame) -> pd.DataFrame:
    """The rows of the lowest seed of each cell."""
    seed = pd.to_numeric(rows.seed)
    return rows[seed == seed.groupby([rows[name] for name in CELL]).transform("min")]


def first_stress(rows: pd.DataFrame) -> pd.DataFrame:
    """Of each detector, LiDAR, preset and scene the rows of the first run, seed and frames."""
    way = rows[["run", "seed", "frames"]].astype(str).agg(" ".join, axis=1)
    return rows[way == way.groupby([rows[name] for name in CURVE]).transform("first")]


def each_road_once(areas: pd.DataFrame) -> pd.DataFrame:
    """Without the rows `all`, which add up the roads of a scene that has several."""
    truth = [areas[name] for name in (*CELL, "seed", "ground_truth")]
    several = areas.groupby(truth).road.transform("nunique") > 1
    return areas[~((areas.road == "all") & several)]


def preset_of_answers(rows: pd.DataFrame) -> str:
    """Of the presets with two LiDARs or more the nearest to LiDARs one can buy, else the first.

    One with a single detector gives no answers where another has several: it is begun, no more.
    rows: of one scene, one or more, with columns preset, lidar and detector.
    """
    counts = rows.groupby("preset")[["lidar", "detector"]].nunique()
    enough = (counts.lidar >= 2) & (counts.detector >= min(2, counts.detector.max()))
    for preset in reversed(PRESETS):
        if enough.get(preset, False):
            return preset
    return str(rows.preset.iloc[0])
