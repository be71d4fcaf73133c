"""Which formats there are, and where each is written or read.

A module that writes has `export(lidar_folder, frames, out)`: the whole export goes into the empty
folder `out`. One that reads has `read(source, options)`, which gives a Recording.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import cast

from pyinfra.core.errors import missing
from pyinfra.exchange.recording import Options, Recording

Export = Callable[[Path, Sequence[int], Path], None]
Read = Callable[[Path, Options], Recording]


@dataclass(frozen=True)
class Format:
    """Modules of this package; they are imported when they are asked for."""

    export: str = ""
    read: str = ""
    extra: str = ""  # of pyproject.toml: the packages that not everybody has
    level: bool | None = None  # whether clouds stand upright; None: if they are labelled
    intensity_max: float | None = None  # that the format says; None: as the clouds have it


FORMATS = {
    "kitti": Format(read="kitti_folder"),
    "openpcdet": Format(export="openpcdet", read="openpcdet"),
    "mmdet3d": Format(export="mmdet3d"),
    "pcd": Format(export="pcd", read="pcd", extra="exchange"),
    "mcap": Format(export="mcap", extra="exchange"),
    "nuscenes": Format(export="nuscenes", read="nuscenes_tables", level=True, intensity_max=255.0),
    "openlabel": Format(export="openlabel"),
    "bin": Format(read="bin_folder", level=False),
    "dair-v2x": Format(read="dair", extra="exchange", level=True, intensity_max=255.0),
    "tumtraf": Format(read="tumtraf", extra="exchange", level=False),
    "rcooper": Format(read="rcooper", extra="exchange", level=False),
}
EXPORTS = tuple(name for name, format in FORMATS.items() if format.export)
IMPORTS = tuple(name for name, format in FORMATS.items() if format.read)


def exporter(name: str) -> Export:
    """Raises ImportError that names the extra whose packages are missing."""
    return cast(Export, _module(FORMATS[name].export, FORMATS[name].extra).export)


def reader(name: str) -> Read:
    """Raises ImportError as `exporter` does."""
    return cast(Read, _module(FORMATS[name].read, FORMATS[name].extra).read)


def _module(module: str, extra: str) -> ModuleType:
    try:
        return importlib.import_module(f"pyinfra.exchange.{module}")
    except ModuleNotFoundError as error:
        if not extra or (error.name or "").startswith("pyinfra"):
            raise
        raise missing(error.name, extra) from None
