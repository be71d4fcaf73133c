"""The scenes, LiDARs and references that come with the package."""

from pathlib import Path

from pyinfra.dataset import launch

SCENES = ("highway", "crossroad", "curve")
LIDARS = ("livox_avia", "helios_16", "pandar_64", "ruby_plus")
FLAT = "flat"


def configs() -> Path:
    """The folder of scenes, LiDARs and references: that of the wheel, else of the source tree."""
    inside = launch.PACKAGE / "configs"
    return inside if inside.is_dir() else launch.PACKAGE.parent / "configs"


def scene_file(name: str) -> Path:
    """File of a scene that comes with the package."""
    return configs() / "scenes" / f"{name}.yaml"


def lidar_file(name: str) -> Path:
    """File of a LiDAR that comes with the package."""
    return configs() / "lidars" / f"{name}.yaml"
