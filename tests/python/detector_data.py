"""A small artificial road: flat ground, and boxes as vehicles, with points on the sides that the
sensor sees."""

import numpy as np

from pyinfra.core.arrays import FloatArray, Points
from pyinfra.models.detectors.detection_area import Area, Site
from pyinfra.models.detectors.sample import Sample

FLOOR_Z = -6.0
SITE = Site(Area((0.0, -12.8, -7.0), (38.4, 12.8, -1.0)), FLOOR_Z)


def vehicle_points(box: FloatArray, draw: np.random.Generator, count: int = 150) -> Points:
    """Returns `count` points on the roof of a box, and on the faces that the sensor sees: (count,
    4)."""
    local = draw.uniform(-0.5, 0.5, (count, 3))
    face = draw.integers(3, size=count)
    cos, sin = np.cos(box[6]), np.sin(box[6])
    towards = np.array([-(cos * box[0] + sin * box[1]), sin * box[0] - cos * box[1]])
    local[face == 0, 0] = 0.5 * np.sign(towards[0])
    local[face == 1, 1] = 0.5 * np.sign(towards[1])
    local[face == 2, 2] = 0.5
    local *= box[3:6]
    x = cos * local[:, 0] - sin * local[:, 1] + box[0]
    y = sin * local[:, 0] + cos * local[:, 1] + box[1]
    return np.column_stack([x, y, local[:, 2] + box[2], np.full(count, 0.5)]).astype(np.float32)


def road_sample(seed: int, vehicles: int = 4) -> Sample:
    """Returns one frame with vehicles in lanes. Some vehicles are at right angles to their lane. No
    vehicles overlap."""
    draw = np.random.default_rng(seed)
    lanes = draw.permutation(8)[:vehicles] * 3.0 - 10.5
    boxes = np.empty((vehicles, 7))
    for i, y in enumerate(lanes):
        long = i % 3 == 2
        size = (8.5, 2.5, 3.2) if long else (4.3, 1.85, 1.6)
        heading = draw.choice([0.0, np.pi]) + draw.normal(0, 0.05)
        heading = (heading + np.pi) % (2 * np.pi) - np.pi
        boxes[i] = [draw.uniform(8, 32), y, FLOOR_Z + size[2] / 2, *size, heading]
    ground = np.column_stack(
        [draw.uniform(0, 38, 3000), draw.uniform(-12, 12, 3000), np.full(3000, FLOOR_Z)]
    )
    ground = np.column_stack([ground, np.full(3000, 0.2)]).astype(np.float32)
    clouds = [ground, *(vehicle_points(box, draw) for box in boxes)]
    return Sample(np.concatenate(clouds), boxes)
