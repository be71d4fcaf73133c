"""What can happen to the world: the test frames again, simulated with other keys into a cache."""

from __future__ import annotations

import hashlib
import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from pyinfra import kitti
from pyinfra.atomic import held, replacing
from pyinfra.evaluation.ground_truth import frame_numbers
from pyinfra.hits import infrasim, lidar_file, scene_file
from pyinfra.kitti import FormatError

NOT_OF_THE_SCENE = ("preset", "version")  # keys that a run adds to its scene


@dataclass(frozen=True, eq=False)
class Base:
    """The undisturbed test frames of one LiDAR."""

    folder: Path
    lidar: kitti.Lidar
    scene: dict[str, Any]  # as the run resolved it; empty without dataset.yaml
    frames: tuple[int, ...]  # ascending

    @property
    def scene_name(self) -> str:
        return str(self.scene.get("name", "unknown"))


@dataclass(frozen=True)
class World:
    """What differs from the base; nothing is as there."""

    set: tuple[str, ...] = ()  # KEY=VALUE
    lidar: str = ""
    scene: str = ""
    preset: str = ""


def read_base(folder: Path, most: int) -> Base:
    """The test frames of a folder, at most so many, evenly spaced.

    Raises FileNotFoundError, FormatError, and ValueError for a folder that is no LiDAR's.
    """
    inside = sorted(file.parent.name for file in folder.glob("*/lidar.yaml"))
    if inside:
        raise ValueError(f"{folder}: found a data set, allowed a LiDAR of it: {', '.join(inside)}")
    frames = frame_numbers(folder)
    if not frames:
        raise ValueError(f"{folder}: found no test frame, allowed one or more")
    description = folder.parent / "dataset.yaml"
    scene = yaml.safe_load(description.read_text("utf-8")) if description.is_file() else {}
    if not isinstance(scene, dict):
        raise FormatError(f"{description}:1: found no mapping, allowed the keys of a scene")
    scene = {key: value for key, value in scene.items() if key not in NOT_OF_THE_SCENE}
    step = math.ceil(len(frames) / most)
    return Base(folder, kitti.read_lidar(folder), scene, tuple(frames[::step]))


def density(base: Base, times: float | str) -> World:
    return World((f"traffic.vehicles_per_km_lane={_times(base, times, 'vehicles_per_km_lane')}",))


def speed(base: Base, times: float | str) -> World:
    return World((f"traffic.speed.mean_km_h={_times(base, times, 'speed', 'mean_km_h')}",))


def tilt(base: Base, pitch_deg: float | str) -> World:
    """Looks down by the pitch; every mount, as there is one."""
    return World(tuple(f"mounts.{name}.pitch_deg={pitch_deg:g}" for name in base.scene["mounts"]))


def other_lidar(_: Base, name: float | str) -> World:
    return World(lidar=str(name))


def other_scene(_: Base, name: float | str) -> World:
    return World(scene=str(name))


def other_preset(_: Base, name: float | str) -> World:
    return World(preset=str(name))


def one_class(_: Base, name: float | str) -> World:
    return World((f"traffic.class_shares={{{name}: 1}}",))


def simulated(base: Base, world: World, cache: Path, name: str) -> Path:
    """The LiDAR's folder of the base's frames in another world; what is there already stays.

    name: of its folder in the cache, for a reader; a digest of the configuration follows.
    Raises ValueError for a LiDAR that is not in the catalogue, and SimulatorError.
    """
    lidar = lidar_file(world.lidar or base.lidar.name)
    if not lidar.is_file():
        raise ValueError(f"{lidar}: found no such LiDAR, needed to simulate again")
    text = yaml.safe_dump(base.scene, sort_keys=False)
    if world.scene:
        text = scene_file(world.scene).read_text("utf-8")
    preset = world.preset or base.lidar.preset
    digest = hashlib.sha256("\n".join([text, preset, *world.set]).encode()).hexdigest()[:8]
    out = cache / f"{name}_{digest}"
    with held(cache / f"{out.name}.lock", wait=True):
        folder = out / lidar.stem
        if all(kitti.frame_file(folder, "velodyne", k).is_file() for k in base.frames):
            return folder
        scene = cache / f"{out.name}.yaml"
        with replacing(scene) as beside:
            beside.write_text(text, "utf-8")
        words = ["--preset", preset, "--frames", frame_words(base.frames), "--threads", "1"]
        sets = ["--set", *world.set] if world.set else []
        infrasim("run", scene, "--lidar", lidar, "--out", out, *words, *sets)
    return folder


def frame_words(frames: Sequence[int]) -> str:
    """A:B:STEP that holds the frames, ascending: all of them, and others if they are not even."""
    gaps = [b - a for a, b in itertools.pairwise(frames)]
    return f"{frames[0]}:{frames[-1] + 1}:{math.gcd(*gaps) or 1}"


def _times(base: Base, times: float | str, *keys: str) -> str:
    value: Any = base.scene.get("traffic")
    if not isinstance(value, dict):
        raise ValueError(f"{base.folder.parent}: found no traffic, needed for density and speed")
    for key in keys:
        value = value[key]
    return f"{float(times) * float(value):g}"
