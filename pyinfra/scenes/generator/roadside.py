"""Roadside objects of a site, placed from the kerb outwards."""

from __future__ import annotations

from typing import Any

import numpy as np

from pyinfra.scenes.generator.layout import WHOLE, FreeSpace, Keys, PlannedRoad, Stretch
from pyinfra.scenes.generator.random_stream import RandomStream, Range
from pyinfra.scenes.generator.ranges import Ranges, RoadType

SIDES = ((1, "left"), (-1, "right"))
KERB_ROW_M = 1.6  # from the lanes to the middles of parked cars: half a van, slightly turned
KERB_REACH_M = 3.2  # from the lanes to the far sides of parked cars
TRIES = 6
Size = dict[str, float]
KINDS = ("barriers", "gantries", "buildings", "vegetation", "parked")


class RoadsideGenerator:
    """Places objects in the free space beside roads, and collects their scene keys."""

    def __init__(
        self, free_space: FreeSpace, road_type: RoadType, ranges: Ranges, foot_m: float, mount: Keys
    ) -> None:
        self.free_space, self.road_type, self.ranges = free_space, road_type, ranges
        self.foot_m, self.mount = foot_m, mount
        self.keys: dict[str, list[Keys]] = {kind: [] for kind in KINDS}
        self._kerbs: set[tuple[str, int]] = set()  # road and side where cars are parked

    def park(self, road: PlannedRoad, seed: int) -> None:
        """Adds parked vehicles on both sides of a road.

        Called for all roads before `furnish`, whose objects avoid them.
        """
        for side, word in SIDES:
            if self._kerb_row(RandomStream(seed, f"{road.name} {word} kerb"), road, side):
                self._kerbs.add((road.name, side))
            stream = RandomStream(seed, f"{road.name} {word} car park")
            self._car_park(stream, road, side, self._outer_m(road, side))

    def furnish(self, road: PlannedRoad, seed: int) -> None:
        """Adds the objects on both sides of a road, over it and in its median."""
        stream = RandomStream(seed, f"{road.name} middle")
        self._median(stream, road)
        kerbs = {(road.name, side) for side, _ in SIDES} & self._kerbs  # no gantry over them
        if stream.chance(self.road_type.gantry) and not kerbs:
            self._gantry(stream, road)
        for side, word in SIDES:
            self._side(road, side, seed, f"{road.name} {word} ")

    def _side(self, road: PlannedRoad, side: int, seed: int, part: str) -> None:
        """Adds rows of objects from the inside out, each with its own random stream.

        `out_m` is where the next row begins.
        """
        road_type = self.road_type
        kerb, out_m = (road.name, side) in self._kerbs, self._outer_m(road, side)
        stream = RandomStream(seed, f"{part}posts")
        if stream.chance(road_type.posts):
            self._posts(stream, road, side, kerb)
        stream = RandomStream(seed, f"{part}rail")
        if not kerb and stream.chance(road_type.rail):
            self._rail(stream, road, side)
        self._boxes(RandomStream(seed, f"{part}boxes"), road, side, out_m)
        stream = RandomStream(seed, f"{part}hedge")
        if stream.chance(road_type.hedge):
            out_m = self._hedge(stream, road, side, out_m)
        stream = RandomStream(seed, f"{part}trees")
        if stream.chance(road_type.trees):
            out_m = self._trees(stream, road, side, out_m)
        stream = RandomStream(seed, f"{part}noise wall")
        if stream.chance(road_type.noise_wall):
            out_m = self._noise_wall(stream, road, side, out_m)
        stream = RandomStream(seed, f"{part}houses")
        if stream.chance(road_type.houses):
            self._houses(stream, road, side, out_m)
        elif stream.chance(road_type.wood):
            self._wood(stream, road, side, out_m)
        self._wild(RandomStream(seed, f"{part}wild"), road, side, out_m)

    def _wild(self, stream: RandomStream, road: PlannedRoad, side: int, out_m: float) -> None:
        """Adds bushes, some as large as a car, and single trees at random positions."""
        things = self.ranges.things
        for _ in range(stream.whole(self.road_type.wild)):
            s = self._nearest_station(road) + stream.within((-things.within_m, things.within_m))
            left_m = side * (out_m + 1 + stream.within(things.wild_m))
            is_tree = stream.chance(things.wild_trees)
            long_m = 0.8 if is_tree else stream.within(things.bush_m)
            wide_m = round(long_m * stream.within((0.4, 1)), 2)
            box = self._box(road, s, left_m, long_m, wide_m, stream.within((-180, 180), 0))
            tree, hedge = self._tree_shape(stream), self._hedge_size(stream)
            near = np.hypot(box[0] - self.mount["x_m"], box[1] - self.mount["y_m"])
            if (
                not 0 < s < road.length_m
                or not self.free_space.holds(box)
                or near < tree["crown_m"]
            ):
                continue
            position = {"x_m": round(box[0], 2), "y_m": round(box[1], 2)}
            base = {"base_m": self.slope_m(road, left_m)}
            if is_tree:
                self.keys["vegetation"].append({"tree": position | self._raised(tree | base)})
                continue
            size = {"length_m": long_m, "width_m": wide_m, "height_m": hedge["height_m"]}
            way = {"heading_deg": round(float(np.degrees(box[6])) % 360, 1)}
            bush = position | size | way | base | {"density_per_m": hedge["density_per_m"]}
            self.keys["vegetation"].append({"hedge": bush})

    # --- in the middle and over the road ----------------------------------------------------------

    def _median(self, stream: RandomStream, road: PlannedRoad) -> None:
        things, median = self.ranges.things, road.keys["lanes"]["median_m"]
        kind = stream.one_of(self.road_type.in_median)
        if median < 1 or kind == "nothing":
            return
        if kind == "rails" and median >= 2:
            size = self._rail_size(stream)
            for left_m in (median / 2 - 0.5, 0.5 - median / 2):
                self._barrier(road, left_m, size)
        elif kind == "hedge" and median >= 1.5:
            size = self._hedge_size(stream)
            size["width_m"] = min(size["width_m"], round(median - 0.6, 2))
            size["height_m"] = min(size["height_m"], 2.0)
            self._hedge_along(road, 0.0, size)
        elif kind == "trees" and median >= 2:
            self._trees_along(stream, road, 0.0)
        else:
            height = stream.within(things.wall_height_m)
            width = stream.within(things.wall_width_m)
            self._barrier(road, 0.0, {"height_m": height, "width_m": width})

    def _gantry(self, stream: RandomStream, road: PlannedRoad) -> None:
        middle = self._nearest_station(road)
        s = middle + stream.side() * stream.within((6, 90))
        reach = road.carriageway_half_m + 1.5
        for left_m in (-reach, reach):
            if not self._is_free(road, s, left_m):
                return
        gantry = {"road": road.name, "s_m": round(s, 1), "clearance_m": stream.within((4.7, 7))}
        self.keys["gantries"].append(gantry)
        for left_m in (-reach, reach):
            x, y, heading = road.pose_at(s, left_m)
            self.free_space.take([x, y, 0, 2, 3, 1, heading])

    # --- along a side -----------------------------------------------------------------------------

    def _kerb_row(self, stream: RandomStream, road: PlannedRoad, side: int) -> bool:
        """Adds cars parked at a kerb; returns whether the kerb has a parking lane."""
        parking = self.ranges.parking
        wide = road.keys["lanes"]["shoulder_m"] >= parking.lane_m[0]
        if self.road_type.kerb_parking == 0 or not wide:
            return False
        left_m = round(side * (road.lanes_half_m + KERB_ROW_M), 3)
        shares = {"Car": 0.85, "Van": 0.12, "Motorcycle": 0.03}
        for start, end in self.free_space.rows(road, left_m, KERB_ROW_M):
            low = min(max(start, self._nearest_station(road) - 130), end)
            row = {
                "from_m": round(low, 1),
                "to_m": end,
                "gap_m": stream.within(parking.kerb_gap_m),
                "occupied": stream.within(parking.occupied),
                "class_shares": shares,
            }
            if end - low > 10:
                self._add("parked", road, left_m, row)
        return True

    def _rail(self, stream: RandomStream, road: PlannedRoad, side: int) -> None:
        """Adds a guard rail at the edge of the shoulder, or between kerb and footway."""
        size = self._rail_size(stream)
        lanes = road.keys["lanes"]
        inwards = 0.35 if lanes["shoulder_m"] >= 0.9 and lanes["sidewalk_m"] == 0 else -0.3
        within = self._stretch(stream, road, 0.3, (30, 150))
        self._barrier(road, side * (road.carriageway_half_m - inwards), size, within)

    def _noise_wall(
        self, stream: RandomStream, road: PlannedRoad, side: int, out_m: float
    ) -> float:
        left_m = max(out_m, self._beyond_mount(road, side)) + stream.within((1, 5))
        height = stream.within(self.ranges.things.noise_wall_m)
        self._barrier(road, side * left_m, {"height_m": height, "width_m": 0.3})
        return left_m + 0.5

    def _hedge(self, stream: RandomStream, road: PlannedRoad, side: int, out_m: float) -> float:
        size = self._hedge_size(stream)
        left_m = out_m + stream.within(self.ranges.things.verge_m) + size["width_m"] / 2
        within = self._stretch(stream, road, 0.4, (8, 60))
        if left_m < self._beyond_mount(road, side):  # cut a hedge that would hide the road
            size["height_m"] = min(size["height_m"], 1.4)
        self._hedge_along(road, side * left_m, size, within)
        return left_m + size["width_m"] / 2

    def _wood(self, stream: RandomStream, road: PlannedRoad, side: int, out_m: float) -> None:
        """Adds the edge of a wood, or other growth of that height."""
        things = self.ranges.things
        size = {
            "height_m": stream.within(things.wood_height_m),
            "width_m": stream.within(things.wood_width_m),
            "density_per_m": stream.within(things.wood_density_per_m),
        }
        left_m = max(out_m, self._beyond_mount(road, side)) + stream.within(things.wood_away_m)
        within = self._stretch(stream, road, 0.5, (30, 150))
        self._hedge_along(road, side * (left_m + size["width_m"] / 2), size, within)

    def _trees(self, stream: RandomStream, road: PlannedRoad, side: int, out_m: float) -> float:
        left_m = out_m + stream.within(self.ranges.things.verge_m)
        self._trees_along(stream, road, side * left_m)
        return left_m + 0.5

    def _posts(self, stream: RandomStream, road: PlannedRoad, side: int, kerb: bool) -> None:
        things = self.ranges.things
        every, height = stream.within(things.post_every_m), stream.within(things.post_height_m)
        width = stream.within(things.post_width_m)
        edge = road.lanes_half_m + KERB_REACH_M if kerb else road.carriageway_half_m
        left_m = side * (edge + stream.within((0.45, 1.2)))
        size = {"length_m": width, "width_m": width, "height_m": height}
        middle = self._nearest_station(road)
        rows = self.free_space.rows(road, left_m, 0.3)
        s = middle - things.within_m + stream.within((0, every))
        while s < middle + things.within_m:
            if any(start <= s <= end for start, end in rows):
                self._building(road, s, left_m, size)
            s += every

    def _boxes(self, stream: RandomStream, road: PlannedRoad, side: int, out_m: float) -> None:
        """Adds cabinets, shelters, containers and stalls: objects of about the size of vehicles."""
        things = self.ranges.things
        for _ in range(stream.whole(self.road_type.boxes) // len(self.free_space.layout.roads)):
            size = {
                "length_m": stream.within(things.box_length_m),
                "width_m": stream.within(things.box_width_m),
                "height_m": stream.within(things.box_height_m),
            }
            s = self._nearest_station(road) + stream.within((-things.within_m, things.within_m))
            left_m = out_m + stream.within((0.5, 6.0)) + size["width_m"] / 2
            self._put(road, s, side * left_m, size, turn_deg=stream.within((-8, 8)))

    def _houses(self, stream: RandomStream, road: PlannedRoad, side: int, out_m: float) -> None:
        things = self.ranges.things
        setback = max(out_m, self._beyond_mount(road, side)) + stream.within(things.house_setback_m)
        storeys = stream.within(things.house_height_m)
        s = self._nearest_station(road) - things.within_m
        while s < self._nearest_station(road) + things.within_m:
            size = {
                "length_m": stream.within(things.house_length_m),
                "width_m": stream.within(things.house_depth_m),
                "height_m": round(storeys * stream.within((0.8, 1.2)), 2),
            }
            s += size["length_m"] / 2
            self._put(road, s, side * (setback + size["width_m"] / 2), size)
            s += size["length_m"] / 2 + stream.within(things.house_gap_m)

    def _car_park(self, stream: RandomStream, road: PlannedRoad, side: int, out_m: float) -> None:
        """Adds rows of parking bays beside a straight section of a road on level ground."""
        parking = self.ranges.parking
        if not stream.chance(self.road_type.car_park) or "embankment" in road.keys:
            return
        lorries = self.road_type.kerb_parking < 0.1 and stream.chance(parking.lorries)
        count = stream.whole(parking.rows)
        offsets = [0.0]
        for i in range(1, count):
            aisle = parking.aisle_m if i % 2 else 0.0
            step = parking.lorry_rows_m if lorries else parking.back_to_back_m + aisle
            offsets.append(offsets[-1] + step)
        deep = 2.0 if lorries else 3.4
        first = out_m + stream.within(parking.away_m) + deep
        half = (offsets[-1] + 2 * deep) / 2
        middle_m = first - deep + half
        for _ in range(TRIES):
            s = self._nearest_station(road) + stream.within((-90, 90))
            long_m = stream.within(parking.length_m)
            if not _is_straight(road, s - long_m / 2 - 1, s + long_m / 2 + 1):
                continue
            box = self._box(road, s, side * middle_m, long_m, 2 * half)
            if not self.free_space.holds(box):
                continue
            self.free_space.take([*box[:3], long_m + 2, 2 * half + 2, 1, box[6]])
            for offset in offsets:
                row = self._bays(stream, s - long_m / 2, s + long_m / 2, lorries)
                self._add("parked", road, side * (first + offset), row)
            return

    def _bays(self, stream: RandomStream, start: float, end: float, lorries: bool) -> Keys:
        parking = self.ranges.parking
        gap = (1.0, 6.0) if lorries else parking.bay_gap_m
        return {
            "from_m": round(start, 1),
            "to_m": round(end, 1),
            "turn_deg": 0 if lorries else stream.one_of(parking.bay_turn_deg),
            "gap_m": stream.within(gap),
            "occupied": stream.within(parking.occupied),
            "base_m": self.foot_m,
            "class_shares": {"Truck": 0.8, "Van": 0.2} if lorries else {"Car": 1.0},
        }

    # --- keys -------------------------------------------------------------------------------------

    def _rail_size(self, stream: RandomStream) -> Size:
        things = self.ranges.things
        height = stream.within(things.rail_height_m)
        return {"height_m": height, "width_m": stream.within(things.rail_width_m)}

    def _tree_shape(self, stream: RandomStream) -> Size:
        things = self.ranges.things
        return {
            "height_m": stream.within(things.tree_height_m),
            "crown_m": stream.within(things.crown_m),
            "trunk_m": stream.within(things.trunk_m),
            "trunk_width_m": stream.within(things.trunk_width_m),
            "density_per_m": stream.within(things.crown_density_per_m),
        }

    def _raised(self, shape: Size) -> Size:
        """Returns the tree with its crown raised above the vehicles of a lane below it."""
        trunk = round(self.ranges.things.free_trunk_m - shape["base_m"], 2)
        return shape | {"trunk_m": trunk, "height_m": max(shape["height_m"], round(trunk + 2, 2))}

    def _hedge_size(self, stream: RandomStream) -> Size:
        things = self.ranges.things
        return {
            "height_m": stream.within(things.hedge_height_m),
            "width_m": stream.within(things.hedge_width_m),
            "density_per_m": stream.within(things.hedge_density_per_m),
        }

    def _barrier(
        self, road: PlannedRoad, left_m: float, size: Size, within: Stretch = WHOLE
    ) -> None:
        for start, end in self.free_space.rows(road, left_m, size["width_m"] / 2, within):
            self._add("barriers", road, left_m, {"from_m": start, "to_m": end} | size)

    def _hedge_along(
        self, road: PlannedRoad, left_m: float, size: Size, within: Stretch = WHOLE
    ) -> None:
        base = {"base_m": self.slope_m(road, left_m)}
        for start, end in self.free_space.rows(road, left_m, size["width_m"] / 2, within):
            stations = {"from_m": start, "to_m": end}
            self._add_plant("hedge_along", road, left_m, stations | size | base)

    def _trees_along(self, stream: RandomStream, road: PlannedRoad, left_m: float) -> None:
        """Adds a row of trees; crowns that reach over a lane are raised above the vehicles."""
        shape = self._tree_shape(stream) | {"base_m": self.slope_m(road, left_m)}
        reaches = abs(left_m) - shape["crown_m"] / 2 < road.lanes_half_m + 0.3
        if reaches or self.free_space.layout.junctions:
            shape |= self._raised(shape)
        shape["every_m"] = stream.within(self.ranges.things.tree_every_m)
        # Keep crowns away from the sensor.
        keep_off = shape["crown_m"] / 2 + 3
        for start, end in self.free_space.rows(road, left_m, 0.5):
            for low, high in self._without_mount(road, left_m, start, end, keep_off):
                stations = {"from_m": round(low, 1), "to_m": round(high, 1)}
                self._add_plant("trees_along", road, left_m, stations | shape)

    def _without_mount(
        self, road: PlannedRoad, left_m: float, start: float, end: float, keep_off: float
    ) -> list[tuple[float, float]]:
        line = road.beside(left_m)
        away = np.hypot(line[:, 0] - self.mount["x_m"], line[:, 1] - self.mount["y_m"])
        near = road.stations[away < keep_off, 0]
        if len(near) == 0 or near[-1] < start or near[0] > end:
            return [(start, end)]
        parts = [(start, float(near[0]) - 1), (float(near[-1]) + 1, end)]
        return [(low, high) for low, high in parts if high > low]

    def _put(
        self, road: PlannedRoad, s: float, left_m: float, size: Size, turn_deg: float = 0.0
    ) -> None:
        """Adds a box if its position is free."""
        if not 0 < s < road.length_m:
            return
        box = self._box(road, s, left_m, size["length_m"], size["width_m"], turn_deg)
        if self.free_space.holds(box):
            self.free_space.take(box)
            self._building(road, s, left_m, size, turn_deg)

    def _building(
        self, road: PlannedRoad, s: float, left_m: float, size: Size, turn_deg: float = 0.0
    ) -> None:
        x, y, heading = road.pose_at(s, left_m)
        base = self.slope_m(road, left_m)
        building = {
            "x_m": round(float(x), 2),
            "y_m": round(float(y), 2),
            **size,
            "heading_deg": round(float(np.degrees(heading)) + turn_deg, 1),
            "base_m": base,
        }
        self.keys["buildings"].append(building)

    def _add(self, kind: str, road: PlannedRoad, left_m: float, keys: Keys) -> None:
        self.keys[kind].append({"road": road.name, "offset_m": round(left_m, 3)} | keys)

    def _add_plant(self, kind: str, road: PlannedRoad, left_m: float, keys: Keys) -> None:
        plant: dict[str, Any] = {"road": road.name, "offset_m": round(left_m, 3)} | keys
        self.keys["vegetation"].append({kind: plant})

    # --- positions --------------------------------------------------------------------------------

    def _box(
        self,
        road: PlannedRoad,
        s: float,
        left_m: float,
        length_m: float,
        width_m: float,
        turn_deg: float = 0.0,
    ) -> list[float]:
        x, y, heading = road.pose_at(s, left_m)
        return [x, y, 0, length_m, width_m, 1, heading + np.radians(turn_deg)]

    def _outer_m(self, road: PlannedRoad, side: int) -> float:
        """Returns the distance from the centreline to the outer edge of the road or parked cars."""
        kerb = (road.name, side) in self._kerbs
        return max(road.outer_half_m, road.lanes_half_m + KERB_REACH_M if kerb else 0.0)

    def _stretch(
        self, stream: RandomStream, road: PlannedRoad, share: float, long_m: Range
    ) -> Stretch:
        """Returns a section of the road near the focus with probability `share`, else all of it."""
        if not stream.chance(share):
            return WHOLE
        middle = self._nearest_station(road) + stream.within((-70, 70))
        half = stream.within(long_m) / 2
        return middle - half, middle + half

    def _is_free(self, road: PlannedRoad, s: float, left_m: float) -> bool:
        rows = self.free_space.rows(road, left_m, 0.5)
        return any(start <= s <= end for start, end in rows)

    def _nearest_station(self, road: PlannedRoad) -> float:
        away = road.stations[:, 1:3] - self.free_space.centre
        return float(road.stations[np.hypot(*away.T).argmin(), 0])

    def _beyond_mount(self, road: PlannedRoad, side: int) -> float:
        """Returns the distance from the centreline beyond which objects are behind the sensor."""
        foot = np.array([[self.mount["x_m"], self.mount["y_m"]]])
        left = road.beside(1.0) - road.stations[:, 1:3]
        nearest = np.hypot(*(road.stations[:, 1:3] - foot).T).argmin()
        left_m = float((foot[0] - road.stations[nearest, 1:3]) @ left[nearest])
        return side * left_m + 1.5 if 0 < side * left_m < 40 else 0.0

    def slope_m(self, road: PlannedRoad, left_m: float) -> float:
        """Returns the height of the surface beside a road: the road, its slope, or the ground."""
        if abs(left_m) <= road.carriageway_half_m:
            return 0.0
        slope = road.keys.get("embankment")
        if slope is None:
            return self.foot_m if abs(left_m) > road.outer_half_m else 0.0
        down = (abs(left_m) - road.outer_half_m) / slope["run_per_rise"]
        return round(float(max(min(0.0, -down), self.foot_m)), 2)


def _is_straight(road: PlannedRoad, start: float, end: float) -> bool:
    if start < 2 or end > road.length_m - 2:
        return False
    inside = (road.stations[:, 0] >= start - 1) & (road.stations[:, 0] <= end + 1)
    return bool(np.ptp(road.stations[inside, 3]) < 1e-6)
