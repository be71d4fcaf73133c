"""Makes tables about the speed and fidelity of the simulator."""

from __future__ import annotations

import pandas as pd

from pyinfra.metrics.replicates import are_pairs, difference
from reproduction.tables.common import LIDARS, markdown, results, with_interval_of_ap


def speed() -> str:
    """Returns a table of the measurements of `make bench`."""
    table = results("speed")
    now = table[~table.what.str.startswith("speed / before")]  # a comparison with another version
    rows = [[r.what, f"{r.value:.2f} {r.unit}"] for r in now.itertuples()]
    return markdown(["measurement", "value"], rows)


def ladder(name: str = "ladder") -> str:
    """Returns a table of AP (R1000) of the default scene model, and of differences to it.

    A paired difference requires the same traffic and frames in both models. Where they differ, the
    table shows the AP of the other model. The times are CPU seconds of the simulation.
    """
    table = results(name)
    settings = ["detail", "aggregation", "parts", "vegetation", "label_time", "frames"]
    table = table.astype(dict.fromkeys(settings, str))
    usual = {setting: table[setting].mode()[0] for setting in settings}
    lidars = [lidar for lidar in LIDARS if lidar in set(table.lidar)]
    rows, default = [], None
    for model, group in table.groupby(settings, sort=False):
        other = [f"{d} `{v}`" for d, v in zip(settings, model, strict=True) if v != usual[d]]
        seconds = group.ms_per_frame_set.astype(float).iloc[0] * int(model[-1]) / 1000
        by_lidar = group.set_index("lidar")
        default = by_lidar if default is None else default
        cells = [_step(by_lidar.loc[x], default.loc[x] if other else None) for x in lidars]
        rows.append([", ".join(other) or "default", f"{seconds:.0f}", *cells])
    return markdown(["model", "CPU, s", *(LIDARS[lidar] for lidar in lidars)], rows)


def _step(row: pd.Series, default: pd.Series | None) -> str:
    """Formats an AP or a paired difference; a significant difference is in bold."""
    if default is None or not are_pairs(row, default):
        return with_interval_of_ap(
            *row[["ap_r1000", "ap_r1000_low", "ap_r1000_high"]].astype(float)
        )
    change = difference(row, default).measured()
    text = f"{change.value:+.1f} [{change.low:+.1f}, {change.high:+.1f}]"
    return f"**{text}**" if change.low > 0 or change.high < 0 else text
