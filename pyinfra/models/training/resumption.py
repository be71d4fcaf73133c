"""Resumes a training at its last checkpoint, if its settings are the same."""

from dataclasses import dataclass, field
from pathlib import Path

import torch
from torch import Tensor

from pyinfra.core.config import as_plain, read_config
from pyinfra.core.errors import ConfigError
from pyinfra.models.detectors.catalogue import config_of
from pyinfra.models.detectors.network import Network
from pyinfra.models.training import checkpoint
from pyinfra.models.training.checkpoint import Checkpoint
from pyinfra.models.training.provenance import Provenance
from pyinfra.models.training.recipe import Learning, Precision
from pyinfra.models.training.samples import Augmentation

PASSING = ("step", "version")  # fields of a checkpoint that may differ when a training resumes


def optimizer_tensors(optimizer: torch.optim.Optimizer) -> dict[str, Tensor]:
    return {
        f"{index}.{name}": tensor
        for index, state in optimizer.state_dict()["state"].items()
        for name, tensor in state.items()
    }


@dataclass(frozen=True)
class Description(Provenance):
    """`run.yaml`: the description of a checkpoint, and the settings of its training."""

    learning: Learning = field(default_factory=Learning)
    augmentation: Augmentation = field(default_factory=Augmentation)
    frames: int = 0  # number of training frames
    precision: Precision = "float32"
    drawn: str = ""  # how the samples of a stream are chosen, or a digest of the labels


def read_begun(out: Path, ours: Description) -> Checkpoint | None:
    """Returns the last checkpoint of a training; None if there is none.

    Raises ConfigError if the checkpoint is from another training or has other settings.
    """
    file = out / "last.safetensors"
    if not file.exists():
        return None
    loaded = checkpoint.load(file)
    theirs, wanted = as_plain(loaded.provenance), as_plain(ours)
    if loaded.provenance.detector == ours.detector:  # adds keys that earlier versions did not have
        theirs["network"] = as_plain(config_of(ours.detector, theirs["network"]))
    if not ours.frames_version:  # recorded frames, for which earlier versions wrote no key
        theirs["frames_version"] = ""
    different = [key for key in theirs if key not in PASSING and theirs[key] != wanted[key]]
    if different:
        raise ConfigError(
            f"{file}: expected a checkpoint of this training, got a checkpoint with different "
            f"values of {', '.join(different)}; choose another folder"
        )
    described = out / "run.yaml"
    before, now = (_ways(d) for d in (read_config(described, Description), ours))
    if not before["drawn"]:  # the file is from a version that wrote no digest
        del before["drawn"]
    for key, value in before.items():
        if value != now[key]:
            raise ConfigError(
                f"{described}: {key}: expected {now[key]} to resume the training, got {value}"
            )
    return loaded


def _ways(description: Description) -> dict[str, object]:
    """Returns the settings of a training by key, such as `learning.steps`."""
    plain = as_plain(description)
    settings = {key: plain[key] for key in ("frames", "precision", "drawn")}
    return settings | {
        f"{name}.{key}": value
        for name in ("learning", "augmentation")
        for key, value in plain[name].items()
    }


def resume(network: Network, optimizer: torch.optim.Optimizer, begun: Checkpoint) -> int:
    """Loads network and optimiser from a checkpoint; returns the number of finished steps."""
    network.load_state_dict(begun.weights())
    state: dict[int, dict[str, Tensor]] = {}
    for key, tensor in begun.tensors.items():
        if key.startswith("optimizer."):
            _, index, name = key.split(".")
            state.setdefault(int(index), {})[name] = tensor
    groups = optimizer.state_dict()["param_groups"]
    optimizer.load_state_dict({"state": state, "param_groups": groups})
    return begun.provenance.step
