"""Paths of the scenes, LiDARs and other configurations that the package ships."""

from pathlib import Path

from pyinfra.dataset import launch

SCENES = ("highway", "crossroad", "curve")
LIDARS = ("livox_avia", "helios_16", "pandar_64", "ruby_plus")
FLAT = "flat"


def configs() -> Path:
    """Returns the folder of the shipped configurations, from the wheel or the source tree."""
    inside = launch.PACKAGE / "configs"
    return inside if inside.is_dir() else launch.PACKAGE.parent / "configs"


def shipped(kind: str) -> dict[str, Path]:
    """Maps the names of shipped files to the files. `kind` is a folder such as `scenes`."""
    return {file.stem: file for file in sorted((configs() / kind).glob("*.yaml"))}


def scene_file(name: str) -> Path:
    """Returns the file of a shipped scene."""
    return configs() / "scenes" / f"{name}.yaml"


def lidar_file(name: str) -> Path:
    """Returns the file of a shipped LiDAR."""
    return configs() / "lidars" / f"{name}.yaml"
