"""Requirements of stressors on a data set.

Each function returns why the data set `base` does not meet a requirement, or an empty text if it
does.
"""

from __future__ import annotations

import yaml

from pyinfra.core.vocabulary import PRESETS
from pyinfra.dataset.catalogue import lidar_file
from pyinfra.dataset.runs import SimulatorError, infrasim
from pyinfra.experiments.stress import lidar
from pyinfra.experiments.stress.altered_scenes import Base

CLOUDS_ALONE = "allowed stressors of clouds alone"


def scene(base: Base) -> str:
    """Requires a simulated scene whose files, recorded trajectories included, are available."""
    folder = base.folder.parent
    if not base.scene:
        return f"{folder}: found no dataset.yaml, {CLOUDS_ALONE}"
    if "roads" not in base.scene:
        return f"{folder / 'dataset.yaml'}: found no roads, as of a recording, {CLOUDS_ALONE}"
    for key in ("static_layers", "lanes", "meshes"):
        if base.scene.get(key):
            problem = f"{folder / 'dataset.yaml'}: {key}: found files that a run does not copy"
            return f"{problem}, {CLOUDS_ALONE}"
    recorded = base.trajectories
    if recorded is not None and not recorded.is_file():
        return f"{recorded}: found no such file, needed to simulate again"
    return ""


def rays(base: Base) -> str:
    """Requires the scan pattern of the LiDAR, with its table files."""
    file = base.lidar_file
    if not file.is_file():
        return f"{file}: found no such file, needed to simulate the fused frames again"
    config = lidar.read(file)
    if not lidar.units_of(config):
        return f"{file}: found no pattern, as of a recording, {CLOUDS_ALONE}"
    for table in lidar.table_files(config, file.parent):
        if not table.is_file():
            return f"{file}: pattern.table.file: found no file {table}, allowed a copy of it there"
    return ""


def seam(base: Base) -> str:
    """Requires a spinning LiDAR, or a bundle with a spinning unit."""
    file = base.lidar_file
    return (
        ""
        if lidar.spins(lidar.read(file))
        else f"{file}: pattern: found none that spins, needed for a seam"
    )


def traffic(base: Base) -> str:
    """Requires simulated traffic, not recorded trajectories."""
    if not base.scene.get("traffic"):
        file = base.folder.parent / "dataset.yaml"
        return f"{file}: traffic: found recorded trajectories, allowed simulated traffic"
    return ""


def several_mounts(base: Base) -> str:
    """Requires fused frames of several mounts."""
    if not base.is_fused:
        return f"{base.folder.parent}: found frames of one mount, allowed fused ones"
    return ""


def one_mount(base: Base) -> str:
    """Requires frames of one mount."""
    if base.is_fused:
        problem = f"found fused frames of {', '.join(base.mounts)}"
        return f"{base.folder.parent}: {problem}, allowed those of one mount"
    return ""


def known_preset(base: Base) -> str:
    """Requires a preset that LiDARs of the catalogue have."""
    preset = base.lidar.preset
    if preset not in PRESETS:
        allowed = f"{', '.join(PRESETS)}, which the catalogue has"
        return f"{base.folder / lidar.FILE}: preset: found '{preset}', allowed {allowed}"
    return ""


def catalogue(base: Base) -> str:
    """Requires an unchanged LiDAR of the catalogue, whose other presets are known."""
    file = base.lidar_file
    shipped = lidar_file(base.lidar.name)
    if not shipped.is_file():
        return f"{file}: name: found '{base.lidar.name}', allowed a LiDAR of the catalogue"
    try:
        text = infrasim("check", shipped, "--preset", base.lidar.preset)
    except SimulatorError as error:
        return str(error)
    key = lidar.difference(lidar.read(file), yaml.safe_load(text))
    if key:
        return f"{file}: {key}: found another than in {shipped}, allowed a LiDAR of the catalogue"
    return ""
