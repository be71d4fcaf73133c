"""Sources of training frames: the folder of a LiDAR, or the simulator."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pyinfra.core.arrays import FloatArray, IntArray, Points
from pyinfra.core.errors import Error
from pyinfra.core.vocabulary import OBJECT_CLASSES, VEHICLES, LabelTime, ObjectClass, Tier
from pyinfra.dataset import regions, split
from pyinfra.dataset.frame_readers import other_types, read_vehicles
from pyinfra.dataset.frame_sequence import FrameSequence
from pyinfra.dataset.frame_tables import Vehicles
from pyinfra.dataset.frames import (
    data_set_of,
    frame_numbers,
    has_labels,
    lidar_folder,
    spread,
)
from pyinfra.dataset.frames_version import number_at
from pyinfra.dataset.ground import Ground, ground_of, ground_of_boxes
from pyinfra.dataset.object_rows import vehicles_of
from pyinfra.dataset.simulated_frames import SimulatedFrames
from pyinfra.formats import kitti
from pyinfra.formats.kitti import read_yaml
from pyinfra.models.detectors.classes import numbers_of
from pyinfra.models.training.accumulation import Accumulation

if TYPE_CHECKING:
    from pyinfra.dataset import simulation
    from pyinfra.models.detectors.detection_area import Site
    from pyinfra.models.training.samples import Samples

# Largest number of training frames by tier. The frames are evenly spread over 500 s.
MOST_FRAMES: dict[Tier, int] = {"smoke": 200, "quick": 800, "full": 4000}
ONE_FRAME = Accumulation()


@dataclass(frozen=True, eq=False)
class Source:
    """The training frames of one LiDAR in one scene."""

    lidar: str
    preset: str
    scene: str
    label_time: LabelTime
    clouds: tuple[Callable[[], Points], ...]
    # (k, 7) boxes of each frame's objects that have a point and belong to `classes`
    read_boxes: Callable[[], tuple[FloatArray, ...]]
    read_warning: Callable[[], str | None] = lambda: None  # warning about object names of no class
    region: regions.Region | None = None  # where vehicles can be, if known
    ground: Ground | None = None  # height of the road; None if it is computed from the vehicles
    accumulation: Accumulation = ONE_FRAME  # clouds are (n, 4) for one frame, (n, 5) if stacked
    classes: tuple[ObjectClass, ...] = VEHICLES  # classes of the boxes
    # (k,) class numbers of the boxes in each frame; if empty, all boxes are of the first class
    read_classes: Callable[[], tuple[IntArray, ...]] = tuple
    frames_version: str = ""  # version of the frames; empty if they were recorded


@dataclass(frozen=True, eq=False)
class Stream:
    """Samples of one or more LiDARs and sites, made on demand, with z measured from the road."""

    # Names of all LiDARs, separated by blanks. The next fields may also have several names.
    lidar: str
    preset: str
    scene: str
    label_time: str
    samples: Samples
    site: Site  # the area around each sensor that a network uses
    ground: Ground | None = None  # ground that is the same for all samples, if any
    anywhere: bool = False  # whether there are many sites, so that the network suits other sites
    accumulation: Accumulation = ONE_FRAME
    classes: tuple[ObjectClass, ...] = VEHICLES
    # How samples are chosen, or a digest of their labels. It must be the same when a training
    # resumes.
    drawn: str = ""
    frames_version: str = ""  # version of the frames; empty if they were recorded


def read_source(
    folder: Path,
    tier: Tier,
    accumulation: Accumulation = ONE_FRAME,
    classes: tuple[ObjectClass, ...] = VEHICLES,
) -> Source:
    """Returns the training frames of a folder.

    The training frames are listed in ImageSets/train.txt. If this file does not exist, they are the
    training frames of the split by time without those of val.txt and test.txt, or all frames if the
    folder has no labels. Only training frames and frames between them are stacked. Test frames are
    never stacked.

    Raises FileNotFoundError, FormatError and Error.
    """
    folder = lidar_folder(folder)
    lidar = kitti.read_lidar(folder)
    numbers = _train_frames(folder, lidar.period_s)
    frames = spread(numbers, MOST_FRAMES[tier])
    stackable = _stackable(folder, numbers) if accumulation.frames > 1 else numbers
    read = partial(read_frame, folder)
    vehicles = cache(partial(read_vehicles, folder, frames))
    names = [name for class_name in classes for name in OBJECT_CLASSES[class_name]]
    return Source(
        lidar=lidar.name,
        preset=lidar.preset,
        scene=scene_of(folder),
        label_time=lidar.label_time,
        clouds=accumulation.clouds(read, frames, stackable, lidar.period_s),
        read_boxes=lambda: hit_boxes(vehicles(), len(frames), classes)[0],
        read_warning=lambda: other_types(folder, frames, vehicles(), names),
        region=regions.region_of(folder, lidar.T_world_levelled),
        ground=ground_of(folder),
        accumulation=accumulation,
        classes=classes,
        read_classes=lambda: hit_boxes(vehicles(), len(frames), classes)[1],
        frames_version=number_at(folder),
    )


def sequence_source(
    frames: FrameSequence,
    tier: Tier,
    classes: tuple[ObjectClass, ...] = VEHICLES,
) -> Source:
    """Returns all frames of a sequence as training frames. Raises Error if the LiDAR is unknown."""
    lidar = frames.lidar
    if lidar is None:
        raise Error("frames: expected frames of a LiDAR with a pose, got frames without a LiDAR")
    chosen = frames.of(spread(frames.numbers, MOST_FRAMES[tier]))
    vehicles, count = cache(chosen.vehicles), len(chosen)
    return Source(
        lidar=lidar.name,
        preset=lidar.preset,
        scene=frames.scene,
        label_time=lidar.label_time,
        clouds=ONE_FRAME.clouds(chosen.points_of, chosen.numbers, chosen.numbers, lidar.period_s),
        read_boxes=lambda: hit_boxes(vehicles(), count, classes)[0],
        region=frames.region,
        ground=frames.ground,
        classes=classes,
        read_classes=lambda: hit_boxes(vehicles(), count, classes)[1],
        frames_version=frames.frames_version,
    )


def _train_frames(folder: Path, period_s: float) -> Sequence[int]:
    if (folder / "ImageSets/train.txt").is_file():
        return frame_numbers(folder, "train")
    if not has_labels(folder):
        return kitti.frames(folder)  # without labels there can be no test frames
    train = split.by_time(kitti.frames(folder), period_s, where=folder).train
    tested = _tested(folder)
    return [k for k in train if k not in tested]


def _tested(folder: Path) -> set[int]:
    """Returns the frames of val.txt and test.txt, as far as these files exist."""
    return {
        k
        for part in ("val", "test")
        if (folder / f"ImageSets/{part}.txt").is_file()
        for k in frame_numbers(folder, part)
    }


def _stackable(folder: Path, train: Sequence[int]) -> set[int]:
    """Returns the training frames, and the frames between them that are not test frames.

    If there is a list of training frames but no list of test frames, any frame that is not in the
    list may be a test frame. Then only the training frames are returned.
    """
    lists = folder / "ImageSets"
    named = any((lists / f"{part}.txt").is_file() for part in ("val", "test"))
    if not train or ((lists / "train.txt").is_file() and not named):
        return set(train)
    between = range(train[0], train[-1] + 1)
    return {k for k in kitti.frames(folder) if k in between} - _tested(folder)


def read_frame(folder: Path, frame: int) -> Points:
    """Reads the cloud (n, 4) of a frame in a LiDAR's folder. Raises FormatError."""
    return kitti.read_points(kitti.frame_file(folder, "velodyne", frame))


def common_label_time(sources: Sequence[Source]) -> LabelTime:
    """Returns the label time that all sources share. Raises Error if their label times differ."""
    first = sources[0]
    for other in sources:
        if other.label_time != first.label_time:
            raise Error(
                f"{other.lidar} in {other.scene}: label_time: expected {first.label_time}, got "
                f"{other.label_time}; {first.lidar} in {first.scene} has {first.label_time}"
            )
    return first.label_time


def on_road(source: Source) -> Source:
    """Returns the source with z of clouds and boxes measured from the road, as networks need it.

    If the height of the road is unknown, it is computed from the vehicles. Raises Error if there is
    no vehicle.
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
    """Returns the scene name of a LiDAR's folder; `unknown` if there is no dataset.yaml."""
    description = data_set_of(folder) / "dataset.yaml"
    return read_yaml(description).at("name").text() if description.is_file() else "unknown"


def hit_boxes(
    vehicles: Vehicles, frames: int, classes: tuple[ObjectClass, ...] = VEHICLES
) -> tuple[tuple[FloatArray, ...], tuple[IntArray, ...]]:
    """Returns the boxes (k, 7) and class numbers (k,) of the objects in each frame.

    Only objects of `classes` with at least one point are included. frames: number of frames.
    """
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
    """Returns the frames that `infrasim run` would write, simulated on demand without files.

    mount: name of the mount, if there are several. Raises ConfigError and IoError as the simulator
    does, and ImportError if the extension is not installed.
    """
    from pyinfra.dataset import simulation

    world = simulation.load_scene(scene, preset=preset, seed=seed, set=set, mount=mount)
    unit = simulation.load_lidar(lidar, preset)
    period_s = unit.period_s
    numbers = split.by_time(range(world.frames_of(period_s)), period_s, where=scene).train
    frames = SimulatedFrames(world, unit, spread(numbers, MOST_FRAMES[tier]), threads=1)
    labels = cache(lambda: hit_boxes(frames.vehicles(), len(frames), classes))
    return Source(
        lidar=unit.name,
        preset=unit.preset,
        scene=str(frames.keys["name"]),
        label_time=frames.label_time,
        clouds=accumulation.clouds(partial(cast, world, unit), frames.numbers, numbers, period_s),
        read_boxes=lambda: labels()[0],
        region=frames.region,
        ground=frames.ground,
        accumulation=accumulation,
        classes=classes,
        read_classes=lambda: labels()[1],
        frames_version=str(simulation.frames_version()),
    )


def pose_of(scene: Mapping[str, Any]) -> kitti.WorldPose:
    """Returns the pose of a scene's only mount."""
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
    """Returns boxes (k, 7) and class numbers (k,) of a simulated frame, as `hit_boxes` does."""
    hit = hit_vehicles(frame, label_time, classes)
    return hit.boxes, numbers_of(hit.names, classes)


def hit_vehicles(
    frame: simulation.Frame, label_time: LabelTime, classes: tuple[ObjectClass, ...] = VEHICLES
) -> Vehicles:
    """Returns the objects of `classes` with at least one point in a simulated frame."""
    vehicles = vehicles_of(frame.objects, 0, label_time)
    return vehicles.select((numbers_of(vehicles.names, classes) >= 0) & (vehicles.points > 0))
