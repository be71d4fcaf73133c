"""Makes the tables about tracks and counts, from results/tracks.csv."""

from typing import Any

import pandas as pd

from reproduction.tables.common import LIDARS, Columns, number, of_rows, results, rows_with

SCENES = {
    "highway": "highway",
    "crossroad": "crossroad",
    "curve": "curve",
    "crossroad_poles": "crossroad, two poles",
}


MEANS = (
    *("hota", "det_a", "ass_a", "mota", "false_tracks_per_min", "speed_error_km_h"),
    *("speed_p95_km_h", "tracks_per_frame", "detector_ms", "tracker_ms"),
)
SUMS = (
    *("switches", "objects", "passages_true", "passages", "never", "extra"),
    *("all_vehicles", "all_tracks"),
)


def rows_of(boxes: str) -> pd.DataFrame:
    """Returns a row for each scene and LiDAR: means or sums over the traffic seeds."""
    table = rows_with(results("tracks"), boxes=boxes)
    groups = table.groupby(["scene", "lidar"], sort=False)
    how = dict.fromkeys(MEANS, "mean") | dict.fromkeys(SUMS, "sum")
    order = {name: i for i, name in enumerate((*SCENES, *LIDARS))}
    return groups.agg(how).reset_index().sort_values(["scene", "lidar"], key=lambda c: c.map(order))


def _table(boxes: str, columns: Columns) -> str:
    """Returns a table with a row per scene and LiDAR. columns: see `of_rows`."""
    rows = rows_of(boxes)
    rows = rows.assign(scene=rows.scene.map(SCENES), lidar=rows.lidar.map(LIDARS))
    return of_rows(rows, {"scene": "{scene}", "LiDAR": "{lidar}", **columns})


def measures() -> str:
    """Returns a table of the tracks of the pretrained detector, a row per scene and LiDAR."""
    return _table(
        "detector",
        {
            "HOTA": "{hota:.0f}",
            "DetA": "{det_a:.0f}",
            "AssA": "{ass_a:.0f}",
            "MOTA": "{mota:.0f}",
            "vehicles": "{objects:.0f}",
            "identity switches": "{switches:.0f}",
            "false tracks per minute": "{false_tracks_per_min:.0f}",
            "speed error, km/h": lambda row: number(row["speed_error_km_h"]),
            "its 95th percentile, km/h": lambda row: number(row["speed_p95_km_h"]),
        },
    )


def _counted_more(row: Any) -> str:
    """Formats the difference of the counted passages to the true ones, in percent."""
    more = row["passages"] - row["passages_true"]
    return f"{100 * more / max(row['passages_true'], 1):+.0f}"


def passages() -> str:
    """Returns a table of the passages over the lines, a row per scene and LiDAR."""
    return _table(
        "detector",
        {
            "true passages": "{passages_true:.0f}",
            "counted": "{passages:.0f}",
            "difference, %": _counted_more,
            "passages never counted": "{never:.0f}",
            "counts without a passage": "{extra:.0f}",
        },
    )


def true_boxes() -> str:
    """Returns a table of the tracks of true boxes, a row per scene and LiDAR."""
    return _table(
        "true",
        {
            "vehicles": "{all_vehicles:.0f}",
            "tracks": "{all_tracks:.0f}",
            "identity switches": "{switches:.0f}",
            "true passages": "{passages_true:.0f}",
            "counted": "{passages:.0f}",
            "speed error, km/h": lambda row: number(row["speed_error_km_h"]),
        },
    )


def times() -> str:
    """Returns a table of processor times per frame, a row per scene and LiDAR."""
    return _table(
        "detector",
        {
            "tracks per frame": "{tracks_per_frame:.0f}",
            "detector, ms": "{detector_ms:.0f}",
            "tracker and smoother, ms": lambda row: number(row["tracker_ms"]),
        },
    )


def follow() -> str:
    """Returns a table of delays and memory of live tracking, a row per ten minutes."""
    columns = {
        "minute": "{minute:.0f}",
        "clouds": "{clouds:,}",
        "lines": "{lines:,}",
        "median delay, ms": "{delay_p50_ms:.0f}",
        "95th percentile, ms": "{delay_p95_ms:.0f}",
        "longest, ms": "{delay_max_ms:.0f}",
        "memory, MB": "{memory_mb:.0f}",
        "load average": "{load:.0f}",
    }
    return of_rows(results("follow"), columns)
