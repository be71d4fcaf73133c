"""Reads the key frames of one LiDAR of a nuScenes data set: JSON tables and .pcd.bin clouds.

The reader follows the public schema of nuScenes (version 1.0). Boxes are transformed from the
global frame to the levelled LiDAR frame. Points of a tilted LiDAR are rotated to the levelled
frame.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from pyinfra.core.arrays import FloatArray
from pyinfra.core.errors import Error, FormatError
from pyinfra.exchange.json_boxes import checked_box, read_json, shown
from pyinfra.exchange.recording import Boxes, Options, RecordedFrame, Recording, read_bin, selected
from pyinfra.formats.kitti import WorldPose

COLUMNS = 5  # number of values per point: x y z intensity ring
INTENSITY_MAX = 255.0
# Assumed visible share of each level: for levels 2 to 4, the middle of the level's range. For level
# 1 (0 to 40 %), the share is so low that the object does not count as visible.
VISIBILITY = {"1": 0.1, "2": 0.5, "3": 0.7, "4": 0.9}
OWN = "infrasim"  # name of an additional table in exports of this package (nuscenes.py)
STILL_M = 0.5  # largest distance between the positions of a LiDAR that does not move
NEEDED = (
    *("sample", "sample_data", "calibrated_sensor", "sensor", "ego_pose"),
    *("sample_annotation", "instance", "category"),
)
Row = dict[str, Any]


def read(source: Path, options: Options) -> Recording:
    """Opens a folder with the tables, or with exactly one subfolder that has them.

    Frames are in order of time. Raises FileNotFoundError, and FormatError with the table and row.
    Raises Error if there are several LiDARs and `options.channel` does not select one of them.
    """
    tables = Tables(_table_folder(source))
    rows = _key_frames(tables, _sensor(tables, options.channel))
    poses = [_pose(tables, row) for row in rows]
    files = [Path(tables.cell("sample_data", row, "filename")) for row in rows]
    annotations: dict[str, list[Row]] = {}
    for row in tables.rows("sample_annotation"):
        annotations.setdefault(tables.cell("sample_annotation", row, "sample_token"), []).append(
            row
        )

    def frame(i: int) -> RecordedFrame:
        points = read_bin(source / files[i], COLUMNS, options, INTENSITY_MAX)
        if not np.allclose(poses[i].leaning, np.eye(3), atol=1e-9):
            points = points.copy()
            points[:, :3] = points[:, :3] @ poses[i].leaning.T.astype(np.float32)
        annotation_rows = annotations.get(tables.cell("sample_data", rows[i], "sample_token"), [])
        return RecordedFrame(points, _boxes(tables, annotation_rows, poses[i]))

    x, y, z = (float(value) for value in poses[0].origin)
    times = np.array([tables.numbers("sample_data", row, "timestamp", ()) for row in rows]) / 1e6
    names = tuple(file.name.split(".")[0] for file in files)
    return Recording(
        names=names,
        read=frame,
        labelled=len(annotations) > 0,
        pose=WorldPose(x, y, z, poses[0].yaw),
        tilt=poses[0].tilt,
        tracks_sha256=sha256("\n".join(tables.instances).encode()).hexdigest()[:16],
        splits=_splits(tables, rows, names),
        times=lambda: times,
        notes=lambda: _motion(poses),
        reads=(tables.folder, source / "maps", *(source / file for file in files)),
    )


def _motion(poses: list[Pose]) -> list[str]:
    """Returns a note if the LiDAR moves."""
    origins = np.array([pose.origin for pose in poses])
    away = float(np.linalg.norm(origins - origins[0], axis=1).max())
    if away <= STILL_M:
        return []
    return [
        f"the LiDAR moves by up to {away:.1f} m, as on a vehicle: boxes are right in each frame, "
        "but positions in the world, such as tracks, use the pose of the first frame"
    ]


class Tables:
    """The JSON tables of a folder, with rows by token. Errors name the table, row and key."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.tables = {name: self._read(name) for name in NEEDED}
        # type and exact visibility of annotations, in exports of this package
        self.own = self._read(OWN) if self._file(OWN).is_file() else {}
        self.instances = {token: i for i, token in enumerate(self.tables["instance"])}

    def rows(self, table: str) -> list[Row]:
        return list(self.tables[table].values())

    def row(self, table: str, token: object) -> Row:
        record = self.tables[table].get(str(token))
        if record is None:
            raise FormatError(f"{self._file(table)}: expected a row with token '{token}', got none")
        return record

    def cell(self, table: str, row: Row, key: str) -> str:
        if key not in row:
            token = row.get("token")
            raise FormatError(
                f"{self._file(table)}: row '{token}': expected the key '{key}', got none"
            )
        return str(row[key])

    def numbers(self, table: str, row: Row, key: str, shape: int | tuple[()]) -> FloatArray:
        """Returns the value of `key` in a row as an array of finite numbers with this shape.

        Shape () means a single number.
        """
        raw = row.get(key)
        want = (shape,) if isinstance(shape, int) else shape
        try:
            values = np.array(raw, dtype=np.float64)
        except (TypeError, ValueError, OverflowError):
            values = np.empty(0)
        if values.shape != want or not np.isfinite(values).all():
            location = f"{self._file(table)}: row '{row.get('token')}': {key}"
            wanted = f"finite numbers of shape {want}" if want else "a finite number"
            raise FormatError(f"{location}: expected {wanted}, got {raw}")
        return values

    def _file(self, table: str) -> Path:
        return self.folder / f"{table}.json"

    def _read(self, table: str) -> dict[str, Row]:
        file = self._file(table)
        rows = read_json(file)
        if not isinstance(rows, list) or not all(
            isinstance(row, dict) and "token" in row for row in rows
        ):
            got = shown(rows)
            raise FormatError(f"{file}: expected a list of rows with the key 'token', got {got}")
        by_token = {str(row["token"]): row for row in rows}
        if len(by_token) < len(rows):
            counts = Counter(str(row["token"]) for row in rows)
            raise FormatError(
                f"{file}: expected each token once, got {counts.most_common(1)[0][0]} twice"
            )
        return by_token


@dataclass(frozen=True, eq=False)
class Pose:
    """The pose of a LiDAR in the global frame, in metres and radians."""

    origin: FloatArray  # position (3,), metres
    yaw: float
    tilt: tuple[float, float]  # pitch and roll, radians
    leaning: FloatArray  # rotation (3, 3) from the sensor frame to the levelled frame


def _table_folder(source: Path) -> Path:
    folders = [
        f.parent for f in (source / "sample.json", *source.glob("*/sample.json")) if f.is_file()
    ]
    if len(folders) != 1:
        names = ", ".join(folder.name for folder in folders) or "none"
        raise Error(f"{source}: expected one folder with a sample.json, got the folders {names}")
    return folders[0]


def _sensor(tables: Tables, channel: str | None) -> str:
    """Returns the token of the selected LiDAR. Raises Error unless exactly one LiDAR fits."""
    lidars = [row for row in tables.rows("sensor") if row.get("modality") == "lidar"]
    names = [str(row.get("channel")) for row in lidars]
    return str(lidars[selected(tables.folder, names, channel)]["token"])


def _key_frames(tables: Tables, sensor: str) -> list[Row]:
    """Returns the key frames of a sensor, as rows of sample_data sorted by time."""
    rows = []
    for row in tables.rows("sample_data"):
        token = tables.cell("sample_data", row, "calibrated_sensor_token")
        mount = tables.row("calibrated_sensor", token)
        if row.get("is_key_frame") and mount.get("sensor_token") == sensor:
            rows.append(row)
    if not rows:
        raise Error(f"{tables.folder}: expected a key frame of the LiDAR, got none")
    for row in rows:
        name = Path(tables.cell("sample_data", row, "filename"))
        if name.is_absolute() or ".." in name.parts or "\0" in str(name):
            raise FormatError(
                f"{tables.folder}/sample_data.json: expected a file inside the folder, got '{name}'"
            )
    return sorted(rows, key=lambda row: float(tables.numbers("sample_data", row, "timestamp", ())))


def _pose(tables: Tables, row: Row) -> Pose:
    ego = tables.row("ego_pose", row.get("ego_pose_token"))
    mount = tables.row("calibrated_sensor", row["calibrated_sensor_token"])
    R_global_ego = _rotation(tables, "ego_pose", ego)
    turn = R_global_ego @ _rotation(tables, "calibrated_sensor", mount)
    origin = tables.numbers("ego_pose", ego, "translation", 3)
    origin = origin + R_global_ego @ tables.numbers("calibrated_sensor", mount, "translation", 3)
    yaw, pitch, roll = angles_of(turn)
    leaning = Rotation.from_euler("ZYX", [0, pitch, roll]).as_matrix()
    return Pose(origin, yaw, (pitch, roll), leaning)


def angles_of(turn: FloatArray) -> tuple[float, float, float]:
    """Returns yaw, pitch and roll of a rotation (3, 3). Roll is 0 if x points up or down."""
    flat = math.hypot(turn[0, 0], turn[1, 0])
    pitch = math.atan2(-turn[2, 0], flat)
    if flat < 1e-6:
        return math.atan2(-turn[0, 1], turn[1, 1]), pitch, 0.0
    return math.atan2(turn[1, 0], turn[0, 0]), pitch, math.atan2(turn[2, 1], turn[2, 2])


def _rotation(tables: Tables, table: str, row: Row) -> FloatArray:
    """Returns the rotation (3, 3) of a row's quaternion w x y z."""
    w, x, y, z = tables.numbers(table, row, "rotation", 4)
    if not 0.9 <= math.hypot(w, x, y, z) <= 1.1:
        location = f"{tables.folder / table}.json: row '{row['token']}': rotation"
        raise FormatError(f"{location}: expected a quaternion of length 1, got {row['rotation']}")
    return np.asarray(Rotation.from_quat([x, y, z, w]).as_matrix(), dtype=np.float64)


def _share(location: str, raw: object) -> float:
    if not isinstance(raw, (int, float)) or not (raw == -1 or 0 <= raw <= 1):
        raise FormatError(f"{location}: visibility: expected 0 to 1, or -1, got {raw}")
    return float(raw)


def _splits(tables: Tables, rows: list[Row], names: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """Returns the frames of train and val as listed in splits.json, which may be missing.

    The file maps names such as `infrasim_train` to names of scenes.
    """
    files = [tables.folder / f"{name}.json" for name in ("splits", "scene")]
    if not all(file.is_file() for file in files):
        return {}
    splits, scenes = (read_json(file) for file in files)
    if not isinstance(splits, dict) or not isinstance(scenes, list):
        got = shown(splits)
        raise FormatError(f"{files[0]}: expected lists of scene names by split, got {got}")
    scene_names = {s.get("token"): s.get("name") for s in scenes if isinstance(s, dict)}
    samples = [tables.row("sample", row.get("sample_token")) for row in rows]
    of_frame = [scene_names.get(sample.get("scene_token")) for sample in samples]
    out = {}
    for part in ("train", "val"):
        listed = [s for key, s in splits.items() if key.split("_")[-1] == part]
        inside = [isinstance(s, list) and scene in s for s in listed for scene in of_frame]
        out[part] = tuple(n for n, i in zip(names, inside, strict=False) if i)
    return out if all(out.values()) else {}


def _boxes(tables: Tables, rows: list[Row], pose: Pose) -> Boxes:
    """Converts global boxes with sizes width length height to the levelled LiDAR frame."""
    table = "sample_annotation"
    names, boxes, ids, visibility = [], [], [], []
    instances: set[str] = set()
    back = Rotation.from_euler("Z", -pose.yaw).as_matrix()
    for row in rows:
        instance = tables.row("instance", row.get("instance_token"))
        category = tables.row("category", instance.get("category_token"))
        names.append(tables.cell("category", category, "name"))
        location = f"{tables.folder / table}.json: row '{row['token']}'"
        if str(instance["token"]) in instances:
            raise FormatError(
                f"{location}: expected each instance_token once in a sample, got "
                f"'{instance['token']}' twice"
            )
        instances.add(str(instance["token"]))
        centre = back @ (tables.numbers(table, row, "translation", 3) - pose.origin)
        width, length, height = tables.numbers(table, row, "size", 3)
        ahead = back @ _rotation(tables, table, row)[:, 0]
        heading = np.arctan2(ahead[1], ahead[0])
        boxes.append(checked_box(location, np.array([*centre, length, width, height, heading])))
        ids.append(tables.instances[str(instance["token"])])
        visibility.append(VISIBILITY.get(str(row.get("visibility_token")), 1.0))
        if own := tables.own.get(str(row["token"])):
            names[-1] = str(own.get("type", names[-1]))
            where = f"{tables.folder / OWN}.json: row '{row['token']}'"
            visibility[-1] = _share(where, own.get("visibility", visibility[-1]))
    return Boxes(
        np.array(names, dtype=np.str_),
        np.array(boxes, dtype=np.float64).reshape(-1, 7),
        np.array(ids, dtype=np.int64),
        np.array(visibility, dtype=np.float64),
    )


def read_results(file: Path, source: Path, channel: str | None = None) -> dict[int, Boxes]:
    """Reads a result file of nuScenes, and returns the boxes by frame.

    Frames count from 0 in order of time. The visibility of a box is its score. source: folder of
    the tables. Raises FormatError.
    """
    tables, data = Tables(_table_folder(source)), read_json(file)
    rows = _key_frames(tables, _sensor(tables, channel))
    results = data.get("results") if isinstance(data, dict) else None
    if not isinstance(results, dict):
        raise FormatError(
            f"{file}: expected the key 'results' with boxes by sample token, got none"
        )
    tokens = [tables.cell("sample_data", row, "sample_token") for row in rows]
    if unknown := sorted(set(results) - set(tokens)):
        raise FormatError(f"{file}: expected the sample tokens of {source}, got '{unknown[0]}'")
    return {
        i: _results(file, results.get(token, []), _pose(tables, row))
        for i, (token, row) in enumerate(zip(tokens, rows, strict=True))
    }


def _results(file: Path, rows: list[Row], pose: Pose) -> Boxes:
    """Converts the global boxes of a sample to the levelled LiDAR frame. Raises FormatError."""
    back = Rotation.from_euler("Z", -pose.yaw)
    try:
        centres = np.array([row["translation"] for row in rows], float).reshape(-1, 3)
        width, length, height = np.array([row["size"] for row in rows], float).reshape(-1, 3).T
        turns = Rotation.from_quat(
            np.array([np.roll(row["rotation"], -1) for row in rows]).reshape(-1, 4)
        )
        names = np.array([row["detection_name"] for row in rows], np.str_)
        scores = np.array([row["detection_score"] for row in rows], float)
    except (KeyError, TypeError, ValueError) as error:
        raise FormatError(
            f"{file}: a box lacks a value of nuScenes' results, or the value is invalid: {error!r}"
        ) from None
    ahead = (back * turns).apply([1.0, 0, 0]) if rows else np.empty((0, 3))
    centres = back.apply(centres - pose.origin) if rows else centres
    heading = np.arctan2(ahead[:, 1], ahead[:, 0])
    boxes = np.column_stack([centres, length, width, height, heading])
    return Boxes(names, boxes, np.full(len(rows), -1), scores)
