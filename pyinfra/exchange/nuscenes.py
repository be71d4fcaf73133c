"""Writes the tables of nuScenes for `nuscenes-devkit` and tools that use the devkit.

    v1.0-infrasim/*.json           thirteen tables whose rows refer to each other by `token`
    v1.0-infrasim/splits.json      scenes of infrasim_train, infrasim_val and infrasim_all
    samples/LIDAR_TOP/*.pcd.bin    float32 x y z intensity ring
    maps/none.png                  an empty mask, because the devkit needs a file
The files follow the public description of the schema (docs/schema_nuscenes.md of the devkit):
- Every frame is a sample. The frames of ImageSets/train.txt form a scene, the frames of val.txt a
  second scene, and the remaining frames a third scene. An object in two scenes is two instances.
  Timestamps are microseconds since the start of the run, at mid-frame.
- Splits have the prefix `infrasim_`, because the devkit reserves `train` and `val` for nuScenes.
- The global frame is the world frame. The ego is on the plane z = 0 of the world, below the sensor,
  with the sensor's yaw. The frame of LIDAR_TOP is the levelled LiDAR frame, x forward.
- Intensity is 0 to 255. The ring is -1 if the folder has no `fields`.
- Annotations are all objects within range. They include objects without points, which the devkit's
  evaluation ignores. `num_lidar_pts` is `points_in_box` of the objects. An unknown visibility is an
  empty token.
- Classes have nuScenes names. For example, a Van is a vehicle.car. Unknown classes keep their
  names.
"""

import json
import uuid
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import matplotlib.image
import numpy as np

from pyinfra.core.errors import FormatError
from pyinfra.core.files import replacing, write
from pyinfra.dataset.frames import frame_numbers
from pyinfra.dataset.world_frame import boxes_to_world
from pyinfra.exchange.series import FrameSeries, StoredFrame, quaternion, read_frames, read_series

Row = dict[str, Any]
Add = Callable[[Row], None]  # adds a row to a table
VERSION = "v1.0-infrasim"
CHANNEL = "LIDAR_TOP"  # the only LiDAR name that the devkit of nuScenes accepts
MAX_INTENSITY = 255
STILL_MPS = 0.2  # highest speed of a standing object
# Name of an additional table for values of annotations that the nuScenes schema does not contain.
OWN = "infrasim"
TABLES = (
    "attribute calibrated_sensor category ego_pose instance log map sample sample_annotation "
    f"sample_data scene sensor visibility {OWN}"
).split()
# Lower bound of the visible share at each visibility level.
VISIBILITY = {"v0-40": 0.0, "v40-60": 0.4, "v60-80": 0.6, "v80-100": 0.8}


@dataclass(frozen=True)
class Category:
    """The nuScenes name of a class, and the attributes of moving and of standing objects."""

    name: str
    moving: str | None = None
    standing: str | None = None


_DRIVES = ("vehicle.moving", "vehicle.stopped")
_RIDDEN = ("cycle.with_rider", "cycle.with_rider")
_WALKS = ("pedestrian.moving", "pedestrian.standing")
CATEGORIES = {
    "Car": Category("vehicle.car", *_DRIVES),
    "Van": Category("vehicle.car", *_DRIVES),
    "Truck": Category("vehicle.truck", *_DRIVES),
    "Bus": Category("vehicle.bus.rigid", *_DRIVES),
    "Motorcycle": Category("vehicle.motorcycle", *_RIDDEN),
    "Cyclist": Category("vehicle.bicycle", *_RIDDEN),
    "Pedestrian": Category("human.pedestrian.adult", *_WALKS),
}


def export(lidar_folder: Path, frames: Sequence[int], out: Path) -> None:
    """Writes the tables, clouds and the mask to the folder `out`.

    The function keeps only one frame and the last annotation of each object in memory. Raises
    FileNotFoundError for an incomplete frame, and FormatError. `frames` must not be empty.
    """
    series = read_series(lidar_folder)
    for folder in (VERSION, f"samples/{CHANNEL}", "maps"):
        (out / folder).mkdir(parents=True)
    matplotlib.image.imsave(out / "maps/none.png", np.zeros((1, 1)), cmap="gray")
    # Iterating over `frames` may show a progress bar, which only the loop below needs. Iterating
    # over `frames[:]` shows no progress bar.
    parts = parts_of(lidar_folder, frames[:])
    with ExitStack() as stack:
        files = {name: out / VERSION / f"{name}.json" for name in TABLES}
        add = {name: stack.enter_context(_table(file)) for name, file in files.items()}
        common = _Common(series, add)
        common.add_sensor()
        common.add_levels()
        scenes = [_Scene(common, part, numbers) for part, numbers in parts.items()]
        scene_of = {number: scene for scene in scenes for number in scene.frames}
        for frame in read_frames(series, frames):
            scene_of[frame.number].add_sample(frame)
            scene_of[frame.number].add_annotations(frame)
            _write_cloud(out / common.cloud_name(frame.number), frame)
        for scene in scenes:
            scene.close()
        common.add_names("category", common.categories)
    splits = {f"infrasim_{scene.part}": [scene.name] for scene in scenes}
    write(out / VERSION / "splits.json", json.dumps(splits))


def parts_of(lidar_folder: Path, frames: Sequence[int]) -> dict[str, list[int]]:
    """Returns the frames of `train` and `val` in ImageSets, and the remaining frames as `all`.

    nuScenes splits by scene, so each part becomes one scene. Raises FormatError for a frame that is
    in both lists.
    """
    listed = {part: lidar_folder / f"ImageSets/{part}.txt" for part in ("train", "val")}
    existing = [part for part, file in listed.items() if file.is_file()]
    numbers = {part: frame_numbers(lidar_folder, part) for part in existing}
    in_both = set(numbers.get("train", ())) & set(numbers.get("val", ()))
    if in_both:
        raise FormatError(
            f"{listed['val']}: expected frames that are not in train.txt, got frame {min(in_both)}"
        )
    parts = {part: sorted(set(frames) & set(members)) for part, members in numbers.items()}
    parts["all"] = sorted(set(frames).difference(*numbers.values()))
    return {part: members for part, members in parts.items() if members}


@contextmanager
def _table(file: Path) -> Iterator[Add]:
    """Opens a JSON file for writing and yields a function that appends a row to its list."""
    with replacing(file) as beside, beside.open("w", encoding="utf-8") as stream:
        before = "[\n"

        def add(row: Row) -> None:
            nonlocal before
            stream.write(before + json.dumps(row, allow_nan=False))
            before = ",\n"

        yield add
        stream.write("[]\n" if before == "[\n" else "\n]\n")


class _Common:
    """Writes the rows that all scenes share, such as sensor, map, visibility and category."""

    def __init__(self, series: FrameSeries, add: dict[str, Add]) -> None:
        self.series, self.add = series, add
        self.name = f"{series.scene}-{series.lidar}"
        self.categories: set[str] = set()

    def token(self, kind: str, key: object) -> str:
        """Returns a token of 32 hexadecimal digits that depends only on series, kind and key."""
        name = [self.name, *self.series.provenance.values(), kind, str(key)]
        return uuid.uuid5(uuid.NAMESPACE_URL, "/".join(name)).hex

    def cloud_name(self, frame: int) -> str:
        return f"samples/{CHANNEL}/{self.name}__{CHANNEL}__{frame:06d}.pcd.bin"

    def add_sensor(self) -> None:
        series, token = self.series, self.token
        sensor = {"token": token("sensor", CHANNEL), "channel": CHANNEL, "modality": "lidar"}
        self.add["sensor"](sensor)
        self.add["calibrated_sensor"](
            {
                "token": token("calibrated_sensor", CHANNEL),
                "sensor_token": sensor["token"],
                "translation": [0.0, 0.0, series.T_world_lidar.z],
                "rotation": [1.0, 0.0, 0.0, 0.0],
                "camera_intrinsic": [],
            }
        )
        log = {
            "token": token("log", ""),
            "logfile": series.lidar_folder.name,
            "vehicle": series.lidar,
            "date_captured": "1970-01-01",  # simulated time has no date
            "location": series.scene,
        }
        self.add["log"](log)
        self.add["map"](
            {
                "token": token("map", ""),
                "log_tokens": [log["token"]],
                "category": "semantic_prior",
                "filename": "maps/none.png",
            }
        )

    def add_levels(self) -> None:
        """Writes all visibility levels and attributes, even if no annotation uses them."""
        for number, (level, least) in enumerate(VISIBILITY.items(), start=1):
            text = f"visible from {least:.0%} on"
            self.add["visibility"]({"token": str(number), "level": level, "description": text})
        self.add_names("attribute", {*_DRIVES, *_RIDDEN, *_WALKS})

    def add_names(self, kind: str, names: set[str]) -> None:
        """Writes a row for each name of an attribute or category."""
        for name in sorted(names):
            self.add[kind]({"token": self.token(kind, name), "name": name, "description": ""})

    def attributes(self, category: Category, speed: float) -> list[str]:
        """Returns the attribute tokens; an empty list for an unknown speed or class."""
        name = category.moving if speed > STILL_MPS else category.standing
        return [] if name is None or np.isnan(speed) else [self.token("attribute", name)]


class _Scene:
    """Writes the samples and annotations of a scene, linked to their neighbours in time."""

    def __init__(self, common: _Common, part: str, frames: list[int]) -> None:
        self.common, self.part, self.frames, self.add = common, part, frames, common.add
        self.name = f"{common.name}-{part}"
        self.following = dict(pairwise(frames))
        self.preceding = dict(pairwise(reversed(frames)))
        self.last: dict[int, Row] = {}  # latest annotation of each object, not yet written
        self.instances: dict[int, Row] = {}

    def token(self, kind: str, key: object) -> str:
        """Returns the token of a key in this scene, or an empty text if the key is None."""
        return "" if key is None else self.common.token(kind, f"{self.part}/{key}")

    def add_sample(self, frame: StoredFrame) -> None:
        time_us = round(frame.middle_s * 1e6)
        pose = self.common.series.T_world_lidar
        sample = self.neighbours("sample", frame.number)
        sample |= {"timestamp": time_us, "scene_token": self.token("scene", "")}
        self.add["sample"](sample)
        ego_pose = {
            "token": self.token("ego_pose", frame.number),
            "timestamp": time_us,
            "translation": [pose.x, pose.y, 0.0],
            "rotation": _wxyz(pose.yaw),
        }
        self.add["ego_pose"](ego_pose)
        self.add["sample_data"](
            self.neighbours("sample_data", frame.number)
            | {
                "sample_token": sample["token"],
                "ego_pose_token": ego_pose["token"],
                "calibrated_sensor_token": self.common.token("calibrated_sensor", CHANNEL),
                "filename": self.common.cloud_name(frame.number),
                "fileformat": "pcd",
                "width": 0,
                "height": 0,
                "timestamp": time_us,
                "is_key_frame": True,
            }
        )

    def neighbours(self, kind: str, frame: int) -> Row:
        return {
            "token": self.token(kind, frame),
            "next": self.token(kind, self.following.get(frame)),
            "prev": self.token(kind, self.preceding.get(frame)),
        }

    def add_annotations(self, frame: StoredFrame) -> None:
        o = frame.objects
        world = boxes_to_world(o.boxes, self.common.series.T_world_lidar)
        for i, number in enumerate(o.ids.tolist()):
            category = CATEGORIES.get(o.names[i], Category(str(o.names[i])))
            row = {
                "token": self.token("sample_annotation", f"{frame.number}/{number}"),
                "sample_token": self.token("sample", frame.number),
                "instance_token": self.token("instance", number),
                "attribute_tokens": self.common.attributes(category, o.speed[i]),
                "visibility_token": visibility_token(o.visibility[i]),
                "translation": world[i, :3].tolist(),
                "size": [o.boxes[i, 4], o.boxes[i, 3], o.boxes[i, 5]],
                "rotation": _wxyz(world[i, 6]),
                "num_lidar_pts": int(o.points_in_box[i]),
                "num_radar_pts": 0,
                "prev": "",
                "next": "",
            }
            share = round(float(o.visibility[i]), 4)
            self.add[OWN]({"token": row["token"], "type": str(o.names[i]), "visibility": share})
            self.chain(number, row)
            self.count(number, row, category)

    def chain(self, number: int, row: Row) -> None:
        """Links an annotation to the object's previous annotation, which is then written."""
        last = self.last.get(number)
        if last is not None:
            row["prev"], last["next"] = last["token"], row["token"]
            self.add["sample_annotation"](last)
        self.last[number] = row

    def count(self, number: int, row: Row, category: Category) -> None:
        new = {
            "token": row["instance_token"],
            "category_token": self.common.token("category", category.name),
            "nbr_annotations": 0,
            "first_annotation_token": row["token"],
        }
        instance = self.instances.setdefault(number, new)
        instance["nbr_annotations"] += 1
        instance["last_annotation_token"] = row["token"]
        self.common.categories.add(category.name)

    def close(self) -> None:
        """Writes the last annotations, the instances and the scene, after the last frame."""
        for row in self.last.values():
            self.add["sample_annotation"](row)
        for row in self.instances.values():
            self.add["instance"](row)
        provenance = self.common.series.provenance
        self.add["scene"](
            {
                "token": self.token("scene", ""),
                "name": self.name,
                "description": ", ".join(f"{key} {value}" for key, value in provenance.items()),
                "log_token": self.common.token("log", ""),
                "nbr_samples": len(self.frames),
                "first_sample_token": self.token("sample", self.frames[0]),
                "last_sample_token": self.token("sample", self.frames[-1]),
            }
        )


def visibility_token(visibility: float) -> str:
    """Returns the token of the level of a visible share in [0, 1]; empty for -1 (unknown)."""
    levels = sum(visibility >= least for least in VISIBILITY.values())
    return str(levels) if levels else ""


def _wxyz(yaw: float) -> list[float]:
    x, y, z, w = quaternion(yaw)
    return [w, x, y, z]


def _write_cloud(file: Path, frame: StoredFrame) -> None:
    cloud = np.full((len(frame.points), 5), -1, dtype="<f4")
    cloud[:, :4] = frame.points * np.array([1, 1, 1, MAX_INTENSITY], dtype=np.float32)
    if frame.fields is not None:
        cloud[:, 4] = frame.fields["ring"]
    write(file, cloud.tobytes())
