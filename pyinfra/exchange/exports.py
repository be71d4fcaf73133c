"""`pyinfra export DATA/LIDAR --to FORMAT --out DIR`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from pyinfra.core.files import new_folder
from pyinfra.exchange.formats import exporter


def export(lidar_folder: Path, frames: Sequence[int], name: str, out: Path) -> None:
    """Writes the frames in a format of EXPORTS into a new folder, whole or not at all.

    Raises what the format raises, ValueError without a frame, and FileExistsError.
    """
    write = exporter(name)
    if not frames:
        raise ValueError(f"{lidar_folder}: found no frame to export, allowed one or more")
    with new_folder(out) as beside:
        write(lidar_folder, frames, beside)
