"""Makes tables about user sites: maps, traffic, pedestrians and cyclists, several poles."""

from __future__ import annotations

import itertools
from collections.abc import Iterable

import pandas as pd

from pyinfra.metrics.replicates import difference
from reproduction.tables.common import (
    DETECTORS,
    LIDARS,
    markdown,
    results,
    with_interval,
    with_interval_of_ap,
)

PEOPLE_POINTS, PEOPLE_BIN_M = 5, 10  # the same values as in the command `people`
POLE_DETECTORS = DETECTORS | {"background-relearnt": "Background, trained again"}
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


def people() -> str:
    """Returns a table of points on pedestrians and cyclists by LiDAR.

    It has the largest distance with at least PEOPLE_POINTS points, and points at four distances.
    """
    table = results("people")
    at_m = (20, 50, 100, 150)
    rows = []
    for lidar, group in table.groupby("lidar", sort=False):
        walkers = group[group["class"] == "Pedestrian"].set_index("from_m").points
        distances = [
            people_distance(group[group["class"] == name]) for name in ("Pedestrian", "Cyclist")
        ]
        rows.append([str(lidar), *distances, *(f"{walkers.get(m, 0):g}" for m in at_m)])
    heads = ["LiDAR", "pedestrian, m", "cyclist, m"]
    return markdown([*heads, *(f"points from {m} m" for m in at_m)], rows)


def people_distance(bins: pd.DataFrame) -> str:
    """Returns the far end (m) of the last distance bin that has at least PEOPLE_POINTS points.

    If a nearer bin has fewer points, the text also gives the distance up to which all bins have
    enough points.
    """
    enough = (bins.points >= PEOPLE_POINTS).to_numpy()
    if not enough.any():
        return "-"
    end = bins.from_m.to_numpy() + PEOPLE_BIN_M
    first, last = enough.argmax(), len(enough) - 1 - enough[::-1].argmax()
    if enough[first : last + 1].all():
        return f"{end[last]}"
    unbroken = first + (~enough[first:]).argmax() - 1
    return f"{end[last]} (all to {end[unbroken]})"


def traffic() -> str:
    """Returns a table of the motion of SUMO's road users before and after smoothing."""
    rows = []
    for (net, seed), group in results("traffic").groupby(["net", "seed"], sort=False):
        before, after = group.iloc[0], group.iloc[1]
        pairs = ("turn_deg", "acceleration_m_s2", "overlap_percent")
        figures = (f"{before[name]:.4g} / {after[name]:.4g}" for name in pairs)
        tracks = f"{after.vehicles_and_riders} + {after.pedestrians}"
        rows.append([net, str(seed), tracks, str(after.left_out), *figures, str(after.appearing)])
    heads = ["network", "seed", "vehicles and riders + pedestrians", "left out", "turn, degrees"]
    return markdown([*heads, "acceleration, m/s2", "overlaps, %", "appear inside"], rows)


def sites() -> str:
    """Returns a table of ten maps: their content, the time of each step, and Background's AP."""
    table = results("sites")
    steps = ("import", "traffic", "check", "run")
    rows = []
    for site, group in table.groupby("site", sort=False):
        first = group.iloc[0]
        counts = [f"{first.lanes}", f"{first.triangles / 1000:.0f}", f"{first.vehicles}"]
        seconds = [f"{first[f'{step}_s']:.1f}" for step in steps]
        by_lidar = group.set_index("lidar")
        line = by_lidar.loc["ruby_plus"]
        seconds += [f"{line.detect_s + line.evaluate_s:.1f}"]
        ap_cells = [site_ap(by_lidar.loc[lidar], "all") for lidar in ("ruby_plus", "livox_avia")]
        captured = [site_ap(by_lidar.loc["livox_avia"], "captured")]
        rows.append([str(site).replace("_", " "), *counts, *seconds, *ap_cells, *captured])
    heads = ["site", "lanes", "triangles, k", "vehicles", *(f"{step}, s" for step in steps)]
    heads += ["Background, s", "AP of all, 128 lines", "AP of all, Avia", "of captured, Avia"]
    return markdown(heads, rows)


def site_ap(row: pd.Series, truth: str) -> str:
    return with_interval_of_ap(*(float(row[f"ap_{truth}{end}"]) for end in ("", "_low", "_high")))


def poles() -> str:
    """Returns a table of AP by number of poles, and of the gain from more poles."""
    rows = []
    for names, by_poles in of_poles():
        ap = [
            with_interval(*by_poles[n][["ap_r1000", "ap_r1000_low", "ap_r1000_high"]])
            if n in by_poles
            else ""
            for n in (1, 2, 4)
        ]
        rows.append(
            [
                *names,
                *ap,
                _less(by_poles.get(2), by_poles.get(1)),
                _less(by_poles.get(4), by_poles.get(2)),
            ]
        )
    heads = ["1 pole", "2 poles", "4 poles", "2 minus 1", "4 minus 2"]
    return markdown(["LiDAR", "detector", *heads], rows)


def pole_points() -> str:
    """Returns a table of the points on the median vehicle and of Background's false positives.

    A table cell has the values for one, two and four poles.
    """
    rows = []
    for (lidar, detector), by_poles in of_poles():
        if detector == POLE_DETECTORS["background"]:
            poles = [by_poles[n] for n in (1, 2, 4)]
            points = " / ".join(f"{row.points_per_vehicle:.0f}" for row in poles)
            background = " / ".join(f"{row.background_per_frame:.1f}" for row in poles)
            misplaced = " / ".join(f"{row.misplaced_per_frame:.1f}" for row in poles)
            rows.append([lidar, points, background, misplaced])
    heads = ["points on the median vehicle", "boxes on background per frame"]
    return markdown(["LiDAR", *heads, "misplaced boxes per frame"], rows)


def places() -> str:
    """Returns a table of AP by LiDAR position, with paired differences to position COMPARED."""
    table = results("places").fillna({"minus": ""})
    keys = ["ground_truth", "place", "minus", "measure"]
    rows = []
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
                less = _signed(after.value, after.low, after.high)
            elif before is not None:
                less = _signed(-before.value, -before.high, -before.low)
            rows.append([str(lidar), words, f"{hidden:.0f} %", *cells, less])
    heads = ["LiDAR", "position", "hidden", "AP of visible vehicles", "AP of all vehicles"]
    return markdown([*heads, "recall, %", "AP minus AP at the corner, 6 m"], rows)


def _signed(value: float, low: float, high: float) -> str:
    return f"{value:+.1f} [{low:+.1f}, {high:+.1f}]"


def pole_errors() -> str:
    """Returns a table of the AP that each clock or pose error costs, with two and four poles."""
    rows = []
    for names, by_poles in of_poles():
        for right in (by_poles[n] for n in (2, 4) if n in by_poles):
            cells = [_less(wrong, right) for wrong in _errors(right)]
            rows.append([*names, f"{right.poles}", *cells])
    return markdown(["LiDAR", "detector", "poles", *POLE_ERRORS.values()], rows)


def of_poles() -> Iterable[tuple[list[str], dict[int, pd.Series]]]:
    """Yields the labels [LiDAR, detector] and the rows by number of poles.

    The rows are those of ground-truth subset `all` without clock or pose errors.
    """
    table = results("poles")
    right = table[(table.error == "none") & (table.ground_truth == "all")]
    for detector, (lidar, words) in itertools.product(POLE_DETECTORS, LIDARS.items()):
        selected = right[(right.lidar == lidar) & (right.arm == detector)]
        if len(selected):
            rows = {int(row.poles): row for _, row in selected.iterrows()}
            yield [words, POLE_DETECTORS[detector]], rows


def _errors(right: pd.Series) -> Iterable[pd.Series | None]:
    """Returns, for each error, the row of the same experiment, or None if there is no row."""
    table = results("poles")
    keys = ["lidar", "arm", "poles", "ground_truth"]
    by_error = table[(table[keys] == right[keys]).all(axis=1)].set_index("error", drop=False)
    return (by_error.loc[name] if name in by_error.index else None for name in POLE_ERRORS)


def _less(a: pd.Series | None, b: pd.Series | None) -> str:
    """Formats the paired difference a - b with its interval; returns "" if a row is missing."""
    if a is None or b is None:
        return ""
    change = difference(a, b).measured()
    return f"{change.value:+.1f} [{change.low:+.1f}, {change.high:+.1f}]"
