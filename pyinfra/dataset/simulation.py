"""The simulator from Python: the same frames, byte for byte, as the `infrasim` binary writes."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping
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
    World,
    frames_version,
    kept_rows,
    learn_background,
    warnings,
)
from pyinfra.core.arrays import Float32Array, FloatArray, Points
from pyinfra.core.errors import Error
from pyinfra.core.vocabulary import LabelTime

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
    "World",
    "filtered",
    "frames_version",
    "kept_rows",
    "label_time",
    "learn_background",
    "load_lidar",
    "load_scene",
    "make_world",
    "points",
    "scan_pattern",
    "simulate",
]

_DUMPER = getattr(yaml, "CSafeDumper", yaml.SafeDumper)  # faster where it is


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
    """A scene made ready: its traffic driven, its meshes built.

    preset: of the LiDARs; a scene may have a block of keys for it.
    set: values by dotted path: `{"traffic.vehicles_per_km_lane": 20}`.
    mount: which of several; a scene with one needs none.
    Raises ConfigError with `file:line:col: key: found, allowed`, and IoError.
    """
    assignments = [f"{key}={_yaml(value)}" for key, value in (set or {}).items()]
    if seed is not None:
        assignments.append(f"seed={seed}")
    return World(str(file), assignments, preset, mount)


def make_world(scene: Mapping[str, object], *, preset: str = "datasheet", mount: str = "") -> World:
    """A scene made ready from its keys as plain data; messages name it in place of a file.

    Paths in it are relative to the working folder. Raises ConfigError and IoError.
    """
    text = yaml.dump(dict(scene), Dumper=_DUMPER, sort_keys=False, default_flow_style=None)
    return World.of_text(text, str(scene.get("name", "scene")), preset, mount)


def load_lidar(file: str | Path, preset: str = "datasheet") -> Lidar:
    """One preset of a LiDAR file. Raises ConfigError and IoError."""
    return Lidar(str(file), preset)


def label_time(scene: World, lidar: Lidar) -> LabelTime:
    """When the labels of a LiDAR's frames hold: the scene's, or that of the LiDAR's preset.

    `frame`: columns x y z heading of `Frame.objects`; `scan`: scan_x scan_y scan_z scan_heading.
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
    """Frames in the given order, each with one `Frame` per LiDAR.

    The next frames are computed by threads of their own while the caller works on this one. The
    columns of a frame are read-only views that keep it alive; nothing is copied.
    A scene or LiDAR may be a file; then preset, seed, set and mount apply to it.
    Warns where weather has no effect.
    Raises ConfigError for a wrong file, a frame that the scene does not have, and LiDARs of a
    preset for which the scene has keys but was not loaded, and IoError.
    """
    if isinstance(scene, World):
        if seed is not None or set or mount:
            raise Error(
                "seed, set and mount need a scene file, found a World that is already built"
            )
        world = scene
    else:
        world = load_scene(scene, preset=preset, seed=seed, set=set, mount=mount)
    units = [x if isinstance(x, Lidar) else load_lidar(x, preset) for x in lidars]
    for line in warnings(world, units):
        warn(line, stacklevel=2)
    count = threads or os.cpu_count() or 1
    numbers = []
    for k in frames:  # one by one, as they may be more than memory holds
        if not 0 <= k < world.frames:
            raise ConfigError(f"frames: found {k}, allowed 0 to {world.frames - 1}")
        numbers.append(k)
    return FrameStream(world, units, numbers, count)


def points(frame: Frame) -> Float32Array:
    """Copy of a frame's points as detectors take them: (n, 4) float32, x y z intensity."""
    return np.column_stack([frame.xyz, frame.intensity])


def filtered(points: Points, *steps: Filter) -> Float32Array:
    """The rows of points (n, 3 or 4), levelled LiDAR frame, that every step keeps, in their order.

    Each step sees what those before it kept, as in `infrasim filter`. Raises Error for
    another shape or type of points and for a parameter out of its range.
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
    """Azimuth, elevation (rad) and time (s) of every ray: (n, 3) float64, column by column.

    Sensor frame; time since the start of the run. Free motors start as if they were locked, or
    with a seed as its runs have them at the mount.
    """
    unit = lidar if isinstance(lidar, Lidar) else load_lidar(lidar, preset)
    return unit.pattern(frames.start, frames.stop, frames.step, seed, mount)


def _yaml(value: object) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(_yaml(v) for v in value) + "]"
    return str(value)
