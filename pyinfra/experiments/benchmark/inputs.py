"""Checks the files that a benchmark names before it runs, and computes their digests."""

import hashlib
import re
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import pandas as pd
import yaml

from pyinfra.core.errors import ConfigError
from pyinfra.core.files import write
from pyinfra.dataset.frames import lidars_in
from pyinfra.dataset.lidars import sum_source
from pyinfra.dataset.runs import infrasim
from pyinfra.experiments import store
from pyinfra.experiments.benchmark.matrix import Plan, name_of
from pyinfra.formats import kitti

PRICE = re.compile(r"^price_usd:\n(?:  .*\n)+", re.MULTILINE)
TOTAL = re.compile(r"^price_total_usd: .*\n", re.MULTILINE)
PRICE_TEXT = ["price_source", "price_date"]
FRAMES_OF = ["scene", "preset", "lidar"]


@cache
def resolved(file: Path, preset: str = "", *words: str) -> str:
    """Returns the text of a scene, or of a LiDAR with a preset, with all defaults filled in.

    Raises SimulatorError.
    """
    return infrasim("check", file, *(["--preset", preset] if preset else []), *words)


def price_of(lidar: Path, preset: str) -> dict[str, Any]:
    """Returns the price with the keys low, high, source, date.

    The price of a bundle is the sum of its units' prices, unless its file has a price.
    """
    file = yaml.safe_load(lidar.read_text("utf-8-sig"))
    for keys in (yaml.safe_load(resolved(lidar, preset)), file):
        if "price_usd" in keys:
            return dict(keys["price_usd"])
    units = [price_of(lidar.parent / unit["lidar"], preset) for unit in file["bundle"]]
    ends = {end: sum(unit[end] for unit in units) for end in ("low", "high")}
    return {**ends, "source": sum_source(str(unit["source"]) for unit in units), "date": ""}


def has_several_mounts(scene: Path) -> bool:
    """Returns whether a scene has several mounts, whose frames are fused. Raises SimulatorError."""
    return len(yaml.safe_load(resolved(scene))["mounts"]) > 1


def traffic_seed(plan: Plan, scene: str) -> int | None:
    """Returns the traffic seed of a plan's scene; None for the seed in the scene's file."""
    if not plan.traffic_offset:
        return None
    scene_keys = yaml.safe_load(resolved(plan.files["scenes", scene]))
    return int(scene_keys["seed"]) + plan.traffic_offset


def check_names(plan: Plan) -> None:
    """Raises ConfigError if the key `name` of a LiDAR differs from the file's name.

    Rows and folders use the file's name. A scene may have another name, because `infrasim run`
    gets the file's name from `name_of_scene`.
    """
    for name in dict.fromkeys(experiment.scene for experiment in plan.experiments):
        resolved(plan.files["scenes", name])  # raises an error for an invalid scene file
    for name, preset in dict.fromkeys(
        (experiment.lidar, experiment.preset) for experiment in plan.experiments
    ):
        file = plan.files["lidars", name]
        check_name(file, resolved(file, preset))


def check_name(file: Path, text: str) -> None:
    """Raises ConfigError if the key `name` in the resolved `text` differs from the file's name."""
    given, name = yaml.safe_load(text)["name"], name_of(file)
    if given != name:
        raise ConfigError(
            f"{file}: name: expected the file's name '{name}', got '{given}'; change the key "
            "`name`, or rename the file"
        )


def name_of_scene(file: Path) -> list[str]:
    """Returns arguments of `infrasim run` that replace a scene's name by the name of its file.

    The list is empty if the names are equal. They differ, for instance, in a copy of a scene file.
    """
    name = name_of(file)
    given = yaml.safe_load(resolved(file))["name"]
    return [] if given == name else ["--set", f"name={name}"]


def digests(plan: Plan) -> pd.DataFrame:
    """Returns a table with the columns scene, preset, lidar and `inputs` (a digest).

    The digest is of all inputs of the frames: the scene with the files that it names, the LiDAR
    without its price, the version and range of the frames, and their split.
    """
    keys = dict.fromkeys(
        (experiment.scene, experiment.preset, experiment.lidar) for experiment in plan.experiments
    )
    return pd.DataFrame(
        [(*key, digest(plan, *key)) for key in keys], columns=[*FRAMES_OF, "inputs"]
    )


def digest(plan: Plan, scene: str, preset: str, lidar: str) -> str:
    # Canonical texts have the keys of version 0.3, so that they stay the same when a later version
    # renames a key. The text of a scene includes `frames_version`.
    file = plan.files["scenes", scene]
    data_set = resolved(file, preset, "--canonical")
    unit = PRICE.sub("", resolved(plan.files["lidars", lidar], preset, "--canonical"))
    parts = [data_set, unit, plan.frames, str(plan.parts)]
    parts += [f"traffic_offset {plan.traffic_offset}"] if plan.traffic_offset else []
    hasher = hashlib.sha256("\n".join(parts).encode())
    for named in named_files(yaml.safe_load(data_set)):
        hasher.update((file.parent / named).read_bytes())
    return hasher.hexdigest()[:16]


def named_files(scene: dict[str, Any]) -> list[str]:
    """Returns the files that a scene names, relative to its own file.

    scene: keys and values of the scene, with the key names of version 0.3.
    """
    layers = [layer for _, layer in sorted(scene.get("static_layers", {}).items())]
    surfaces = [mesh["file"] for mesh in scene.get("meshes", [])]
    names = [scene.get("trajectories"), *layers, scene.get("lanes"), *surfaces]
    return [name for name in names if name]


def check_frames(hits: Path, wanted: pd.DataFrame) -> None:
    """Raises ConfigError if rows of the table have other inputs than the benchmark.

    wanted: the result of `digests`. Rows of earlier versions have no digest and are accepted.
    """
    table = store.read(hits)
    if "inputs" not in table:
        return
    with_digest = table.dropna(subset="inputs").merge(wanted, on=FRAMES_OF, suffixes=("", "_now"))
    other = with_digest[with_digest.inputs != with_digest.inputs_now]
    if len(other):
        row = other.iloc[0]
        raise ConfigError(
            f"{hits}: {row.scene} {row.preset} {row.lidar}: expected rows of this benchmark, got "
            "rows of a different scene, LiDAR, range of frames or split with the same names; "
            "choose a different `out`"
        )


def check_lidars(hits: Path, plan: Plan, folder_of: Callable[[str], Path]) -> None:
    """Raises ConfigError if rows were measured with another set of LiDARs in the data set.

    Ground truth `common`, the vehicles in view of all LiDARs, depends on the whole set.
    """
    table = store.read(hits)
    for data_set, experiments in plan.data_sets().items() if len(table) else ():
        scene, preset = experiments[0].scene, experiments[0].preset
        known = set(table.lidar[(table.scene == scene) & (table.preset == preset)])
        on_disk = {lidar.name for lidar in lidars_in(folder_of(data_set))}
        now = on_disk | {experiment.lidar for experiment in experiments}
        if known and known != now:
            raise ConfigError(
                f"{hits}: {scene} {preset}: expected rows of the LiDARs {', '.join(sorted(now))}, "
                f"got rows measured with {', '.join(sorted(known))}; choose a different `out`. The "
                "trained detectors in `work` are used again"
            )


def with_prices(plan: Plan, lidars: pd.DataFrame) -> pd.DataFrame:
    """Returns the table of LiDARs with the current prices of the LiDAR files.

    lidars: table in which the columns PRICE_TEXT are text.
    """
    # pandas reads a column of whole-number prices as integers.
    lidars = lidars.astype({"price_low_usd": float, "price_high_usd": float})
    for name, preset in dict.fromkeys(
        (experiment.lidar, experiment.preset) for experiment in plan.experiments
    ):
        price = price_of(plan.files["lidars", name], preset)
        at = (lidars.lidar == name) & (lidars.preset == preset)
        lidars.loc[at, ["price_low_usd", "price_high_usd"]] = [price["low"], price["high"]]
        lidars.loc[at, PRICE_TEXT] = [price["source"], str(price["date"])]
    return lidars


def renew_price(lidar: Path, preset: str, file: Path) -> None:
    """Writes the current price into a `lidar.yaml`. Frames do not depend on the price."""
    price = price_of(lidar, preset)
    mounts = len(kitti.read_keys(file).get("mounts", ["the only one"]))
    price |= {end: mounts * price[end] for end in ("low", "high")}
    total = "price_total_usd: {{low: {low:.15g}, high: {high:.15g}}}\n".format(**price)
    price_match = PRICE.search(resolved(lidar, preset))
    old = file.read_text(encoding="utf-8")
    text = TOTAL.sub(total, PRICE.sub(lambda _: price_match.group() if price_match else "", old))
    if text != old:
        write(file, text)
