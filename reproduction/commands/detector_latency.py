"""Measures the time of the pretrained detector by part, with one and two threads.

The engine of the package (ONNX Runtime with the compiled extension) is compared with PyTorch on one
thread, which runs on the same frames after it. The frames are those of four LiDARs on the study's
scenes, and of four LiDARs of 16 lines that are fused at a crossroad. Run it on an idle machine:

    python -m reproduction detector_latency --work out/latency --out results/detector_latency.csv
"""

import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import torch

from pyinfra.core.arrays import Points
from pyinfra.dataset.frames import frame_numbers
from pyinfra.experiments import store
from pyinfra.formats import kitti
from pyinfra.models.detectors import Detector
from pyinfra.models.detectors.ground_adapter import OnRoad
from pyinfra.models.detectors.network import one_thread
from pyinfra.models.inference import detect
from pyinfra.models.onnx.detector import OnnxDetector
from reproduction import provenance
from reproduction.arguments import Out, Work, command
from reproduction.simulate import simulate

FRAMES = "0:1450:47"  # 31 frames; the first one is not timed
SCENES = ("highway", "crossroad", "curve")
LIDARS = ("ruby_plus", "livox_avia", "pandar_64", "helios_16")
FUSED_SCENE, FUSED_LIDAR, FUSED = "crossroad_poles", "helios_16", "fused"
THREADS = (1, 2)
READ, PILLARS, LAYERS, BOXES, ALL = "reading", "pillars", "layers", "boxes", "all"
KEY = ["scene", "lidar", "engine", "threads", "part"]


@dataclass
class Clock:
    """The times (ms) of the parts of one engine, a value for each frame."""

    times: dict[str, list[float]] = field(default_factory=lambda: defaultdict(list))
    of_frame: dict[str, float] = field(default_factory=lambda: defaultdict(float))

    def timed(self, part: str, function: Callable[..., Any]) -> Callable[..., Any]:
        """Returns a function that also records its time."""

        def run(*values: Any, **named: Any) -> Any:
            started = time.perf_counter()
            result = function(*values, **named)
            self.of_frame[part] += 1000 * (time.perf_counter() - started)
            return result

        return run

    def frame(self, detector: Detector, points: Points) -> None:
        """Records the times of a frame. BOXES has the time outside all other parts."""
        self.of_frame.clear()
        started = time.perf_counter()
        detector.predict(points)
        whole = 1000 * (time.perf_counter() - started)
        rest = whole - sum(self.of_frame.values())
        for name, ms in (*self.of_frame.items(), (BOXES, rest), (ALL, whole)):
            self.times[name].append(ms)


class Session:
    """A session of ONNX Runtime whose runs are timed."""

    def __init__(self, session: Any, clock: Clock) -> None:
        self.run = clock.timed(LAYERS, session.run)


def engine_of_package(folder: Path, threads: int, clock: Clock) -> Detector:
    ground, region = detect.ground_and_region_of(folder)
    detector = detect.load_detector(
        Path("generalist"), ground=ground, region=region, threads=threads
    )
    assert isinstance(detector, OnRoad)
    assert isinstance(detector.detector, OnnxDetector)
    detector.detector.tiles = [
        (tile, Session(session, clock)) for tile, session in detector.detector.tiles
    ]
    detector.detector.map.of = clock.timed(PILLARS, detector.detector.map.of)  # type: ignore[method-assign]
    return detector


def pytorch(folder: Path, clock: Clock) -> Detector:
    ground, region = detect.ground_and_region_of(folder)
    network: Any = detect.load_network(detect.model_file(Path("generalist")), region)
    network.encoder.forward = clock.timed(PILLARS, network.encoder.forward)
    network.bev.forward = clock.timed(LAYERS, network.bev.forward)
    assert ground is not None
    return OnRoad(network, ground)


def rows_of(folder: Path) -> Iterator[dict[str, object]]:
    """Yields the median and the 95 % quantile of each part, over all frames but the first."""
    clocks = {("package", threads): Clock() for threads in THREADS} | {("pytorch", 1): Clock()}
    detectors = {
        key: pytorch(folder, clock)
        if key[0] == "pytorch"
        else engine_of_package(folder, key[1], clock)
        for key, clock in clocks.items()
    }
    files = [kitti.frame_file(folder, "velodyne", k) for k in frame_numbers(folder, "all")]
    clouds = []
    for file in files:
        started = time.perf_counter()
        clouds.append(kitti.read_points(file))
        read_ms = 1000 * (time.perf_counter() - started)
        for clock in clocks.values():
            clock.times[READ].append(read_ms)
    for key, clock in clocks.items():
        with one_thread():
            for points in clouds:
                clock.frame(detectors[key], points)
    for (engine, threads), clock in clocks.items():
        for part, values in clock.times.items():
            p50, p95 = np.percentile(values[1:], [50, 95])
            yield {
                "engine": engine,
                "threads": threads,
                "part": part,
                "ms_p50": round(float(p50), 2),
                "ms_p95": round(float(p95), 2),
                "frames": len(values) - 1,
                "points": round(float(np.mean([len(points) for points in clouds]))),
            }


def simulated(scene: str, lidar: str, work: Path) -> Path:
    """Simulates the frames of a scene; returns the folder of the LiDAR or of the fused LiDARs."""
    is_fused = scene == FUSED_SCENE
    out = simulate(
        scene, [lidar], work / f"{scene}_{lidar}", preset="datasheet", label_time="scan",
        frames=FRAMES, fuse=is_fused,
    )  # fmt: skip
    return out / FUSED / lidar if is_fused else out / lidar


@command
def main(*, work: Work, out: Out = Path("detector_latency.csv")) -> None:
    """
    Parameters
    ----------
    work : working folder for frames
    """
    torch.set_grad_enabled(False)
    pairs = [(scene, lidar) for scene in SCENES for lidar in LIDARS]
    for scene, lidar in [*pairs, (FUSED_SCENE, FUSED_LIDAR)]:
        rows = pd.DataFrame(rows_of(simulated(scene, lidar, work)))
        table = rows.assign(scene=scene, lidar=lidar, **provenance("detector_latency"))
        store.put(out, table[[*KEY, *(c for c in table if c not in KEY)]], KEY)
        whole = table[table.part == ALL].set_index(["engine", "threads"]).ms_p50
        print(scene, lidar, whole.to_dict(), flush=True)
