"""Writes scene file, lanes and meshes of an imported site."""

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from pyinfra.core.arrays import FloatArray
from pyinfra.core.files import write
from pyinfra.formats.ply import Triangles, write_ply
from pyinfra.scenes.maps.lane_map import NARROWEST_M, MapLane, MapTree, SiteMap
from pyinfra.scenes.maps.map_readers import ImportOptions
from pyinfra.scenes.maps.mount_guess import Pole
from pyinfra.scenes.maps.site_folder import SCENE
from pyinfra.scenes.maps.surfaces import Sheet

CLEARANCE_M = 4.5  # minimum free height above a lane, as in the simulator
# Distances of a tree's foot from a lane below which the crown (default: 5 m wide) or the trunk
# overlaps the lane. The simulator checks the square outlines of crowns.
CROWN_M, TRUNK_M = 2.5 * 2**0.5, 0.3
# Material of each mesh. A mesh that is not listed has the material of its own name.
MATERIALS = {"buildings": "structure"}


def yaml_text(data: dict[str, Any]) -> str:
    return str(yaml.safe_dump(data, sort_keys=False, default_flow_style=None, width=100))


def write_site(
    folder: Path,
    name: str,
    site_map: SiteMap,
    meshes: dict[str, Triangles],
    pole: Pole,
    options: ImportOptions,
    terrain: Sheet,
) -> None:
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
    if plants := trees_beside_lanes(site_map, terrain):
        scene["vegetation"] = [{"tree": plant} for plant in plants]
    write(folder / SCENE, yaml_text(scene))


def trees_beside_lanes(site_map: SiteMap, terrain: Sheet) -> list[dict[str, float]]:
    """Returns the keys of the trees. No tree is in the space that vehicles need over a lane.

    A crown that reaches over a lane is raised. A tree whose trunk is on a lane is left out. Both
    are added to `mended` of the map.
    """
    lanes = [lane for lane in site_map.lanes if lane.driveable]
    start = np.concatenate([lane.centre[:-1] for lane in lanes])  # start points (n, 3) of segments
    step = np.concatenate([np.diff(lane.centre, axis=0) for lane in lanes])
    length2 = np.maximum((step[:, :2] ** 2).sum(1), 1e-9)
    half = np.concatenate([np.maximum(lane.width[:-1], lane.width[1:]) / 2 for lane in lanes])
    plants, raised = [], 0
    for tree in site_map.trees:
        plant = _tree(tree, terrain)
        foot = np.array([tree.x_m, tree.y_m])
        along = ((foot - start[:, :2]) * step[:, :2]).sum(1) / length2
        nearest = start + np.clip(along, 0, 1)[:, None] * step
        away = np.hypot(*(nearest[:, :2] - foot).T) - half
        top = plant["base_m"] + plant["height_m"]
        is_below = (nearest[:, 2] < top) & (nearest[:, 2] + CLEARANCE_M > plant["base_m"])
        if (is_below & (away < TRUNK_M)).any():
            where = f"{tree.x_m:.1f} {tree.y_m:.1f}"
            site_map.mended.append(f"tree at {where}: left out, because it is on a lane")
            continue
        crossed = is_below & (away < CROWN_M)
        if crossed.any():
            trunk = float(nearest[crossed, 2].max()) + CLEARANCE_M + 0.01 - plant["base_m"]
            plant["trunk_m"] = round(trunk, 2)
            plant["height_m"] = round(max(plant["height_m"], trunk + 2), 2)
            raised += 1
        plants.append(plant)
    if raised:
        site_map.mended.append(f"crowns raised to {CLEARANCE_M:g} m above the lanes: {raised}")
    return plants


def _tree(tree: MapTree, terrain: Sheet) -> dict[str, float]:
    ground = float(terrain.at(np.array([[tree.x_m, tree.y_m]]))[0])
    base = ground if tree.base_m is None else tree.base_m
    trunk = min(3.0, tree.height_m / 3)
    row = {"x_m": tree.x_m, "y_m": tree.y_m, "height_m": tree.height_m, "trunk_m": trunk}
    return {k: round(v, 2) for k, v in {**row, "base_m": base}.items()}


def lanes_table(lanes: Sequence[MapLane]) -> str:
    """Returns the text of lanes.csv, the centrelines of driveable lanes that are wide enough."""
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
