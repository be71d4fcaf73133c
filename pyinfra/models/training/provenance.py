"""The description of a checkpoint, and its weights as arrays; this module needs no PyTorch."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import yaml
from safetensors import SafetensorError, safe_open

from pyinfra.core.arrays import Floats
from pyinfra.core.config import from_plain
from pyinfra.core.errors import ConfigError
from pyinfra.core.version import __version__
from pyinfra.dataset.frames_version import FIRST
from pyinfra.models.detectors.detection_area import Site
from pyinfra.models.training.accumulation import LabelAt

FORMAT = 1
CONVENTION = "levelled LiDAR frame: x forward, y left, z up, metres, origin at the sensor"


@dataclass(frozen=True)
class Provenance:
    """The description of a checkpoint."""

    detector: str
    network: Any  # the detector's Config as plain values
    site: Site
    lidar: str
    preset: str
    scene: str
    seed: int
    step: int
    steps: int
    label_time: str = "frame"
    above_road: bool = True  # whether z of the network's input is measured from the road
    # a, b, c of the road z = a x + b y + c at the training site, if the road is one plane. This
    # plane is used at sites whose ground is unknown.
    ground: tuple[float, float, float] | None = None
    anywhere: bool = False  # whether the network was trained at many sites, for use at other sites
    accumulate: int = 1  # number of frames that are stacked into one cloud
    label_at: LabelAt = "newest"  # which of the stacked frames has the labels
    start: str = ""  # digest of the weights at the start of the training; empty for random weights
    # a, b of logit(score) -> a logit(score) + b, which makes a score the probability of a true
    # positive. If there are several classes, each class has a pair a, b.
    calibration: tuple[float, ...] | None = None
    figures: Any = None  # measured figures, by name
    # frames_version of the training frames; empty if they were recorded. Several versions are
    # separated by blanks. If the key is missing, as before version 0.5, the value is 3.
    frames_version: str = FIRST
    format: int = FORMAT
    convention: str = CONVENTION
    version: str = __version__


def is_among(name: str, names: str) -> bool:
    """Returns whether a name is one of `names`, which are separated by blanks.

    A name may itself contain blanks.
    """
    return f" {name} " in f" {names} "


def read_provenance(file: Path) -> Provenance:
    """Reads the description of a checkpoint. Raises the errors of checkpoint.load."""
    with opened(file, "np") as weights:
        return provenance_of(weights, file)


def read_arrays(file: Path) -> dict[str, Floats]:
    """Returns the weights of a checkpoint's network, by the names that the network uses.

    Raises the errors of checkpoint.load, and ConfigError for a weight that is not finite.
    """
    with opened(file, "np") as weights:
        provenance_of(weights, file)
        tensors = tensors_of(weights)
    arrays = {
        name.removeprefix("network."): np.asarray(array, np.float32)
        for name, array in tensors.items()
        if name.startswith("network.") and np.issubdtype(array.dtype, np.floating)
    }
    for name, array in arrays.items():
        if not np.isfinite(array).all():
            raise ConfigError(f"{file}: {name}: expected finite weights, got NaN or inf")
    return arrays


@contextmanager
def opened(file: Path, framework: Literal["np", "pt"]) -> Iterator[Any]:
    """Opens a file of weights. Raises the errors of checkpoint.load."""
    if not file.is_file():
        raise FileNotFoundError(2, "No such checkpoint", str(file))
    try:
        with safe_open(file, framework=framework) as weights:
            yield weights
    except SafetensorError as error:
        raise ConfigError(
            f"{file}: expected a checkpoint, got a file that cannot be read as one: {error}"
        ) from None


def tensors_of(weights: Any) -> dict[str, Any]:
    return {name: weights.get_tensor(name) for name in weights.keys()}  # noqa: SIM118


def provenance_of(weights: Any, file: Path) -> Provenance:
    """Returns the description of opened weights.

    Raises ConfigError for a file that is not a checkpoint of this format.
    """
    try:
        plain = yaml.safe_load((weights.metadata() or {}).get("about", ""))
    except yaml.YAMLError:
        plain = None
    if not isinstance(plain, dict) or "format" not in plain:
        raise ConfigError(
            f"{file}: expected weights that pyinfra wrote, got a file without metadata `about`"
        )
    written = {"format": FORMAT, "convention": CONVENTION, "above_road": True}
    for key, wanted in written.items():
        if plain.get(key) != wanted:
            raise ConfigError(f"{file}: {key}: expected '{wanted}', got '{plain.get(key)}'")
    return from_plain(plain, Provenance, str(file))
