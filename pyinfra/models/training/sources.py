"""Where frames to learn from come from: the folder of a LiDAR, or the simulator itself."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pyinfra.core.arrays import FloatArray, IntArray, Points
from pyinfra.core.vocabulary import OBJECT_CLASSES, VEHICLES, LabelTime, ObjectClass, Tier
from pyinfra.dataset import regions, split
from pyinfra.dataset.frame_sequence import SimulatedFrames, vehicles_of
from pyinfra.dataset.frame_tables import Vehicles, other_types, read_vehicles
from pyinfra.dataset.frames import (
    PERIOD_S,
    check_no_data_set,
    data_set_of,
    frame_numbers,
    has_labels,
)
from pyinfra.dataset.ground import Ground, ground_of, ground_of_boxes
from pyinfra.formats import kitti
from pyinfra.formats.kitti import read_yaml
from pyinfra.models.detectors.classes import numbers_of
from pyinfra.models.training.accumulation import Accumulation

if TYPE_CHECKING:
    from pyinfra.dataset import simulation
    from pyinfra.models.detectors.detection_area import Site
    from pyinfra.models.training.samples import Samples

# Of the train frames of 500 s, at most so many, evenly spread.
MOST_FRAMES: dict[Tier, int] = {"smoke": 200, "quick": 800, "full": 4000}
ONE_FRAME = Accumulation()


@dataclass(frozen=True, eq=False)
class Source:
    """The train frames of one LiDAR in one scene."""

    lidar: str
    preset: str
    scene: str
    label_time: LabelTime
    clouds: tuple[Callable[[], Points], ...]
    # (k, 7) of each frame's vehicles with a point, or of whatever the classes are
    read_boxes: Callable[[], tuple[FloatArray, ...]]
    read_warning: Callable[[], str | None] = lambda: None  # of names that are no vehicle's
    region: regions.Region | None = None  # where vehicles can be, if that is known
    ground: Ground | None = None  # how high the road lies; None: as the vehicles stand
    accumulation: Accumulation = ONE_FRAME  # of the clouds: (n, 5), of one frame (n, 4)
    classes: tuple[ObjectClass, ...] = VEHICLES  # that the boxes are of
    # (k,) numbers of the boxes' classes in each frame; none: all are of the first
    read_classes: Callable[[], tuple[IntArray, ...]] = tuple


@dataclass(frozen=True, eq=False)
class Stream:
    """Samples above the road of many LiDARs and sites, made when they are asked for."""

    lidar: str  # names of all, with blanks between, as the next three
    preset: str
    scene: str
    label_time: str
    samples: Samples
    site: Site  # what a network looks at around each sensor
    ground: Ground | None = None  # if it is the same for all
    anywhere: bool = False  # whether sites are so many that another one is meant to be found in
    accumulation: Accumulation = ONE_FRAME
    classes: tuple[ObjectClass, ...] = VEHICLES  # that the samples' boxes are of
    drawn: str = ""  # how samples are drawn, which a run that goes on must not change


def read_source(
    folder: Path,
    tier: Tier,
    accumulation: Accumulation = ONE_FRAME,
    classes: tuple[ObjectClass, ...] = VEHICLES,
) -> Source:
    """The train frames of a folder: those of ImageSets/train.txt, else the split by time.

    Without a label all frames are train frames. Stacked with them are train frames and those that
    lie between them, never one to test on.

    Raises FileNotFoundError, FormatError and Error.
    """
    check_no_data_set(folder)
    lidar = kitti.read_lidar(folder)
    numbers = _train_frames(folder, lidar.period_s)
    frames = spread(numbers, MOST_FRAMES[tier])
    there = _stackable(folder, numbers) if accumulation.frames > 1 else numbers
    read = partial(read_frame, folder)
    vehicles = cache(partial(read_vehicles, folder, frames))
    known = [name for class_name in classes for name in OBJECT_CLASSES[class_name]]
    return Source(
        lidar=lidar.name,
        preset=lidar.preset,
        scene=scene_of(folder),
        label_time=lidar.label_time,
        clouds=accumulation.clouds(read, frames, there, lidar.period_s),
        read_boxes=lambda: hit_boxes(vehicles(), len(frames), classes)[0],
        read_warning=lambda: other_types(folder, frames, vehicles(), known),
        region=regions.region_of(folder, lidar.T_world_levelled),
        ground=ground_of(folder),
        accumulation=accumulation,
        classes=classes,
        read_classes=lambda: hit_boxes(vehicles(), len(frames), classes)[1],
    )


def _train_frames(folder: Path, period_s: float) -> Sequence[int]:
    if (folder / "ImageSets/train.txt").is_file():
        return frame_numbers(folder, "train")
    if not has_labels(folder):
        return kitti.frames(folder)  # nothing to test on
    return split.by_time(kitti.frames(folder), period_s).train


def _stackable(folder: Path, train: Sequence[int]) -> set[int]:
    """Train frames, and those between them that are not to be tested on.

    With a list of train frames and none of test frames the others may all be to test on.
    """
    lists = folder / "ImageSets"
    named = [part for part in ("val", "test") if (lists / f"{part}.txt").is_file()]
    if not train or ((lists / "train.txt").is_file() and not named):
        return set(train)
    tested = {k for part in named for k in frame_numbers(folder, part)}
    between = range(train[0], train[-1] + 1)
    return {k for k in kitti.frames(folder) if k in between} - tested


def read_frame(folder: Path, frame: int) -> Points:
    """The cloud (n, 4) of a frame of a LiDAR's folder. Raises FormatError."""
    return kitti.read_points(kitti.frame_file(folder, "velodyne", frame))


def on_road(source: Source) -> Source:
    """With clouds and boxes above the road, as networks are given them.

    Raises Error if neither the road's height is known nor a vehicle is there.
    """
    boxes = source.read_boxes()
    ground = source.ground or ground_of_boxes(boxes)
    return replace(
        source,
        clouds=tuple(partial(_above, ground, cloud) for cloud in source.clouds),
        read_boxes=lambda: tuple(map(ground.above, boxes)),
        ground=ground,
    )


def _above(ground: Ground, cloud: Callable[[], Points]) -> Points:
    return ground.above(cloud())


def scene_of(folder: Path) -> str:
    """Name of the scene that a LiDAR's folder was simulated in."""
    description = data_set_of(folder) / "dataset.yaml"
    return read_yaml(description).at("name").text() if description.is_file() else "unknown"


def hit_boxes(
    vehicles: Vehicles, frames: int, classes: tuple[ObjectClass, ...] = VEHICLES
) -> tuple[tuple[FloatArray, ...], tuple[IntArray, ...]]:
    """(k, 7) of what of the classes has a point in each frame, and the numbers (k,) of these."""
    numbers = numbers_of(vehicles.names, classes)
    hit = (numbers >= 0) & (vehicles.points > 0)
    masks = [hit & (vehicles.frame == i) for i in range(frames)]
    return tuple(vehicles.boxes[i] for i in masks), tuple(numbers[i] for i in masks)


def simulated_source(
    scene: Path,
    lidar: Path,
    tier: Tier,
    *,
    preset: str = "datasheet",
    seed: int | None = None,
    set: Mapping[str, object] | None = None,
    mount: str = "",
    accumulation: Accumulation = ONE_FRAME,
    classes: tuple[ObjectClass, ...] = VEHICLES,
) -> Source:
    """The same frames as a run would write, cast when they are asked for; nothing is on disk.

    mount: which of several. Raises ConfigError and IoError as the simulator does, ImportError
    without the extension.
    """
    from pyinfra.dataset import simulation

    world = simulation.load_scene(scene, preset=preset, seed=seed, set=set, mount=mount)
    unit = simulation.load_lidar(lidar, preset)
    numbers = split.by_time(range(world.frames), PERIOD_S).train
    frames = SimulatedFrames(world, unit, spread(numbers, MOST_FRAMES[tier]), threads=1)
    labels = cache(lambda: hit_boxes(frames.vehicles(), len(frames), classes))
    return Source(
        lidar=unit.name,
        preset=unit.preset,
        scene=str(frames.keys["name"]),
        label_time=frames.label_time,
        clouds=accumulation.clouds(partial(cast, world, unit), frames.numbers, numbers, PERIOD_S),
        read_boxes=lambda: labels()[0],
        region=frames.region,
        ground=frames.ground,
        accumulation=accumulation,
        classes=classes,
        read_classes=lambda: labels()[1],
    )


def pose_of(scene: Mapping[str, Any]) -> kitti.WorldPose:
    """Of a scene's one mount."""
    ((_, mount),) = scene["mounts"].items()
    yaw = float(np.radians(mount["yaw_deg"]))
    return kitti.WorldPose(mount["x_m"], mount["y_m"], mount["z_m"], yaw)


def cast(world: simulation.World, lidar: simulation.Lidar, frame: int) -> Points:
    from pyinfra.dataset import simulation

    ((_, (simulated,)),) = simulation.simulate(world, [lidar], [frame], threads=1)
    return simulation.points(simulated)


def labels_of_frame(
    frame: simulation.Frame,
    label_time: LabelTime,
    classes: tuple[ObjectClass, ...] = VEHICLES,
) -> tuple[FloatArray, IntArray]:
    """(k, 7) of what of the classes has a point in a simulated frame, and the numbers (k,)."""
    (boxes,), (numbers,) = hit_boxes(vehicles_of(frame.objects, 0, label_time), 1, classes)
    return boxes, numbers


def spread(numbers: Sequence[int], most: int) -> tuple[int, ...]:
    """At most so many of the numbers, evenly spread."""
    if len(numbers) <= most:
        return tuple(numbers)
    return tuple(numbers[i * len(numbers) // most] for i in range(most))
