"""Reads the tables of the paper."""

import pandas as pd

from pyinfra.formats.csv_table import read_csv
from reproduction import ROOT

REFERENCE = ROOT / "reproduction/reference"


def paper_hits() -> pd.DataFrame:
    """Returns the paper's hit points per frame as a table with the columns lidar, scene, hits.

    The LiDARs have this project's names.
    """
    return read_csv(REFERENCE / "paper_hit_points.csv")


def paper_ap() -> pd.DataFrame:
    """Returns the paper's AP as a table with the columns scene, lidar, detector, ap.

    Scenes, LiDARs and detectors have this project's names.
    """
    return read_csv(REFERENCE / "paper_average_precision.csv")
