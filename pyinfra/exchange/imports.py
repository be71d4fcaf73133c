"""`pyinfra import SOURCE --from FORMAT --out DATA/LIDAR`."""

from __future__ import annotations

import math
from pathlib import Path

from pyinfra.atomic import new_folder
from pyinfra.exchange.data_set import Found, LidarFacts, write_description, write_lidar
from pyinfra.exchange.formats import reader
from pyinfra.exchange.rates import Shown
from pyinfra.exchange.recording import Options
from pyinfra.kitti import VEHICLE_TYPES


def import_recording(
    source: Path, name: str, out: Path, about: LidarFacts, options: Options
) -> tuple[Found, bool]:
    """Writes a recording in a format of IMPORTS as the new folder DATA/LIDAR, whole or not at all.

    Returns what was in it, and whether it has labels. Raises what the format raises, and
    FileExistsError.
    """
    read = reader(name)
    if source.exists() and not source.is_dir():
        raise ValueError(
            f"{source}: found a file, allowed a folder: archives are not unpacked, and pickles "
            "never read because reading one can run what is in it"
        )
    recording = read(source, options)
    with new_folder(out) as beside:
        found = write_lidar(recording, beside, about, Shown(range(len(recording.names))))
        write_description(out.parent, about.scene, ids_are_tracks=recording.ids_are_tracks)
    return found, recording.labelled


def warnings(found: Found, labelled: bool) -> list[str]:
    """What the user should know of the imported frames."""
    out = []
    if not labelled:
        out.append("found no labels: networks, statistics of vehicles and evaluation need them")
    elif not set(found.types) & set(VEHICLE_TYPES):
        names = ", ".join(found.types) or "none"
        out.append(f"found no vehicle among {names}; --type NAME=Car says what is one")
    if found.without_return:
        out.append(
            f"left out {found.without_return} points without a return (not finite, or 0 0 0)"
        )
    return out


def checked(options: Options) -> Options:
    """Raises ValueError for a number out of range."""
    highest, columns = options.intensity_max, options.columns
    if highest is not None and not 0 < highest < math.inf:
        raise ValueError(f"--intensity-max: found {highest:g}, allowed above 0")
    if columns is not None and not 4 <= columns <= 64:
        raise ValueError(f"--columns: found {columns}, allowed 4 to 64")
    return options
