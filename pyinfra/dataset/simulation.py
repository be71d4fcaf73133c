"""Python interface of the simulator. Its frames equal those of the `infrasim` binary exactly."""

import json
import math
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TypeAlias
from warnings import warn

import numpy as np
import yaml

from pyinfra._core import (
    BackgroundModel,
    ConfigError,
    CropBox,
    CropFieldOfView,
    CropPolygon,
    CropRange,
    Frame,
    FrameStream,
    GroundHeight,
    GroundMorphological,
    GroundPlane,
    IoError,
    Lidar,
    Observer,
    World,
    frames_version,
    kept_rows,
    learn_background,
    warnings,
)
from pyinfra.core.arrays import Float32Array, FloatArray, Points, Records
from pyinfra.core.errors import Error
from pyinfra.core.vocabulary import LabelTime
from pyinfra.dataset.frames import PERIOD_S
from pyinfra.dataset.made import recipe_of, remembered
from pyinfra.formats import kitti

__all__ = [
    "BackgroundModel",
    "ConfigError",
    "CropBox",
    "CropFieldOfView",
    "CropPolygon",
    "CropRange",
    "Filter",
    "Frame",
    "FrameStream",
    "GroundHeight",
    "GroundMorphological",
    "GroundPlane",
    "IoError",
    "Lidar",
    "Observer",
    "World",
    "fields",
    "filtered",
    "frames_version",
    "kept_rows",
    "label_time",
    "learn_background",
    "load_lidar",
    "load_observer",
    "load_scene",
    "make_world",
    "points",
    "scan_pattern",
    "simulate",
    "with_mount",
]

_DUMPER = getattr(yaml, "CSafeDumper", yaml.SafeDumper)  # CSafeDumper is faster than SafeDumper


Filter: TypeAlias = (
    CropBox
    | CropPolygon
    | CropRange
    | CropFieldOfView
    | GroundHeight
    | GroundPlane
    | GroundMorphological
    | BackgroundModel
)


def load_scene(
    file: str | Path,
    *,
    preset: str = "datasheet",
    seed: int | None = None,
    set: Mapping[str, object] | None = None,
    mount: str = "",
) -> World:
    """Loads a scene and builds its meshes. Traffic is simulated up to the last frame requested.

    preset: preset of the LiDARs; a scene may have special keys for a preset.
    set: overrides of keys, such as `{"traffic.vehicles_per_km_lane": 20}`.
    mount: name of the mount; only needed if the scene has several mounts.
    Raises ConfigError with `file:line:col: key: expected ..., got ...`, and IoError. If a vehicle
    hits the sensor, the error is raised later: by `drive`, or by a request for the frame of the hit
    or a later frame.
    """
    assignments = _assignments(set, seed)
    make = partial(World, str(Path(file).absolute()), assignments, preset, mount)
    return remembered(World(str(file), assignments, preset, mount), make)


def load_observer(
    file: str | Path,
    frames: Sequence[int],
    *,
    preset: str = "datasheet",
    seed: int | None = None,
    set: Mapping[str, object] | None = None,
    mount: str = "",
    period_s: float = PERIOD_S,
) -> Observer:
    """Builds a site and the traffic of some frames, to be observed from many poses.

    frames: the frames that may be observed. period_s: frame period of the LiDARs.
    mount: the mount whose evaluation region counts; only needed if the scene has several.
    set: overrides of keys, as in `load_scene`. The scene's filters have no effect.
    Raises ConfigError and IoError.
    """
    return Observer(str(file), _assignments(set, seed), preset, mount, list(frames), period_s)


def make_world(scene: Mapping[str, object], *, preset: str = "datasheet", mount: str = "") -> World:
    """Builds a world from the keys of a scene, given as a mapping.

    Messages show the scene's name in place of a file. Paths in the keys are relative to the working
    folder. Raises ConfigError and IoError.
    """
    text = yaml.dump(dict(scene), Dumper=_DUMPER, sort_keys=False, default_flow_style=None)
    make = partial(_world_of_text, text, str(scene.get("name", "scene")), preset, mount)
    return remembered(make(), make)


def _world_of_text(text: str, name: str, preset: str, mount: str) -> World:
    # This function exists because World.of_text cannot be pickled.
    return World.of_text(text, name, preset, mount)


def with_mount(world: World, mount: str) -> World:
    """Returns a world that load_scene or make_world made, at another mount of its scene."""
    recipe = recipe_of(world)
    make: Callable[[], World] = partial(recipe.func, *recipe.args[:-1], mount)
    return remembered(make(), make)


def load_lidar(
    file: str | Path,
    preset: str = "datasheet",
    *,
    rate_hz: float | None = None,
    law_exponent: float | None = None,
    echo: str | None = None,
) -> Lidar:
    """Loads a LiDAR file under one preset. Raises ConfigError and IoError.

    rate_hz: frames per second; by default that of the file
    law_exponent: exponent of the detection law of a LiDAR with one published range
    echo: echoes of a ray that become points: strongest, first, last or dual
    """
    lidar = remembered(Lidar(str(file), preset), partial(Lidar, str(Path(file).absolute()), preset))
    if rate_hz is not None:
        lidar = lidar.with_rate(rate_hz)
    if law_exponent is not None:
        lidar = lidar.with_law_exponent(law_exponent)
    return lidar if echo is None else lidar.with_echo(echo)


def label_time(scene: World, lidar: Lidar) -> LabelTime:
    """Returns the label time of the scene, or that of the LiDAR's preset if the scene sets none.

    For `frame`, label poses are the columns x y z heading of `Frame.objects`. For `scan`, label
    poses are the columns scan_x scan_y scan_z scan_heading.
    """
    return "scan" if scene.label_time(lidar.preset) == "scan" else "frame"


def simulate(
    scene: World | str | Path,
    lidars: Iterable[Lidar | str | Path],
    frames: Iterable[int],
    *,
    preset: str = "datasheet",
    seed: int | None = None,
    set: Mapping[str, object] | None = None,
    mount: str = "",
    threads: int | None = None,
) -> Iterator[tuple[int, list[Frame]]]:
    """Yields each frame's number and a list of one `Frame` per LiDAR, in the given order.

    Threads compute the next frames while the caller processes the current one. The columns of a
    frame are read-only views of the frame's memory, which stays allocated while a view exists.
    If the scene or a LiDAR is a file, preset, seed, set and mount apply to that file.
    Warns if the scene's weather has no effect on a LiDAR.
    Raises IoError, and ConfigError for a wrong file or a frame that the scene does not have. Also
    raises ConfigError if the scene has keys for a LiDAR's preset but was loaded with a different
    preset, and for LiDARs of different frame periods.
    """
    if isinstance(scene, World):
        if seed is not None or set or mount:
            raise Error("seed, set, mount: expected a scene file for these arguments, got a World")
        world = scene
    else:
        world = load_scene(scene, preset=preset, seed=seed, set=set, mount=mount)
    units = [x if isinstance(x, Lidar) else load_lidar(x, preset) for x in lidars]
    for line in warnings(world, units):
        warn(line, stacklevel=2)
    count = threads or os.cpu_count() or 1
    existing = world.frames_of(units[0].period_s) if units else world.frames
    numbers = []
    for k in frames:  # checked one by one, because an iterable may not fit into memory
        if not 0 <= k < existing:
            raise ConfigError(f"frames: expected 0 to {existing - 1}, got {k}")
        numbers.append(k)
    return FrameStream(world, units, numbers, count)


def points(frame: Frame) -> Float32Array:
    """Returns a copy of a frame's points for detectors: (n, 4) float32, x y z intensity."""
    return np.column_stack([frame.xyz, frame.intensity])


def fields(frame: Frame) -> Records:
    """Returns the records (n,) of a frame's points, as in the files of the folder `fields`."""
    records = np.empty(len(frame), dtype=kitti.FIELDS)
    columns = (frame.time, frame.ring, frame.class_id, frame.echo, frame.object_id)
    for name, column in zip(kitti.FIELDS.names or (), columns, strict=True):
        records[name] = column
    return records


def filtered(points: Points, *steps: Filter) -> Float32Array:
    """Applies filter steps to points (n, 3 or 4) in the levelled LiDAR frame.

    Each step receives the points that the previous steps kept, as in `infrasim filter`. The order
    of the points does not change. Points that are not finite, or 0 0 0, are left out, because they
    are not returns. Raises Error for a wrong shape or type of points, and for
    a parameter out of its range.
    """
    rows: Float32Array = points[kept_rows(points, list(steps))]
    return rows


def scan_pattern(
    lidar: Lidar | str | Path,
    frames: range,
    *,
    preset: str = "datasheet",
    seed: int | None = None,
    mount: str = "pole",
) -> FloatArray:
    """Returns azimuth, elevation (rad) and time (s) of each ray, (n, 3) float64.

    The rays are in the order of firing, one unit of the LiDAR after the other. Angles are in the
    sensor frame. Time counts from the start of the run. Without a seed, motors start at the same
    angle as with phase lock. With a seed, motors start as in runs with that seed at the mount.
    """
    unit = lidar if isinstance(lidar, Lidar) else load_lidar(lidar, preset)
    return unit.pattern(frames.start, frames.stop, frames.step, seed, mount)


def _assignments(set: Mapping[str, object] | None, seed: int | None) -> list[str]:
    """Returns overrides of keys as KEY=VALUE, with the seed last."""
    keys = {**(set or {}), **({} if seed is None else {"seed": seed})}
    return [f"{key}={_yaml(value)}" for key, value in keys.items()]


def _yaml(value: object) -> str:
    if isinstance(value, (np.ndarray, np.generic)):
        value = value.tolist()
    if isinstance(value, bool):
        return "true" if value else "false"
    if value is None:
        return "null"
    if isinstance(value, float) and not math.isfinite(value):
        return f"{value}".replace("inf", ".inf").replace("nan", ".nan")
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{_text(str(k))}: {_yaml(v)}" for k, v in value.items()) + "}"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(_yaml(v) for v in value) + "]"
    return _text(str(value))


def _text(text: str) -> str:
    """Returns a text for YAML, in quotes if YAML would change it. `{x_m: 1}` remains a map."""
    try:
        (read,) = yaml.safe_load(f"[{text}]")
    except (yaml.YAMLError, ValueError):  # ValueError: commas divide the text into several values
        return json.dumps(text, ensure_ascii=False)
    is_other = isinstance(read, (str, dict, list)) and read != text
    return json.dumps(text, ensure_ascii=False) if is_other and text[0] not in "{['\"" else text
