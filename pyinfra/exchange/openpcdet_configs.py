"""Writes OpenPCDet's configuration files for frames with the road at z = 0.

The networks are those of OpenPCDet's public configurations (pointpillar, pv_rcnn and dsvt of Waymo,
pointrcnn of KITTI). Ranges, voxels, anchors and sizes are derived from the exported vehicles.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from string import Template

import numpy as np

from pyinfra.core.arrays import FloatArray
from pyinfra.core.boxes import CAR_M, LONG_M, footprints
from pyinfra.core.files import write
from pyinfra.formats import kitti

MODELS = ("pointpillars", "pointrcnn", "pv_rcnn", "dsvt")
TEMPLATES = Path(__file__).parent / "openpcdet_models"

PILLAR_M = 0.32
VOXEL_M = 0.1
CELLS = 16  # side lengths of a grid are multiples of this number of cells
LAYERS = 40  # number of voxel layers in z
LOW_Z_M, HIGH_Z_M = -2.0, 4.0  # minimum z range of the grid, relative to the road
MARGIN_M = 0.5  # vertical margin above and below the vehicles
AROUND_M = 2.0  # horizontal margin around the vehicles
# Margin beyond the LiDAR's range, because the centre of a vehicle can be farther than its near end.
BEYOND_M = 12.0

# Vehicles longer than this have a separate anchor, because the IoU of a bus with a car's anchor is
# too low.
LONG_FROM_M = 6.0


@dataclass(frozen=True)
class Box:
    """An axis-parallel box given by two corners x y z, in metres, with z above the road."""

    low: tuple[float, float, float]
    high: tuple[float, float, float]

    def on_grid(self, cell_m: float) -> Box:
        """Returns the box enlarged in x and y to multiples of CELLS cells, aligned to the cells."""
        low, high = list(self.low), list(self.high)
        for i in range(2):
            first = math.floor(self.low[i] / cell_m + 1e-9)
            count = math.ceil(self.high[i] / cell_m - 1e-9) - first
            count = CELLS * math.ceil(count / CELLS)
            low[i], high[i] = first * cell_m, (first + count) * cell_m
        return Box((low[0], low[1], low[2]), (high[0], high[1], high[2]))

    def cells(self, cell_m: float) -> list[int]:
        """Returns the number of cells in x and y."""
        return [round((self.high[i] - self.low[i]) / cell_m) for i in range(2)]


def area_of(vehicles: FloatArray, reach_m: float) -> Box:
    """Returns the box that contains the vehicles (m, 7), limited by the LiDAR's range."""
    corners, farthest = footprints(vehicles), reach_m + BEYOND_M
    low = np.maximum(corners.min(axis=(0, 1)) - AROUND_M, -farthest)
    high = np.minimum(corners.max(axis=(0, 1)) + AROUND_M, farthest)
    bottom = (vehicles[:, 2] - vehicles[:, 5] / 2).min() - MARGIN_M
    top = (vehicles[:, 2] + vehicles[:, 5] / 2).max() + MARGIN_M
    return Box(
        (float(low[0]), float(low[1]), min(LOW_Z_M, math.floor(bottom))),
        (float(high[0]), float(high[1]), max(HIGH_Z_M, math.ceil(top))),
    )


def sizes_of(vehicles: FloatArray) -> list[list[float]]:
    """Returns mean length, width and height of the short and of the long vehicles (m, 7)."""
    long = vehicles[:, 3] > LONG_FROM_M
    return [
        [round(float(v), 2) for v in vehicles[mask, 3:6].mean(axis=0)] if mask.any() else usual
        for mask, usual in ((~long, list(CAR_M)), (long, list(LONG_M)))
    ]


def values(vehicles: FloatArray, reach_m: float) -> dict[str, str]:
    """Returns the values of the placeholders in the templates. reach_m: range of the LiDAR."""
    area = area_of(vehicles, reach_m)
    pillars, voxels = area.on_grid(PILLAR_M), area.on_grid(VOXEL_M)
    height = area.high[2] - area.low[2]
    sizes = sizes_of(vehicles)
    grid = pillars.cells(PILLAR_M)
    return {
        "pillar_range": _numbers([*pillars.low, *pillars.high]),
        "voxel_range": _numbers([*voxels.low, *voxels.high]),
        "pillar": _numbers([PILLAR_M, PILLAR_M, height]),
        "voxel": _numbers([VOXEL_M, VOXEL_M, height / LAYERS]),
        "grid": str(grid),
        "grid_3d": str([*grid, 1]),
        "anchors": f"[{_numbers(sizes[0])}, {_numbers(sizes[1])}]",
        "mean_size": f"[{_numbers(vehicles[:, 3:6].mean(axis=0).round(2).tolist())}]",
    }


def write_configs(out: Path, vehicles: FloatArray, lidar: kitti.Lidar) -> None:
    """Writes the folder `cfgs` for OpenPCDet/tools, and a README with the commands."""
    reach = max(unit.range_m[1] for unit in lidar.field_of_view)
    placeholders = values(vehicles, reach)
    folders = {"custom_dataset": "cfgs/dataset_configs"}
    folders |= dict.fromkeys(MODELS, "cfgs/custom_models")
    for name, folder in folders.items():
        text = (TEMPLATES / f"{name}.yaml").read_text(encoding="utf-8")
        (out / folder).mkdir(parents=True, exist_ok=True)
        write(out / folder / f"{name}.yaml", Template(text).substitute(placeholders))
    write(out / "README.md", (TEMPLATES / "README.md").read_bytes())


def _numbers(numbers: list[float]) -> str:
    return "[" + ", ".join(f"{round(value, 4):g}" for value in numbers) + "]"
