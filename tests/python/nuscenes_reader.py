"""A strict reader of nuScenes tables, written from the public description of their schema.

It replaces `nuscenes-devkit`, which requires a NumPy below version 2 and therefore can't be
installed with the other packages. The reader checks the keys and types of every row, and every
reference, including prev and next.
"""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from exchange_data import rotation

Row = dict[str, Any]

# Type of each column: `-> table` is a token of that table, `?` may be empty, `*` is a list.
SCHEMA = {
    "attribute": "token:str name:str description:str",
    "calibrated_sensor": "token:str sensor_token:->sensor translation:float3 rotation:float4 "
    "camera_intrinsic:float0",
    "category": "token:str name:str description:str",
    "ego_pose": "token:str translation:float3 rotation:float4 timestamp:int",
    "instance": "token:str category_token:->category nbr_annotations:int "
    "first_annotation_token:->sample_annotation last_annotation_token:->sample_annotation",
    "log": "token:str logfile:str vehicle:str date_captured:str location:str",
    "map": "token:str log_tokens:*->log category:str filename:str",
    "sample": "token:str timestamp:int scene_token:->scene next:?->sample prev:?->sample",
    "sample_annotation": "token:str sample_token:->sample instance_token:->instance "
    "attribute_tokens:*->attribute visibility_token:?->visibility translation:float3 size:float3 "
    "rotation:float4 num_lidar_pts:int num_radar_pts:int next:?->sample_annotation "
    "prev:?->sample_annotation",
    "sample_data": "token:str sample_token:->sample ego_pose_token:->ego_pose "
    "calibrated_sensor_token:->calibrated_sensor filename:str fileformat:str width:int height:int "
    "timestamp:int is_key_frame:bool next:?->sample_data prev:?->sample_data",
    "scene": "token:str name:str description:str log_token:->log nbr_samples:int "
    "first_sample_token:->sample last_sample_token:->sample",
    "sensor": "token:str channel:str modality:str",
    "visibility": "token:str level:str description:str",
}


@dataclass(frozen=True)
class Database:
    root: Path
    tables: dict[str, dict[str, Row]]  # rows of each table, by token

    def rows(self, table: str) -> list[Row]:
        return list(self.tables[table].values())

    def get(self, table: str, token: str) -> Row:
        return self.tables[table][token]

    def annotations(self, sample: Row) -> list[Row]:
        rows = self.rows("sample_annotation")
        return [row for row in rows if row["sample_token"] == sample["token"]]

    def data(self, sample: Row) -> Row:
        (row,) = (r for r in self.rows("sample_data") if r["sample_token"] == sample["token"])
        return row

    def cloud(self, data: Row) -> np.ndarray:
        """Returns the points of a sweep in the sensor frame: (n, 5) x y z intensity ring."""
        return np.fromfile(self.root / data["filename"], dtype="<f4").reshape(-1, 5)

    def poses(self, data: Row) -> list[tuple[np.ndarray, np.ndarray]]:
        """Returns two pairs of rotation and translation: from the sensor to the ego frame, and from
        the ego frame to the global frame."""
        rows = [
            self.get("calibrated_sensor", data["calibrated_sensor_token"]),
            self.get("ego_pose", data["ego_pose_token"]),
        ]
        return [(turn(row["rotation"]), np.array(row["translation"])) for row in rows]

    def to_global(self, xyz: np.ndarray, data: Row) -> np.ndarray:
        for turned, moved in self.poses(data):
            xyz = xyz @ turned.T + moved
        return xyz

    def box_in_sensor(self, annotation: Row, data: Row) -> np.ndarray:
        """Returns an annotation as x y z dx dy dz heading in the sensor frame."""
        centre, axes = np.array(annotation["translation"]), turn(annotation["rotation"])
        for turned, moved in reversed(self.poses(data)):
            centre, axes = turned.T @ (centre - moved), turned.T @ axes
        width, length, height = annotation["size"]
        return np.array([*centre, length, width, height, np.arctan2(axes[1, 0], axes[0, 0])])


def turn(wxyz: list[float]) -> np.ndarray:
    w, x, y, z = wxyz
    return rotation((x, y, z, w))


def read(root: Path, version: str) -> Database:
    """Reads the tables, and asserts that they have the described schema."""
    tables: dict[str, dict[str, Row]] = {}
    for name in SCHEMA:
        rows = json.loads((root / version / f"{name}.json").read_text())
        tables[name] = {row["token"]: row for row in rows}
        assert len(tables[name]) == len(rows), f"{name}: a token twice"
    for name, rows in tables.items():
        columns = dict(word.split(":", 1) for word in SCHEMA[name].split())
        for row in rows.values():
            assert row.keys() == columns.keys(), name
            for column, kind in columns.items():
                check(tables, f"{name}.{column}", kind, row[column])
    for name in ("sample", "sample_data", "sample_annotation"):
        check_chains(tables, name)
    check_ends(tables)
    files = [root / row["filename"] for row in tables["sample_data"].values()]
    assert all(file.is_file() for file in files)
    assert all((root / row["filename"]).is_file() for row in tables["map"].values())
    return Database(root, tables)


def check(tables: dict[str, dict[str, Row]], location: str, kind: str, value: Any) -> None:
    if "->" in kind:
        tokens = value if kind.startswith("*") else [value]
        if not (kind.startswith("?") and value == ""):
            assert all(token in tables[kind.split("->")[1]] for token in tokens), location
    elif kind.startswith("float"):
        assert len(value) == int(kind[5:]), location
        assert all(type(number) is float for number in value), location
    else:
        assert type(value).__name__ == kind, location


def check_chains(tables: dict[str, dict[str, Row]], name: str) -> None:
    """Checks the links of a table. `prev` is the inverse of `next`, time increases, and a chain
    stays in its scene and instance."""
    rows = tables[name]
    for row in rows.values():
        if row["prev"]:
            assert rows[row["prev"]]["next"] == row["token"], name
        if row["next"]:
            after = rows[row["next"]]
            assert after["prev"] == row["token"], name
            first, then = (sample_of(tables, name, r) for r in (row, after))
            assert then["timestamp"] > first["timestamp"], name
            assert then["scene_token"] == first["scene_token"], name
            assert row.get("instance_token") == after.get("instance_token"), name


def sample_of(tables: dict[str, dict[str, Row]], name: str, row: Row) -> Row:
    return row if name == "sample" else tables["sample"][row["sample_token"]]


def check_ends(tables: dict[str, dict[str, Row]]) -> None:
    """Checks the counts of scenes and instances, which must equal the length of the chain from the
    first to the last row."""
    for scene in tables["scene"].values():
        ends = scene["first_sample_token"], scene["last_sample_token"]
        chain = walk(tables["sample"], *ends)
        assert len(chain) == scene["nbr_samples"]
        assert all(row["scene_token"] == scene["token"] for row in chain)
    for instance in tables["instance"].values():
        ends = instance["first_annotation_token"], instance["last_annotation_token"]
        chain = walk(tables["sample_annotation"], *ends)
        assert len(chain) == instance["nbr_annotations"]
        assert all(row["instance_token"] == instance["token"] for row in chain)
    assert sum(s["nbr_samples"] for s in tables["scene"].values()) == len(tables["sample"])
    counts = [i["nbr_annotations"] for i in tables["instance"].values()]
    assert sum(counts) == len(tables["sample_annotation"])


def walk(rows: dict[str, Row], first: str, last: str) -> list[Row]:
    chain = [rows[first]]
    while chain[-1]["next"]:
        chain.append(rows[chain[-1]["next"]])
    assert chain[0]["prev"] == ""
    assert chain[-1]["token"] == last
    return chain
