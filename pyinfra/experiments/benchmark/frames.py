"""The data sets of a benchmark: simulated in parts, split by time, and described in tables."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from pyinfra.core.errors import ConfigError, Error
from pyinfra.core.vocabulary import Tier
from pyinfra.dataset import split
from pyinfra.dataset.data_set import read_data_set
from pyinfra.dataset.frames import lidars_in
from pyinfra.dataset.frames_version import MAY_BE_BETTER, other_frames
from pyinfra.dataset.runs import infrasim
from pyinfra.experiments.benchmark.inputs import (
    has_several_mounts,
    name_of_scene,
    traffic_seed,
)
from pyinfra.experiments.benchmark.matrix import Experiment, Parts, Plan, range_of
from pyinfra.experiments.value import MOUNTS
from pyinfra.formats import kitti
from pyinfra.metrics.observations import blocks_of, read_observations
from pyinfra.metrics.scanning_statistics import vehicle_tables
from pyinfra.models.inference.detect import model_file
from pyinfra.models.inference.frames_learnt import learnt_from
from pyinfra.models.training.recipe import read_recipe

POINT_BYTES = 16
STATISTICS = ("points_per_vehicle", "quality")


@dataclass(frozen=True)
class Shard:
    """Frames of one data set that one process simulates."""

    folder: Path
    scene: Path
    lidars: tuple[Path, ...]
    preset: str
    frames: str  # frame numbers A:B:STEP, B excluded
    seed: int | None = None  # traffic seed; None for the seed of the scene file


def shards(plan: Plan, work: Path, parts: int) -> list[Shard]:
    """Returns every data set of the plan in `parts` parts of consecutive frames."""
    return [
        Shard(
            folder=work / "data" / data_set,
            scene=plan.files["scenes", experiments[0].scene],
            lidars=tuple(plan.files["lidars", name] for name in lidars_of(experiments)),
            preset=experiments[0].preset,
            frames=frames,
            seed=traffic_seed(plan, experiments[0].scene),
        )
        for data_set, experiments in plan.data_sets().items()
        for frames in parts_of(plan.frames, parts)
    ]


def lidars_of(experiments: Sequence[Experiment]) -> list[str]:
    """Returns the distinct LiDARs of the experiments."""
    return list(dict.fromkeys(experiment.lidar for experiment in experiments))


def parts_of(frames: str, parts: int) -> list[str]:
    """Divides A:B[:STEP] into at most `parts` ranges, which together have the same frames."""
    numbers = range_of(frames)
    cuts = [len(numbers) * i // parts for i in range(parts + 1)]
    pieces = [numbers[a:b] for a, b in itertools.pairwise(cuts) if a < b]
    return [f"{p[0]}:{p[-1] + 1}:{numbers.step}" for p in pieces]


def warnings(plan: Plan) -> list[str]:
    """Returns warnings about the frames of each LiDAR and about the training frames of detectors.

    The result is empty if the C++ extension is not built.
    """
    try:
        from pyinfra.dataset import simulation
    except ImportError:
        return []
    chosen = range_of(plan.frames)
    units = dict.fromkeys(
        (plan.files["lidars", experiment.lidar], experiment.preset)
        for experiment in plan.experiments
    )
    ends = (chosen.start, chosen.stop, chosen.step)
    lines = [simulation.load_lidar(*unit).period_warnings(*ends) for unit in units]
    detectors = dict.fromkeys((one.detector, one.tier) for one in plan.experiments)
    used = str(simulation.frames_version())
    learnt = [_learnt_warning(plan, *detector, used) for detector in detectors]
    return list(dict.fromkeys(filter(None, itertools.chain(*lines, learnt))))


def _learnt_warning(plan: Plan, detector: str, tier: Tier, used: str) -> str:
    """Returns a warning if a pretrained detector learnt from frames of another frames_version."""
    try:
        learning = read_recipe(plan.files["detectors", detector], tier).learning
        if learning.steps or not learning.start:
            return ""
        learnt = learnt_from(model_file(Path(learning.start)))
    except (Error, OSError):  # the row of the failed experiment reports this error
        return ""
    return other_frames(detector, learnt, used, MAY_BE_BETTER)


def check_data_set(folder: Path, plan: Plan) -> None:
    """Raises ConfigError if the frames or the split of a folder differ from those of the plan.

    Experiments use all frames of the folder. A part of the frames without a split is accepted,
    because the simulation may have been stopped.
    """
    numbers, parts = range_of(plan.frames), plan.parts
    for lidar in lidars_in(folder):
        period_s = kitti.read_lidar(lidar).period_s
        wanted = split.by_time(numbers, period_s, parts.train_until_s, parts.val_from_s)
        present = kitti.frames(lidar) if (lidar / "training/velodyne").is_dir() else []
        lists = {"train": wanted.train, "val": wanted.val}
        if not set(present) <= set(numbers) or any(
            (file := lidar / f"ImageSets/{part}.txt").is_file()
            and tuple(map(int, file.read_text("utf-8-sig").split())) != listed
            for part, listed in lists.items()
        ):
            raise ConfigError(
                f"{lidar}: expected the frames {plan.frames} and the split of this benchmark, got "
                f"{len(present)} frames of a different benchmark or tier; choose a different `work`"
            )


def simulate(shard: Shard) -> None:
    """Simulates the frames of a shard that do not exist yet. Raises SimulatorError."""
    words = ["--preset", shard.preset, "--frames", shard.frames, "--threads", "1"]
    words += [] if shard.seed is None else ["--seed", str(shard.seed)]
    words += ["--fuse"] if has_several_mounts(shard.scene) else []
    words += name_of_scene(shard.scene)
    infrasim("run", shard.scene, "--lidar", *shard.lidars, *words, "--out", shard.folder)


def split_by_time(folder: Path, parts: Parts) -> None:
    """Splits a data set by time. Raises FileExistsError if the data set has a different split."""
    data = read_data_set(folder)
    ends = (parts.train_until_s, parts.val_from_s)
    split.write(data, split.by_time(data.frames, data.period_s, *ends))


def described(folder: Path, experiments: Sequence[Experiment]) -> dict[str, pd.DataFrame]:
    """Returns the tables that describe a data set and all LiDARs in it.

    The tables are `lidars`, those of STATISTICS, and `hits`. Table `hits` comes last. A row in
    `hits` means that the other tables are complete.
    """
    key = {"scene": experiments[0].scene, "preset": experiments[0].preset}
    data = read_data_set(folder)
    vehicles = read_observations(data)
    tables = {"lidars": pd.DataFrame([lidar_row(folder / name) for name in vehicles.lidars])}
    by_name = vehicle_tables(vehicles, blocks_of(data, vehicles))
    for name in STATISTICS:
        rows = by_name[name]
        tables[name] = pd.concat([pd.DataFrame([key] * len(rows)), rows], axis=1)
    on_vehicles = zip(vehicles.lidars, vehicles.points.sum(axis=0), strict=True)
    hits = [key | hit_row(folder / name, points) for name, points in on_vehicles]
    return tables | {"hits": pd.DataFrame(hits)}


def lidar_row(folder: Path) -> dict[str, object]:
    """Returns price, field of view and range of a LiDAR from the `lidar.yaml` of its folder.

    For a fused data set, these are the values of the LiDAR at the first mount.
    """
    mounts = mount_names(folder)
    folder = folder.parents[1] / mounts[0] / folder.name if mounts else folder
    lidar, top = kitti.read_lidar(folder), kitti.read_yaml(folder / "lidar.yaml")
    units = lidar.field_of_view
    price = top.at("price_usd") if len(units) == 1 else None
    widths = [unit.azimuth[1] - unit.azimuth[0] for unit in units]
    heights = [unit.elevation[1] - unit.elevation[0] for unit in units]
    return {
        "lidar": lidar.name,
        "preset": lidar.preset,
        "model": lidar.model,
        "units": len(units),
        "period_s": lidar.period_s,
        "price_low_usd": lidar.price_usd[0],
        "price_high_usd": lidar.price_usd[1],
        "price_source": price.at("source").text() if price else "sum of the units",
        "price_date": price.at("date").text() if price else "",
        "horizontal_fov_deg": min(360.0, math.degrees(sum(widths))),
        "vertical_fov_deg": math.degrees(max(heights)),
        "range_m": max(unit.range_m[1] for unit in units),
    }


def hit_row(folder: Path, on_vehicles: int) -> dict[str, object]:
    """Returns the mean number of points per frame, and the mean number of points on vehicles."""
    frames, mounts = kitti.frames(folder), mount_names(folder)
    sizes = [kitti.frame_file(folder, "velodyne", k).stat().st_size for k in frames]
    return {
        "lidar": folder.name,
        "frames": len(frames),
        "hits_per_frame": sum(sizes) / POINT_BYTES / len(frames),
        "vehicle_points_per_frame": on_vehicles / len(frames),
    } | ({MOUNTS: len(mounts)} if mounts else {})


def mount_names(folder: Path) -> list[str]:
    """Returns the names of the mounts whose frames are fused in a folder.

    The result is empty if the frames are not fused.
    """
    return list(kitti.read_keys(folder / "lidar.yaml").get("mounts", []))
