"""Makes the tables about tracks and counts, from results/tracks.csv."""

import pandas as pd

from reproduction.tables.common import LIDARS, markdown, number, results

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
    table = results("tracks")
    table = table[table.boxes == boxes]
    groups = table.groupby(["scene", "lidar"], sort=False)
    how = dict.fromkeys(MEANS, "mean") | dict.fromkeys(SUMS, "sum")
    order = {name: i for i, name in enumerate((*SCENES, *LIDARS))}
    return groups.agg(how).reset_index().sort_values(["scene", "lidar"], key=lambda c: c.map(order))


def measures() -> str:
    """Returns a table of the tracks of the pretrained detector, a row per scene and LiDAR."""
    rows = [
        [
            SCENES[row.scene],
            LIDARS[row.lidar],
            f"{row.hota:.0f}",
            f"{row.det_a:.0f}",
            f"{row.ass_a:.0f}",
            f"{row.mota:.0f}",
            f"{row.objects:.0f}",
            f"{row.switches:.0f}",
            f"{row.false_tracks_per_min:.0f}",
            number(row.speed_error_km_h),
            number(row.speed_p95_km_h),
        ]
        for row in rows_of("detector").itertuples()
    ]
    heads = ["scene", "LiDAR", "HOTA", "DetA", "AssA", "MOTA", "vehicles", "identity switches"]
    heads += ["false tracks per minute", "speed error, km/h", "its 95th percentile, km/h"]
    return markdown(heads, rows)


def passages() -> str:
    """Returns a table of the passages over the lines, a row per scene and LiDAR."""
    rows = [
        [
            SCENES[row.scene],
            LIDARS[row.lidar],
            f"{row.passages_true:.0f}",
            f"{row.passages:.0f}",
            f"{100 * (row.passages - row.passages_true) / max(row.passages_true, 1):+.0f}",
            f"{row.never:.0f}",
            f"{row.extra:.0f}",
        ]
        for row in rows_of("detector").itertuples()
    ]
    heads = ["scene", "LiDAR", "true passages", "counted", "difference, %"]
    return markdown([*heads, "passages never counted", "counts without a passage"], rows)


def true_boxes() -> str:
    """Returns a table of the tracks of true boxes, a row per scene and LiDAR."""
    rows = [
        [
            SCENES[row.scene],
            LIDARS[row.lidar],
            f"{row.all_vehicles:.0f}",
            f"{row.all_tracks:.0f}",
            f"{row.switches:.0f}",
            f"{row.passages_true:.0f}",
            f"{row.passages:.0f}",
            number(row.speed_error_km_h),
        ]
        for row in rows_of("true").itertuples()
    ]
    heads = [
        "scene",
        "LiDAR",
        "vehicles",
        "tracks",
        "identity switches",
        "true passages",
        "counted",
    ]
    return markdown([*heads, "speed error, km/h"], rows)


def times() -> str:
    """Returns a table of processor times per frame, a row per scene and LiDAR."""
    rows = [
        [
            SCENES[row.scene],
            LIDARS[row.lidar],
            f"{row.tracks_per_frame:.0f}",
            f"{row.detector_ms:.0f}",
            number(row.tracker_ms),
        ]
        for row in rows_of("detector").itertuples()
    ]
    heads = ["scene", "LiDAR", "tracks per frame", "detector, ms", "tracker and smoother, ms"]
    return markdown(heads, rows)


def follow() -> str:
    """Returns a table of delays and memory of live tracking, a row per ten minutes."""
    rows = [
        [
            f"{row.minute:.0f}",
            f"{row.clouds:,}",
            f"{row.lines:,}",
            f"{row.delay_p50_ms:.0f}",
            f"{row.delay_p95_ms:.0f}",
            f"{row.delay_max_ms:.0f}",
            f"{row.memory_mb:.0f}",
            f"{row.load:.0f}",
        ]
        for row in results("follow").itertuples()
    ]
    heads = ["minute", "clouds", "lines", "median delay, ms", "95th percentile, ms", "longest, ms"]
    return markdown([*heads, "memory, MB", "load average"], rows)
