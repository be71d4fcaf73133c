"""Strict readers for the files of two toolboxes, written from their public descriptions.

OpenPCDet: docs/CUSTOM_DATASET_TUTORIAL.md, with its rules for ranges. MMDetection3D:
docs/en/advanced_guides/customize_dataset.md. The position of its LiDAR boxes is the bottom centre.
"""

import pickle
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

CLASSES = ("Vehicle", "Pedestrian", "Cyclist")


@dataclass(frozen=True)
class Read:
    points: np.ndarray  # (n, 4)
    names: list[str]
    boxes: np.ndarray  # (k, 7), x y z of the centre
    counts: list[int]  # number of points of each box, if the format has it


def listed(folder: Path, part: str) -> list[str]:
    names = (folder / f"ImageSets/{part}.txt").read_text().splitlines()
    assert all(re.fullmatch(r"\d{6}", name) for name in names)
    assert len(set(names)) == len(names)
    return names


def openpcdet(folder: Path, name: str) -> Read:
    points = np.load(folder / f"points/{name}.npy")
    assert points.dtype == np.float32
    assert points.ndim == 2
    assert points.shape[1] == 4
    rows = [
        line.strip().split(" ") for line in (folder / f"labels/{name}.txt").read_text().splitlines()
    ]
    assert all(len(row) == 8 and row[7] in CLASSES for row in rows)
    boxes = np.array([row[:7] for row in rows], dtype=np.float64).reshape(-1, 7)
    assert (boxes[:, 3:6] > 0).all()
    return Read(points, [row[7] for row in rows], boxes, [])


def openpcdet_config(folder: Path, model: str) -> dict[str, Any]:
    """Returns a model's configuration merged with its base file, as `cfg_from_yaml_file` does."""
    config = yaml.safe_load((folder / f"cfgs/custom_models/{model}.yaml").read_text())
    base = config["DATA_CONFIG"].pop("_BASE_CONFIG_")
    data = yaml.safe_load((folder / base).read_text())
    config["DATA_CONFIG"] = data | config["DATA_CONFIG"]
    return dict(config)


def grid_of(config: dict[str, Any]) -> np.ndarray:
    """Returns the number of voxels along x, y and z, which must be whole numbers."""
    area = np.array(config["DATA_CONFIG"]["POINT_CLOUD_RANGE"])
    (voxel,) = (
        step["VOXEL_SIZE"]
        for step in config["DATA_CONFIG"]["DATA_PROCESSOR"]
        if "VOXEL_SIZE" in step
    )
    cells = (area[3:] - area[:3]) / np.array(voxel)
    assert np.allclose(cells, cells.round(), atol=1e-6)
    return cells.round().astype(int)


def mmdet3d(folder: Path, part: str) -> dict[str, Read]:
    """Returns the frames of an info file by name."""
    content = pickle.loads((folder / f"custom_infos_{part}.pkl").read_bytes())
    assert set(content) == {"metainfo", "data_list"}
    classes = content["metainfo"]["classes"]
    assert content["metainfo"]["categories"] == {name: i for i, name in enumerate(classes)}
    out = {}
    for info in content["data_list"]:
        assert info["lidar_points"]["num_pts_feats"] == 4
        path = folder / "points" / info["lidar_points"]["lidar_path"]
        points = np.fromfile(path, dtype=np.float32).reshape(-1, 4)
        boxes = np.array([i["bbox_3d"] for i in info["instances"]], dtype=np.float64).reshape(-1, 7)
        boxes[:, 2] += boxes[:, 5] / 2
        names = [classes[i["bbox_label_3d"]] for i in info["instances"]]
        counts = [i["num_lidar_pts"] for i in info["instances"]]
        assert path.stem == f"{info['sample_idx']:06d}"
        out[path.stem] = Read(points, names, boxes, counts)
    return out
