"""What the names of a benchmark stand for: read before anything runs, and kept with its tables."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import pandas as pd
import yaml

from pyinfra.core.errors import ConfigError
from pyinfra.core.files import replacing
from pyinfra.dataset.frames import lidars_in
from pyinfra.dataset.runs import infrasim
from pyinfra.experiments import store
from pyinfra.experiments.benchmark.matrix import Plan, name_of
from pyinfra.formats import kitti

PRICE = re.compile(r"^price_usd:\n(?:  .*\n)+", re.MULTILINE)
TOTAL = re.compile(r"^price_total_usd: .*\n", re.MULTILINE)
PRICE_TEXT = ["price_source", "price_date"]
FRAMES_OF = ["scene", "preset", "lidar"]
FIRST_NUMBER = "frames_version: 3\n"  # of 0.3, whose digests are without it


@cache
def resolved(file: Path, preset: str = "", *words: str) -> str:
    """A scene, or a LiDAR under a preset, as the simulator writes it. Raises SimulatorError."""
    return infrasim("check", file, *(["--preset", preset] if preset else []), *words)


def canonical(file: Path, preset: str) -> str:
    """The same by the keys of version 0.3, with the number of a scene's frames.

    Whatever a later version calls a key, this stays. Raises SimulatorError.
    """
    return resolved(file, preset, "--canonical").removesuffix(FIRST_NUMBER)


def price_of(lidar: Path, preset: str) -> dict[str, Any]:
    """Keys low, high, source and date; of a bundle the sum of its units."""
    file = yaml.safe_load(lidar.read_text("utf-8"))
    for keys in (yaml.safe_load(resolved(lidar, preset)), file):
        if "price_usd" in keys:
            return dict(keys["price_usd"])
    units = [price_of(lidar.parent / unit["lidar"], preset) for unit in file["bundle"]]
    ends = {end: sum(unit[end] for unit in units) for end in ("low", "high")}
    return {**ends, "source": "sum of the units", "date": ""}


def has_several_mounts(scene: Path) -> bool:
    """Whether a scene's frames are fused. Raises SimulatorError."""
    return len(yaml.safe_load(resolved(scene))["mounts"]) > 1


def check_names(plan: Plan) -> None:
    """Raises ConfigError if a scene or LiDAR is not named as its file, as rows and folders are."""
    for name in dict.fromkeys(cell.scene for cell in plan.cells):
        check_name(plan.files["scenes", name], resolved(plan.files["scenes", name]))
    for name, preset in dict.fromkeys((cell.lidar, cell.preset) for cell in plan.cells):
        file = plan.files["lidars", name]
        check_name(file, resolved(file, preset))


def check_name(file: Path, text: str) -> None:
    """Raises ConfigError if a resolved text is not named as the file."""
    given, name = yaml.safe_load(text)["name"], name_of(file)
    if given != name:
        what = "file" if name == file.stem else "folder"
        raise ConfigError(f"{file}: name: found '{given}', allowed '{name}', as the {what}")


def digests(plan: Plan) -> pd.DataFrame:
    """Columns scene, preset, lidar and `inputs`: a digest of what the frames depend on.

    That is the scene with the files that it names, the LiDAR without its price, the number and the
    range of the frames and how they are split.
    """
    keys = dict.fromkeys((cell.scene, cell.preset, cell.lidar) for cell in plan.cells)
    return pd.DataFrame(
        [(*key, digest(plan, *key)) for key in keys], columns=[*FRAMES_OF, "inputs"]
    )


def digest(plan: Plan, scene: str, preset: str, lidar: str) -> str:
    file = plan.files["scenes", scene]
    world = canonical(file, preset)
    unit = PRICE.sub("", canonical(plan.files["lidars", lidar], preset))
    hasher = hashlib.sha256("\n".join([world, unit, plan.frames, str(plan.parts)]).encode())
    for named in named_files(yaml.safe_load(world)):
        hasher.update((file.parent / named).read_bytes())
    return hasher.hexdigest()[:16]


def named_files(scene: dict[str, Any]) -> list[str]:
    """What a scene reads besides itself, relative to its file; by canonical keys."""
    layers = [layer for _, layer in sorted(scene.get("static_layers", {}).items())]
    surfaces = [mesh["file"] for mesh in scene.get("meshes", [])]
    names = [scene.get("trajectories"), *layers, scene.get("lanes"), *surfaces]
    return [name for name in names if name]


def check_frames(hits: Path, wanted: pd.DataFrame) -> None:
    """Raises ConfigError if the table has rows of another scene, LiDAR or range of frames.

    wanted: of `digests`. Rows of an earlier version, without a digest, are taken for the same.
    """
    table = store.read(hits)
    if "inputs" not in table:
        return
    both = table.dropna(subset="inputs").merge(wanted, on=FRAMES_OF, suffixes=("", "_now"))
    other = both[both.inputs != both.inputs_now]
    if len(other):
        row = other.iloc[0]
        raise ConfigError(
            f"{hits}: {row.scene} {row.preset} {row.lidar}: found rows of another scene, LiDAR, "
            "range of frames or split of these names, allowed those of this benchmark, or another "
            "`out`"
        )


def check_lidars(hits: Path, plan: Plan, folder_of: Callable[[str], Path]) -> None:
    """Raises ConfigError if rows were measured among other LiDARs than the data set has or gets.

    Which vehicles all LiDARs of a data set can see, the truth `common`, is a matter of all of them.
    """
    table = store.read(hits)
    for world, cells in plan.worlds().items() if len(table) else ():
        scene, preset = cells[0].scene, cells[0].preset
        known = set(table.lidar[(table.scene == scene) & (table.preset == preset)])
        there = {lidar.name for lidar in lidars_in(folder_of(world))}
        now = there | {cell.lidar for cell in cells}
        if known and known != now:
            raise ConfigError(
                f"{hits}: {scene} {preset}: found rows measured among the LiDARs "
                f"{', '.join(sorted(known))}, allowed {', '.join(sorted(now))}, or another `out`; "
                "trainings in the folder of `work` are used again"
            )


def with_prices(plan: Plan, lidars: pd.DataFrame) -> pd.DataFrame:
    """The table of LiDARs with the prices that the files of its LiDARs have now.

    lidars: with the columns PRICE_TEXT as text.
    """
    lidars = lidars.astype({"price_low_usd": float, "price_high_usd": float})  # may all be whole
    for name, preset in dict.fromkeys((cell.lidar, cell.preset) for cell in plan.cells):
        price = price_of(plan.files["lidars", name], preset)
        at = (lidars.lidar == name) & (lidars.preset == preset)
        lidars.loc[at, ["price_low_usd", "price_high_usd"]] = [price["low"], price["high"]]
        lidars.loc[at, PRICE_TEXT] = [price["source"], str(price["date"])]
    return lidars


def renew_price(lidar: Path, preset: str, file: Path) -> None:
    """Writes the price of now into the `lidar.yaml` of frames, which do not depend on it."""
    price = price_of(lidar, preset)
    mounts = len(kitti.read_keys(file).get("mounts", ["the only one"]))
    price |= {end: mounts * price[end] for end in ("low", "high")}
    total = "price_total_usd: {{low: {low:.15g}, high: {high:.15g}}}\n".format(**price)
    price_match = PRICE.search(resolved(lidar, preset))
    old = file.read_text(encoding="utf-8")
    text = TOTAL.sub(total, PRICE.sub(lambda _: price_match.group() if price_match else "", old))
    if text != old:
        with replacing(file) as beside:
            beside.write_text(text, encoding="utf-8")
