"""Makes tables about the speed and fidelity of the simulator."""

import pandas as pd

from pyinfra.metrics.comparison import Interval
from reproduction.tables.common import (
    LIDARS,
    Rows,
    interval,
    markdown,
    mean_of_ap,
    of_rows,
    results,
    rows_with,
    signed,
    with_heads,
)

MODEL = ["detail", "aggregation", "parts", "vegetation", "label_time", "frames"]


def speed() -> str:
    """Returns a table of the measurements of `make bench`."""
    table = results("speed")
    # The table leaves out the comparison with another version.
    now = table[~table.what.str.startswith("speed / before")]
    return of_rows(now, {"measurement": "{what}", "value": "{value:.2f} {unit}"})


@with_heads("scene", "CPU time per frame, ms", "CPU time of the start, s", "peak memory, MB")
def growth() -> Rows:
    """Returns a table of the time and memory of `infrasim run` by the size of a scene, with the
    values of version 0.4 in brackets."""
    table = results("growth").set_index(["build", "quantity", "size"])
    here = table.loc["this"]
    before = table.loc["other"].reindex(here.index) if "other" in table.index else None
    for (quantity, size), row in here.iterrows():
        cells = []
        for column, digits in (("frame_ms", 1), ("start_s", 2), ("peak_mb", 0)):
            text = f"{row[column]:.{digits}f}"
            if before is not None and pd.notna(other := before.loc[(quantity, size), column]):
                text += f" ({other:.{digits}f})"
            cells.append(text)
        yield [f"{quantity}: {size:,}", *cells]


def by_seed(rows: pd.DataFrame) -> pd.DataFrame:
    """Returns the AP of one model: one row per seed and one column per LiDAR."""
    return rows.pivot(index="seed", columns="lidar", values="ap_r1000")


def ladder(detector: str = "background", preset: str = "datasheet") -> str:
    """Returns a table of AP (R1000) of the default scene model, and of differences to it.

    Values are means over traffic seeds. Differences are paired by seed, and bold if significant.
    The times are CPU seconds of the simulation.
    """
    table, usual, default = _models(detector, preset)
    lidars = [lidar for lidar in LIDARS if lidar in set(table.lidar)]
    rows: list[list[str]] = []
    for model, group in table.groupby(MODEL, sort=False):
        other = [f"{d} `{v}`" for d, v in zip(MODEL, model, strict=True) if v != usual[d]]
        seconds = group.ms_per_frame_set.mean() * int(model[-1]) / 1000
        aps = by_seed(group)
        if other:
            cells = [_difference(interval(aps[lidar] - default[lidar])) for lidar in lidars]
        else:
            cells = [mean_of_ap(aps[lidar]) for lidar in lidars]
        rows.append([", ".join(other) or "default", f"{seconds:.0f}", *cells])
    return markdown(["changed setting", "CPU time, s", *(LIDARS[lidar] for lidar in lidars)], rows)


def changes_of_models(
    detector: str = "background", preset: str = "datasheet"
) -> dict[tuple[str, str], dict[str, Interval]]:
    """Returns the changes of AP by setting, value and LiDAR, for models with one other setting."""
    table, usual, default = _models(detector, preset)
    changes = {}
    for model, group in table.groupby(MODEL, sort=False):
        other = [(name, v) for name, v in zip(MODEL, model, strict=True) if v != usual[name]]
        if len(other) == 1:
            aps = by_seed(group)
            changes[other[0]] = {name: interval(aps[name] - default[name]) for name in aps}
    return changes


def _models(detector: str, preset: str) -> tuple[pd.DataFrame, dict[str, str], pd.DataFrame]:
    """Returns the rows of all models, the settings of the default one, and its AP by seed."""
    table = rows_with(results("ladder"), detector=detector, preset=preset)
    table = table.astype(dict.fromkeys(MODEL, str))
    usual = {setting: table[setting].mode()[0] for setting in MODEL}
    return table, usual, by_seed(table[(table[MODEL] == pd.Series(usual)).all(axis=1)])


def _difference(mean: Interval) -> str:
    """Formats a difference; a significant one is in bold."""
    return f"**{signed(mean)}**" if mean.is_significant else signed(mean)
