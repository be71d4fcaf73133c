"""Candidate poses: read from a file, or made along kerbs, medians and walls."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.spatial import cKDTree

from pyinfra.core.arguments import check_fields
from pyinfra.core.arrays import BoolArray, FloatArray, IntArray
from pyinfra.core.errors import Error, FormatError
from pyinfra.dataset.roads import Road, offset_curve
from pyinfra.experiments.planner.site import PlanSite
from pyinfra.formats.csv_table import check_columns, expect, read_csv
from pyinfra.scenes.maps.site_folder import check_metres

POSE = ["x_m", "y_m", "z_m", "yaw_deg", "pitch_deg"]
KERB_M = 0.8  # distance of a pole from the edge of the carriageway
KERB_TOLERANCE_M = 0.1  # tolerance of KERB_M, because centrelines have one point per metre
WALL_M = 0.3  # distance of a LiDAR from the wall that carries it
WALL_TO_ROAD_M = 20.0  # maximum distance of a wall with a LiDAR from the nearest carriageway
LEAST_MEDIAN_M = 1.0  # minimum width of a median that carries a pole
SEARCH_M = 20.0  # maximum distance from an impossible pose to a proposed free place
ISLAND_M = 6.0  # a place gets no pole if carriageways are within this distance on every side
APART_M = 1.0  # minimum distance between two positions; the later one is left out
WORDS = frozenset({"existing", "kind", "name", "lidar", "left_out"})
# Columns of an arm from the mast at x_m, y_m. The bearing is 0 to the north and 90 to the east.
ARM = ["arm_m", "bearing_deg"]
# Columns of a file of poses, including all columns of candidates.csv, whose rows can be copied.
COLUMNS = (*POSE, *ARM, "existing", *(WORDS - {"existing"}), "height_m", "frames", "recall")
MOST_ARM_M = 30.0
FOOT = ["foot_x_m", "foot_y_m"]  # columns with the position of the pole or mast
MOST_GIVEN = 12  # maximum number of the user's positions that each get an option in the tables
GIVEN = ("file", "arm")  # kinds of poses that the user gives
TRIED_M = (5.0, 8.0, 12.0)  # heights above the road to try for a pose below the road
GRID_RANGES = {
    "every_m": (0.5, 1000),
    "heights_m": (0.5, 100),
    "pitches_deg": (-90, 90),
    "yaws": (1, 72),
    "yaw_step_deg": (1, 180),
}


@dataclass(frozen=True)
class PoseGrid:
    """Spacing, heights and directions of the poses that `make_candidates` makes."""

    every_m: float = 15.0
    heights_m: tuple[float, ...] = (4.0, 6.0, 8.0)
    yaws: int = 3  # number of yaw angles of a LiDAR with a narrow view, the first one to the centre
    yaw_step_deg: float = 45.0
    pitches_deg: tuple[float, ...] = (0.0, 10.0)


def check_grid(grid: PoseGrid) -> None:
    """Raises Error for a value out of range."""
    for name in ("heights_m", "pitches_deg"):
        if not len(getattr(grid, name)):
            raise Error(f"{name}: expected one value or more, got none")
    check_fields(grid, GRID_RANGES)


def make_candidates(site: PlanSite, within_m: float, grid: PoseGrid) -> pd.DataFrame:
    """Returns poses along kerbs, medians and walls within a distance of the site's centre.

    Each lane of an imported map is a road. Its edge is no kerb if another lane is beside it.
    """
    places = [*_beside_roads(site, grid.every_m), *_on_walls(site, grid.every_m)]
    distances = [math.hypot(at[1] - site.centre[0], at[2] - site.centre[1]) for at in places]
    near = [at for at, away in zip(places, distances, strict=True) if away <= within_m]
    free = off_carriageways(np.array([at[1:3] for at in near]).reshape(-1, 2), site.roads)
    rows: list[dict[str, object]] = []
    taken = np.empty((0, 2))
    for (kind, x, y, ground, top), stands in zip(near, free, strict=True):
        near_another = (np.hypot(*(taken - (x, y)).T) < APART_M).any()
        if near_another or not (stands or kind == "median"):
            continue
        taken = np.vstack([taken, (x, y)])
        place = {"kind": kind, "existing": kind == "wall", "x_m": x, "y_m": y}
        place |= {"foot_x_m": x, "foot_y_m": y}
        rows += [place | {"z_m": ground + h} for h in grid.heights_m if ground + h <= top]
    if not rows:
        nearest = f"; the nearest is {min(distances):.0f} m away" if distances else ""
        raise Error(
            f"within_m: expected a kerb, median or wall within {within_m:g} m of "
            f"({site.centre[0]:.0f}, {site.centre[1]:.0f}), got none{nearest}; set `poses` to a "
            "file with poses"
        )
    return turned(pd.DataFrame(rows), site, grid)


def read_candidates(file: Path, site: PlanSite, grid: PoseGrid) -> pd.DataFrame:
    """Reads poses from a CSV file. Missing heights, yaws and pitches are those of `grid`.

    Raises the errors of `read_poses`.
    """
    poses = read_poses(file, site.file.parent)
    ground, _ = nearest_roads(site.roads, poses[["x_m", "y_m"]].to_numpy(float))
    poses = filled(poses, "z_m", [{"z_m": ground + h} for h in grid.heights_m])
    return turned(poses, site, grid)


def read_poses(file: Path, folder: Path) -> pd.DataFrame:
    """Reads poses from a CSV file, for a site in a folder.

    Columns: x_m, y_m; optional z_m, yaw_deg, pitch_deg, and existing (yes or no) for a mast that
    needs no new pole; arm_m and bearing_deg for an arm of the mast, at whose end the LiDAR is.
    Raises FormatError with file, line and column.
    """
    table = read_csv(file, WORDS, POSE[:2])
    check_columns(file, table, COLUMNS, [*POSE, *ARM, "existing"])
    if "height_m" in table and "z_m" not in table:
        raise FormatError(
            f"{file}:1: expected the column z_m (world frame), got the column height_m"
        )
    if table.empty:
        raise FormatError(f"{file}: expected one pose or more, got none")
    for name in [name for name in (*POSE, *ARM) if name in table]:
        blank = table[name].isna() & (name not in POSE[:2])
        expect(file, table[name], blank | (table[name].abs() <= 1e5), "a number")
    check_metres(folder, table[POSE[:2]].to_numpy(float), f"{file}: x_m, y_m")
    table["existing"] = table.existing.fillna("no") if "existing" in table else "no"
    expect(file, table.existing, table.existing.isin(["yes", "no"]), "yes or no")
    rows = table.drop_duplicates(["x_m", "y_m", "existing"])
    twice = rows.index[rows.duplicated(["x_m", "y_m"])]
    if len(twice):
        raise FormatError(
            f"{file}:{twice[0] + 2}: existing: expected one value for each position, got yes and no"
        )
    return on_arms(table.assign(kind="file", existing=table.existing == "yes"), file)


def filled(
    poses: pd.DataFrame, name: str, choices: Sequence[Mapping[str, FloatArray | float]]
) -> pd.DataFrame:
    """Replaces each pose without a value in column `name` by one pose for each of the choices.

    choices: values by column, a number or an array (poses,). Returns all poses.
    """
    blank = poses[name].isna().to_numpy() if name in poses else np.ones(len(poses), bool)
    made = (poses.assign(**choice)[blank] for choice in choices)
    return pd.concat((p for p in (poses[~blank], *made) if len(p)), ignore_index=True)


def on_arms(poses: pd.DataFrame, file: Path) -> pd.DataFrame:
    """Returns the poses at the ends of their arms, with the foot of each mast.

    Raises FormatError for an arm without a bearing, or with a length or bearing out of range.
    """
    feet = poses.assign(foot_x_m=poses.x_m, foot_y_m=poses.y_m)
    if "arm_m" not in poses:
        return feet
    if "bearing_deg" not in poses:
        raise FormatError(f"{file}:1: expected the column bearing_deg beside arm_m, got none")
    poses = poses.assign(arm_m=poses.arm_m.fillna(0))
    poses = poses.assign(bearing_deg=poses.bearing_deg.mask(poses.arm_m == 0, 0))
    for name, low, high in (("arm_m", 0.0, MOST_ARM_M), ("bearing_deg", -360.0, 360.0)):
        expect(file, poses[name], poses[name].between(low, high), f"{low:g} to {high:g}")
    bearing = np.radians(poses.bearing_deg)
    return feet.assign(
        x_m=poses.x_m + poses.arm_m * np.sin(bearing),
        y_m=poses.y_m + poses.arm_m * np.cos(bearing),
        kind=np.where(poses.arm_m > 0, "arm", "file"),
    )


def given_places(poses: pd.DataFrame) -> IntArray:
    """Returns (n,) the position number of each pose that the user gave, and -1 for other poses.

    Every pose is -1 if the user gave more than MOST_GIVEN positions.
    """
    place = poses.groupby(POSE[:2], sort=False).ngroup().to_numpy()
    given = poses.kind.isin(GIVEN).to_numpy()
    return np.where(given & (len(np.unique(place[given])) <= MOST_GIVEN), place, -1)


def turned(poses: pd.DataFrame, site: PlanSite, grid: PoseGrid) -> pd.DataFrame:
    """Returns the poses; a pose without yaw or pitch is repeated with each yaw and pitch of `grid`.

    Column `turn` is 0 for a given yaw and for the yaw to the centre. LiDARs that see all around use
    only poses with `turn` 0.
    """
    to_centre = site.centre - poses[["x_m", "y_m"]].to_numpy(float)
    yaw = np.degrees(np.arctan2(to_centre[:, 1], to_centre[:, 0])).round(1)
    steps = [(i + 1) // 2 * (-1) ** i * grid.yaw_step_deg for i in range(grid.yaws)]
    yaws = [{"yaw_deg": (yaw + s + 180) % 360 - 180, "turn": float(s != 0)} for s in steps]
    poses = filled(poses.assign(turn=0.0), "yaw_deg", yaws)
    poses = filled(poses, "pitch_deg", [{"pitch_deg": p} for p in grid.pitches_deg])
    poses = poses[["kind", "existing", *POSE, "turn", *FOOT]]
    table = poses.drop_duplicates(POSE).sort_values(POSE, ignore_index=True)
    ground, _ = nearest_roads(site.roads, table[["x_m", "y_m"]].to_numpy(float))
    table.insert(5, "height_m", table.z_m - ground)
    return table.round(3)


def with_faults(poses: pd.DataFrame, site: PlanSite) -> pd.DataFrame:
    """Adds column `fault`: the reason why no sensor can have the pose; empty if one can.

    The rules are those of a scene's mounts: outside buildings, trees and lanes, above the ground.
    """
    faults = (site.observer.fault([*row]) for row in poses[POSE].to_numpy(float))
    return poses.assign(fault=[": ".join(fault.split(": ", 2)[-2:]) for fault in faults])


def feasible(poses: pd.DataFrame, site: PlanSite) -> pd.DataFrame:
    """Returns the poses without a fault. If there are none, raises Error that proposes a pose."""
    free = poses[poses.fault == ""].reset_index(drop=True)
    if free.empty:
        reasons = poses.fault.value_counts()
        pose = poses.iloc[0]
        near = f"no pose near ({pose.x_m:g}, {pose.y_m:g}) is possible"
        if place := nearest_free(site, pose[POSE].to_numpy(float)):
            near = f"instead of ({pose.x_m:g}, {pose.y_m:g}), use ({place[0]:.1f}, {place[1]:.1f}) "
            near += f"at z_m {place[2]:.1f}"
        raise Error(
            f"poses: expected one or more possible poses, got {len(poses)} impossible poses; "
            f"{reasons.iloc[0]} of them: {reasons.index[0]}; {near}"
        )
    return free


def nearest_free(site: PlanSite, pose: FloatArray) -> tuple[float, float, float] | None:
    """Returns x, y, z of a free pose near `pose`: at another height, or else beside the roads.

    Beside the roads, positions within SEARCH_M are tried at the z of `pose`, the nearest first.
    The result is None if none is free.
    """
    ground, outside = nearest_road(site.roads, pose[:2])
    for height in TRIED_M if outside > 0 else ():
        place = (float(pose[0]), float(pose[1]), ground + height)
        if pose[2] < ground and not site.observer.fault([*place, *pose[3:]]):
            return place
    for away in np.arange(0.5, SEARCH_M + 0.1, 0.5):
        for angle in np.arange(0, 2 * np.pi, np.pi / 8):
            at = pose[:2] + away * np.array([np.cos(angle), np.sin(angle)])
            beside = nearest_road(site.roads, at)[1] > 0
            if beside and not site.observer.fault([*at, *pose[2:]]):
                return float(at[0]), float(at[1]), float(pose[2])
    return None


def _beside_roads(
    site: PlanSite, every_m: float
) -> Iterator[tuple[str, float, float, float, float]]:
    """Yields kind, x, y, height of the ground and highest z of positions on kerbs and medians."""
    medians = {
        str(road["name"]): float((road.get("lanes") or {}).get("median_m") or 0)
        for road in site.keys.get("roads") or []
    }
    for road in site.roads:
        lines: list[tuple[str, FloatArray]] = [
            ("kerb", offset_curve(road.xy, road.heading, side * (road.half_width + KERB_M)))
            for side in (1, -1)
        ]
        if medians.get(road.name, 0) >= LEAST_MEDIAN_M:
            lines.append(("median", road.xy))
        step = max(1, round(every_m / max(float(np.diff(road.s).mean()), 1e-6)))
        first = int(np.abs(road.s).argmin()) % step
        for kind, line in lines:
            for i in range(first, len(line), step):
                yield kind, float(line[i, 0]), float(line[i, 1]), float(road.z[i]), math.inf


def off_carriageways(places: FloatArray, roads: Sequence[Road]) -> BoolArray:
    """Returns which places (n, 2) are off the carriageways and not enclosed by them, (n,) bool."""
    beside = nearest_roads(roads, places)[1] >= KERB_M - KERB_TOLERANCE_M
    angles = np.arange(0, 2 * np.pi, np.pi / 8)
    ways = np.stack([np.cos(angles), np.sin(angles)], axis=1)  # 16 unit vectors, (16, 2)
    steps = np.arange(1, ISLAND_M + 1)[:, None, None] * ways  # shape (metres, directions, 2)
    around = places[beside, None, None] + steps  # shape (places, metres, directions, 2)
    on_road = nearest_roads(roads, around.reshape(-1, 2))[1] <= 0
    in_direction = np.any(on_road.reshape(around.shape[:-1]), axis=1)  # shape (places, directions)
    beside[beside] = ~np.all(in_direction, axis=1)
    return beside


def _on_walls(site: PlanSite, every_m: float) -> Iterator[tuple[str, float, float, float, float]]:
    """Yields positions, as `_beside_roads`, at the walls of buildings near a carriageway."""
    for house in site.keys.get("buildings") or []:
        angle = math.radians(house.get("heading_deg", 0))
        along = np.array([math.cos(angle), math.sin(angle)])
        across = np.array([-along[1], along[0]])
        length, width = house["length_m"], house["width_m"]
        top = float(house.get("base_m", 0)) + house["height_m"]
        for way, side, half, wide in (
            (along, across, width / 2, length),
            (along, -across, width / 2, length),
            (across, along, length / 2, width),
            (across, -along, length / 2, width),
        ):
            middle = np.array([house["x_m"], house["y_m"]]) + side * (half + WALL_M)
            count = max(1, int(wide // every_m))
            for k in range(count):
                at = middle + way * wide * ((k + 0.5) / count - 0.5)
                ground, away = nearest_road(site.roads, at)
                if away <= WALL_TO_ROAD_M:
                    yield "wall", float(at[0]), float(at[1]), ground, top


def nearest_roads(roads: Sequence[Road], places: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Returns the z (n,) of the road nearest to each place (n, 2), and the distance (n,) from the
    edge of its carriageway, which is negative on the carriageway.
    """
    height, outside = np.zeros(len(places)), np.full(len(places), np.inf)
    for road in roads:
        away, index = cKDTree(road.xy).query(places)
        away -= road.half_width[index]
        nearer = away < outside
        height[nearer], outside[nearer] = road.z[index[nearer]], away[nearer]
    return height, outside


def nearest_road(roads: Sequence[Road], at: FloatArray) -> tuple[float, float]:
    """Returns the z of the nearest road, and the distance from the edge of its carriageway."""
    height, outside = nearest_roads(roads, at[None])
    return float(height[0]), float(outside[0])
