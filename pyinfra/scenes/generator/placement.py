"""Puts objects beside a road where space is free, and collects their scene keys."""

import numpy as np

from pyinfra.scenes.generator.layout import WHOLE, FreeSpace, Keys, PlannedRoad, Stretch

KINDS = ("barriers", "gantries", "buildings", "vegetation", "parked")
TRUNK_GAP_M = 3.0  # minimum distance from the sensor to the crowns of a row of trees
BuildingSize = tuple[float, float, float]  # length, width and height, metres
Base = tuple[float, float, float, float]  # x, y, heading (rad) and z of an object's base


class Placement:
    """The free space of a site, and the scene keys of the objects that were already placed.

    `left_m` is the distance of an object to the left of a road's centreline, and `s` is the station
    of the object.
    """

    def __init__(self, free_space: FreeSpace, foot_m: float, mount: Keys) -> None:
        """`foot_m` is the ground's elevation beside roads, and `mount` is the sensor's pose."""
        self.free_space, self.foot_m, self.mount = free_space, foot_m, mount
        self.keys: dict[str, list[Keys]] = {kind: [] for kind in KINDS}

    def barrier(
        self, road: PlannedRoad, left_m: float, size: Keys, within: Stretch = WHOLE
    ) -> None:
        self.keys["barriers"] += [
            along(road, left_m, part, size)
            for part in self.free_space.rows(road, left_m, size["width_m"] / 2, within)
        ]

    def hedge(self, road: PlannedRoad, left_m: float, size: Keys, within: Stretch = WHOLE) -> None:
        hedge = size | {"base_m": self.slope_m(road, left_m)}
        self.keys["vegetation"] += [
            {"hedge_along": along(road, left_m, part, hedge)}
            for part in self.free_space.rows(road, left_m, size["width_m"] / 2, within)
        ]

    def trees(self, road: PlannedRoad, left_m: float, trees: Keys) -> None:
        """Adds a row of trees, with a gap where their crowns would reach the sensor."""
        line = road.beside(left_m)
        away = np.hypot(line[:, 0] - self.mount["x_m"], line[:, 1] - self.mount["y_m"])
        near = road.stations[away < trees["crown_m"] / 2 + TRUNK_GAP_M, 0]
        for start, end in self.free_space.rows(road, left_m, 0.5):
            parts = [(start, end)]
            if len(near) and near[-1] >= start and near[0] <= end:
                parts = [(start, float(near[0]) - 1), (float(near[-1]) + 1, end)]
            self.keys["vegetation"] += [
                {"trees_along": along(road, left_m, part, trees)}
                for part in parts
                if part[1] > part[0]
            ]

    def box(
        self, road: PlannedRoad, s: float, left_m: float, size: BuildingSize, turn_deg: float = 0.0
    ) -> None:
        """Adds a box if its position is free."""
        if not 0 < s < road.length_m:
            return
        box = box_at(road, s, left_m, size[:2], turn_deg)
        if self.free_space.holds(box):
            self.free_space.take(box)
            self.building(self.base(road, s, left_m), size, turn_deg)

    def building(self, base: Base, size: BuildingSize, turn_deg: float = 0.0) -> None:
        """Adds a box. Does not test whether its position is free."""
        x, y, heading, base_m = base
        self.keys["buildings"].append(
            {
                "x_m": round(float(x), 2),
                "y_m": round(float(y), 2),
                "length_m": size[0],
                "width_m": size[1],
                "height_m": size[2],
                "heading_deg": round(float(np.degrees(heading)) + turn_deg, 1),
                "base_m": round(base_m, 2),
            }
        )

    def base(self, road: PlannedRoad, s: float, left_m: float) -> Base:
        return *road.pose_at(s, left_m), self.slope_m(road, left_m)

    def slope_m(self, road: PlannedRoad, left_m: float) -> float:
        """Returns the height of the road, the embankment or the ground at `left_m`."""
        if abs(left_m) <= road.carriageway_half_m:
            return 0.0
        slope = road.keys.get("embankment")
        if slope is None:
            return self.foot_m if abs(left_m) > road.outer_half_m else 0.0
        down = (abs(left_m) - road.outer_half_m) / slope["run_per_rise"]
        return round(float(max(min(0.0, -down), self.foot_m)), 2)

    def beyond_mount(self, road: PlannedRoad, side: int) -> float:
        """Returns the distance from the centreline beyond which objects are behind the sensor.

        It is 0 if the sensor is on the other side of the road or far from it.
        """
        foot = np.array([[self.mount["x_m"], self.mount["y_m"]]])
        left = road.beside(1.0) - road.stations[:, 1:3]
        nearest = np.hypot(*(road.stations[:, 1:3] - foot).T).argmin()
        left_m = float((foot[0] - road.stations[nearest, 1:3]) @ left[nearest])
        return side * left_m + 1.5 if 0 < side * left_m < 40 else 0.0


def along(road: PlannedRoad, left_m: float, part: Stretch, keys: Keys) -> Keys:
    """Returns the scene keys of a row of objects along a part of a road."""
    stations = {"from_m": round(part[0], 1), "to_m": round(part[1], 1)}
    return {"road": road.name, "offset_m": round(left_m, 3)} | stations | keys


def box_at(
    road: PlannedRoad,
    s: float,
    left_m: float,
    footprint: tuple[float, float],
    turn_deg: float = 0.0,
) -> list[float]:
    """Returns the box (x y z dx dy dz heading) of a footprint; z and height are not used."""
    x, y, heading = road.pose_at(s, left_m)
    return [x, y, 0, *footprint, 1, heading + np.radians(turn_deg)]
