"""Loads trained detectors and runs them on clouds on disk."""

import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np

from pyinfra.core.arrays import FloatArray, Points
from pyinfra.core.errors import Error
from pyinfra.core.progress import track
from pyinfra.dataset.frames import frame_numbers, period_of
from pyinfra.dataset.ground import Ground, ground_of
from pyinfra.dataset.regions import Region, region_of
from pyinfra.formats import kitti
from pyinfra.formats.kitti import Labels
from pyinfra.models.detectors import Detections, Detector
from pyinfra.models.detectors.background import Background
from pyinfra.models.detectors.ground_adapter import OnRoad
from pyinfra.models.pytorch import need_pytorch
from pyinfra.models.training.accumulation import Accumulation
from pyinfra.models.training.provenance import is_among, read_provenance
from pyinfra.models.training.sources import read_frame, scene_of

MODELS = Path(__file__).resolve().parents[1]  # folder of the pretrained detectors
PERCENTILES = (50, 95)


def load_detector(
    run: Path,
    *,
    ground: Ground | None = None,
    region: Region | None = None,
    device: str = "cpu",
    stacks: bool = False,
    threads: int = 1,
) -> Detector:
    """Loads a detector.

    run: the folder of a training, a model's file, or the name of a pretrained detector. ground,
    region: ground and region of the site where the detector is used; by default those of the site
    where it was trained, if known. stacks: whether the caller stacks frames as `accumulation_of`
    describes; otherwise the detector gets single frames. threads: number of threads of ONNX
    Runtime. The detector centerpoint-pillar on a CPU runs with ONNX Runtime. Other networks run
    with PyTorch on one thread.

    Raises FileNotFoundError, and MissingPackage if PyTorch is needed and not installed. Raises
    Error for a file that is not a model, if no ground is known, and if a model of stacked frames
    would get single frames.
    """
    file = model_file(run)
    if file.suffix == ".npz":
        return Background.load(file)
    provenance = read_provenance(file)
    if not stacks:
        check_single(run, provenance.accumulate)
    if ground is None and provenance.ground is not None:
        ground = Ground(provenance.ground)
    if ground is None:
        raise Error(
            f"{run}: expected the height of the sensor above the road, got none; set `height_m`"
        )
    if device == "cpu" and runs_with_onnx(provenance.detector):
        from pyinfra.models.onnx.detector import load

        return OnRoad(load(file, region, threads), ground)
    return OnRoad(load_network(file, region, device), ground)


def threads_of(file: Path, device: str, threads: int) -> int:
    """Returns the number of threads that a model uses if the user sets `threads`."""
    with_onnx = device == "cpu" and file.suffix != ".npz"
    return threads if with_onnx and runs_with_onnx(read_provenance(file).detector) else 1


def runs_with_onnx(detector: str) -> bool:
    """Returns whether a detector runs with ONNX Runtime, which needs the extension."""
    from pyinfra.models.ops.kernels import kernels

    return detector == "centerpoint-pillar" and kernels is not None


def load_network(file: Path, region: Region | None = None, device: str = "cpu") -> Detector:
    """Loads a network with PyTorch; its z is measured from the road.

    Raises the errors of load_detector, and MissingPackage.
    """
    need_pytorch()
    from pyinfra.models.detectors.fuse_batchnorm import fused
    from pyinfra.models.detectors.network import device_of
    from pyinfra.models.training import checkpoint

    return fused(checkpoint.load(file).network(region).to(device_of(device)))


def check_single(run: Path, frames: int) -> None:
    """Raises Error for a model of stacked frames. frames: number of frames in a stack."""
    if frames > 1:
        raise Error(
            f"{run}: expected a model of single frames, got a model of {frames} stacked frames; "
            "only frames in a LiDAR's folder can be stacked"
        )


def accumulation_of(file: Path) -> Accumulation:
    """Returns how a model's frames are stacked. Raises the errors of checkpoint.load."""
    if file.suffix == ".npz":
        return Accumulation()
    provenance = read_provenance(file)
    return Accumulation(provenance.accumulate, provenance.label_at)


def inputs_used(file: Path) -> str:
    """Returns a text on the inputs that a model uses: single frames, or stacked frames."""
    stacked = accumulation_of(file).frames
    return f"{stacked} stacked frames" if stacked > 1 else "single frames"


def reader_at(run: Path, lidar_folder: Path, files: Sequence[Path]) -> Callable[[Path], Points]:
    """Returns a function that reads clouds of a folder as a model needs them."""
    file = model_file(run)
    numbers = [int(cloud.stem) for cloud in files]
    return stacking(lidar_folder, numbers, accumulation_of(file))


def stacking(
    lidar_folder: Path,
    frames: Sequence[int],
    accumulation: Accumulation,
    *,
    existing: Sequence[int] | None = None,
) -> Callable[[Path], Points]:
    """Returns a function that reads a frame's file and adds its neighbours' points.

    Neighbouring frames are stacked even if they belong to another split. existing: numbers of the
    frames that can be neighbours, by default all. Raises Error if no frame has a neighbour.
    """
    if existing is None:
        existing = frame_numbers(lidar_folder, "all")
    period_s = period_of(lidar_folder)
    read = partial(read_frame, lidar_folder)
    clouds = accumulation.clouds(read, frames, existing, period_s)
    files = [kitti.frame_file(lidar_folder, "velodyne", k) for k in frames]
    by_file = dict(zip(files, clouds, strict=True))
    return lambda file: by_file[file]()


def detector_at(run: Path, lidar_folder: Path, *, device: str = "cpu") -> Detector:
    """Loads a detector for the site of a LiDAR's folder. Raises the errors of load_detector."""
    ground, region = ground_and_region_of(lidar_folder)
    return load_detector(run, ground=ground, region=region, device=device)


def ground_and_region_of(lidar_folder: Path) -> tuple[Ground | None, Region | None]:
    """Returns the ground and the region at the site of a folder. Each is None if unknown.

    Raises FormatError, and ConfigError for an invalid outline.
    """
    if not (lidar_folder / "lidar.yaml").is_file():
        return None, None
    pose = kitti.read_lidar(lidar_folder).T_world_levelled
    return ground_of(lidar_folder), region_of(lidar_folder, pose)


def shipped() -> list[str]:
    """Returns the names of the pretrained detectors of the package."""
    return sorted(file.stem for file in MODELS.glob("*.safetensors"))


def model_file(run: Path, which: Literal["last", "best"] = "last") -> Path:
    """Returns the model file of a training's folder or of a pretrained detector.

    run: a folder, the name of a pretrained detector, or a model file, which is returned. which:
    which checkpoint of a training. Raises FileNotFoundError.
    """
    if run.is_file():
        return run
    if not run.exists() and str(run) in shipped():
        return MODELS / f"{run}.safetensors"
    if not run.exists():
        ours = ", ".join(shipped()) or "none"
        raise FileNotFoundError(
            2,
            f"No such folder or file, and no pretrained detector ({ours}) has this name",
            str(run),
        )
    names = (f"{which}.safetensors", "background.npz")
    for name in names:
        if (run / name).is_file():
            return run / name
    raise FileNotFoundError(2, f"The folder has no {' or '.join(names)}", str(run))


def transfer(run: Path, lidar_folder: Path) -> str:
    """Returns a text that lists how a folder differs from the training data of a model.

    The function compares the LiDAR, the preset, the scene and the label time. The text is empty if
    there is no difference, or if the model was trained at many sites.
    """
    file = model_file(run)
    if file.suffix == ".npz" or not (lidar_folder / "lidar.yaml").is_file():
        return ""
    provenance, lidar = read_provenance(file), kitti.read_lidar(lidar_folder)
    if provenance.anywhere:
        return ""
    pairs = {
        "LiDAR": (provenance.lidar, lidar.name),
        "preset": (provenance.preset, lidar.preset),
        "scene": (provenance.scene, scene_of(lidar_folder)),
        "label time": (provenance.label_time, lidar.label_time),
    }
    return ", ".join(
        f"{name} {theirs} (trained on {ours})"
        for name, (ours, theirs) in pairs.items()
        if not is_among(theirs, ours)
    )


def detect(
    detector: Detector,
    files: Sequence[Path],
    out: Path | None,
    *,
    read: Callable[[Path], Points] = kitti.read_points,
) -> tuple[list[Detections], FloatArray]:
    """Runs a detector; returns the detections in each cloud and the computing time of each cloud.

    The time in milliseconds covers the steps from points to boxes. If `out` is given, the boxes are
    also written there as KITTI results, in the camera frame of the frame's calib file. If there is
    no calib file, the camera frame of a simulated LiDAR is used. Raises FormatError for an invalid
    cloud, and Error for two clouds of the same name.
    """
    per_frame, times = [], []
    if out is not None:
        once(files)
        out.mkdir(parents=True, exist_ok=True)
    for file in track(files, "frame"):
        points = read(file)
        detections, seconds = timed(detector, points)
        per_frame.append(detections)
        times.append(1000 * seconds)
        if out is not None:
            write(out, file, detections)
    return per_frame, np.array(times)


def write(out: Path, cloud: Path, detections: Detections) -> None:
    """Writes the KITTI result of a cloud. Raises FormatError for an invalid calib file."""
    labels = Labels(detections.names, detections.boxes, detections.scores)
    kitti.write_labels(out / f"{cloud.stem}.txt", labels, calibration_of(cloud))


def once(files: Sequence[Path]) -> None:
    """Raises Error if two clouds have the same name, so that their results would be one file."""
    named: dict[str, Path] = {}
    for file in files:
        if file.stem in named:
            other = named[file.stem]
            raise Error(
                f"{file}: expected point clouds of different names with `out`, got the same name "
                f"as {other}"
            )
        named[file.stem] = file


def calibration_of(cloud: Path) -> kitti.Calibration | None:
    """Reads the calibration of a cloud in a folder `velodyne`, from the folder `calib` beside it.

    The result is None if the cloud is in another folder, or if the file does not exist. Raises
    FormatError.
    """
    file = cloud.parent.parent / "calib" / f"{cloud.stem}.txt"
    beside = cloud.parent.name == "velodyne" and file.is_file()
    return kitti.read_calibration(file) if beside else None


def timed(detector: Detector, points: Points) -> tuple[Detections, float]:
    start = time.perf_counter()
    detections = detector.predict(points)
    return detections, time.perf_counter() - start
