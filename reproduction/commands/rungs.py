"""Measures what each model of a LiDAR changes in the points per vehicle, by distance.

A rung is one model that is on or off: the divergence of beams, their width and number of sub-rays,
the echoes of a ray, the range of each channel, the range law. Each rung changes one setting of
the catalogue's LiDARs, preset `datasheet`. All settings see the same traffic, so that the same
vehicles are compared. Vehicles of the evaluation region with a visible share of 0.2 or more count.
The command writes out/rungs.csv, a row for each rung, LiDAR, distance and seed:

    python -m reproduction rungs
"""

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import pandas as pd
import yaml

from pyinfra.core.vocabulary import OBJECT_NAMES, VEHICLE_TYPES
from pyinfra.dataset import simulation
from reproduction import ROOT, provenance
from reproduction.arguments import Out, command

FOUR = ("livox_avia", "helios_16", "pandar_64", "ruby_plus")
BY_CHANNEL = ("hesai_xt32", "hesai_ot128")
ASSUMED_BEAM = (*FOUR[1:], *BY_CHANNEL)
SCENES = ("highway", "crossroad", "curve")
FRAMES = range(0, 600, 30)
BANDS_M = [0, 30, 60, 90, 120]
KEYS = ["scene", "frame", "id"]
Keys = dict[str, Any]


def beam(width_deg: float | None = None, **keys: object) -> Keys:
    """Returns changes of `returns.beam`; a width replaces both divergences."""
    widths = {} if width_deg is None else {"vertical_deg": width_deg, "horizontal_deg": width_deg}
    return {"beam": {**widths, **keys}}


def echoes(**keys: object) -> Keys:
    return {"echoes": keys}


# For each compared model: the LiDAR keys that it changes, and the LiDARs to which it applies.
# `None` removes a section.
RUNGS: dict[str, tuple[Keys, tuple[str, ...]]] = {
    "one ray": ({"beam": None}, FOUR),
    "assumed beams of 0.05 degrees": (beam(0.05), ASSUMED_BEAM[:3]),
    "assumed beams of 0.2 degrees": (beam(0.2), ASSUMED_BEAM[:3]),
    "beams by FWHM": (beam(scale=1.7), FOUR),
    "19 sub-rays": (beam(sub_rays=5), FOUR),
    "sub-rays everywhere": (beam(where="everywhere"), FOUR),
    "separation of 0.25 m": (echoes(separation_m=0.25), FOUR),
    "separation of 1 m": (echoes(separation_m=1.0), FOUR),
    "first echo": (echoes(mode="first", offered=[]), FOUR),
    "last echo": (echoes(mode="last", offered=[]), FOUR),
    "two echoes": (echoes(mode="dual", offered=[]), FOUR),
    "exponent 0.5": ({"detection": {"law_exponent": 0.5}}, FOUR[1:]),
    "one range for all channels": ({}, BY_CHANNEL),
}


def changed_file(name: str, rung: str, folder: Path) -> Path:
    """Writes a catalogue LiDAR with the changed keys of a rung to a folder; returns its file."""
    file = ROOT / "configs/lidars" / f"{name}.yaml"
    text = yaml.safe_load(file.read_text())
    preset = text["presets"]["datasheet"]
    for part in (text, preset):
        channels = part.get("pattern", {}).get("spinning", {}).get("channels", {})
        if "file" in channels:
            table = (file.parent / channels["file"]).resolve()
            if rung == "one range for all channels":
                rows = pd.read_csv(table)
                table = folder / f"{name}.csv"
                rows.drop(columns=["range_at_10_percent_m"]).to_csv(table, index=False)
            channels["file"] = str(table)
    for section, keys in RUNGS[rung][0].items() if rung != "default" else ():
        if keys is None:
            preset["returns"].pop(section)
            continue
        now = preset["returns"].setdefault(section, {})
        scale = keys.get("scale", 1)
        now.update({key: value for key, value in keys.items() if key != "scale"})
        for key in ("vertical_deg", "horizontal_deg"):
            if key in now:
                now[key] = round(now[key] * scale, 4)
    copied = folder / f"{name}.yaml"
    copied.write_text(yaml.safe_dump(text))
    return copied


def objects(worlds: dict[str, simulation.World], lidar: simulation.Lidar) -> pd.DataFrame:
    """Returns the points of each vehicle in each frame."""
    tables = []
    for scene, world in worlds.items():
        for number, (frame,) in simulation.simulate(world, [lidar], FRAMES):
            tables.append(pd.DataFrame(frame.objects).assign(scene=scene, frame=number))
    rows = pd.concat(tables)
    seen = (rows.visibility >= 0.2) & rows.class_id.map(OBJECT_NAMES).isin(VEHICLE_TYPES)
    return rows[seen].set_index(KEYS)[["points", "points_in_box", "distance"]]


def compared(rung: str, lidar: str, default: pd.DataFrame, now: pd.DataFrame) -> pd.DataFrame:
    """Returns the mean points per vehicle without and with a rung, by distance."""
    both = default.join(now, lsuffix="_default", rsuffix="_rung")
    both = both.assign(points_rung=both.points_rung.fillna(0))
    from_m = pd.cut(both.distance_default, BANDS_M, right=False, labels=BANDS_M[:-1])
    groups = both.groupby(from_m, observed=True)
    table = groups.agg(
        vehicles=("points_default", "size"),
        points_default=("points_default", "mean"),
        points_rung=("points_rung", "mean"),
    )
    table.index.name = "from_m"
    return table.reset_index().assign(rung=rung, lidar=lidar)


def measured(seed: int, rungs: Sequence[str]) -> pd.DataFrame:
    """Returns the table of one traffic seed."""
    worlds = {
        scene: simulation.load_scene(
            ROOT / f"configs/scenes/{scene}.yaml", preset="datasheet", set={"seed": seed}
        )
        for scene in SCENES
    }
    defaults: dict[str, pd.DataFrame] = {}
    tables = []
    with tempfile.TemporaryDirectory() as folder:
        for rung in ["default", *rungs]:
            names = (*FOUR, *BY_CHANNEL) if rung == "default" else RUNGS[rung][1]
            for name in names:
                lidar = simulation.load_lidar(changed_file(name, rung, Path(folder)), "datasheet")
                rows = objects(worlds, lidar)
                if rung == "default":
                    defaults[name] = rows
                else:
                    tables.append(compared(rung, name, defaults[name], rows))
            print(seed, rung, flush=True)
    return pd.concat(tables).assign(seed=seed)


@command
def main(
    *,
    seeds: int = 5,
    rungs: Annotated[Sequence[str] | None, {"choices": list(RUNGS)}] = None,
    out: Out = Path("rungs.csv"),
) -> None:
    """
    Parameters
    ----------
    seeds : number of traffic seeds; default: 5
    rungs : rungs to measure (default: all)
    """
    tables = [measured(seed, rungs or list(RUNGS)) for seed in range(1, seeds + 1)]
    table = pd.concat(tables).assign(preset="datasheet", **provenance("rungs"))
    table.to_csv(out, index=False, float_format="%.5g")
