"""Imports a file of trajectories as the traffic of a site's folder."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from pyinfra.core.errors import Error, FormatError
from pyinfra.core.names import check_name
from pyinfra.scenes.maps import fcd, recorded_boxes, site_folder
from pyinfra.scenes.maps.lane_heights import height_notes, on_lanes
from pyinfra.scenes.maps.site_traffic import RECORD
from pyinfra.scenes.maps.tracks import CLASSES, lasts_s
from pyinfra.scenes.maps.traffic_figures import report_lines
from pyinfra.scenes.maps.trajectory_file import NAME, write_trajectories
from pyinfra.scenes.maps.trajectory_import import ImportedTracks, import_boxes, import_fcd


def write_recorded(
    file: Path,
    site: Path,
    *,
    columns: Mapping[str, str],
    classes: Mapping[str, str],
    rate_hz: float | None = None,
    in_world: bool = False,
    degrees: bool = False,
) -> list[str]:
    """Writes trajectories.csv of a site, sets its duration, and returns the lines of a report.

    The arguments are those of `pyinfra.import_trajectories`. Raises FileNotFoundError, Error for an
    argument out of range, and FormatError, which names the file.
    """
    if rate_hz is not None and not 0.1 <= rate_hz <= 10_000:
        raise Error(f"rate_hz: expected 0.1 to 10000, got {rate_hz:g}")
    for name in classes.values():
        check_name(name, CLASSES, "classes")
    if not site.is_dir():
        raise FileNotFoundError(f"{site}: expected an existing site folder, got no such folder")
    offset = np.zeros(3) if in_world else site_folder.offset(site)
    how = recorded_boxes.BoxColumns(dict(columns), dict(classes), rate_hz, degrees)
    try:
        imported, notes = _read(file, site, how, offset)
    except FormatError as error:
        text = str(error)
        named = text if text.startswith(str(file)) else f"{file}: {text}"
        raise FormatError(named) from error
    write_trajectories(site / NAME, imported.tracks)
    (site / RECORD).unlink(missing_ok=True)
    has_scene = (site / site_folder.SCENE).exists()
    if has_scene:
        site_folder.set_duration(site, lasts_s(imported.tracks))
    feet = site_folder.feet(site) if has_scene else np.zeros((1, 2))
    notes += [*height_notes(site, imported.tracks), *imported.notes]
    return list(report_lines(site / NAME, imported.tracks, feet, notes))


def _read(
    file: Path, site: Path, how: recorded_boxes.BoxColumns, offset: np.ndarray
) -> tuple[ImportedTracks, list[str]]:
    """Reads tracks from a file or folder; returns them with notes on their heights."""
    if file.suffix.lower() in (".xml", ".gz") or fcd.is_fcd_csv(file):
        projection, has_site = site_folder.projection(site), (site / site_folder.SCENE).exists()
        recorded = fcd.read_fcd(file)
        return import_fcd(recorded, how.classes, offset, projection, has_site=has_site), []
    if file.is_dir():
        return import_boxes(recorded_boxes.read_frames(file), np.zeros(3)), []
    boxes, notes = on_lanes(site, recorded_boxes.read_boxes(file, how), offset)
    return import_boxes(boxes, offset), notes
