"""Directions and density of a LiDAR's rays, without a scene. Needs the compiled extension."""

import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import yaml

from pyinfra.core.arrays import FloatArray, IntArray
from pyinfra.core.files import resolved
from pyinfra.formats.kitti import read_keys, read_written_keys

CELL_DEG = 0.28
FIELD_S = 4.0
TIMES_S = (0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.7, 1.0, 1.5, 2.0)
DENSITY_S = 1.0
OFF_AXIS_EDGES_DEG = np.arange(0.0, 91.0, 1.0)
ELEVATION_EDGES_DEG = np.arange(-40.0, 41.0, 2.0)
HALF_WIDTH_DEG = 10.0
CONFIG_KEYS = ("name", "model", "price_usd", "pattern", "bundle")


@dataclass(frozen=True, eq=False)
class Rays:
    """Directions and times of n rays in the sensor's frame."""

    azimuth_deg: FloatArray  # (n,) azimuths, without a jump within the field of view
    elevation_deg: FloatArray  # (n,) elevations
    time_s: FloatArray  # (n,) time since the start of the run


def read_rays(lidar_yaml: Path, seconds: float, period_s: float) -> Rays:
    """Returns the rays of the LiDAR in the `lidar.yaml` of a data set, from time 0 to `seconds`.

    The phase of the pattern is 0. Raises ConfigError for an invalid file.
    """
    from pyinfra.dataset import simulation

    written = read_written_keys(lidar_yaml)
    config = {key: written[key] for key in CONFIG_KEYS if written.get(key)}
    if table := config.get("pattern", {}).get("table"):
        table["file"] = str(resolved(lidar_yaml.parent / table["file"]))
    config["presets"] = {"run": {"returns": written["returns"]}}
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "lidar.yaml"
        file.write_text(yaml.safe_dump(config), encoding="utf-8")
        frames = int(np.ceil(seconds / period_s - 1e-9))
        rays = simulation.scan_pattern(file, range(frames), preset="run")
    rays = rays[rays[:, 2] < seconds - 1e-9]
    azimuth = np.degrees(rays[:, 0])
    # If a field of view contains the azimuth 180 degrees, azimuths continue above 180.
    middle = sum(written["field_of_view"][0]["azimuth_deg"]) / 2
    azimuth[azimuth < middle - 180] += 360
    return Rays(azimuth, np.degrees(rays[:, 1]), rays[:, 2])


def has_pattern(lidar_yaml: Path) -> bool:
    """Returns whether a `lidar.yaml` has a scan pattern. Recordings and bundles have none."""
    return "returns" in read_keys(lidar_yaml)


def lit_share(rays: Rays, times_s: tuple[float, ...] = TIMES_S) -> pd.DataFrame:
    """Returns the share of the field of view that rays have covered after each time.

    The field of view is divided into cells of CELL_DEG of azimuth and elevation. A ray covers the
    cell in which it lies. A row of cells has one elevation. In each row, the field of view extends
    between the outermost rays. A row without rays has the width of the row below. Columns: time_s,
    lit_percent, field_deg2 (product of azimuth and elevation in square degrees, not a solid angle).
    """
    column = np.floor(rays.azimuth_deg / CELL_DEG).astype(np.int64)
    row = np.floor(rays.elevation_deg / CELL_DEG).astype(np.int64)
    width = int(np.ptp(column)) + 1
    key = (row - row.min()) * width + column - column.min()
    cells = _field_cells(row - row.min(), column - column.min())
    _, first = np.unique(key, return_index=True)  # first ray of each cell; rays are ordered by time
    lit_at = rays.time_s[first]
    return pd.DataFrame(
        [
            {
                "time_s": time,
                "lit_percent": 100 * np.count_nonzero(lit_at < time - 1e-9) / cells,
                "field_deg2": cells * CELL_DEG**2,
            }
            for time in times_s
        ]
    )


def angular_density(rays: Rays, seconds: float = DENSITY_S) -> pd.DataFrame:
    """Returns the mean density of the rays up to the time `seconds`, per second and square degree.

    Column axis is `off_axis` for rings around the x axis, and `elevation` for rows of elevation
    within HALF_WIDTH_DEG of the x axis. Other columns: from_deg, to_deg, rays, density.
    """
    keep = rays.time_s < seconds - 1e-9
    azimuth, elevation = np.radians(rays.azimuth_deg[keep]), np.radians(rays.elevation_deg[keep])
    off_axis = np.arccos(np.clip(np.cos(azimuth) * np.cos(elevation), -1, 1))
    rings = 2 * np.pi * -np.diff(np.cos(np.radians(OFF_AXIS_EDGES_DEG)))
    ahead = np.abs(azimuth) <= np.radians(HALF_WIDTH_DEG)
    rows = 2 * np.radians(HALF_WIDTH_DEG) * np.diff(np.sin(np.radians(ELEVATION_EDGES_DEG)))
    return pd.concat(
        [
            _density("off_axis", off_axis, OFF_AXIS_EDGES_DEG, rings, seconds),
            _density("elevation", elevation[ahead], ELEVATION_EDGES_DEG, rows, seconds),
        ],
        ignore_index=True,
    )


def _density(
    axis: str, angle: FloatArray, edges_deg: FloatArray, solid_angle: FloatArray, seconds: float
) -> pd.DataFrame:
    """Returns the density of rays in bins of `angle`; solid_angle: (bins,) steradians."""
    counts, _ = np.histogram(np.degrees(angle), edges_deg)
    square_degrees = solid_angle * np.degrees(1) ** 2
    return pd.DataFrame(
        {
            "axis": axis,
            "from_deg": edges_deg[:-1],
            "to_deg": edges_deg[1:],
            "rays": counts,
            "density": counts / square_degrees / seconds,
        }
    )


def _field_cells(row: IntArray, column: IntArray) -> int:
    """Returns the number of cells in the field of view.

    A row has the cells between its outermost rays. A row without rays has as many cells as the row
    below it. row, column: cell indices of the rays.
    """
    rows = int(row.max()) + 1
    low, high = np.full(rows, np.iinfo(np.int64).max), np.full(rows, -1)
    np.minimum.at(low, row, column)
    np.maximum.at(high, row, column)
    extent = high - low + 1
    used = np.where(high >= 0, np.arange(rows), 0)
    return int(extent[np.maximum.accumulate(used)].sum())
