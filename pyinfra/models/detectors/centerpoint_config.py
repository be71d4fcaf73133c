"""Sizes of CenterPoint on pillars (centerpoint_pillar.py); this module needs no PyTorch."""

from dataclasses import dataclass, field

from pyinfra.core.config import ruled
from pyinfra.core.errors import Error
from pyinfra.core.vocabulary import VEHICLES, ObjectClass
from pyinfra.models.detectors.bev_config import BevConfig


@dataclass(frozen=True)
class Config:
    """Sizes of the network; the defaults are the published sizes."""

    pillar_m: float = ruled(0.2, 0.05, 2)  # side of a pillar
    pillar_width: int = ruled(64, 1, 512)  # channels of a pillar
    intensity: bool = True  # whether intensity is an input; each LiDAR has its own scale
    place: bool = True  # whether x and y are inputs; networks for many sites do not use them
    age: bool = False  # whether the age of points in stacked frames is an input (--accumulate)
    bev: BevConfig = field(default_factory=BevConfig)
    head_width: int = ruled(64, 1, 512)  # channels of the layer that heat map and boxes share
    # whether the axis of a box and its direction along this axis are predicted separately; useful
    # if traffic moves in all directions
    axis: bool = False
    classes: tuple[ObjectClass, ...] = ruled(VEHICLES, once=True)  # classes that are distinguished

    @property
    def columns(self) -> int:
        """Columns that the network uses: x y z intensity [age]."""
        return 4 + self.age

    def __post_init__(self) -> None:
        if not self.classes:
            raise Error("classes: expected at least 1 class, got none")
