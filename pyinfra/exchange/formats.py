"""The supported formats, and the modules that read or write them.

A module that writes a format has a function `export(lidar_folder, frames, out)`, which writes to
the empty folder `out`. A module that reads a format has a function `read(source, options)`, which
returns a Recording.
"""

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
    """The modules of a format, and the format's conventions. Modules are imported on first use."""

    export: str = ""
    read: str = ""
    # Import format that reads exports of this format; empty if no format reads them.
    back: str = ""
    # Python packages that are needed to read or write the format.
    packages: str = ""
    extra: str = ""  # extra of pyproject.toml that installs the optional packages
    # Whether z is vertical in the format's clouds. With None, z is vertical in labelled clouds.
    level: bool | None = None
    # Largest intensity in the format, or None to determine the value from the clouds.
    intensity_max: float | None = None


LZF, MCAP = "python-neo-lzf", "mcap, mcap-ros2-support"
FORMATS = {
    "kitti": Format(export="kitti_export", read="kitti_folder", back="kitti"),
    "openpcdet": Format(export="openpcdet", read="openpcdet", back="openpcdet"),
    "mmdet3d": Format(export="mmdet3d"),
    "pcd": Format(export="pcd", read="pcd", back="pcd", packages=LZF, extra="exchange"),
    "mcap": Format(export="mcap", back="bag", packages=MCAP, extra="exchange"),
    "nuscenes": Format(
        export="nuscenes", read="nuscenes_tables", back="nuscenes", level=True, intensity_max=255.0
    ),
    "openlabel": Format(export="openlabel", back="openpcdet"),
    "bag": Format(read="bag", packages="rosbags", extra="bag"),
    "pcap": Format(read="velodyne_packets", packages="velodyne-decoder", extra="pcap", level=False),
    "las": Format(read="las", packages="laspy, lazrs", extra="las"),
    "ply": Format(read="ply"),
    "csv": Format(read="csv_clouds", packages="pandas"),
    "bin": Format(read="bin_folder"),
    "dair-v2x": Format(
        read="dair", packages=LZF, extra="exchange", level=True, intensity_max=255.0
    ),
    "tumtraf": Format(read="tumtraf", packages=LZF, extra="exchange", level=False),
    "rcooper": Format(read="rcooper", packages=LZF, extra="exchange", level=False),
}
EXPORTS = tuple(name for name, format in FORMATS.items() if format.export)
IMPORTS = tuple(name for name, format in FORMATS.items() if format.read)


def exporter(name: str) -> Export:
    """Returns the export function of a format.

    Raises ImportError if packages are missing; the message names the extra that installs them.
    """
    return cast(Export, module(FORMATS[name].export, FORMATS[name].extra).export)


def reader(name: str) -> Read:
    """Returns the read function of a format. Raises ImportError like `exporter`."""
    return cast(Read, module(FORMATS[name].read, FORMATS[name].extra).read)


def module(name: str, extra: str) -> ModuleType:
    """Imports a module of this package. Raises ImportError if packages of `extra` are missing."""
    try:
        return importlib.import_module(f"pyinfra.exchange.{name}")
    except ModuleNotFoundError as error:
        if not extra or (error.name or "").startswith("pyinfra"):
            raise
        raise missing(error.name, extra) from None
