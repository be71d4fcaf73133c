"""Compares inference engines for the pretrained detector: PyTorch, ONNX Runtime, OpenVINO.

The backbone takes most of the time of a frame. An engine therefore replaces only the backbone, and
all other computations are the same. The test uses frames of three scenes on one core. Each frame is
processed by all engines in turn. The command also measures the AP with each engine. The int8
variants are quantised with activations of frames that are not tested. Writes out/engines.csv:

    .venv/bin/pip install openvino
    python -m reproduction engines --work data/engines
"""

from __future__ import annotations

import argparse
import logging
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
import onnxruntime
import openvino
import pandas as pd
import torch
from onnxruntime.quantization import CalibrationDataReader, QuantFormat, quant_pre_process
from onnxruntime.quantization import quantize_static as quantize
from torch import Tensor, nn

from pyinfra.core.arrays import FloatArray
from pyinfra.dataset.catalogue import lidar_file, scene_file
from pyinfra.dataset.frames import frame_numbers
from pyinfra.dataset.ground import Ground
from pyinfra.dataset.runs import infrasim
from pyinfra.experiments import store
from pyinfra.formats import kitti
from pyinfra.metrics.evaluate import match_results_of
from pyinfra.metrics.evaluation_tables import ap_r1000_of
from pyinfra.metrics.settings import Settings
from pyinfra.models.detectors.centerpoint_pillar import CenterPointPillar
from pyinfra.models.detectors.fuse_batchnorm import fused
from pyinfra.models.detectors.ground_adapter import OnRoad
from pyinfra.models.detectors.network import one_thread
from pyinfra.models.inference import detect
from pyinfra.models.training import checkpoint
from reproduction import add_out, provenance

CELLS = (("highway", "ruby_plus"), ("crossroad", "pandar_64"), ("curve", "livox_avia"))
FRAMES, QUANTISED_BY = (
    "0:2000:50",
    5,
)  # the first frames are used for int8 calibration, the others for the test
SETTINGS = Settings(ground_truths=("captured",))
KEY = ["scene", "lidar", "engine"]
Run = Callable[[FloatArray], Sequence[FloatArray]]


class Engine(nn.Module):
    """A backbone that an inference engine runs in place of PyTorch."""

    def __init__(self, run: Run) -> None:
        super().__init__()
        self.run = run

    def forward(self, canvas: Tensor) -> Tensor:
        return torch.from_numpy(self.run(canvas.contiguous().numpy())[0])


class Canvases(CalibrationDataReader):  # type: ignore[misc]  # the base class has no types
    """Provides the backbone inputs from which int8 activation ranges are measured."""

    def __init__(self, canvases: Sequence[FloatArray]) -> None:
        self.left = iter(canvases)

    def get_next(self) -> dict[str, FloatArray] | None:
        canvas = next(self.left, None)
        return None if canvas is None else {"canvas": canvas}


def by_onnxruntime(file: Path) -> Run:
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    session = onnxruntime.InferenceSession(str(file), options, ["CPUExecutionProvider"])
    return lambda canvas: session.run(None, {"canvas": canvas})


def by_openvino(file: Path) -> Run:
    limits = {"INFERENCE_NUM_THREADS": 1, "PERFORMANCE_HINT": "LATENCY"}
    compiled = openvino.Core().compile_model(str(file), "CPU", limits)
    return lambda canvas: [compiled(canvas)[0]]


def engines(
    backbone: nn.Module, canvases: Sequence[FloatArray], work: Path
) -> dict[str, nn.Module]:
    whole, ready, small = (work / f"{name}.onnx" for name in ("whole", "ready", "int8"))
    first = torch.from_numpy(canvases[0])
    logging.getLogger("torch.onnx").setLevel(logging.ERROR)
    torch.onnx.export(
        backbone,
        (first,),
        str(whole),
        input_names=["canvas"],
        output_names=["maps"],
        dynamo=True,
        external_data=False,
    )
    quant_pre_process(str(whole), str(ready), skip_symbolic_shape=True)
    quantize(
        str(ready), str(small), Canvases(canvases), quant_format=QuantFormat.QDQ, per_channel=True
    )
    return {
        "pytorch": backbone,
        "onnxruntime": Engine(by_onnxruntime(whole)),
        "onnxruntime int8": Engine(by_onnxruntime(small)),
        "openvino": Engine(by_openvino(whole)),
        "openvino int8": Engine(by_openvino(small)),
    }


def simulated(scene: str, lidar: str, work: Path) -> Path:
    words = ["--preset", "datasheet", "--frames", FRAMES, "--out", work / scene]
    infrasim("run", scene_file(scene), "--lidar", lidar_file(lidar), *map(str, words))
    return work / scene / lidar


def rows(folder: Path, work: Path) -> Iterator[dict[str, object]]:
    ground, region = detect.ground_and_region_of(folder)
    network = checkpoint.load(detect.model_file(Path("generalist"))).network(region)
    network_on_road = OnRoad(fused(network), ground or Ground())
    assert isinstance(network, CenterPointPillar)
    files = [kitti.frame_file(folder, "velodyne", k) for k in frame_numbers(folder, "all")]
    seen: list[FloatArray] = []
    hook = network.bev.register_forward_pre_hook(lambda _, given: seen.append(given[0].numpy()))
    detect.detect(network_on_road, files[:QUANTISED_BY], None)
    hook.remove()
    with one_thread():
        by_engine = engines(network.bev, seen, work)
    times: dict[str, list[float]] = {name: [] for name in by_engine}
    for file in files[QUANTISED_BY:]:
        points = kitti.read_points(file)
        for name, engine in by_engine.items():
            network.register_module("bev", engine)
            start = time.perf_counter()
            boxes = network_on_road.predict(points)
            times[name].append(1000 * (time.perf_counter() - start))
            (work / name).mkdir(exist_ok=True)
            detect.write(work / name, file, boxes)
    frames = [int(file.stem) for file in files[QUANTISED_BY:]]
    for name, timings in times.items():
        (match_result,) = match_results_of(folder, work / name, SETTINGS, frames=frames)
        ratio = np.median(np.array(times["pytorch"]) / np.array(timings))
        yield {
            "engine": name,
            "latency_p50_ms": round(float(np.median(timings)), 1),
            "speed": round(float(ratio), 3),
            "ap_r1000": round(ap_r1000_of(match_result).measured().value, 3),
        }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--work", type=Path, required=True, help="working folder for frames")
    add_out(parser, "engines.csv")
    args = parser.parse_args()
    columns = provenance("engines")
    for scene, lidar in CELLS:
        folder = simulated(scene, lidar, args.work)
        for row in rows(folder, args.work):
            record = {"scene": scene, "lidar": lidar, **row, **columns}
            store.put(args.out, pd.DataFrame([record]), KEY)
            print(record, flush=True)
