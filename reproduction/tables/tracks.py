"""Makes the tables about tracks and counts, from results/tracks.csv."""

import pandas as pd

from reproduction.tables.common import LIDARS, markdown, number, results

SCENES = {
    "highway": "highway",
    "crossroad": "crossroad",
    "curve": "curve",
    "crossroad_poles": "crossroad, two poles",
}


def rows_of(boxes: str) -> pd.DataFrame:
    """Returns the rows of the detector's boxes, or of true boxes, by scene and LiDAR."""
    table = results("tracks")
    table = table[table.boxes == boxes]
    order = {name: i for i, name in enumerate(SCENES)} | {name: i for i, name in enumerate(LIDARS)}
    return table.sort_values(["scene", "lidar", "seed"], key=lambda c: c.map(order).fillna(c))


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
            f"{row.switches:.0f} of {row.objects:.0f}",
            f"{row.false_tracks_per_min:.0f}",
            number(row.speed_error_km_h),
            number(row.speed_p95_km_h),
        ]
        for row in rows_of("detector").itertuples()
    ]
    heads = ["scene", "LiDAR", "HOTA", "DetA", "AssA", "MOTA", "switches, of vehicles"]
    heads += ["false tracks a minute", "speed error, km/h", "95 % below, km/h"]
    return markdown(heads, rows)


def passages() -> str:
    """Returns a table of the passages over the lines, a row per scene and LiDAR."""
    rows = [
        [
            SCENES[row.scene],
            LIDARS[row.lidar],
            f"{row.passages_true}",
            f"{row.passages}",
            f"{100 * (row.passages - row.passages_true) / max(row.passages_true, 1):+.0f}",
            f"{row.never}",
            f"{row.extra}",
        ]
        for row in rows_of("detector").itertuples()
    ]
    heads = ["scene", "LiDAR", "true passages", "counted", "difference, %"]
    return markdown([*heads, "never counted", "counted without a vehicle"], rows)


def true_boxes() -> str:
    """Returns a table of the tracks of true boxes, a row per scene and LiDAR."""
    rows = [
        [
            SCENES[row.scene],
            LIDARS[row.lidar],
            f"{row.all_vehicles:.0f}",
            f"{row.all_tracks:.0f}",
            f"{row.switches:.0f}",
            f"{row.passages_true}",
            f"{row.passages}",
            number(row.speed_error_km_h),
        ]
        for row in rows_of("true").itertuples()
    ]
    heads = ["scene", "LiDAR", "vehicles", "tracks", "switches", "true passages", "counted"]
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
    heads = ["minute", "clouds", "lines", "delay, ms (median)", "95 %", "longest", "memory, MB"]
    return markdown([*heads, "load"], rows)
