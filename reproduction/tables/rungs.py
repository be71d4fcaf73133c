"""Makes tables about the models of a LiDAR, from results/rungs.csv and results/rungs_ap.csv.

A rung is one model of a LiDAR that is on or off, or one other setting of it. A band is a range of
distances.
"""

import itertools
from dataclasses import dataclass

import pandas as pd

from pyinfra.metrics.comparison import Interval
from reproduction.tables.common import (
    DETECTORS,
    LIDARS,
    Rows,
    interval,
    markdown,
    mean_of_ap,
    results,
    signed,
    with_heads,
)

LEAST_POINTS = 1.0  # minimum number of points per vehicle in a band that is compared between LiDARs
NAMES = {**LIDARS, "hesai_xt32": "XT32", "hesai_ot128": "OT128"}
BANDS = {0: "0 to 30 m", 30: "30 to 60 m", 60: "60 to 90 m", 90: "90 to 120 m"}
# The present default of each compared setting, in the words of the table.
DEFAULTS = {
    "one ray": "beam with its divergence",
    "assumed beams of 0.05 degrees": "0.1 degrees",
    "assumed beams of 0.2 degrees": "0.1 degrees",
    "beams by FWHM": "full width at 1/e2",
    "19 sub-rays": "up to 7 sub-rays",
    "sub-rays everywhere": "near moving objects",
    "separation of 0.25 m": "0.5 m, or the vendor's",
    "separation of 1 m": "0.5 m, or the vendor's",
    "first echo": "strongest echo",
    "last echo": "strongest echo",
    "two echoes": "strongest echo",
    "exponent 0.5": "0.25, or fitted",
    "one range for all channels": "a range for each channel",
}


@dataclass(frozen=True)
class Relative:
    """The largest change of the points of one LiDAR relative to another, in percent."""

    lidar: str
    other: str
    from_m: int
    change: Interval


def changes() -> pd.DataFrame:
    """Returns the change of points per vehicle in percent, by model, LiDAR, band and seed."""
    table = results("rungs")
    table = table[table.points_default > 0]
    return table.assign(change=100 * (table.points_rung / table.points_default - 1))


def largest_relative(rung: pd.DataFrame, points: pd.DataFrame) -> Relative:
    """Returns the largest relative change between two LiDARs in a band.

    A LiDAR that the rung does not change has a change of 0. `points` has the mean points per
    vehicle without the rung, by LiDAR and band.
    """
    best: Relative | None = None
    for from_m, band in rung.groupby("from_m"):
        by_lidar = band.pivot_table("change", "seed", "lidar")
        for name in LIDARS:
            if name not in by_lidar:
                by_lidar[name] = 0.0
        enough = [n for n in by_lidar if points.loc[n, from_m] >= LEAST_POINTS]
        for a, b in itertools.permutations(enough, 2):
            ratio = 100 * ((1 + by_lidar[a] / 100) / (1 + by_lidar[b] / 100) - 1)
            relative = Relative(a, b, int(from_m), interval(ratio))
            if best is None or abs(relative.change.value) > abs(best.change.value):
                best = relative
    assert best is not None
    return best


@with_heads(
    "changed model",
    *(f"{band}, %" for band in BANDS.values()),
    "largest change of a ratio, %",
    "default",
)
def rungs() -> Rows:
    """Returns a table of what each model changes in the points per vehicle.

    A cell has the lowest and the highest change of the rung's LiDARs in percent, as means over
    seeds.
    """
    table = changes()
    points = table.groupby(["lidar", "from_m"]).points_default.mean().unstack()
    for name, rung in table.groupby("rung", sort=False):
        means = rung.groupby(["from_m", "lidar"]).change.mean()
        cells = []
        for from_m in BANDS:
            kept = [n for n in rung.lidar.unique() if points.loc[n, from_m] >= LEAST_POINTS]
            of_band = means[from_m][kept]
            cells.append(f"{of_band.min():+.1f} to {of_band.max():+.1f}")
        top = largest_relative(rung, points)
        pair = f"{NAMES[top.lidar]} relative to {NAMES[top.other]}, {BANDS[top.from_m]}"
        yield [str(name), *cells, f"{signed(top.change)}: {pair}", DEFAULTS[str(name)]]


@with_heads("LiDAR", *(f"{band}, %" for band in BANDS.values()))
def rungs_by_lidar(rung: str = "one ray") -> Rows:
    """Returns a table of what one model changes, by LiDAR and distance, in percent."""
    table = changes()
    of_rung = table[table.rung == rung]
    for name in of_rung.lidar.unique():
        one = of_rung[of_rung.lidar == name]
        cells = [signed(interval(one[one.from_m == from_m].change)) for from_m in BANDS]
        yield [NAMES[name], *cells]


def rungs_ap() -> str:
    """Returns a table of the AP (R1000) with beams, and its change without them, by detector."""
    table = results("rungs_ap")
    rows = []
    for lidar in LIDARS:
        cells = []
        for detector in table.detector.unique():
            one = table[(table.lidar == lidar) & (table.detector == detector)]
            ap = one.pivot_table("ap_r1000", "seed", "rung")
            change = interval(ap["one ray"] - ap["default"])
            text = signed(change)
            cells += [mean_of_ap(ap["default"]), f"**{text}**" if change.is_significant else text]
        rows.append([LIDARS[lidar], *cells])
    heads = ["LiDAR"]
    for detector in table.detector.unique():
        name = DETECTORS.get(detector, detector)
        heads += [f"{name}: AP", f"{name}: change with one ray"]
    return markdown(heads, rows)
