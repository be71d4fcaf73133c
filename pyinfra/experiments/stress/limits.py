"""Requirements of stressors on a data set.

Each function returns the reason why the data set `base` does not meet a requirement. The text is
empty if the data set meets the requirement.
"""

import yaml

from pyinfra.core.vocabulary import PRESETS
from pyinfra.dataset.catalogue import lidar_file
from pyinfra.dataset.frames_version import number_at
from pyinfra.dataset.runs import SimulatorError, infrasim
from pyinfra.dataset.simulation import frames_version
from pyinfra.experiments.stress import lidar
from pyinfra.experiments.stress.altered_scenes import Base

ONLY_CLOUDS = "expected stressors that only change clouds"


def scene(base: Base) -> str:
    """Requires a simulated scene whose files, including recorded trajectories, are available.

    The frames_version of the frames must be that of the simulator. Otherwise results would also
    differ because of the two versions of the simulator.
    """
    folder, file = base.folder.parent, base.trajectories
    described, number = folder / "dataset.yaml", number_at(base.folder) or "none"
    faults = (
        (not base.scene, f"{folder}: {ONLY_CLOUDS}, because there is no dataset.yaml"),
        (
            "roads" not in base.scene,
            f"{described}: {ONLY_CLOUDS}, because a recording has no roads",
        ),
        *(
            (
                base.scene.get(key),
                f"{described}: {key}: {ONLY_CLOUDS}, because a run does not copy the files of this "
                "key",
            )
            for key in ("static_layers", "lanes", "meshes")
        ),
        (
            file is not None and not file.is_file(),
            f"{file}: expected this file, got none; the scene is simulated again with this file",
        ),
        (
            number != str(frames_version()),
            f"{described}: frames_version: expected {frames_version()} for stressors that change "
            f"more than clouds, got {number}",
        ),
    )
    return next((text for is_fault, text in faults if is_fault), "")


def rays(base: Base) -> str:
    """Requires the scan pattern of the LiDAR, with its table files."""
    file = base.lidar_file
    if not file.is_file():
        return f"{file}: expected this file, got none; the LiDAR is simulated again with this file"
    config = lidar.read(file)
    if not lidar.units_of(config):
        return f"{file}: {ONLY_CLOUDS}, because a recording has no pattern"
    for table in lidar.table_files(config, file.parent):
        if not table.is_file():
            return f"{file}: pattern.table.file: expected the file {table}, got none"
    return ""


def cut_angle(base: Base) -> str:
    """Requires a spinning LiDAR, or a bundle with a spinning unit."""
    if lidar.spins(lidar.read(base.lidar_file)):
        return ""
    return f"{base.lidar_file}: pattern: expected a spinning unit for a cut angle, got none"


def traffic(base: Base) -> str:
    """Requires simulated traffic, not recorded trajectories."""
    if base.scene.get("traffic"):
        return ""
    file = base.folder.parent / "dataset.yaml"
    return f"{file}: traffic: expected simulated traffic, got recorded trajectories"


def several_mounts(base: Base) -> str:
    """Requires fused frames of several mounts."""
    if not base.is_fused:
        return f"{base.folder.parent}: expected fused frames of two mounts or more, got one mount"
    return ""


def one_mount(base: Base) -> str:
    """Requires frames of one mount."""
    if not base.is_fused:
        return ""
    fused = ", ".join(base.mounts)
    return f"{base.folder.parent}: expected frames of one mount, got fused frames of {fused}"


def known_preset(base: Base) -> str:
    """Requires a preset that LiDARs of the catalogue have."""
    preset = base.lidar.preset
    if preset not in PRESETS:
        allowed = f"{', '.join(PRESETS)}, the presets of the catalogue"
        return f"{base.folder / lidar.FILE}: preset: expected {allowed}, got '{preset}'"
    return ""


def catalogue(base: Base) -> str:
    """Requires an unchanged LiDAR of the catalogue, whose other presets are known."""
    file = base.lidar_file
    shipped = lidar_file(base.lidar.name)
    if not shipped.is_file():
        return f"{file}: name: expected a LiDAR of the catalogue, got '{base.lidar.name}'"
    try:
        text = infrasim("check", shipped, "--preset", base.lidar.preset)
    except SimulatorError as error:
        return str(error)
    key = lidar.difference(lidar.read(file), yaml.safe_load(text))
    if key:
        return (
            f"{file}: {key}: expected the value of the catalogue, in {shipped}, got a different one"
        )
    return ""
