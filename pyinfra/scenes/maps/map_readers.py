"""Readers of each map format. They return a `SiteMap`, and write the network with netconvert."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from pyinfra.core.arrays import FloatArray
from pyinfra.scenes.maps import (
    left_hand,
    openstreetmap,
    osm_buildings,
    osm_features,
    osm_lanes,
    osm_levels,
)
from pyinfra.scenes.maps.lane_comparison import bodies_on_lanes, lane_differences
from pyinfra.scenes.maps.lane_map import (
    FARTHEST_IN_MAP_M,
    MapError,
    MapLane,
    SiteMap,
    checked_lanes,
)
from pyinfra.scenes.maps.lanelet2_map import read_lanelets
from pyinfra.scenes.maps.netconvert import OPENDRIVE, OSM, netconvert, without_sidewalk
from pyinfra.scenes.maps.network import read_network
from pyinfra.scenes.maps.opendrive import read_opendrive
from pyinfra.scenes.maps.opendrive_mending import mended_for_netconvert
from pyinfra.scenes.maps.ramps import CLEARANCE_M
from pyinfra.scenes.maps.site_folder import NET

RADIUS_M = 1000.0  # default radius of the imported area


@dataclass(frozen=True)
class ImportOptions:
    """Options of a map import."""

    # Centre of the imported area: x, y in the frame of the map, or for OpenStreetMap, longitude and
    # latitude in either order.
    centre: tuple[float, float] | None = None
    radius_m: float = RADIUS_M
    mount: tuple[float, float, float, float] | None = None  # x, y, z, yaw_deg in the site's frame
    duration_s: float = 500.0
    region_half_length_m: float = 100.0
    # Side of the road on which vehicles drive. Only OpenStreetMap files do not state the side.
    traffic_side: openstreetmap.Side | None = None


def _from_opendrive(
    file: Path, folder: Path, scratch: Path, options: ImportOptions
) -> tuple[SiteMap, dict[str, Any]]:
    _check_side(file, options)
    site_map = read_opendrive(file)
    offset = _offset(site_map.lanes, file, options)
    _move(site_map, offset)
    _cut(site_map, options.radius_m, file)
    readable, changed = mended_for_netconvert(file, scratch / "readable.xodr")
    site_map.not_understood += changed
    left = left_hand.has_left_hand_traffic(readable)
    if left:
        readable = left_hand.mirrored_map(readable, scratch / "mirrored.xodr")
        site_map.guessed.append('left-hand traffic, because all roads have rule="LHT"')
    arguments = ["--opendrive-files", str(readable), *OPENDRIVE]
    shift = offset * (1, -1, 1) if left else offset
    warnings = _shifted_network(file, arguments, shift, folder / NET)
    if left:
        left_hand.mirror_network(folder / NET)
    network = read_network(folder / NET)
    site_map.not_understood += lane_differences(site_map.lanes, network.lanes)
    site_map.areas, site_map.junctions = _near(network, options.radius_m)
    site_map.guessed.append("traffic lights, which the map does not have")
    return site_map, {"offset_m": offset.tolist(), "network": warnings}


def _from_network(
    file: Path, folder: Path, scratch: Path, options: ImportOptions
) -> tuple[SiteMap, dict[str, Any]]:
    _check_side(file, options)
    offset = _offset(read_network(file).lanes, file, options)
    warnings = _shifted_network(file, ["--sumo-net-file", str(file)], offset, folder / NET)
    return _network_map(file, folder, options), {"offset_m": offset.tolist(), "network": warnings}


def _from_osm(
    file: Path, folder: Path, scratch: Path, options: ImportOptions
) -> tuple[SiteMap, dict[str, Any]]:
    streets = openstreetmap.read_street_map(file)
    if streets.lanelets:
        return _from_lanelet2(file, options)
    centre, turned = streets.place_of(options.centre)
    if not (abs(centre[0]) <= 180 and abs(centre[1]) <= 85):
        raise MapError(
            f"{file}: `centre`: expected longitude and latitude in degrees, got {centre}"
        )
    streets.check_centre(centre, file, options.radius_m)
    levels = osm_levels.find_levels(streets, centre, options.radius_m)
    side = options.traffic_side or streets.traffic_side()
    swapped = side == "left" and osm_lanes.has_sides(streets)
    source = file
    changed = streets.deleted or streets.rearranged or streets.ignores_heights
    if levels.heights or changed or swapped:
        source = scratch / "levelled.osm"
        osm_levels.write_levelled(file, source, streets, levels, swapped=swapped)
    lon, lat = centre
    reach = options.radius_m / 111_000
    wide = reach / max(0.05, math.cos(math.radians(lat)))
    box = f"{lon - wide},{lat - reach},{lon + wide},{lat + reach}"
    projection = f"+proj=tmerc +lat_0={lat!r} +lon_0={lon!r} +k=1 +ellps=WGS84 +units=m +no_defs"
    bare = osm_features.edges_without_sidewalk(streets, side or "right")
    arguments = [
        *without_sidewalk(bare, scratch / "sidewalks.netccfg"),
        *("--osm-files", str(source), *OSM, "--proj", projection),
        *("--offset.disable-normalization", "--keep-edges.in-geo-boundary", box),
        *(["--lefthand"] if side == "left" else []),
    ]
    warnings = netconvert(file, arguments, folder / NET)
    site_map = _network_map(file, folder, options)
    site_map.features = list(osm_features.features(streets, centre, options.radius_m))
    site_map.lanes = osm_features.without_kerb_at_crossings(site_map.lanes, streets)
    osm_buildings.add_surroundings(site_map, streets, centre, options.radius_m)
    site_map.not_understood += bodies_on_lanes(site_map.bodies, site_map.lanes)
    site_map.not_understood += osm_lanes.lane_notes(streets, site_map.lanes)
    site_map.guessed += ["sidewalks and crossings", "traffic lights", "widths of lanes"]
    if options.traffic_side is None:
        why = "as in its roundabouts" if side else "the map does not show the side"
        site_map.guessed.append(f"traffic on the {side or 'right'}: {why}")
    if turned:
        site_map.guessed.append(
            f"`centre` appears to be lat,lon: read as {centre[0]:g} east, {centre[1]:g} north"
        )
    site_map.not_understood += levels.flat
    if levels.crossings:
        site_map.covered_m = osm_levels.COVERED_M
        site_map.guessed.append(
            f"heights of bridges and tunnels at {levels.crossings} crossings: "
            f"{CLEARANCE_M:g} m apart, with ramps"
        )
    elif not any(np.ptp(lane.centre[:, 2]) > 0 for lane in site_map.lanes):
        why = "only some of its nodes have" if streets.ignores_heights else "the map has no"
        site_map.guessed.append(f"all roads are level: {why} heights")
    if streets.deleted:
        site_map.guessed.append(
            f"{streets.deleted} elements marked as deleted by an editor: left out"
        )
    return site_map, {"projection": projection, "offset_m": [0.0, 0.0, 0.0], "network": warnings}


def _from_lanelet2(file: Path, options: ImportOptions) -> tuple[SiteMap, dict[str, Any]]:
    _check_side(file, options)
    site_map, centre = read_lanelets(file, options.centre)
    if not site_map.lanes:
        raise MapError(f"{file}: expected one or more lanelets with two borders, got none")
    offset = _offset(site_map.lanes, file, options)
    if centre is not None:
        offset[:2] = 0.0
    _move(site_map, offset)
    _cut(site_map, options.radius_m, file)
    origin: dict[str, Any] = {"offset_m": offset.tolist(), "network": []}
    if centre is not None:
        lon, lat = centre
        origin["projection"] = f"+proj=tmerc +lat_0={lat!r} +lon_0={lon!r} +k=1 +ellps=WGS84"
    return site_map, origin


READERS = {
    ".xodr": _from_opendrive,
    ".net.xml": _from_network,
    ".osm": _from_osm,
    ".osm.xml": _from_osm,
}


def _check_side(file: Path, options: ImportOptions) -> None:
    if options.traffic_side is not None:
        raise MapError(
            f"{file}: `traffic_side`: expected no value, got {options.traffic_side}; the map "
            "states the side"
        )


def _shifted_network(
    file: Path, arguments: Sequence[str], offset: FloatArray, out: Path
) -> list[str]:
    """Writes the network in the site's frame. Returns netconvert's warnings. Raises MapError."""
    x, y, z = (-offset).tolist()
    moved = ["--offset.disable-normalization", f"--offset.x={x!r}", f"--offset.y={y!r}"]
    return netconvert(file, [*arguments, *moved, f"--offset.z={z!r}"], out)


def _network_map(file: Path, folder: Path, options: ImportOptions) -> SiteMap:
    """Reads the network that netconvert wrote, within the radius around the origin."""
    site_map = read_network(folder / NET)
    _cut(site_map, options.radius_m, file)
    site_map.areas, site_map.junctions = _near(site_map, options.radius_m)
    return site_map


def _offset(lanes: Sequence[MapLane], file: Path, options: ImportOptions) -> FloatArray:
    """Returns the offset x y z (3,) to subtract from a map's coordinates. Raises MapError."""
    checked_lanes(lanes, str(file), FARTHEST_IN_MAP_M)
    points = np.concatenate([lane.centre for lane in lanes])
    low, high = points.min(0), points.max(0)
    x, y = options.centre or tuple(((low + high)[:2] / 2).round(0).tolist())
    return np.array([x, y, round(float(low[2]), -1) if abs(low[2]) > 50 else 0.0])


def _move(site_map: SiteMap, offset: FloatArray) -> None:
    """Subtracts the offset x y z (3,) from the lanes, bodies, trees and features."""
    x, y, z = offset.tolist()
    site_map.lanes = [
        replace(lane, left=lane.left - offset, right=lane.right - offset) for lane in site_map.lanes
    ]
    site_map.bodies = [
        replace(
            b, outline=b.outline - offset[:2], base_m=None if b.base_m is None else b.base_m - z
        )
        for b in site_map.bodies
    ]
    site_map.trees = [
        replace(t, x_m=t.x_m - x, y_m=t.y_m - y, base_m=None if t.base_m is None else t.base_m - z)
        for t in site_map.trees
    ]
    site_map.features = [replace(f, x_m=f.x_m - x, y_m=f.y_m - y) for f in site_map.features]


def _cut(site_map: SiteMap, radius_m: float, file: Path) -> None:
    """Removes objects outside the radius around the origin.

    A lane that is partly inside is kept whole. Raises MapError if no lane for vehicles is left.
    """
    site_map.lanes = [x for x in site_map.lanes if np.hypot(*x.centre[:, :2].T).min() <= radius_m]
    if not any(lane.driveable for lane in site_map.lanes):
        raise MapError(
            f"{file}: expected a lane for vehicles within {radius_m:g} m (`radius_m`) of the "
            "centre, got none"
        )
    site_map.bodies = [b for b in site_map.bodies if np.hypot(*b.outline.mean(0)) <= radius_m]
    site_map.trees = [t for t in site_map.trees if math.hypot(t.x_m, t.y_m) <= radius_m]
    site_map.features = [f for f in site_map.features if math.hypot(f.x_m, f.y_m) <= radius_m]
    site_map.footways = [f for f in site_map.footways if np.hypot(*f[:, :2].T).min() <= radius_m]


def _near(network: SiteMap, radius_m: float) -> tuple[list[FloatArray], list[Any]]:
    areas = [a for a in network.areas if np.hypot(*a.T).min() <= radius_m]
    return areas, [j for j in network.junctions if math.hypot(j[1], j[2]) <= radius_m]
