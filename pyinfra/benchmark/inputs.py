"""What the names of a benchmark stand for: read before anything runs, and kept with its tables."""

from __future__ import annotations

import hashlib
import re
from functools import cache
from pathlib import Path

import pandas as pd
import yaml

from pyinfra.atomic import replacing
from pyinfra.benchmark import store
from pyinfra.benchmark.matrix import Plan
from pyinfra.config import ConfigError
from pyinfra.hits import infrasim

PRICE = re.compile(r"^price_usd:\n(?:  .*\n)+", re.MULTILINE)
TOTAL = re.compile(r"^price_total_usd: .*\n", re.MULTILINE)
FRAMES_OF = ["scene", "preset", "lidar"]


@cache
def resolved(file: Path, preset: str = "") -> str:
    """A scene, or a LiDAR under a preset, as the simulator writes it. Raises SimulatorError."""
    return infrasim("check", file, *(["--preset", preset] if preset else []))


def price_of(lidar: Path, preset: str) -> str:
    """The price as the simulator writes it; nothing for a bundle, which has none of its own."""
    found = PRICE.search(resolved(lidar, preset))
    return found.group() if found else ""


def check_names(plan: Plan) -> None:
    """Raises ConfigError if a LiDAR is not named as its file, by which its folder is found."""
    for name, preset in dict.fromkeys((cell.lidar, cell.preset) for cell in plan.cells):
        file = plan.files["lidars", name]
        found = yaml.safe_load(resolved(file, preset))["name"]
        if found != name:
            raise ConfigError(f"{file}: name: found '{found}', allowed '{name}', as the file")


def digests(plan: Plan) -> pd.DataFrame:
    """Columns scene, preset, lidar and `inputs`: a digest of what the frames depend on.

    That is the scene, the LiDAR without its price, and the range of frames.
    """
    keys = dict.fromkeys((cell.scene, cell.preset, cell.lidar) for cell in plan.cells)
    return pd.DataFrame(
        [(*key, digest(plan, *key)) for key in keys], columns=[*FRAMES_OF, "inputs"]
    )


def digest(plan: Plan, scene: str, preset: str, lidar: str) -> str:
    world = resolved(plan.files["scenes", scene])
    unit = PRICE.sub("", resolved(plan.files["lidars", lidar], preset))
    return hashlib.sha256("\n".join([world, unit, plan.frames]).encode()).hexdigest()[:16]


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
            f"{hits}: {row.scene} {row.preset} {row.lidar}: found rows of another scene, LiDAR or "
            "range of frames of these names, allowed those of this benchmark, or another --out"
        )


def with_prices(plan: Plan, lidars: pd.DataFrame) -> pd.DataFrame:
    """The table of LiDARs with the prices that the files of single LiDARs have now."""
    # A table whose dates are all years was read as whole numbers.
    numbers = dict.fromkeys(("price_low_usd", "price_high_usd"), float)
    lidars = lidars.astype(numbers | dict.fromkeys(("price_source", "price_date"), object))
    for name, preset in dict.fromkeys((cell.lidar, cell.preset) for cell in plan.cells):
        text = price_of(plan.files["lidars", name], preset)
        if text:
            price = yaml.safe_load(text)["price_usd"]
            at = (lidars.lidar == name) & (lidars.preset == preset)
            lidars.loc[at, ["price_low_usd", "price_high_usd"]] = [price["low"], price["high"]]
            lidars.loc[at, ["price_source", "price_date"]] = [price["source"], str(price["date"])]
    return lidars


def renew_price(lidar: Path, preset: str, file: Path) -> None:
    """Writes the price of now into the `lidar.yaml` of frames, which do not depend on it."""
    new = price_of(lidar, preset)
    if not new or not file.is_file():
        return
    low, high = (re.findall(rf"{end}: (\S+)", new)[0] for end in ("low", "high"))
    total = f"price_total_usd: {{low: {low}, high: {high}}}\n"
    old = file.read_text(encoding="utf-8")
    text = TOTAL.sub(total, PRICE.sub(lambda _: new, old))
    if text != old:
        with replacing(file) as beside:
            beside.write_text(text, encoding="utf-8")
