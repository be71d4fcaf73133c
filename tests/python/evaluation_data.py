"""Writes a small data set and predictions, for the tests of evaluate and validate."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from pyinfra.formats import kitti

Vehicle = Mapping[str, object]

SENSOR_HEIGHT_M = 6.0
LIDAR = """name: "{name}"
model: "made up"
preset: "recorded"
price_total_usd: {{low: 1, high: 1}}
period_s: {period}
T_world_levelled: {{x_m: 10, y_m: 20, z_m: 6, yaw_deg: 90}}
T_levelled_sensor: {{pitch_deg: 0, roll_deg: 0}}
label_time: {label_time}
field_of_view:
  - yaw_deg: 0
    pitch_deg: 0
    azimuth_deg: [-{half}, {half}]
    elevation_deg: [-60, 15]
    range_m: [0, {reach}]
"""


def fill_clouds(folder: Path, frames: Sequence[Sequence[Vehicle]]) -> None:
    """Writes clouds with the points of each vehicle, all in the middle of the vehicle's box."""
    for k, vehicles in enumerate(frames):
        rows = [[*box(v)[:3], 0.5] for v in vehicles for _ in range(int(str(v["points"])))]
        points = np.array(rows, dtype="<f4").reshape(-1, 4)
        points.tofile(kitti.frame_file(folder, "velodyne", k))


def car(x: float, y: float = 3.0, **changes: object) -> dict[str, object]:
    """Returns a car on the road, with its box at mid-frame, class, points and visibility. `ahead`
    is the distance from this box to the box at scan time."""
    standard = {
        "class": "Car",
        "heading": 0.0,
        "points": 20,
        "visibility": 1.0,
        "id": -1,
        "ahead": 0.0,
    }
    size = {"z": 0.75 - SENSOR_HEIGHT_M, "dx": 4.0, "dy": 2.0, "dz": 1.5}
    return {"x": x, "y": y, **size, **standard, **changes}


def box(vehicle: Vehicle) -> list[float]:
    return [float(vehicle[c]) for c in "x y z dx dy dz heading".split()]  # type: ignore[arg-type]


def scanned(vehicle: Vehicle) -> dict[str, object]:
    """Returns the vehicle at its position at scan time."""
    return {**vehicle, "x": vehicle["x"] + vehicle["ahead"], "ahead": 0.0}  # type: ignore[operator]


def write_lidar(
    folder: Path,
    frames: Sequence[Sequence[Vehicle]],
    *,
    objects: bool = True,
    half_deg: float = 180,
    reach_m: float = 200,
    period_s: float = 0.1,
    label_time: str = "frame",
) -> Path:
    """Writes a LiDAR's folder. It has labels for the vehicles with points, and empty clouds."""
    for part in ("velodyne", "label_2", *(["objects"] if objects else [])):
        (folder / "training" / part).mkdir(parents=True)
    for k, vehicles in enumerate(frames):
        kitti.frame_file(folder, "velodyne", k).touch()
        seen = [scanned(v) if label_time == "scan" else v for v in vehicles if v["points"]]
        labels = "".join(label_line(str(v["class"]), box(v)) + "\n" for v in seen)
        kitti.frame_file(folder, "label_2", k).write_text(labels)
        if objects:
            text = "".join(
                object_line(v["id"] if v["id"] != -1 else i, v) + "\n"
                for i, v in enumerate(vehicles)
            )
            header = ",".join(kitti.OBJECT_COLUMNS)
            kitti.frame_file(folder, "objects", k).write_text(f"{header}\n{text}")
    fields = {"name": folder.name, "half": half_deg, "reach": reach_m, "period": period_s}
    text = LIDAR.format(**fields, label_time=label_time)
    (folder / "lidar.yaml").write_text(text)
    return folder


def write_roads(folder: Path, half_width: float = 10.0) -> None:
    """Writes one straight road through the sensor's foot. The road runs in the viewing direction,
    which is +y in the world."""
    rows = "".join(f"main,{s},10,{20 + s},0,{math.pi / 2},{half_width}\n" for s in range(-100, 101))
    (folder / "roads.csv").write_text(f"road,s,x,y,z,heading,half_width\n{rows}")


def object_line(number: object, v: Vehicle) -> str:
    at = ",".join(f"{value:.6f}" for value in box(v))
    distance = math.hypot(*box(v)[:2])
    points, name = v["points"], v["class"]
    x, y, z, *_, heading = box(scanned(v))
    scan = f"{x:.6f},{y:.6f},{z:.6f},{heading:.6f},0.08,{points}"
    return f"{number},{name},{at},15.0,{points},{points},{distance:.4f},{v['visibility']},{scan}"


def label_line(name: str, values: Sequence[float], score: float | None = None) -> str:
    """Returns a line of label_2 in the devkit's format. With a score, it is a line of a result
    file."""
    x, y, z, dx, dy, dz, heading = values
    size, position = f"{dz:.6f} {dy:.6f} {dx:.6f}", f"{-y:.6f} {dz / 2 - z:.6f} {x:.6f}"
    line = (
        f"{name} 0.00 0 0.00 0.00 0.00 50.00 50.00 {size} {position} {-heading - math.pi / 2:.6f}"
    )
    return line if score is None else f"{line} {score:.6f}"


def write_predictions(
    folder: Path, frames: Sequence[Sequence[tuple[Sequence[float], float]]], name: str = "vehicle"
) -> Path:
    """Writes boxes with scores as KITTI result files."""
    folder.mkdir(parents=True, exist_ok=True)
    for k, boxes in enumerate(frames):
        text = "".join(label_line(name, values, score) + "\n" for values, score in boxes)
        (folder / f"{k:06d}.txt").write_text(text)
    return folder


def perfect(frames: Sequence[Sequence[Vehicle]]) -> list[list[tuple[list[float], float]]]:
    """Returns the boxes of all vehicles with points, with different scores."""
    return [
        [(box(v), 0.9 - 0.001 * i) for i, v in enumerate(frame) if v["points"]] for frame in frames
    ]


def traffic(frames: int, seed: int = 0, per_frame: int = 8) -> list[list[dict[str, object]]]:
    """Returns cars on four lanes. Cars on the same lane are 12 m apart or more."""
    random = np.random.default_rng(seed)
    result = []
    for _ in range(frames):
        slots = random.choice(16, per_frame, replace=False)
        positions = -96 + 12 * slots + random.uniform(0, 4, per_frame)
        lanes = random.choice([-6.0, -2.0, 2.0, 6.0], per_frame)
        result.append([car(x, y) for x, y in zip(positions, lanes, strict=True)])
    return result


def noisy(
    frames: Sequence[Sequence[Vehicle]], seed: int = 1, spread: float = 0.3, ghosts: int = 2
) -> list[list[tuple[list[float], float]]]:
    """Returns boxes of most vehicles with errors. Some vehicles have two boxes, and some boxes have
    no vehicle."""
    random = np.random.default_rng(seed)
    scale = spread * np.array([1, 0.5, 0.3, 0.5, 0.2, 0.2, 0.1])
    result = []
    for frame in frames:
        copies = []
        for v in frame:
            if random.random() < 0.85:
                copies += [box(v)] * (1 + (random.random() < 0.1))
        noisy_boxes = [(np.array(b) + random.normal(size=7) * scale).tolist() for b in copies]
        empty = [box(car(random.uniform(-100, 100), random.uniform(-9, 9))) for _ in range(ghosts)]
        scored = [(b, random.uniform(0.3, 1)) for b in noisy_boxes]
        result.append(scored + [(b, random.uniform(0.1, 0.7)) for b in empty])
    return result
