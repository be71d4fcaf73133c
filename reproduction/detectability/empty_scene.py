"""Computes two measures of a pose that other tools use, from a scene without traffic.

Space is divided into voxels. The probability p of a voxel is the share of frames in which a vehicle
fills it. A beam reaches the voxels between the LiDAR and its return in the empty scene.

- coverage: share of the voxels with p > 0 that a beam reaches
- information: sum of the entropy of p over these voxels, in bits. This is the entropy-guided
  visibility score of Jiang et al. (arXiv 2504.06772), computed by the formula of the paper.

Both measures ignore that vehicles hide each other.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import yaml

from pyinfra.core.arrays import AnyArray, BoolArray, FloatArray
from pyinfra.core.files import write
from pyinfra.core.vocabulary import OBJECT_NAMES, PERSON_TYPES
from pyinfra.dataset.simulation import Lidar
from pyinfra.dataset.world_frame import to_world
from pyinfra.experiments.planner.simulate import frames_at
from pyinfra.experiments.planner.site import PlanSite, open_site

VOXEL_M = (1.0, 1.0, 0.5)
STEP_M = 0.25  # distance between samples of a beam
BEAMS_AT_ONCE = 4096
OCCUPANCY_FRAMES = 400
PEOPLE = ("people", "standing_people")  # keys of a scene that add people
RARE = 1e-3  # vehicles per km and lane in a scene without traffic; the scene requires this key


@dataclass(frozen=True, eq=False)
class Occupancy:
    """Voxels that vehicles fill: a grid with its lowest corner, and the probability of each."""

    corner: FloatArray  # (3,) lowest corner of the grid in the world frame, m
    probability: FloatArray  # (nx, ny, nz) probability that a vehicle fills a voxel

    @cached_property
    def entropy(self) -> FloatArray:
        p = np.clip(self.probability, 1e-12, 1 - 1e-12)
        return np.where(self.probability > 0, -p * np.log2(p) - (1 - p) * np.log2(1 - p), 0.0)


def occupancy(file: Path, frames: int = OCCUPANCY_FRAMES) -> Occupancy:
    """Returns how often the vehicles of a scene fill each voxel of the evaluation region."""
    site = open_site(file, frames)
    rows = site.observer.present([*site.frames])
    person = np.isin([OBJECT_NAMES[int(c)] for c in rows["class_id"]], PERSON_TYPES)
    rows = rows[~person]
    of_boxes = [_inside(row) for row in rows]
    samples = np.concatenate(of_boxes)
    frame = np.repeat(rows["frame"].astype(np.int64), [len(points) for points in of_boxes])
    corner = samples.min(0)
    index = ((samples - corner) / VOXEL_M).astype(np.int64)
    shape = index.max(0) + 1
    flat = np.ravel_multi_index(tuple(index.T), tuple(shape))
    size = int(shape.prod())
    counts = np.bincount(np.unique(frame * size + flat) % size, minlength=size)
    return Occupancy(corner, counts.reshape(shape) / len(site.frames))


def _inside(row: AnyArray) -> FloatArray:
    """Returns a grid of points in a vehicle's box, at most half a voxel apart: (n, 3), world."""
    axes = [
        np.linspace(-row[size] / 2, row[size] / 2, max(2, int(np.ceil(2 * row[size] / voxel)) + 1))
        for size, voxel in zip(("dx", "dy", "dz"), VOXEL_M, strict=True)
    ]
    along, across, up = (a.ravel() for a in np.meshgrid(*axes, indexing="ij"))
    c, s = np.cos(row["heading"]), np.sin(row["heading"])
    x = row["x"] + c * along - s * across
    y = row["y"] + s * along + c * across
    return np.stack([x, y, row["z"] + up], axis=1)


def empty_scene(file: Path) -> Path:
    """Writes the scene without moving objects beside it, if it is missing; returns its path."""
    out = file.with_name(f"{file.stem}_empty.yaml")
    if not out.is_file():
        keys = yaml.safe_load(file.read_text(encoding="utf-8"))
        keys = {name: value for name, value in keys.items() if name not in PEOPLE}
        keys["traffic"]["vehicles_per_km_lane"] = RARE
        write(out, yaml.safe_dump(keys))
    return out


def measures(
    site: PlanSite, empty: Path, filled: Occupancy, pose: FloatArray, lidar: Lidar
) -> tuple[float, float]:
    """Returns coverage (0 to 1) and information (bits) of one frame of a LiDAR at a pose."""
    frames = frames_at(replace(site, file=empty), [*pose], lidar, site.frames[:1])
    points = frames[0].points[:, :3].astype(float)
    to = frames.lidar.T_world_levelled
    ends = np.column_stack([to_world(points[:, :2], to), points[:, 2] + to.z])
    reached = reached_voxels(np.array([to.x, to.y, to.z]), ends, filled)
    used = filled.probability > 0
    return float((reached & used).sum() / used.sum()), float(filled.entropy[reached].sum())


def reached_voxels(start: FloatArray, ends: FloatArray, filled: Occupancy) -> BoolArray:
    """Returns which voxels of the grid the beams from `start` to `ends` (n, 3) pass or hit."""
    reached = np.zeros(filled.probability.shape, bool)
    top = filled.corner[2] + filled.probability.shape[2] * VOXEL_M[2]
    fall = (start[2] - top) / np.maximum(start[2] - ends[:, 2], 1e-9)
    # The share of a beam's length at which the beam comes down to the height of the grid.
    enters = np.clip(fall, 0, 1) if start[2] > top else np.zeros(len(ends))
    length = np.linalg.norm(ends - start, axis=1)
    order = np.argsort((1 - enters) * length)  # a batch has beams that need equally many samples
    for i in range(0, len(ends), BEAMS_AT_ONCE):
        part = order[i : i + BEAMS_AT_ONCE]
        most = float(((1 - enters[part]) * length[part]).max(initial=0))
        steps = np.linspace(0, 1, max(2, int(np.ceil(most / STEP_M)) + 1))
        share = enters[part, None] + (1 - enters[part, None]) * steps
        samples = start + share[:, :, None] * (ends[part] - start)[:, None, :]
        index = np.floor((samples - filled.corner) / VOXEL_M).astype(np.int64).reshape(-1, 3)
        inside = ((index >= 0) & (index < reached.shape)).all(1)
        reached[tuple(index[inside].T)] = True
    return reached
