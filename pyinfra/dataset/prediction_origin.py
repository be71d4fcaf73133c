"""Writes and checks `origin.yaml`, which states the model and the frames of predictions.

Predictions of other tools have no `origin.yaml` and are not checked.
"""

import hashlib
import re
from collections.abc import Mapping
from pathlib import Path

import yaml

from pyinfra.core.errors import Error
from pyinfra.core.files import resolved, write
from pyinfra.core.version import __version__
from pyinfra.dataset.frames import data_set_of
from pyinfra.formats import kitti

ORIGIN_FILE = "origin.yaml"
# Keys of origin.yaml that identify the frames, and keys that identify the model.
OF_FRAMES = ("lidar", "preset", "scene", "seed", "dataset_sha256", "lidar_sha256")
OF_MODEL = ("model_sha256",)
MODEL_FRAMES = "model_frames_version"  # key of the training frames' frames_version
# Model files with these names are identified by the name of their training folder.
RUN_FILES = ("last", "best", "background")
# Matches the lines of a lidar.yaml that contain its prices.
PRICES = re.compile(rb"^price_usd:\n(?:  .*\n)+|^price_total_usd: .*\n", re.MULTILINE)


def model_name(model: Path) -> str:
    """Returns the name of a model's file, or of its folder if the file has a name of RUN_FILES."""
    return resolved(model).parent.name if model.stem in RUN_FILES else model.stem


def origin_of(lidar_folder: Path, model: Path | None = None) -> dict[str, str]:
    """Returns the keys that identify a LiDAR's frames and, if it is given, the model file.

    Raises FormatError for a wrong lidar.yaml or dataset.yaml.
    """
    origin = {"version": __version__}
    if model is not None:
        origin["model"] = model_name(model)
        origin["model_sha256"] = _digest(model.read_bytes())
    if (lidar_folder / "lidar.yaml").is_file():
        lidar = kitti.read_lidar(lidar_folder)
        without_prices = PRICES.sub(b"", (lidar_folder / "lidar.yaml").read_bytes())
        origin |= {"lidar": lidar.name, "preset": lidar.preset}
        origin["lidar_sha256"] = _digest(without_prices)  # frames do not depend on prices
    description = data_set_of(lidar_folder) / "dataset.yaml"
    if description.is_file():
        top = kitti.read_yaml(description)
        for key, name in (("name", "scene"), ("seed", "seed")):
            if (node := top.maybe(key)) is not None:
                origin[name] = node.text()
        origin["dataset_sha256"] = _digest(description.read_bytes())
    return origin


def read_origin(predictions: Path) -> dict[str, str] | None:
    """Reads the origin of a folder of predictions.

    Returns None if the folder has no origin file. Raises FormatError.
    """
    file = predictions / ORIGIN_FILE
    if not file.is_file():
        return None
    return {key: str(value) for key, value in kitti.read_keys(file).items()}


def write_origin(predictions: Path, origin: Mapping[str, str], *, replace: bool = False) -> None:
    """Writes the origin. With `replace`, an existing file is replaced.

    Without `replace`, raises Error if the folder has predictions of another model or other frames.
    """
    stored = None if replace else read_origin(predictions)
    if stored is not None:
        _check(predictions, stored, origin, OF_FRAMES + OF_MODEL, "choose another folder")
    write(predictions / ORIGIN_FILE, yaml.safe_dump(dict(origin), sort_keys=False))


def check_origin(predictions: Path, lidar_folder: Path) -> bool:
    """Returns whether the folder of predictions has an origin file.

    Raises Error if the predictions were made for other frames than those of the LiDAR's folder.
    """
    stored = read_origin(predictions)
    if stored is None:
        return False
    _check(
        predictions,
        stored,
        origin_of(lidar_folder),
        OF_FRAMES,
        f"they are not predictions of {lidar_folder}",
    )
    return True


def _check(
    predictions: Path,
    there: Mapping[str, str],
    origin: Mapping[str, str],
    keys: tuple[str, ...],
    hint: str,
) -> None:
    """Raises Error if the origins differ in the value of a key that both have."""
    for key in keys:
        if key in there and key in origin and there[key] != origin[key]:
            raise Error(
                f"{predictions / ORIGIN_FILE}: {key}: expected {origin[key]}, got {there[key]}: "
                f"the predictions belong to other frames or to another model; {hint}"
            )


def _digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()[:16]
