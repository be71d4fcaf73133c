"""What an evaluation came to in each draw of blocks, kept so that two can be compared in pairs.

A row is one figure of one detector on one LiDAR; the columns `draw_1` .. are its draws. They are
the same blocks for all LiDARs and detectors of a world, and for those alone: the columns SAME say
which.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np
import pandas as pd

from pyinfra.core.arrays import FloatArray
from pyinfra.core.errors import Error
from pyinfra.dataset.frames import data_set_of
from pyinfra.formats.kitti import read_yaml
from pyinfra.metrics.comparison import Bootstrapped
from pyinfra.metrics.evaluation_tables import HIGH_QUALITY, fine_ap, high_quality_share
from pyinfra.metrics.ground_truth import GroundTruth
from pyinfra.metrics.intervals import Blocks, ratio
from pyinfra.metrics.match_results import Judgement

# What two rows must have in common: else their draws are not of the same blocks, or not comparable.
SAME = ("world", "frames_version", "label_time", "frames", "block_s", "draws", "draws_seed")
COLUMNS = ("ground_truth", "measure", "value", "blocks", "version", *SAME)
DIGITS = 3
AHEAD_M = (0.0, 100.0)  # of the first road, for the slope
WINDOWS_OVERLAP = 4  # as many hold each vehicle
LEAST_WINDOWS = 5


def measure_of(range_m: float) -> str:
    """The measure of AP within a range: ap_fine_60m."""
    return f"ap_fine_{range_m:g}m"


def figures(
    judgement: Judgement,
    distance: tuple[pd.DataFrame, FloatArray],
    areas: tuple[pd.DataFrame, FloatArray],
) -> Iterator[tuple[str, Bootstrapped]]:
    """What is kept of one ground truth; tables with their draws: as of `distance_table`.

    ap_fine; n_hqda and p_hqda, number and percent of high-quality areas; ap_slope, AP per 10 m
    ahead of the sensor, if there are windows enough; recall, percent of the objects that a box of
    any score found.
    """
    blocks = judgement.blocks.count
    yield "ap_fine", fine_ap(judgement)
    table, draws = areas
    counts = (table.quality != "few").to_numpy()
    high = (table.ap_fine[counts] > HIGH_QUALITY).sum()
    yield (
        "n_hqda",
        Bootstrapped(float(high), (draws[counts] > HIGH_QUALITY).sum(0).astype(float), blocks),
    )
    if counts.any():
        share = high_quality_share(table, draws)
        yield "p_hqda", Bootstrapped(100 * float(high) / int(counts.sum()), share, blocks)
    yield from _slope_ahead(*distance, blocks)
    yield "recall", recall(judgement)


def recall(judgement: Judgement) -> Bootstrapped:
    """Percent of the objects that a prediction of any score found."""
    ranking, weights = judgement.ranking(), judgement.weights
    objects = ranking.objects.astype(np.float64)
    hits = np.bincount(ranking.hit_slot, minlength=len(objects)).astype(np.float64)
    every = np.ones((1, len(objects)))
    value, *draws = 100 * ratio(
        np.vstack([every, weights]) @ hits, np.vstack([every, weights]) @ objects
    )
    return Bootstrapped(float(value), np.array(draws), judgement.blocks.count)


def _slope_ahead(
    distance: pd.DataFrame, draws: FloatArray, blocks: float
) -> Iterator[tuple[str, Bootstrapped]]:
    ahead = (distance.road == distance.road.iloc[0]) & distance.s.between(*AHEAD_M)
    ahead &= distance.ap_fine_high > distance.ap_fine_low
    if ahead.sum() >= LEAST_WINDOWS:
        yield "ap_slope", slope(distance[ahead], draws[ahead], blocks)


def slope(windows: pd.DataFrame, draws: FloatArray, blocks: float) -> Bootstrapped:
    """AP per 10 m: lines by least squares, windows weighted by their intervals; draws (w, d)."""
    weight = 1 / (windows.ap_fine_high - windows.ap_fine_low).to_numpy() ** 2
    tens = windows.s.to_numpy() / 10
    away = weight * (tens - np.average(tens, weights=weight))
    gain = away / (away @ tens)
    return Bootstrapped(float(gain @ windows.ap_fine), gain @ draws, blocks)


def same_of(truth: GroundTruth, blocks: Blocks, seed: int) -> dict[str, object]:
    """The columns SAME of an evaluation's rows, and the version that wrote the frames."""
    frames_version, version = versions_of(truth)
    return {
        "world": world_of(truth),
        "version": version,
        "frames_version": frames_version,
        "label_time": truth.lidar.label_time if truth.lidar else "",
        "frames": len(truth.frames),
        "block_s": blocks.block_s,
        "draws": len(blocks.draws),
        "draws_seed": seed,
    }


def draw_rows(
    same: Mapping[str, object], which: str, estimates: Iterable[tuple[str, Bootstrapped]]
) -> pd.DataFrame:
    """The rows of one ground truth, with columns COLUMNS and the draws; same: of `same_of`."""
    rows = []
    for measure, one in estimates:
        head = {"ground_truth": which, "measure": measure, "value": one.value}
        drawn = {f"draw_{i + 1}": round(v, DIGITS) for i, v in enumerate(one.draws.tolist())}
        rows.append({**head, "blocks": one.blocks, **same, **drawn})
    return pd.DataFrame(rows)


def world_of(truth: GroundTruth) -> str:
    """A digest of what there is to be found, whichever LiDAR looks: vehicles of the region."""
    v = truth.vehicles
    there = v.visibility >= 0 if truth.has_objects else np.ones(len(v), np.bool_)
    frames = np.array(truth.frames)[v.frame[there]]
    sizes = np.round(v.mid_frame[there, 3:6] * 100).astype(np.int64)
    rows = np.unique(np.column_stack([frames, v.ids[there], sizes]), axis=0)
    parts = [np.array(truth.frames, np.int64), rows.astype(np.int64)]
    return hashlib.sha256(b"".join(part.tobytes() for part in parts)).hexdigest()[:16]


def versions_of(truth: GroundTruth) -> tuple[str, str]:
    """The number of the frames and the version that wrote them; nothing without dataset.yaml."""
    if truth.versions is not None:
        return truth.versions
    file = data_set_of(truth.folder) / "dataset.yaml"
    top = read_yaml(file) if file.is_file() else None
    number, version = (top.maybe(k) if top else None for k in ("frames_version", "version"))
    text = version.text() if version else ""
    return number.text() if number else frames_version_of(text), text


def frames_version_of(version: str) -> str:
    """The number of the frames of version 0.3, which did not write it: "3".

    Of other versions nothing is known: only those of the same one go together.
    """
    return "3" if version.startswith("0.3.") else version


def _same(row: pd.Series, name: str) -> str:
    """The text of a column SAME; rows of 0.3 have their version in place of `frames_version`."""
    text = str(row[name]) if name in row and pd.notna(row[name]) else ""
    return text or frames_version_of(str(row["version"])) if name == "frames_version" else text


def drawn(row: pd.Series) -> Bootstrapped:
    """A row of the table as a figure with its draws."""
    names = [f"draw_{i + 1}" for i in range(int(row.draws))]
    return Bootstrapped(float(row.value), row[names].to_numpy(np.float64), float(row.blocks))


def are_pairs(a: pd.Series, b: pd.Series) -> bool:
    """Whether the draws of two rows are of the same blocks, and may be compared."""
    return all(_same(a, name) == _same(b, name) for name in SAME)


def check_pair(a: pd.Series, b: pd.Series, also: Sequence[str] = ()) -> None:
    """Raises Error with what differs if two rows cannot be compared in pairs."""
    for name in (*also, *SAME):
        if _same(a, name) != _same(b, name):
            origins = [str(row["origin"]) for row in (a, b) if "origin" in row]
            where = f"{' and '.join(origins)}: " if origins else ""
            raise Error(
                f"{where}{name}: found {_same(a, name)} and {_same(b, name)}, allowed the same: "
                "draws of blocks are pairs within one world, number of frames and label time alone"
            )


def difference(a: pd.Series, b: pd.Series, also: Sequence[str] = ()) -> Bootstrapped:
    """The first less the second, draw by draw. Raises Error as `check_pair`."""
    check_pair(a, b, also)
    return drawn(a).less(drawn(b))
