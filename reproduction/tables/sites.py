"""Makes tables about user sites: maps, traffic, pedestrians and cyclists, several poles."""

import itertools
from collections.abc import Iterator, Mapping

import pandas as pd

from pyinfra.metrics.comparison import Interval, over_replicates
from reproduction.tables.common import (
    DETECTORS,
    LIDARS,
    Rows,
    results,
    rows_with,
    signed,
    with_heads,
    with_interval,
    with_interval_of_ap,
)

PEOPLE_POINTS, PEOPLE_BIN_M = 5, 10  # the same values as in the command `people`
PEOPLE_AT_M = (20, 50, 100, 150)
SITE_STEPS = ("import", "traffic", "check", "run")
POLE_DETECTORS = DETECTORS | {"background-again": "Background, trained again"}
Aps = Mapping[tuple[int, str], pd.Series]  # AP by seed, for each number of poles and error
COMPARED = "6m"
PLACES = {
    "back": "40 m before the crossing, 6 m",
    "4m": "at the corner, 4 m",
    "6m": "at the corner, 6 m",
    "8m": "at the corner, 8 m",
    "8m_down": "at the corner, 8 m, 10 degrees down",
    "two": "two poles, 6 m",
}
POLE_ERRORS = {
    "clock_20_ms": "clock, 20 ms",
    "clock_50_ms": "clock, 50 ms",
    "yaw_0.2_deg": "yaw, 0.2 degrees",
    "yaw_0.5_deg": "yaw, 0.5 degrees",
}


@with_heads(
    "LiDAR",
    "distance of pedestrians, m",
    "distance of cyclists, m",
    *(f"points on a pedestrian, {m} to {m + PEOPLE_BIN_M} m" for m in PEOPLE_AT_M),
)
def people() -> Rows:
    """Returns a table of points on pedestrians and cyclists by LiDAR.

    It has the largest distance with at least PEOPLE_POINTS points, and points at four distances.
    """
    table = results("people")
    for lidar, group in table.groupby("lidar", sort=False):
        walkers = group[group["class"] == "Pedestrian"].set_index("from_m").points
        distances = [
            people_distance(group[group["class"] == name]) for name in ("Pedestrian", "Cyclist")
        ]
        yield [str(lidar), *distances, *(f"{walkers.get(m, 0):g}" for m in PEOPLE_AT_M)]


def people_distance(bins: pd.DataFrame) -> str:
    """Returns the far end (m) of the last distance bin that has at least PEOPLE_POINTS points.

    If the nearest bins have fewer points, the text begins with the distance from which there are
    enough. If another bin has fewer points, it also gives the distance up to which all bins have
    enough.
    """
    enough = (bins.points >= PEOPLE_POINTS).to_numpy()
    if not enough.any():
        return "-"
    end = bins.from_m.to_numpy() + PEOPLE_BIN_M
    first, last = enough.argmax(), len(enough) - 1 - enough[::-1].argmax()
    text = f"{end[last]}" if enough[0] else f"{bins.from_m.iloc[first]} to {end[last]}"
    if enough[first : last + 1].all():
        return text
    unbroken = first + (~enough[first:]).argmax() - 1
    return f"{text} (all to {end[unbroken]})"


@with_heads(
    "network",
    "seed",
    "vehicles and riders + pedestrians",
    "tracks left out",
    "turn, degrees",
    "acceleration, m/s2",
    "overlaps, %",
    "appear or vanish inside",
)
def traffic() -> Rows:
    """Returns a table of the motion of SUMO's road users before and after smoothing."""
    for (net, seed), group in results("traffic").groupby(["net", "seed"], sort=False):
        before, after = group.iloc[0], group.iloc[1]
        pairs = ("turn_deg", "acceleration_m_s2", "overlap_percent")
        figures = (f"{before[name]:.4g} / {after[name]:.4g}" for name in pairs)
        tracks = f"{after.vehicles_and_riders} + {after.pedestrians}"
        yield [net, str(seed), tracks, str(after.left_out), *figures, str(after.appearing)]


@with_heads(
    "site",
    "lanes",
    "triangles, thousands",
    "vehicles",
    *(f"{step}, s" for step in SITE_STEPS),
    "Background, s",
    "AP of `all`, Ruby Plus",
    "AP of `all`, Avia",
    "AP of `captured`, Avia",
)
def sites() -> Rows:
    """Returns a table of ten maps: their content, the time of each step, and Background's AP."""
    table = results("sites")
    for site, group in table.groupby("site", sort=False):
        first = group.iloc[0]
        counts = [f"{first.lanes}", f"{first.triangles / 1000:.0f}", f"{first.vehicles}"]
        seconds = [f"{first[f'{step}_s']:.1f}" for step in SITE_STEPS]
        by_lidar = group.set_index("lidar")
        line = by_lidar.loc["ruby_plus"]
        seconds += [f"{line.detect_s + line.evaluate_s:.1f}"]
        ap_cells = [site_ap(by_lidar.loc[lidar], "all") for lidar in ("ruby_plus", "livox_avia")]
        captured = [site_ap(by_lidar.loc["livox_avia"], "captured")]
        yield [str(site).replace("_", " "), *counts, *seconds, *ap_cells, *captured]


def site_ap(row: pd.Series, truth: str) -> str:
    return with_interval_of_ap(*(float(row[f"ap_{truth}{end}"]) for end in ("", "_low", "_high")))


@with_heads(
    "LiDAR",
    "detector",
    "AP with 1 pole",
    "2 poles",
    "4 poles",
    "2 poles minus 1",
    "4 poles minus 2",
)
def poles() -> Rows:
    """Returns a table of AP by number of poles, and of the gain from more poles."""
    for names, aps in ap_of_poles():
        ap = [_mean(aps[n, "none"]) if (n, "none") in aps else "" for n in (1, 2, 4)]
        gains = [_change(aps, (n, "none"), (n // 2, "none")) for n in (2, 4)]
        yield [*names, *ap, *gains]


@with_heads(
    "LiDAR",
    "points on the median vehicle",
    "boxes on background per frame",
    "misplaced boxes per frame",
)
def pole_points() -> Rows:
    """Returns a table of the points on the median vehicle and of Background's false positives.

    A table cell has the values for one, two and four poles, as means over the traffic seeds.
    """
    where = {"detector": "background", "error": "none", "ground_truth": "all"}
    table = rows_with(results("poles"), **where)
    means = table.groupby(["lidar", "poles"]).mean(numeric_only=True)
    columns = {"points_per_vehicle": 0, "background_per_frame": 1, "misplaced_per_frame": 1}
    for lidar, words in LIDARS.items():
        if lidar in means.index:
            of_lidar = means.loc[lidar].loc[[1, 2, 4]]
            cells = [" / ".join(f"{v:.{d}f}" for v in of_lidar[c]) for c, d in columns.items()]
            yield [words, *cells]


@with_heads(
    "LiDAR",
    "position",
    "hidden",
    "AP of visible vehicles",
    "AP of all vehicles",
    "recall, %",
    "AP of all vehicles minus that at the corner, 6 m",
)
def places() -> Rows:
    """Returns a table of AP by LiDAR position, with paired differences to position COMPARED."""
    table = results("places").fillna({"minus": ""})
    keys = ["ground_truth", "place", "minus", "measure"]
    for lidar, group in table.groupby("lidar", sort=False):
        by_key = {tuple(row[key] for key in keys): row for _, row in group.iterrows()}
        for place, words in PLACES.items():
            cells = [
                with_interval_of_ap(*by_key[truth, place, "", measure][["value", "low", "high"]])
                for truth, measure in (
                    ("all", "ap_r1000"),
                    ("present", "ap_r1000"),
                    ("present", "recall_percent"),
                )
            ]
            hidden = by_key["present", place, "", "hidden_percent"].value
            after = by_key.get(("present", place, COMPARED, "ap_r1000"))
            before = by_key.get(("present", COMPARED, place, "ap_r1000"))
            less = ""
            if after is not None:
                less = signed(Interval(after.value, after.low, after.high))
            elif before is not None:
                less = signed(Interval(-before.value, -before.high, -before.low))
            yield [str(lidar), words, f"{hidden:.0f} %", *cells, less]


@with_heads("LiDAR", "detector", "poles", *POLE_ERRORS.values())
def pole_errors() -> Rows:
    """Returns a table of the AP that each clock or pose error costs, with two and four poles."""
    for names, aps in ap_of_poles():
        for n in (2, 4):
            cells = [_change(aps, (n, error), (n, "none")) for error in POLE_ERRORS]
            if any(cells):
                yield [*names, f"{n}", *cells]


def ap_of_poles() -> Iterator[tuple[list[str], Aps]]:
    """Yields the labels [LiDAR, detector], and the AP by seed of each (number of poles, error).

    The AP is that of ground-truth subset `all`.
    """
    table = rows_with(results("poles"), ground_truth="all")
    for detector, (lidar, words) in itertools.product(POLE_DETECTORS, LIDARS.items()):
        selected = table[(table.lidar == lidar) & (table.detector == detector)]
        if len(selected):
            groups = selected.groupby(["poles", "error"])
            by_seed = {key: rows.set_index("seed").ap_r1000 for key, rows in groups}
            yield [words, POLE_DETECTORS[detector]], by_seed


def _mean(values: pd.Series) -> str:
    """Formats the mean over seeds with its 95 % interval."""
    mean = over_replicates(values.to_list())
    return with_interval(mean.value, mean.low, mean.high)


def change_of(aps: Aps, changed: tuple[int, str], to: tuple[int, str]) -> Interval:
    """Returns the AP of `changed` minus that of `to`, paired by seed."""
    return over_replicates((aps[changed] - aps[to]).dropna().to_list())


def _change(aps: Aps, changed: tuple[int, str], to: tuple[int, str]) -> str:
    """Formats the result of `change_of`; returns "" if an AP is missing."""
    return signed(change_of(aps, changed, to)) if changed in aps and to in aps else ""
