"""Imports a map file as a site folder: scene, lanes, meshes, network and a record of the import."""

import gzip
import hashlib
import math
import tempfile
import zlib
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import yaml

from pyinfra.core.arrays import FloatArray
from pyinfra.core.files import new_folder, write
from pyinfra.formats.ply import Triangles, write_ply
from pyinfra.scenes.maps import openstreetmap, osm_features, osm_levels
from pyinfra.scenes.maps.disagreements import disagreements
from pyinfra.scenes.maps.lane_map import (
    NARROWEST_M,
    MapError,
    MapLane,
    SiteMap,
    checked_lanes,
    steep_lanes,
    with_unique_names,
)
from pyinfra.scenes.maps.mount_guess import HEIGHT_M, Pole, guess_pole
from pyinfra.scenes.maps.netconvert import OPENDRIVE, OSM, netconvert, without_sidewalk
from pyinfra.scenes.maps.network import KERB_M, read_network
from pyinfra.scenes.maps.opendrive import read_opendrive
from pyinfra.scenes.maps.opendrive_mending import mended_for_netconvert
from pyinfra.scenes.maps.openstreetmap import opened
from pyinfra.scenes.maps.osm_pbf import PBF, write_xml
from pyinfra.scenes.maps.surfaces import Sheet, surfaces

RADIUS_M = 1000.0
LONGEST_BYTES = 2 << 30  # maximum size of a map file
MOST_TRIANGLES = 20_000_000
MATERIALS = {"buildings": "structure"}  # material by mesh; other meshes are named as theirs
FORMATS = (".xodr", ".osm", ".osm.xml", ".net.xml")  # also compressed as .gz and .bz2
PACKED = (".gz", ".bz2")
CONVERTED = {".o5m": "osmconvert {0} -o={1}.osm"}
NETWORK = "map.net.xml"
RECORD = "map.yaml"
VERSION = 3  # of the import's output


@dataclass(frozen=True)
class ImportOptions:
    """Options of a map import."""

    centre: tuple[float, float] | None = None  # x, y in the map; OSM: lon, lat (or lat, lon)
    radius_m: float = RADIUS_M
    mount: tuple[float, float, float, float] | None = None  # x, y, z, yaw_deg in the site's frame
    duration_s: float = 500.0
    region_half_length_m: float = 100.0


@dataclass(frozen=True)
class Imported:
    """A summary of an import."""

    lanes: int
    triangles: int
    pole: Pole
    record: dict[str, Any]  # content of map.yaml
    anew: bool  # False: the same import already existed


def import_map(file: Path, out: Path, options: ImportOptions | None = None) -> Imported:
    """Writes the site folder, unless it already has the result of the same import.

    Raises MapError, ImportError without SUMO or osmium, and FileExistsError if the folder has other
    content.
    """
    options = options or ImportOptions()
    kind = format_of(file)
    identity = {
        "source": file.name,
        "sha256": _digest(file),
        "import": VERSION,
        **_options_as_keys(options),
    }
    if (out / RECORD).exists():
        record = yaml.safe_load((out / RECORD).read_text())
        if isinstance(record, dict) and {k: record.get(k) for k in identity} == identity:
            return Imported(
                record["lanes"], record["triangles"], Pole(**record["pole"]), record, False
            )
        raise FileExistsError(f"{out}: expected a new folder, got one of another import")
    with new_folder(out) as folder, tempfile.TemporaryDirectory() as scratch:
        plain = _unpacked(file, kind, Path(scratch))
        try:
            site_map, origin = _READERS[kind](plain, folder, Path(scratch), options)
        except MapError as error:
            raise MapError(str(error).replace(str(plain), str(file))) from error
        site_map.lanes = checked_lanes(with_unique_names(site_map.lanes), str(file))
        site_map.not_understood += disagreements(site_map.lanes) + steep_lanes(site_map.lanes)
        meshes, terrain = surfaces(site_map, KERB_M)
        if sum(len(m.faces) for m in meshes.values()) > MOST_TRIANGLES:
            raise MapError(
                f"{file}: more than {MOST_TRIANGLES} triangles; take a smaller `radius_m`"
            )
        pole, what = _pole(site_map, options)
        site_map.guessed += [what] if what else []
        _write_site(folder, out.name, site_map, meshes, (pole, options), terrain)
        counts = {
            "lanes": len(site_map.lanes),
            "triangles": sum(len(m.faces) for m in meshes.values()),
        }
        lists = {k: getattr(site_map, k) for k in ("guessed", "mended", "not_understood")}
        record = {**identity, **origin, **counts, "pole": asdict(pole)}
        record |= {"features": _listed(site_map), **lists}
        write(folder / RECORD, _yaml(record))
    return Imported(counts["lanes"], counts["triangles"], pole, record, True)


def format_of(file: Path) -> str:
    """Returns the extension that determines the map format, without that of the compression.

    Raises MapError.
    """
    name = file.name.lower()
    for ending, command in CONVERTED.items():
        if name.endswith(ending):
            stem = file.name[: -len(ending)].removesuffix(".osm")
            raise MapError(
                f"{file}: expected XML, got {ending}: convert it first, as by "
                f"`{command.format(file.name, stem)}`"
            )
    if name.endswith(PBF):
        return ".osm"
    for packing in PACKED:
        name = name.removesuffix(packing)
    for ending in FORMATS:
        if name.endswith(ending):
            return ending
    if name.endswith(".xml") and (ending := _BY_ROOT.get(_root_of(file), "")):
        return ending
    raise MapError(
        f"{file}: expected {', '.join(FORMATS)}, plain or packed ({', '.join(PACKED)}), or "
        f".osm{PBF}, got '{file.suffix}'"
    )


_BY_ROOT = {"OpenDRIVE": ".xodr", "osm": ".osm", "net": ".net.xml"}


def _root_of(file: Path) -> str:
    """Returns the name of the first element; empty if there is none. Raises MapError if not XML."""
    try:
        with opened(file) as stream:
            for _, node in ElementTree.iterparse(stream, events=("start",)):
                return str(node.tag).rpartition("}")[2]
    except (ElementTree.ParseError, EOFError, zlib.error, gzip.BadGzipFile) as error:
        raise MapError(f"{file}: not XML that can be read: {error}") from error
    return ""


def _unpacked(file: Path, kind: str, scratch: Path) -> Path:
    """Returns the file, or a decompressed copy of it. Raises MapError and MissingPackage."""
    if file.suffix.lower() == PBF:
        write_xml(file, out := scratch / "map.osm", LONGEST_BYTES)
        return out
    if file.suffix.lower() not in PACKED:
        return file
    out = scratch / f"map{kind}"
    try:
        with opened(file) as stream, out.open("wb") as into:
            while block := stream.read(1 << 20):
                into.write(block)
                if into.tell() > LONGEST_BYTES:
                    raise MapError(f"{file}: expected up to {LONGEST_BYTES} bytes in it, got more")
    except (EOFError, zlib.error, OSError) as error:
        raise MapError(f"{file}: not a packed file that can be read: {error}") from error
    return out


def _listed(site_map: SiteMap) -> dict[str, list[dict[str, Any]]]:
    """Returns the features by kind, each with its name in the map, position and tags."""
    by_kind: dict[str, list[dict[str, Any]]] = {}
    for each in site_map.features:
        position = {"x_m": round(each.x_m, 2), "y_m": round(each.y_m, 2)}
        by_kind.setdefault(each.kind, []).append({"id": each.source, **position, **each.tags})
    return dict(sorted(by_kind.items()))


def _options_as_keys(options: ImportOptions) -> dict[str, Any]:
    return {k: list(v) if isinstance(v, tuple) else v for k, v in asdict(options).items()}


def _digest(file: Path) -> str:
    size = file.stat().st_size
    if not 0 < size <= LONGEST_BYTES:
        raise MapError(f"{file}: expected 1 to {LONGEST_BYTES}, got {size} bytes")
    with file.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _yaml(data: dict[str, Any]) -> str:
    return str(yaml.safe_dump(data, sort_keys=False, default_flow_style=None, width=100))


def _from_opendrive(
    file: Path, folder: Path, scratch: Path, options: ImportOptions
) -> tuple[SiteMap, dict[str, Any]]:
    site_map = read_opendrive(file)
    checked_lanes(site_map.lanes, str(file))
    low, high, z = _extent(site_map.lanes)
    x, y = options.centre or tuple(((low + high) / 2).round(0).tolist())
    offset = np.array([x, y, z])
    site_map.lanes = [_moved(lane, offset) for lane in site_map.lanes]
    site_map.bodies = [_moved_body(thing, offset) for thing in site_map.bodies]
    site_map.trees = [
        replace(t, x_m=t.x_m - x, y_m=t.y_m - y, base_m=None if t.base_m is None else t.base_m - z)
        for t in site_map.trees
    ]
    site_map.features = [replace(f, x_m=f.x_m - x, y_m=f.y_m - y) for f in site_map.features]
    _cut(site_map, options.radius_m, file)
    readable, changed = mended_for_netconvert(file, scratch / "readable.xodr")
    site_map.not_understood += changed
    arguments = ["--opendrive-files", str(readable), *OPENDRIVE]
    warnings = _shifted_network(file, arguments, offset, folder / NETWORK)
    network = read_network(folder / NETWORK, lanes=False)
    site_map.areas, site_map.junctions = _near(network, options.radius_m)
    site_map.guessed.append("traffic lights, where the map says none")
    return site_map, {"offset_m": offset.tolist(), "network": warnings}


def _from_network(
    file: Path, folder: Path, scratch: Path, options: ImportOptions
) -> tuple[SiteMap, dict[str, Any]]:
    read = read_network(file)
    checked_lanes(read.lanes, str(file))
    low, high, z = _extent(read.lanes)
    x, y = options.centre or tuple(((low + high) / 2).round(0).tolist())
    offset = np.array([x, y, z])
    warnings = _shifted_network(file, ["--sumo-net-file", str(file)], offset, folder / NETWORK)
    site_map = read_network(folder / NETWORK)
    _cut(site_map, options.radius_m, file)
    site_map.areas, site_map.junctions = _near(site_map, options.radius_m)
    return site_map, {"offset_m": offset.tolist(), "network": warnings}


def _from_osm(
    file: Path, folder: Path, scratch: Path, options: ImportOptions
) -> tuple[SiteMap, dict[str, Any]]:
    streets = openstreetmap.read_street_map(file)
    centre, turned = streets.place_of(options.centre)
    if not (abs(centre[0]) <= 180 and abs(centre[1]) <= 85):
        raise MapError(f"{file}: centre: expected lon,lat in degrees, got {centre}")
    levels = osm_levels.find_levels(streets, centre, options.radius_m)
    source = file
    if levels.heights or streets.deleted or streets.rearranged:
        source = scratch / "levelled.osm"
        osm_levels.write_levelled(file, source, streets, levels)
    lon, lat = centre
    reach = options.radius_m / 111_000
    wide = reach / max(0.05, math.cos(math.radians(lat)))
    box = f"{lon - wide},{lat - reach},{lon + wide},{lat + reach}"
    projection = f"+proj=tmerc +lat_0={lat!r} +lon_0={lon!r} +k=1 +ellps=WGS84 +units=m +no_defs"
    bare = osm_features.edges_without_sidewalk(streets)
    arguments = without_sidewalk(bare, scratch / "sidewalks.netccfg")
    arguments += ["--osm-files", str(source), *OSM, "--proj", projection]
    arguments += ["--offset.disable-normalization", "--keep-edges.in-geo-boundary", box]
    warnings = netconvert(file, arguments, folder / NETWORK)
    site_map = read_network(folder / NETWORK)
    _cut(site_map, options.radius_m, file)
    site_map.areas, site_map.junctions = _near(site_map, options.radius_m)
    site_map.features = list(osm_features.features(streets, centre, options.radius_m))
    site_map.lanes = osm_features.without_kerb_at_crossings(site_map.lanes, streets)
    openstreetmap.add_surroundings(site_map, streets, centre, options.radius_m)
    site_map.guessed += ["sidewalks and crossings", "traffic lights", "widths of lanes"]
    if turned:
        site_map.guessed.append(
            f"`centre` is lat,lon: taken as {centre[0]:g} east, {centre[1]:g} north"
        )
    site_map.not_understood += levels.flat
    if levels.crossings:
        site_map.covered_m = osm_levels.COVERED_M
        site_map.guessed.append(
            f"heights of bridges and tunnels at {levels.crossings} crossings: "
            f"{osm_levels.CLEARANCE_M:g} m apart, with ramps"
        )
    elif not any(np.ptp(lane.centre[:, 2]) > 0 for lane in site_map.lanes):
        site_map.guessed.append("all roads are level: the map has no heights")
    if streets.deleted:
        site_map.guessed.append(f"{streets.deleted} elements that an editor deleted: left out")
    return site_map, {"projection": projection, "offset_m": [0.0, 0.0, 0.0], "network": warnings}


_READERS = {
    ".xodr": _from_opendrive,
    ".net.xml": _from_network,
    ".osm": _from_osm,
    ".osm.xml": _from_osm,
}


def _shifted_network(
    file: Path, arguments: Sequence[str], offset: FloatArray, out: Path
) -> list[str]:
    """Writes the network in the site's frame; returns netconvert's warnings. Raises MapError."""
    x, y, z = (-offset).tolist()
    moved = ["--offset.disable-normalization", f"--offset.x={x!r}", f"--offset.y={y!r}"]
    return netconvert(file, [*arguments, *moved, f"--offset.z={z!r}"], out)


def _extent(lanes: Sequence[MapLane]) -> tuple[FloatArray, FloatArray, float]:
    """Returns the lower and upper corner (2,) of all lanes, and an offset of z to subtract."""
    points = np.concatenate([lane.centre for lane in lanes])
    low, high = points.min(0), points.max(0)
    return low[:2], high[:2], round(float(low[2]), -1) if abs(low[2]) > 50 else 0.0


def _moved(lane: MapLane, offset: FloatArray) -> MapLane:
    return replace(lane, left=lane.left - offset, right=lane.right - offset)


def _moved_body(thing: Any, offset: FloatArray) -> Any:
    base = None if thing.base_m is None else thing.base_m - offset[2]
    return replace(thing, outline=thing.outline - offset[:2], base_m=base)


def _cut(site_map: SiteMap, radius_m: float, file: Path) -> None:
    """Removes objects outside the radius around the origin; lanes that reach into it stay whole."""
    site_map.lanes = [x for x in site_map.lanes if np.hypot(*x.centre[:, :2].T).min() <= radius_m]
    if not any(lane.driveable for lane in site_map.lanes):
        raise MapError(
            f"{file}: expected a lane for vehicles within {radius_m:g} m of the centre, got none"
        )
    site_map.bodies = [b for b in site_map.bodies if np.hypot(*b.outline.mean(0)) <= radius_m]
    site_map.trees = [t for t in site_map.trees if math.hypot(t.x_m, t.y_m) <= radius_m]
    site_map.features = [f for f in site_map.features if math.hypot(f.x_m, f.y_m) <= radius_m]
    site_map.footways = [f for f in site_map.footways if np.hypot(*f[:, :2].T).min() <= radius_m]


def _near(network: SiteMap, radius_m: float) -> tuple[list[FloatArray], list[Any]]:
    areas = [a for a in network.areas if np.hypot(*a.T).min() <= radius_m]
    return areas, [j for j in network.junctions if math.hypot(j[1], j[2]) <= radius_m]


def _pole(site_map: SiteMap, options: ImportOptions) -> tuple[Pole, str]:
    if options.mount is not None:
        return Pole(*options.mount), ""
    pole, what = guess_pole(site_map)
    return pole, f"the pole, {HEIGHT_M:g} m high, beside {what}"


def _write_site(
    folder: Path,
    name: str,
    site_map: SiteMap,
    meshes: dict[str, Triangles],
    choice: tuple[Pole, ImportOptions],
    terrain: Sheet,
) -> None:
    pole, options = choice
    (folder / "meshes").mkdir()
    for mesh, triangles in meshes.items():
        write_ply(folder / "meshes" / f"{mesh}.ply", triangles)
    write(folder / "lanes.csv", lanes_table(site_map.lanes))
    scene: dict[str, Any] = {
        "name": name,
        "mounts": {"pole": asdict(pole)},
        "lanes": "lanes.csv",
        "meshes": [
            {"file": f"meshes/{mesh}.ply", "material": MATERIALS.get(mesh, mesh)} for mesh in meshes
        ],
        "trajectories": "trajectories.csv",
        "duration_s": options.duration_s,
        "region_half_length_m": options.region_half_length_m,
    }
    if site_map.trees:
        scene["vegetation"] = [{"tree": _tree(tree, terrain)} for tree in site_map.trees]
    write(folder / "site.yaml", _yaml(scene))


def _tree(tree: Any, terrain: Sheet) -> dict[str, float]:
    ground = float(terrain.at(np.array([[tree.x_m, tree.y_m]]))[0])
    base = ground if tree.base_m is None else tree.base_m
    trunk = min(3.0, tree.height_m / 3)
    row = {"x_m": tree.x_m, "y_m": tree.y_m, "height_m": tree.height_m, "trunk_m": trunk}
    return {k: round(v, 2) for k, v in {**row, "base_m": base}.items()}


def lanes_table(lanes: Sequence[MapLane]) -> str:
    """Returns lanes.csv: the centrelines of driveable lanes where they are wide enough."""
    rows = ["lane,x,y,z,width"]
    for lane in lanes:
        if not lane.driveable:
            continue
        for part, (first, last) in enumerate(_wide(lane.width)):
            name = lane.name if part == 0 else f"{lane.name}_part{part + 1}"
            table = np.column_stack([lane.centre, lane.width])[first:last]
            apart = np.abs(np.diff(table[:, :3].round(3), axis=0)).max(1) > 0
            table = table[np.concatenate([[True], apart])]
            if len(table) < 2:
                continue
            rows += [f"{name},{x:.3f},{y:.3f},{z:.4f},{w:.3f}" for x, y, z, w in table]
    return "\n".join(rows) + "\n"


def _wide(width: FloatArray) -> list[tuple[int, int]]:
    """Returns index ranges [first, last) of two or more points at which a lane is wide enough."""
    enough = np.concatenate([[False], width >= NARROWEST_M, [False]])
    edges = np.flatnonzero(np.diff(enough.astype(int))).reshape(-1, 2)
    return [(int(a), int(b)) for a, b in edges if b - a >= 2]
