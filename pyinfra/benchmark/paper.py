"""How the AP of a benchmark goes with the paper's."""

from __future__ import annotations

import pandas as pd
from scipy.stats import spearmanr

from pyinfra.hits import paper_ap
from pyinfra.statistics.selection import first_seed

CASE = ["scene", "lidar", "detector"]
LEAST_CELLS = 3


def paper_table(cells: pd.DataFrame) -> pd.DataFrame:
    """Spearman's rank correlation with the paper, and the mean difference, of preset `paper`.

    One row a scene, and one for the scenes together (`all`); over the cells that both have.
    Columns scene, preset, cells, rank_correlation, p_value, mean_difference (here less the paper).
    """
    own = first_seed(cells[(cells.preset == "paper") & cells.ap.notna()])
    both = own.merge(paper_ap(), on=CASE, suffixes=("", "_paper"))
    groups = [*both.groupby("scene", sort=False), ("all", both)]
    rows = [{"scene": s, "preset": "paper", **agreement(t)} for s, t in groups]
    return pd.DataFrame([row for row in rows if row["cells"] >= LEAST_CELLS])


def agreement(both: pd.DataFrame) -> dict[str, float]:
    found = spearmanr(both.ap, both.ap_paper) if len(both) >= LEAST_CELLS else None
    return {
        "cells": len(both),
        "rank_correlation": float(found.statistic) if found else float("nan"),
        "p_value": float(found.pvalue) if found else float("nan"),
        "mean_difference": float((both.ap - both.ap_paper).mean()),
    }
