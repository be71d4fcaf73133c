"""A network on disk: one safetensors file with a description as YAML in its header.

Pickles are not used, so that loading an untrusted checkpoint runs no code. A file is first written
under another name and then renamed, so that a checkpoint is never incomplete.
"""

import hashlib
import importlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml
from safetensors import SafetensorError
from safetensors.torch import save_file
from torch import Tensor, nn

from pyinfra.core.config import as_plain
from pyinfra.core.errors import ConfigError
from pyinfra.core.files import replacing
from pyinfra.core.vocabulary import ObjectClass
from pyinfra.dataset.regions import Region
from pyinfra.models.detectors.catalogue import DETECTORS, config_of
from pyinfra.models.detectors.classes import classes_of
from pyinfra.models.detectors.detection_area import Site, around
from pyinfra.models.detectors.network import Network
from pyinfra.models.training.provenance import Provenance, opened, provenance_of, tensors_of


@dataclass(frozen=True, eq=False)
class Checkpoint:
    """A checkpoint in memory. Tensors are named `network.` (weights) and `optimizer.` (state)."""

    provenance: Provenance
    tensors: dict[str, Tensor]

    @property
    def classes(self) -> tuple[ObjectClass, ...]:
        """The classes that the network of the checkpoint distinguishes."""
        return classes_of(config_of(self.provenance.detector, self.provenance.network))

    def weights(self) -> dict[str, Tensor]:
        """Returns the weights of the network, with the names that the network uses."""
        return {
            name.removeprefix("network."): tensor.float() if tensor.is_floating_point() else tensor
            for name, tensor in self.tensors.items()
            if name.startswith("network.")
        }

    def network(self, region: Region | None = None) -> Network:
        """Returns the network in eval mode.

        region: the region of the frames to process; by default the region of its training.
        Raises ConfigError if the weights do not fit the Config.
        """
        site = self.provenance.site if region is None else around(region, self.provenance.site)
        network, weights = (
            build(self.provenance.detector, self.provenance.network, site),
            self.weights(),
        )
        try:
            network.load_state_dict(weights)
        except RuntimeError as error:
            first = str(error).splitlines()[-1].strip()
            raise ConfigError(f"checkpoint of {self.provenance.detector}: {first}") from None
        for name, tensor in weights.items():
            if not tensor.isfinite().all():
                raise ConfigError(
                    f"checkpoint of {self.provenance.detector}: {name}: expected finite "
                    "weights, got NaN or inf"
                )
        network.calibration = self.provenance.calibration
        if region is not None:
            network.know(region)
        return network.eval()


def build(detector: str, config: Any, site: Site) -> Network:
    """Returns a new network. config: the detector's Config, or its values as a mapping."""
    entry = DETECTORS.get(detector)
    if entry is None or not entry.learnt:
        learnt = ", ".join(name for name, row in DETECTORS.items() if row.learnt)
        raise ConfigError(f"detector: expected one of {learnt}; got '{detector}'")
    module = importlib.import_module(entry.module)
    network: Network = getattr(module, entry.name)(config_of(detector, config), site)
    return network


def digest(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()[:16]


def save(
    file: Path, network: nn.Module, optimizer: dict[str, Tensor], provenance: Provenance
) -> None:
    """Writes a checkpoint. If this fails, raises OSError; an existing file does not change."""
    tensors = {f"network.{k}": v.contiguous() for k, v in network.state_dict().items()}
    tensors |= {f"optimizer.{k}": v.contiguous() for k, v in optimizer.items()}
    write(file, tensors, provenance)


def write(file: Path, tensors: dict[str, Tensor], provenance: Provenance) -> None:
    """Writes a checkpoint from tensors of any precision by name. Raises OSError as `save`."""
    try:
        with replacing(file) as beside:
            save_file(tensors, beside, metadata={"about": yaml.safe_dump(as_plain(provenance))})
    except (OSError, SafetensorError) as error:
        raise OSError(getattr(error, "errno", None) or 5, str(error), str(file)) from None


def load(file: Path) -> Checkpoint:
    """Reads a checkpoint.

    Raises FileNotFoundError, and ConfigError for a file that is not a checkpoint of this format.
    """
    with opened(file, "pt") as weights:
        return Checkpoint(provenance_of(weights, file), tensors_of(weights))
