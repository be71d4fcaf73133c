"""Imports a map file as a site folder with scene, lanes, meshes, network and import record."""

import math
import tempfile
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from pyinfra.core.files import new_folder, write
from pyinfra.formats.yaml_file import read_keys
from pyinfra.scenes.maps.disagreements import disagreements
from pyinfra.scenes.maps.lane_map import (
    MapError,
    SiteMap,
    checked_lanes,
    steep_lanes,
    with_unique_names,
)
from pyinfra.scenes.maps.map_file import digest, format_of, unpacked
from pyinfra.scenes.maps.map_readers import READERS, ImportOptions
from pyinfra.scenes.maps.mount_guess import HEIGHT_M, Pole, guess_pole
from pyinfra.scenes.maps.network import KERB_M
from pyinfra.scenes.maps.site_folder import MAP, check_metres
from pyinfra.scenes.maps.site_writer import write_site, yaml_text
from pyinfra.scenes.maps.surfaces import surfaces

MOST_TRIANGLES = 20_000_000
VERSION = 5  # version of the import's output


def import_map(file: Path, out: Path, options: ImportOptions | None = None) -> dict[str, Any]:
    """Writes the site folder, unless it already has the result of the same import.

    Returns the content of map.yaml. Raises MapError, FormatError for a mount in degrees, and
    FileExistsError if the folder has other content. Raises ImportError if SUMO or osmium is needed
    but not installed.
    """
    options = options or ImportOptions()
    kind = format_of(file)
    identity = {
        "source": file.name,
        "sha256": digest(file),
        "import": VERSION,
        **{k: list(v) if isinstance(v, tuple) else v for k, v in asdict(options).items()},
    }
    if (out / MAP).exists():
        record = read_keys(out / MAP)
        if {k: record.get(k) for k in identity} == identity:
            return record
        raise FileExistsError(f"{out}: expected a new folder, got the folder of a different import")
    with new_folder(out) as folder, tempfile.TemporaryDirectory() as scratch:
        plain = unpacked(file, kind, Path(scratch))
        try:
            site_map, origin = READERS[kind](plain, folder, Path(scratch), options)
        except MapError as error:
            raise MapError(str(error).replace(str(plain), str(file))) from error
        site_map.lanes = checked_lanes(with_unique_names(site_map.lanes), str(file))
        site_map.not_understood += disagreements(site_map.lanes) + steep_lanes(site_map.lanes)
        meshes, terrain = surfaces(site_map, KERB_M)
        triangles = sum(len(mesh.faces) for mesh in meshes.values())
        if triangles > MOST_TRIANGLES:
            raise MapError(
                f"{file}: expected up to {MOST_TRIANGLES} triangles, got more; use a smaller "
                "`radius_m`"
            )
        pole, assumption = _pole(site_map, folder, options, origin["offset_m"])
        site_map.guessed += [assumption] if assumption else []
        write_site(folder, out.name, site_map, meshes, pole, options, terrain)
        record = {
            **identity,
            **origin,
            "lanes": len(site_map.lanes),
            "triangles": triangles,
            "pole": asdict(pole),
            "features": _listed(site_map),
            "guessed": site_map.guessed,
            "mended": site_map.mended,
            "not_understood": site_map.not_understood,
        }
        write(folder / MAP, yaml_text(record))
    return record


def _listed(site_map: SiteMap) -> dict[str, list[dict[str, Any]]]:
    """Maps each kind to the list of its features, with their name in the map, position and tags."""
    by_kind: dict[str, list[dict[str, Any]]] = {}
    for feature in site_map.features:
        position = {"x_m": round(feature.x_m, 2), "y_m": round(feature.y_m, 2)}
        row = {"id": feature.source, **position, **feature.tags}
        by_kind.setdefault(feature.kind, []).append(row)
    return dict(sorted(by_kind.items()))


def _pole(
    site_map: SiteMap, folder: Path, options: ImportOptions, offset_m: Sequence[float]
) -> tuple[Pole, str]:
    if options.mount is not None:
        x, y = options.mount[:2]
        check_metres(folder, np.array([[x, y]]), "mount")
        if not math.hypot(x, y) <= options.radius_m:
            at = ", ".join(f"{v:g}" for v in offset_m[:2])
            of_map = f" ({at} in the coordinates of the map)" if any(offset_m) else ""
            raise MapError(
                f"mount: expected a position within {options.radius_m:g} m of the site's "
                f"origin{of_map}, got {x:g}, {y:g}"
            )
        return Pole(*options.mount), ""
    pole, beside = guess_pole(site_map)
    return pole, f"the pole, {HEIGHT_M:g} m high, beside {beside}"
