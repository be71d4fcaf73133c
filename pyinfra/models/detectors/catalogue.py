"""The detectors by name; a new detector needs a file and a row here."""

import importlib
from dataclasses import dataclass
from typing import Any

from pyinfra.core.config import from_plain
from pyinfra.models.pytorch import need_pytorch


@dataclass(frozen=True)
class Entry:
    """Module and class of a detector. A module also has a class `Config`.

    learnt: whether the detector is a network that is trained. config_module: another module that
    has the class `Config` and needs no PyTorch.
    """

    module: str
    name: str
    learnt: bool = True
    config_module: str = ""

    @property
    def config(self) -> Any:
        """The class of the detector's settings. Raises MissingPackage if PyTorch is missing."""
        if self.learnt and not self.config_module:
            need_pytorch()
        return importlib.import_module(self.config_module or self.module).Config


DETECTORS = {
    "background": Entry("pyinfra.models.detectors.background", "Background", learnt=False),
    "pointpillars": Entry("pyinfra.models.detectors.pointpillars", "PointPillars"),
    "pointrcnn": Entry("pyinfra.models.detectors.pointrcnn", "PointRCNN"),
    "pointrcnn-remedied": Entry("pyinfra.models.detectors.pointrcnn", "PointRCNN"),
    "centerpoint-pillar": Entry(
        "pyinfra.models.detectors.centerpoint_pillar",
        "CenterPointPillar",
        config_module="pyinfra.models.detectors.centerpoint_config",
    ),
    "dsvt": Entry("pyinfra.models.detectors.dsvt", "Dsvt"),
    "pv-rcnn": Entry("pyinfra.models.detectors.pv_rcnn", "PvRcnn"),
}


def config_of(detector: str, config: Any) -> Any:
    """Returns a detector's Config from plain values; missing keys get their defaults."""
    kind = DETECTORS[detector].config
    if isinstance(config, kind):
        return config
    return from_plain(config, kind, f"{detector}: network")
