"""Makes tables about the speed and fidelity of the simulator."""

from __future__ import annotations

import pandas as pd

from pyinfra.metrics.comparison import Interval
from reproduction.report.ladder import by_seed, interval
from reproduction.tables.common import LIDARS, markdown, mean_of_ap, results, signed


def speed() -> str:
    """Returns a table of the measurements of `make bench`."""
    table = results("speed")
    now = table[~table.what.str.startswith("speed / before")]  # a comparison with another version
    rows = [[r.what, f"{r.value:.2f} {r.unit}"] for r in now.itertuples()]
    return markdown(["measurement", "value"], rows)


def growth() -> str:
    """Returns a table of the time and memory of `infrasim run` by the size of a scene, with the
    values of version 0.4 in brackets."""
    table = results("growth").set_index(["build", "quantity", "size"])
    here = table.loc["this"]
    before = table.loc["other"].reindex(here.index) if "other" in table.index else None
    rows = []
    for (quantity, size), row in here.iterrows():
        cells = []
        for column, digits in (("frame_ms", 1), ("start_s", 2), ("peak_mb", 0)):
            text = f"{row[column]:.{digits}f}"
            if before is not None and pd.notna(other := before.loc[(quantity, size), column]):
                text += f" ({other:.{digits}f})"
            cells.append(text)
        rows.append([f"{quantity}: {size:,}", *cells])
    return markdown(["scene", "CPU of a frame, ms", "CPU of the start, s", "peak memory, MB"], rows)


def ladder(detector: str = "background", preset: str = "datasheet") -> str:
    """Returns a table of AP (R1000) of the default scene model, and of differences to it.

    Values are means over traffic seeds. Differences are paired by seed, and bold if significant.
    The times are CPU seconds of the simulation.
    """
    table = results("ladder")
    table = table[(table.detector == detector) & (table.preset == preset)]
    settings = ["detail", "aggregation", "parts", "vegetation", "label_time", "frames"]
    table = table.astype(dict.fromkeys(settings, str))
    usual = {setting: table[setting].mode()[0] for setting in settings}
    lidars = [lidar for lidar in LIDARS if lidar in set(table.lidar)]
    rows: list[list[str]] = []
    default = by_seed(table[(table[settings] == pd.Series(usual)).all(axis=1)])
    for model, group in table.groupby(settings, sort=False):
        other = [f"{d} `{v}`" for d, v in zip(settings, model, strict=True) if v != usual[d]]
        seconds = group.ms_per_frame_set.mean() * int(model[-1]) / 1000
        aps = by_seed(group)
        if other:
            cells = [_difference(interval(aps[lidar] - default[lidar])) for lidar in lidars]
        else:
            cells = [mean_of_ap(aps[lidar]) for lidar in lidars]
        rows.append([", ".join(other) or "default", f"{seconds:.0f}", *cells])
    return markdown(["model", "CPU, s", *(LIDARS[lidar] for lidar in lidars)], rows)


def _difference(mean: Interval) -> str:
    """Formats a difference; a significant one is in bold."""
    return f"**{signed(mean)}**" if mean.is_significant else signed(mean)
