"""Compares detectors with the files that `pyinfra onnx` writes: AP and time of a frame.

Each detector is trained on the highway. Its file is run by ONNX Runtime on one thread, with and
without non-maximum suppression in the graph. The detector also runs with PyTorch on one thread, as
in training.

    python -m reproduction onnx_files --work out/onnx --out results/onnx_files.csv
"""

import json
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import torch

import pyinfra as pi
from pyinfra.core.arrays import Points
from pyinfra.core.config import from_plain
from pyinfra.dataset.frames import frame_numbers
from pyinfra.experiments import store
from pyinfra.experiments.benchmark.matrix import Parts
from pyinfra.formats import kitti
from pyinfra.models.detectors import Detections
from pyinfra.models.detectors.classes import TYPES
from pyinfra.models.detectors.detection_area import Site
from pyinfra.models.detectors.fuse_batchnorm import fused
from pyinfra.models.detectors.ground_adapter import OnRoad
from pyinfra.models.detectors.network import one_thread
from pyinfra.models.detectors.sample import with_columns
from pyinfra.models.inference import detect
from pyinfra.models.inference.onnx import export
from pyinfra.models.onnx.detector import session_of
from pyinfra.models.training import checkpoint
from reproduction import provenance
from reproduction.arguments import Out, Work, command
from reproduction.simulate import simulate

FRAMES = "0:5000:20"

PAIRS = (("generalist", "ruby_plus"), ("generalist", "livox_avia"), ("pointpillars", "livox_avia"))
KEY = ["scene", "lidar", "detector", "engine"]


@dataclass
class OnnxFile:
    """A detector that runs a file of `pyinfra onnx`. Its points and boxes have z above the road."""

    session: Any
    site: Site
    classes: tuple[str, ...]

    def predict(self, points: Points) -> Detections:
        columns = self.session.get_inputs()[0].shape[1]
        inside = with_columns(self.site.area.crop(points), columns)
        boxes, scores, *numbers = self.session.run(None, {"points": inside})
        which = numbers[0] if numbers else np.zeros(len(scores), int)
        return Detections(boxes, scores, np.array([TYPES[self.classes[i]] for i in which], str))


def engines(run: Path, folder: Path) -> dict[str, Any]:
    """Returns the detector with PyTorch, and its file with and without suppression."""
    ground, _ = detect.ground_and_region_of(folder)
    assert ground is not None
    network = checkpoint.load(detect.model_file(run)).network()
    found: dict[str, Any] = {"pytorch": OnRoad(fused(network), ground)}
    for name, suppress in (("file", True), ("without suppression", False)):
        file = run / f"{name.replace(' ', '_')}.onnx"
        export(run, file, suppress=suppress)
        session = session_of(file.read_bytes(), 1)
        area = json.loads(session.get_modelmeta().custom_metadata_map["area"])
        site = from_plain(area, Site, str(file))
        found[name] = OnRoad(OnnxFile(session, site, network.classes), ground)
    return found


def rows_of(run: Path, folder: Path) -> Iterator[dict[str, object]]:
    """Yields AP and time of each engine on the test frames. Engines take turns at each frame."""
    numbers = frame_numbers(folder, "val")
    clouds = [kitti.read_points(kitti.frame_file(folder, "velodyne", k)) for k in numbers]
    detectors = engines(run, folder)
    times: dict[str, list[float]] = {name: [] for name in detectors}
    boxes: dict[str, list[pd.DataFrame]] = {name: [] for name in detectors}
    with one_thread():
        for number, points in zip([numbers[0], *numbers], [clouds[0], *clouds], strict=True):
            for name, detector in detectors.items():
                started = time.perf_counter()
                found = detector.predict(points)
                times[name].append(1000 * (time.perf_counter() - started))
                table = pd.DataFrame(found.boxes, columns="x y z dx dy dz heading".split())
                boxes[name].append(table.assign(frame=number, type=found.names, score=found.scores))
    for name in detectors:
        table = pd.concat(boxes[name][1:])  # the first frame only warms up the detector
        result = pi.evaluate(folder, table[table.type != "Pedestrian"], split="val")
        ap = result.ap.set_index("ground_truth").ap_r1000["captured"]
        yield {
            "engine": name,
            "ap_r1000": round(ap, 2),
            "ms_p50": round(float(np.median(times[name][1:])), 1),
            "ms_more_p50": round(
                float(np.median(np.subtract(times[name], times["without suppression"])[1:])),
                1,
            ),
            "boxes_per_frame": round(len(table) / len(numbers), 1),
            "frames": len(numbers),
        }


def simulated(lidar: str, work: Path) -> Path:
    options = {"preset": "datasheet", "frames": FRAMES}
    return simulate("highway", [lidar], work / lidar, parts=Parts(), **options) / lidar


@command
def main(*, work: Work, out: Out = Path("onnx_files.csv")) -> None:
    """
    Parameters
    ----------
    work : working folder for frames, about 1 GB
    """
    torch.set_grad_enabled(False)
    for name, lidar in PAIRS:
        folder, run = simulated(lidar, work), work / f"{name}_{lidar}"
        with torch.enable_grad():
            pi.train(name, folder, work=run)
        rows = pd.DataFrame(rows_of(run, folder)).assign(
            scene="highway", lidar=lidar, detector=name, **provenance("onnx_files")
        )
        store.put(out, rows[[*KEY, *(c for c in rows if c not in KEY)]], KEY)
        print(name, lidar, rows[["engine", "ap_r1000", "ms_p50"]].values.tolist(), flush=True)
