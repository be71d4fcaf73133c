"""What can happen to the world: the test frames again, simulated with other keys into a cache."""

from __future__ import annotations

import hashlib
import itertools
import math
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from pyinfra.core.errors import Error
from pyinfra.core.files import held, replacing
from pyinfra.dataset.catalogue import lidar_file, scene_file
from pyinfra.dataset.frames import check_no_data_set, frame_numbers
from pyinfra.dataset.runs import SimulatorError, infrasim
from pyinfra.experiments.stress import lidar
from pyinfra.formats import kitti

# Keys that a run adds to its scene.
NOT_OF_THE_SCENE = ("surfaces", "preset", "version", "frames_version")
FIRST_NUMBER = 3  # of the frames of 0.3, whose digests are without it
PHASES = 16  # angles that are drawn: a bundle of more spinning units has some twice
SCENE = "scene.yaml"


@dataclass(frozen=True, eq=False)
class Base:
    """The undisturbed test frames of one LiDAR."""

    folder: Path
    lidar: kitti.Lidar
    scene: dict[str, Any]  # as the run resolved it, files by whole paths; empty if not known
    frames: tuple[int, ...]  # ascending

    @property
    def scene_name(self) -> str:
        return str(self.scene.get("name", "unknown"))

    @property
    def trajectories(self) -> Path | None:
        """Where the recorded vehicles are; nothing if they are simulated."""
        file = self.scene.get("trajectories")
        return Path(file) if file else None

    @property
    def mounts(self) -> dict[str, dict[str, Any]]:
        """By name; several of a fused data set, none if they are not known."""
        return dict(self.scene.get("mounts", {}))

    @cached_property
    def identity(self) -> str:
        """What the frames are told by: scene and LiDAR, by the keys of version 0.3."""
        return _identity(self)

    @property
    def is_fused(self) -> bool:
        return len(self.mounts) > 1

    @property
    def lidar_file(self) -> Path:
        """What says where rays go: of a fused data set, that of its first mount beside it."""
        if not self.is_fused:
            return self.folder / lidar.FILE
        return self.folder.parents[1] / next(iter(self.mounts)) / self.folder.name / lidar.FILE


@dataclass(frozen=True)
class World:
    """What differs from the base; nothing is as there."""

    set: tuple[str, ...] = ()  # KEY=VALUE
    lidar: str = ""  # of the catalogue
    scene: str = ""  # of the catalogue
    preset: str = ""
    turns_deg: tuple[float, ...] = ()  # of the units' seams, over and over


def read_base(folder: Path, most: int) -> Base:
    """The test frames of a folder, at most so many, evenly spaced.

    Raises FileNotFoundError, FormatError, and Error for a folder that is no LiDAR's.
    """
    check_no_data_set(folder)
    frames = frame_numbers(folder)
    if not frames:
        raise Error(f"{folder}: found no test frame, allowed one or more")
    description = folder.parent / "dataset.yaml"
    scene = _scene(kitti.read_keys(description), folder) if description.is_file() else {}
    step = math.ceil(len(frames) / most)
    return Base(folder, kitti.read_lidar(folder), scene, tuple(frames[::step]))


def _scene(keys: dict[str, Any], folder: Path) -> dict[str, Any]:
    """That of a `dataset.yaml`, to be simulated again."""
    scene = {key: value for key, value in keys.items() if key not in NOT_OF_THE_SCENE}
    if scene.get("trajectories"):  # relative to a scene file that is elsewhere; a run copies them
        scene["trajectories"] = str((folder.parent / "trajectories.csv").resolve())
        _tell_from_first(scene["mounts"])
    return scene


def _tell_from_first(mounts: dict[str, dict[str, Any]]) -> None:
    """The copy of trajectories is by the clock of the only mount, or of the first."""
    first_s = next(iter(mounts.values())).get("clock_offset_s", 0)
    for mount in mounts.values():
        late_s = mount.pop("clock_offset_s", 0) - first_s
        if late_s:
            mount["clock_offset_s"] = late_s


def _identity(base: Base) -> str:
    description, lidar_yaml = base.folder.parent / "dataset.yaml", base.folder / lidar.FILE
    try:
        keys = yaml.safe_load(infrasim("check", description, "--canonical"))
        text = infrasim("check", lidar_yaml, "--canonical")
    except SimulatorError:  # of a recording, or of a simulation whose files were changed
        return f"{base.scene}\n{lidar_yaml.read_text('utf-8')}"
    number = keys["frames_version"]
    later = "" if number == FIRST_NUMBER else f"\nframes_version: {number}"
    return f"{_scene(keys, base.folder)}\n{text}{later}"


def density(base: Base, times: float | str) -> World:
    return World((f"traffic.vehicles_per_km_lane={_times(base, times, 'vehicles_per_km_lane')}",))


def speed(base: Base, times: float | str) -> World:
    return World((f"traffic.speed.mean_km_h={_times(base, times, 'speed', 'mean_km_h')}",))


def tilt(base: Base, pitch_deg: float | str) -> World:
    """Looks further down by the pitch; every mount."""
    mounts = base.mounts.items()
    down = {name: mount.get("pitch_deg", 0) + float(pitch_deg) for name, mount in mounts}
    return World(tuple(f"mounts.{name}.pitch_deg={deg:g}" for name, deg in down.items()))


def pole_clock(base: Base, ms: float | str) -> World:
    return World(late_clocks(base.mounts, float(ms)))


def pole_yaw(base: Base, degrees: float | str) -> World:
    return World(wrong_turns(base.mounts, float(degrees)))


def late_clocks(mounts: Mapping[str, Mapping[str, Any]], ms: float) -> tuple[str, ...]:
    """KEY=VALUE: clocks later than they are, the last one's by ms, those between evenly."""
    offsets_s = [mount.get("clock_offset_s", 0) for mount in mounts.values()]
    more_s = [ms / 1000 * i / (len(offsets_s) - 1) for i in range(len(offsets_s))]
    late = zip(mounts, offsets_s, more_s, strict=True)
    return tuple(f"mounts.{name}.clock_offset_s={a + b:.6g}" for name, a, b in late if b)


def wrong_turns(mounts: Mapping[str, Mapping[str, Any]], degrees: float) -> tuple[str, ...]:
    """KEY=VALUE: all but the first are taken to stand turned, left and right by turns."""
    words = []
    for i, (name, mount) in enumerate(mounts.items()):
        given_deg = mount.get("calibration_error", {}).get("yaw_deg", 0)
        if i > 0:
            yaw_deg = given_deg + degrees * (1 if i % 2 else -1)
            words.append(f"mounts.{name}.calibration_error.yaw_deg={yaw_deg:g}")
    return tuple(words)


def seam(_: Base, degrees: float | str) -> World:
    """The turns of all units begin so much further left."""
    return World(turns_deg=(float(degrees),))


def phase(_: Base, draw: float | str) -> World:
    """Every unit's motor starts at an angle of its own, as after power was cut."""
    return World(turns_deg=angles_deg(int(str(draw).removeprefix("draw_"))))


def angles_deg(draw: int) -> tuple[float, ...]:
    """Where motors stand after power was cut for the draw-th time."""
    angles = np.random.default_rng([draw, PHASES]).uniform(0, 360, PHASES)
    return tuple(angles.round(3).tolist())


def other_lidar(_: Base, name: float | str) -> World:
    return World(lidar=str(name))


def other_scene(_: Base, name: float | str) -> World:
    return World(scene=str(name))


def other_preset(base: Base, name: float | str) -> World:
    """Of the catalogue's LiDAR of this name: a data set holds one preset alone."""
    return World(lidar=base.lidar.name, preset=str(name))


def one_class(_: Base, name: float | str) -> World:
    return World((f"traffic.class_shares={{{name}: 1}}",))


def check(base: Base, world: World) -> None:
    """Reads all that a world is made of, as its run will, and casts no ray.

    Raises Error for frames that its scene is too short for, and SimulatorError.
    """
    with tempfile.TemporaryDirectory() as folder:
        scene, lidar_yaml = _written(_texts(base, world), world, Path(folder))
        infrasim("check", lidar_yaml, "--preset", _preset(base, world))
        if world.scene or world.set:  # that of the base was read by its own run
            text = infrasim("check", scene, *_sets(world))
    if world.scene:
        _check_length(base, scene_file(world.scene), yaml.safe_load(text)["duration_s"])


def _check_length(base: Base, scene: Path, duration_s: float) -> None:
    needed = (base.frames[-1] + 1) * base.lidar.period_s
    if needed > duration_s + 1e-6:
        raise Error(
            f"{scene}: duration_s: found {duration_s:g}, allowed {needed:g} or more, as frame "
            f"{base.frames[-1]} is tested"
        )


def simulated(base: Base, world: World, cache: Path, name: str) -> Path:
    """The LiDAR's folder of the base's frames in another world; what is there already stays.

    name: of its folder in the cache, for a reader; a digest of the configuration follows.
    Raises FormatError for a LiDAR that was not simulated, and SimulatorError.
    """
    texts = _texts(base, world)
    out = cache / f"{name}_{_digest(base, world, texts)}"
    with held(cache / f"{out.name}.lock", wait=True):
        fused = out / "fused" if base.is_fused else out
        folder = fused / (world.lidar or base.lidar.name)
        if all(kitti.frame_file(folder, "velodyne", k).is_file() for k in base.frames):
            return folder
        scene, lidar_yaml = _written(texts, world, cache / f"{out.name}_inputs")
        words = ["--preset", _preset(base, world), "--frames", frame_words(base.frames)]
        words += ["--threads", "1", "--label-time", base.lidar.label_time, *_sets(world)]
        words += ["--fuse"] if base.is_fused else []
        infrasim("run", scene, "--lidar", lidar_yaml, "--out", out, *words)
    return folder


def _texts(base: Base, world: World) -> dict[str, str]:
    """What the simulator reads, by name; a LiDAR of the catalogue stays where it is."""
    text = yaml.safe_dump(base.scene, sort_keys=False)
    if world.scene:
        text = scene_file(world.scene).read_text("utf-8")
    lidar_texts = {} if world.lidar else {lidar.FILE: _lidar_text(base, world)}
    return {SCENE: text} | lidar_texts


def _lidar_text(base: Base, world: World) -> str:
    return lidar.text(base.lidar_file, world.turns_deg)


def _written(texts: dict[str, str], world: World, folder: Path) -> tuple[Path, Path]:
    """Writes the texts; returns the files of the scene and of the LiDAR."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in texts.items():
        with replacing(folder / name) as beside:
            beside.write_text(text, "utf-8")
    return folder / SCENE, lidar_file(world.lidar) if world.lidar else folder / lidar.FILE


def _digest(base: Base, world: World, texts: dict[str, str]) -> str:
    """Of all that a world depends on but the frames, the binary and the catalogue's LiDARs."""
    parts = [*texts.values(), _preset(base, world), base.lidar.label_time, *world.set]
    digest = hashlib.sha256("\n".join(parts).encode())
    if base.trajectories and not world.scene:
        digest.update(base.trajectories.read_bytes())
    return digest.hexdigest()[:8]


def _preset(base: Base, world: World) -> str:
    return world.preset or base.lidar.preset


def _sets(world: World) -> list[str]:
    return ["--set", *world.set] if world.set else []


def frame_words(frames: Sequence[int]) -> str:
    """A:B:STEP that holds the frames, ascending: all of them, and others if they are not even."""
    gaps = [b - a for a, b in itertools.pairwise(frames)]
    return f"{frames[0]}:{frames[-1] + 1}:{math.gcd(*gaps) or 1}"


def _times(base: Base, times: float | str, *keys: str) -> str:
    value: Any = base.scene.get("traffic")
    if not isinstance(value, dict):
        raise Error(f"{base.folder.parent}: found no traffic, needed for density and speed")
    for key in keys:
        value = value[key]
    return f"{float(times) * float(value):g}"
