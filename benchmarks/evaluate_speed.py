"""Measures the exactness and speed of the evaluation on one core.

Writes out/evaluation.csv:

    .venv/bin/python benchmarks/evaluate_speed.py
"""

from __future__ import annotations

import argparse
import itertools
import math
import os
import sys
import tempfile
import time
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import process
import shapely

from pyinfra.core import boxes
from pyinfra.core.arrays import FloatArray
from pyinfra.core.version import __version__
from pyinfra.formats import kitti
from pyinfra.metrics import matching
from reproduction import add_out

ROOT = Path(__file__).resolve().parent.parent
Row = tuple[str, float, str]
OBJECTS, PREDICTIONS = 20, 30
LIDAR = """name: "speed"
model: "made up"
preset: "none"
price_total_usd: {low: 1, high: 1}
label_time: frame
period_s: 0.1
T_world_levelled: {x_m: 0, y_m: 0, z_m: 6, yaw_deg: 0}
T_levelled_sensor: {pitch_deg: 0, roll_deg: 0}
field_of_view:
  - {yaw_deg: 0, pitch_deg: 0, azimuth_deg: [-180, 180], elevation_deg: [-30, 15],
     range_m: [0, 200]}
"""


def random_boxes(random: np.random.Generator, n: int) -> FloatArray:
    low = [-3, -3, -1, 0.5, 0.5, 1, -4]
    high = [3, 3, 1, 12, 3, 4, 4]
    return random.uniform(low, high, (n, 7))


def box_pairs(random: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Returns 50,000 random pairs of boxes and 50,000 special pairs.

    The boxes of a special pair are equal, nearly equal or touching, or both boxes lie on a grid.
    """
    a, b = random_boxes(random, 50_000), random_boxes(random, 50_000)
    parts = [(a, b)]
    for share, quarters in itertools.product(
        [(0, 0), (1, 0), (0, 1), (1, 1), (0.5, 0), (1 / 3, 0)], [0, 1, 2, 4]
    ):
        boxes = random_boxes(random, 1250)
        moved = boxes.copy()
        cos, sin = np.cos(boxes[:, 6]), np.sin(boxes[:, 6])
        ahead, left = share[0] * boxes[:, 3], share[1] * boxes[:, 4]
        moved[:, 0] += cos * ahead - sin * left
        moved[:, 1] += sin * ahead + cos * left
        moved[:, 6] += quarters * math.pi / 2
        parts.append((boxes, moved))
    for exponent in range(-16, -3):
        boxes = random_boxes(random, 1000)
        parts.append((boxes, boxes + random.uniform(-1, 1, (1000, 7)) * 10.0**exponent))
    grid = np.round(random_boxes(random, 7000) * 2) / 2
    grid[:, 3:6] = np.maximum(grid[:, 3:6], 0.5)
    grid[:, 6] = np.round(grid[:, 6] / (math.pi / 4)) * (math.pi / 4)
    parts.append((grid, grid[random.permutation(7000)]))
    first, second = zip(*parts, strict=True)
    return np.concatenate(first), np.concatenate(second)


def corners(box: FloatArray) -> FloatArray:
    """Returns the footprint corners (n, 4, 2) of boxes (n, 7)."""
    u = np.array([0.5, 0.5, -0.5, -0.5]) * box[:, 3, None]
    v = np.array([-0.5, 0.5, 0.5, -0.5]) * box[:, 4, None]
    cos, sin = np.cos(box[:, 6, None]), np.sin(box[:, 6, None])
    x, y = box[:, 0, None] + cos * u - sin * v, box[:, 1, None] + sin * u + cos * v
    return np.stack([x, y], axis=2)


def shapely_iou(a: FloatArray, b: FloatArray) -> FloatArray:
    one, two = shapely.polygons(corners(a)), shapely.polygons(corners(b))
    shared = shapely.area(shapely.intersection(one, two))
    return np.asarray(shared / (shapely.area(one) + shapely.area(two) - shared))


def exact_iou(a: FloatArray, b: FloatArray) -> float:
    """Returns the exact IoU of two boxes (7,), by clipping in rational arithmetic.

    The value decides which result is correct if pyinfra's IoU and shapely's IoU differ.
    """
    one, two = (
        [(Fraction(float(x)), Fraction(float(y))) for x, y in corners(box[None])[0]]
        for box in (a, b)
    )
    clipped = list(one)
    for (ax, ay), (bx, by) in itertools.pairwise([*two, two[0]]):
        side = [(bx - ax) * (y - ay) - (by - ay) * (x - ax) for x, y in clipped]
        kept = []
        for k, (x, y) in enumerate(clipped):
            px, py = clipped[k - 1]
            if (side[k - 1] >= 0) != (side[k] >= 0):
                t = side[k - 1] / (side[k - 1] - side[k])
                kept.append((px + t * (x - px), py + t * (y - py)))
            if side[k] >= 0:
                kept.append((x, y))
        clipped = kept
    areas = [
        sum((p[k - 1][0] * p[k][1] - p[k][0] * p[k - 1][1] for k in range(len(p))), Fraction(0)) / 2
        for p in (clipped, one, two)
    ]
    return float(areas[0] / (areas[1] + areas[2] - areas[0]))


def exactness(random: np.random.Generator) -> list[Row]:
    a, b = box_pairs(random)
    ours, theirs = boxes.pair_bev_iou(a, b), shapely_iou(a, b)
    apart = np.flatnonzero(np.abs(ours - theirs) > 1e-9)
    true = np.array([exact_iou(a[i], b[i]) for i in apart])
    agree = np.delete(np.abs(ours - theirs), apart)
    return [
        ("pairs of boxes, random and degenerate", len(a), "pairs"),
        ("IoU: largest difference from shapely where within 1e-9", agree.max(), ""),
        ("IoU: pairs where shapely is more than 1e-9 off", len(apart), "pairs"),
        (
            "IoU: largest error on those, rational arithmetic",
            np.abs(ours[apart] - true).max(initial=0),
            "",
        ),
        ("IoU: largest error of shapely on those", np.abs(theirs[apart] - true).max(initial=0), ""),
    ]


def frame(random: np.random.Generator) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Returns the vehicles of a frame on 8 lanes, predicted boxes, and the scores of the boxes.

    Most predictions are vehicles with added noise.
    """
    n = OBJECTS
    lane = random.integers(0, 8, n)
    x, y = random.uniform(-100, 100, n), 3.5 * lane - 12.25
    z = np.full(n, -5.2)
    truth = np.stack([x, y, z, *(np.full(n, v) for v in (4.5, 1.8, 1.5, 0.0))], axis=1)
    spread = np.array([0.3, 0.15, 0.1, 0.3, 0.1, 0.1, 0.05])
    predicted = (
        np.concatenate([truth, truth])[:PREDICTIONS] + random.normal(size=(PREDICTIONS, 7)) * spread
    )
    background = np.arange(PREDICTIONS) >= 24
    predicted[background, :2] = random.uniform([-100, -14], [100, 14], (int(background.sum()), 2))
    scores = np.where(
        np.arange(PREDICTIONS) < OBJECTS,
        random.uniform(0.2, 1, PREDICTIONS),
        random.uniform(0.1, 0.6, PREDICTIONS),
    )
    return truth, predicted, scores


def write_data_set(folder: Path, frames: int, random: np.random.Generator) -> tuple[Path, Path]:
    """Writes a LiDAR's folder with empty point clouds, and a folder of predictions."""
    lidar, predictions = folder / "speed", folder / "predictions"
    for part in ("velodyne", "objects"):
        (lidar / "training" / part).mkdir(parents=True)
    predictions.mkdir()
    (lidar / "lidar.yaml").write_text(LIDAR)
    rows = "".join(f"road,{s},{s},0,0,0,14\n" for s in range(-100, 101))
    (folder / "roads.csv").write_text(f"road,s,x,y,z,heading,half_width\n{rows}")
    for k in range(frames):
        truth, predicted, scores = frame(random)
        lines = [",".join(kitti.OBJECT_COLUMNS)]
        for i, box in enumerate(truth):
            numbers = ",".join(f"{value:.4f}" for value in box)
            points = int(random.integers(0, 50))
            distance = math.hypot(box[0], box[1])
            seen = f"{points},{points},{distance:.4f},0.9000"
            scan = ",".join(f"{value:.4f}" for value in (*box[:3], box[6]))
            lines.append(f"{i},Car,{numbers},15.0000,{seen},{scan},0.0500,{points}")
        kitti.frame_file(lidar, "objects", k).write_text("\n".join(lines) + "\n")
        kitti.frame_file(lidar, "velodyne", k).touch()
        (predictions / f"{k:06d}.txt").write_text("".join(map(result_line, predicted, scores)))
    return lidar, predictions


def result_line(box: FloatArray, score: float) -> str:
    x, y, z, length, width, height, heading = box
    position = f"{-y:.4f} {height / 2 - z:.4f} {x:.4f} {-heading - math.pi / 2:.6f}"
    return f"Car 0 0 0 0 0 50 50 {height:.4f} {width:.4f} {length:.4f} {position} {score:.4f}\n"


def evaluation(frames: int, random: np.random.Generator, *options: str) -> tuple[float, float]:
    """Returns the CPU seconds and the peak memory (MB) of one `pyinfra evaluate` command.

    The values include the start of Python. The CPU seconds equal the wall time on an idle machine.
    """
    with tempfile.TemporaryDirectory() as name:
        lidar, predictions = write_data_set(Path(name), frames, random)
        command = [sys.executable, "-m", "pyinfra", "evaluate", str(lidar)]
        command += [str(predictions), "--out", f"{name}/out", *options]
        cost = process.run(command, cwd=ROOT)
    return cost.cpu_s, cost.peak_mb


def whole_rows(random: np.random.Generator) -> list[Row]:
    rows: list[Row] = []
    for frames in (1250, 2500, 5000):
        seconds, peak = evaluation(frames, random, "--no-figures")
        rows.append((f"whole evaluation of {frames} frames", seconds, "core s"))
        rows.append((f"peak memory, {frames} frames", peak, "MB"))
    rows.append(("the same with figures, 5000 frames", evaluation(5000, random)[0], "core s"))
    return rows


def matching_rows(random: np.random.Generator, frames: int) -> list[Row]:
    """Compares the time of pyinfra's matching with the time of a loop that uses shapely.

    Both match greedily. The loop computes the IoU of every pair of boxes.
    """
    data = [frame(random) for _ in range(frames)]
    ours, fast = timed(lambda: match_ours(data))
    theirs, slow = timed(lambda: [match_shapely(*arrays) for arrays in data])
    if ours != sum(theirs):
        raise RuntimeError(f"expected {sum(theirs)} matches, as with shapely, got {ours}")
    return [
        ("IoU and matching", 1e6 * fast / frames, "us/frame"),
        ("shapely loop over all pairs", 1e6 * slow / frames, "us/frame"),
        ("shapely loop / IoU and matching", slow / fast, "times"),
    ]


def match_ours(data: list[tuple[FloatArray, FloatArray, FloatArray]]) -> int:
    truth, predicted, scores = (np.concatenate(column) for column in zip(*data, strict=True))
    of_truth = np.repeat(np.arange(len(data)), OBJECTS)
    of_predicted = np.repeat(np.arange(len(data)), PREDICTIONS)
    pairs = matching.overlapping_pairs(of_predicted, predicted, of_truth, truth)
    pairs = matching.in_order(pairs, scores, predicted, truth)
    return int((matching.match(pairs, len(predicted), len(truth), 0.5) >= 0).sum())


def match_shapely(truth: FloatArray, predicted: FloatArray, scores: FloatArray) -> int:
    vehicles = [shapely.Polygon(c) for c in corners(truth)]
    predictions = [shapely.Polygon(c) for c in corners(predicted)]
    taken: set[int] = set()
    for p in np.argsort(-scores):
        best, at = 0.0, -1
        for v, vehicle in enumerate(vehicles):
            shared = predictions[p].intersection(vehicle).area
            iou = shared / (predictions[p].area + vehicle.area - shared)
            if iou > best and v not in taken:
                best, at = iou, v
        if best >= 0.5:
            taken.add(at)
    return len(taken)


def timed(work: Callable[[], Any]) -> tuple[Any, float]:
    start = time.perf_counter()
    result = work()
    return result, time.perf_counter() - start


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    add_out(parser, "evaluation.csv")
    parser.add_argument(
        "--frames",
        type=int,
        default=200,
        help="number of frames for the comparison with shapely (default: %(default)s)",
    )
    args = parser.parse_args()
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    random = np.random.default_rng(1)
    rows = [*exactness(random), *matching_rows(random, args.frames), *whole_rows(random)]
    table = pd.DataFrame(rows, columns=["what", "value", "unit"]).assign(
        command="benchmarks/evaluate_speed.py", seed=1, version=__version__
    )
    table.to_csv(args.out, index=False, float_format="%.4g")
    print(table[["what", "value", "unit"]].to_string(index=False))


if __name__ == "__main__":
    main()
