"""The tables of the paper."""

import pandas as pd

from pyinfra.formats.csv_table import read_csv
from reproduction import ROOT

REFERENCE = ROOT / "reproduction/reference"


def paper_hits() -> pd.DataFrame:
    """The paper's table: columns lidar, scene, hits; LiDARs by the names they have here."""
    return read_csv(REFERENCE / "paper_hit_points.csv")


def paper_ap() -> pd.DataFrame:
    """The paper's AP: columns scene, lidar, detector, ap; by the names they have here."""
    return read_csv(REFERENCE / "paper_average_precision.csv")
