"""Current names of the columns, values, keys and files that version 0.3 wrote."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pandas as pd

# Maps column names of version 0.3 to the current names.
_RENAMED_COLUMNS = {
    "cells": "experiments",
    "dial": "severity",
    "dial_least": "severity_least",
    "dials": "severities",
    "draws": "replicates",
    "draws_seed": "replicates_seed",
    "forgiven_ghosts": "forgiven_background",
    "found_percent": "recall_percent",
    "ghosts_per_frame": "background_per_frame",
    "precision_said": "precision_predicted",
    "recall_said": "recall_predicted",
    "seam_turned_deg": "cut_angle_turned_deg",
    "world": "vehicles_digest",
}
# Maps values of version 0.3 to current values, by column. The values of the column `measure` are
# column names, which _RENAMED_COLUMNS maps.
_RENAMED_VALUES = {
    "arm": {"specialist": "site_trained"},
    "fails_first": {"ghosts": "background"},
    "largest_blame": {"ghosts": "background"},
    "severity": {f"draw_{i}": f"sample_{i}" for i in range(1, 5)},
    "start": {"drawn": "random"},
    "stressor": {"seam": "cut_angle"},
}
# Maps keys of YAML files of version 0.3 to their current names.
_RENAMED_KEYS = {
    "own_draws": "own_random_stream",
    "seam_deg": "cut_angle_deg",
    "wedges": "prisms",
}


def current_name(column: str) -> str:
    """Returns the current name of a column. Only names of version 0.3 change."""
    column = re.sub(r"^ap_((?:all|common|present|whole)_)?fine", r"ap_\1r1000", column)
    column = re.sub(r"^draw_(?=\d+$)", "replicate_", column)
    return _RENAMED_COLUMNS.get(column, column)


def with_current_values(table: pd.DataFrame) -> pd.DataFrame:
    """Returns a text table in which the values of version 0.3 are replaced."""
    if "measure" in table:
        table["measure"] = table.measure.map(current_name)
    return table.replace({c: values for c, values in _RENAMED_VALUES.items() if c in table})


def existing(file: Path) -> Path:
    """Returns `file`, or the file of version 0.3 with the same table if only that file exists."""
    older = file.with_name(re.sub(r"replicates\.csv$", "draws.csv", file.name))
    return older if older.is_file() and not file.is_file() else file


def with_current_keys(value: Any) -> Any:
    """Returns a YAML value in which all keys have their current names."""
    if isinstance(value, dict):
        return {_RENAMED_KEYS.get(k, k): with_current_keys(v) for k, v in value.items()}
    return [with_current_keys(v) for v in value] if isinstance(value, list) else value
