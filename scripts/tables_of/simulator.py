"""Speed, fidelity and bad input of the simulator and its readers."""

from __future__ import annotations

import re

import pandas as pd

from pyinfra.metrics.replicates import are_pairs, difference
from tables_of.common import DETECTORS, LIDARS, PRESETS, markdown, results, with_interval_of_ap

SHOWN = 90  # letters of a finding


def doors() -> str:
    """What is wrong, and what 0.2.0 and the latest version made of it; crashes are bold."""
    table = results("doors")
    versions = list(dict.fromkeys(table.version))
    before, now = (table[table.version == v].set_index(["door", "tried"]) for v in versions)
    rows = []
    for key, row in now.iterrows():
        was = before.loc[key] if key in before.index else None
        rows.append([str(key[0]), key[1], "" if was is None else told(was), told(row)])
    return markdown(["door", "tried", "0.2.0", "now"], rows)


def told(row: pd.Series) -> str:
    """A finding in a cell of a table."""
    text = re.sub(r"[|<>`*]", " ", str(row.found))
    short = text if len(text) <= SHOWN else text[:SHOWN].rsplit(" ", 1)[0] + " ..."
    return short if row.shut else f"**open**: {short}"


def static_layers() -> str:
    """Of each preset: what casting with static layers changed, cast and took."""
    rows = []
    for preset, own in results("static_layer").groupby("preset"):
        cast, time = 100 * own.cast_share, own.time_ratio
        rows.append(
            [
                str(preset),
                str(len(own)),
                str(own.different_files.sum()),
                f"{cast.median():.0f} ({cast.min():.0f} to {cast.max():.0f})",
                f"{time.median():.2f} ({time.min():.2f} to {time.max():.2f})",
            ]
        )
    names = ["preset", "scenes x LiDARs", "files that differ", "rays cast, %", "time / casting all"]
    return markdown(names, rows)


def speed() -> str:
    """What `make bench` measured."""
    rows = results("speed").itertuples()
    return markdown(["what", "value"], [[r.what, f"{r.value:.2f} {r.unit}"] for r in rows])


def points_before() -> str:
    """Points per vehicle by preset, LiDAR and distance: of 0.2.0, and today's share of them."""
    table = results("before")
    rows = []
    for preset in PRESETS:
        for lidar, words in LIDARS.items():
            own = table[(table.preset == preset) & (table.lidar == lidar)]
            points = own.pivot(index="from_m", columns="model", values="points_per_vehicle")
            cells = [f"{r.before:.1f} x {r.today / r.before:.2f}" for r in points.itertuples()]
            rows.append([preset, words, *cells])
    return markdown(["preset", "LiDAR", *(f"from {m} m" for m in sorted(set(table.from_m)))], rows)


def points_by_model() -> str:
    """What each model of `datasheet` leaves of the points of 0.2.0, one more at a time."""
    table = results("before")
    table = table[table.preset == "datasheet"]
    rows = []
    for lidar, words in LIDARS.items():
        own = table[table.lidar == lidar]
        points = own.pivot(index="from_m", columns="model", values="points_per_vehicle")
        for model in ("law", "and glass", "and gap", "and coat", "today"):
            shares = points[model] / points.before
            said = {"law": "the law", "today": "and plants"}.get(model, model)
            rows.append([words, said, *(f"{share:.2f}" for share in shares)])
    return markdown(["LiDAR", "model", *(f"from {m} m" for m in sorted(set(table.from_m)))], rows)


def deskew_by_seam() -> str:
    """Points in the box from `instant` to `exact`, in %, with the seams turned."""
    table = results("deskew")
    table["name"] = table.statement.str.extract(r"box of (\w+) ")
    rows = [
        [
            words,
            *(
                f"{row.value:.1f} {row.verdict}"
                for row in table[table.name == lidar].sort_values("seam_turned_deg").itertuples()
            ),
        ]
        for lidar, words in LIDARS.items()
    ]
    turns = sorted(set(table.seam_turned_deg))
    return markdown(["LiDAR", *(f"{degrees}°" for degrees in turns)], rows)


def label_times() -> str:
    """By how much a motor's phase moves AP of all vehicles: least to most, ends of intervals."""
    table = results("label_time")
    table = table[table.ground_truth == "all"]
    rows = []
    keys = ["detector", "scene", "lidar", "label_time"]
    for (detector, scene, lidar, label_time), own in table.groupby(keys, sort=False):
        (base,) = own[own.dial == "none"].ap
        cells = [
            f"{part.change.min():+.1f} to {part.change.max():+.1f} "
            f"[{part.change_low.min():+.1f}, {part.change_high.max():+.1f}]"
            for part in (own[own.dial == dial] for dial in ("turn", "seam", "phase"))
        ]
        rows.append([DETECTORS[detector], scene, LIDARS[lidar], label_time, f"{base:.1f}", *cells])
    heads = ["detector", "scene", "LiDAR", "labels", "AP", "turned", "other seams", "other phases"]
    return markdown(heads, rows)


def ladder(name: str = "ladder") -> str:
    """Fine AP of the default model of a scene; of others one dial away, how far they are from it.

    In pairs where the worlds are one, else AP. CPU seconds of the run.
    """
    table = results(name)
    dials = ["detail", "aggregation", "parts", "vegetation", "label_time", "frames"]
    table = table.astype(dict.fromkeys(dials, str))
    usual = {dial: table[dial].mode()[0] for dial in dials}
    lidars = [lidar for lidar in LIDARS if lidar in set(table.lidar)]
    rows, default = [], None
    for model, own in table.groupby(dials, sort=False):
        other = [f"{d} `{v}`" for d, v in zip(dials, model, strict=True) if v != usual[d]]
        seconds = own.ms_per_frame_set.astype(float).iloc[0] * int(model[-1]) / 1000
        by_lidar = own.set_index("lidar")
        default = by_lidar if default is None else default
        cells = [_step(by_lidar.loc[x], default.loc[x] if other else None) for x in lidars]
        rows.append([", ".join(other) or "the default", f"{seconds:.0f}", *cells])
    return markdown(["model", "CPU, s", *(LIDARS[lidar] for lidar in lidars)], rows)


def _step(own: pd.Series, default: pd.Series | None) -> str:
    """AP, or a signed difference, bold where its interval does not hold 0."""
    if default is None or not are_pairs(own, default):
        return with_interval_of_ap(*own[["ap_fine", "ap_fine_low", "ap_fine_high"]].astype(float))
    found = difference(own, default).measured()
    text = f"{found.value:+.1f} [{found.low:+.1f}, {found.high:+.1f}]"
    return f"**{text}**" if found.low > 0 or found.high < 0 else text
