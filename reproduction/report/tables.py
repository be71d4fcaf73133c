"""Declares the study's tables in a folder of results, in addition to pyinfra's tables."""

from pyinfra.experiments.result_tables import FINITE, SHARE, kind

TABLES = {
    "fidelity": kind(
        "fidelity.csv",
        "detail lidar distance_m",
        "points_per_vehicle change_percent relative_time",
        change_percent=FINITE,
    ),
    "aggregation": kind(
        "aggregation.csv",
        "aggregation lidar",
        "points_per_vehicle outside_box_percent ms_per_frame_set",
        outside_box_percent=SHARE,
    ),
    "ladder": kind(
        "ladder.csv",
        "detail aggregation frames lidar",
        "seed ap_r1000 vehicle_points_per_frame ms_per_frame_set",
    ),
    "beam": kind("beam.csv", "lidar distance", "vehicles points_per_vehicle in_box"),
    "speed": kind("speed.csv", "what unit", "value"),
}
