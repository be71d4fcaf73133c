"""Objects beside and over the roads of a site, placed from the kerb outwards."""

import numpy as np

from pyinfra.scenes.generator.layout import SIDES, WHOLE, PlannedRoad, Stretch
from pyinfra.scenes.generator.parking import KERB_REACH_M, Parking
from pyinfra.scenes.generator.placement import Placement, box_at
from pyinfra.scenes.generator.random_stream import RandomStream, Range
from pyinfra.scenes.generator.road_types import RoadType
from pyinfra.scenes.generator.roadside_ranges import ThingRanges

Size = dict[str, float]


class Roadside:
    """Places the objects beside roads, over them and in their medians.

    Parked vehicles must already be placed.
    """

    def __init__(self, parking: Parking, road_type: RoadType, things: ThingRanges) -> None:
        self.parking, self.road_type, self.things = parking, road_type, things
        self.placement: Placement = parking.placement
        self.free_space = self.placement.free_space

    def add(self, road: PlannedRoad, seed: int) -> None:
        """Adds the objects of a road."""
        stream = RandomStream(seed, f"{road.name} middle")
        self._median(stream, road)
        self._gantry(stream, road)
        for side, word in SIDES:
            self._side(road, side, seed, f"{road.name} {word} ")

    def _side(self, road: PlannedRoad, side: int, seed: int, part: str) -> None:
        """Adds rows of objects from the road outwards, each with a separate random stream.

        The next row begins at the distance `out_m` from the centreline.
        """
        road_type, out_m = self.road_type, self.parking.outer_m(road, side)
        kerb = (road.name, side) in self.parking.kerbs
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
            left_m = out_m + stream.within(self.things.verge_m)
            self._trees(stream, road, side * left_m)
            out_m = left_m + 0.5
        stream = RandomStream(seed, f"{part}noise wall")
        if stream.chance(road_type.noise_wall):
            out_m = self._noise_wall(stream, road, side, out_m)
        stream = RandomStream(seed, f"{part}houses")
        if stream.chance(road_type.houses):
            self._houses(stream, road, side, out_m)
        elif stream.chance(road_type.wood):
            self._wood(stream, road, side, out_m)
        self._wild(RandomStream(seed, f"{part}wild"), road, side, out_m)

    # --- objects in the median and over the road --------------------------------------------------

    def _median(self, stream: RandomStream, road: PlannedRoad) -> None:
        things, median = self.things, road.keys["lanes"]["median_m"]
        kind = stream.one_of(self.road_type.in_median)
        if median < 1 or kind == "nothing":
            return
        if kind == "rails" and median >= 2:
            size = stream.each(things.rail)
            for left_m in (median / 2 - 0.5, 0.5 - median / 2):
                self.placement.barrier(road, left_m, size)
        elif kind == "hedge" and median >= 1.5:
            size = stream.each(things.hedge)
            size["width_m"] = min(size["width_m"], round(median - 0.6, 2))
            size["height_m"] = min(size["height_m"], 2.0)
            self.placement.hedge(road, 0.0, size)
        elif kind == "trees" and median >= 2:
            self._trees(stream, road, 0.0)
        else:
            self.placement.barrier(road, 0.0, stream.each(things.wall))

    def _gantry(self, stream: RandomStream, road: PlannedRoad) -> None:
        """Adds a gantry over the road, unless cars are parked at a kerb below it."""
        kerbs = {(road.name, side) for side, _ in SIDES} & self.parking.kerbs
        if not stream.chance(self.road_type.gantry) or kerbs:
            return
        nearest = self.free_space.nearest_station(road)
        s = nearest + stream.side() * stream.within(self.things.gantry_away_m)
        reach = road.carriageway_half_m + 1.5
        for left_m in (-reach, reach):
            if not any(a <= s <= b for a, b in self.free_space.rows(road, left_m, 0.5)):
                return
        clearance_m = stream.within(self.things.clearance_m)
        gantry = {"road": road.name, "s_m": round(s, 1), "clearance_m": clearance_m}
        self.placement.keys["gantries"].append(gantry)
        for left_m in (-reach, reach):
            self.free_space.take(box_at(road, s, left_m, (2, 3)))

    # --- objects along a side of the road ---------------------------------------------------------

    def _rail(self, stream: RandomStream, road: PlannedRoad, side: int) -> None:
        """Adds a guard rail at the edge of the shoulder, or between kerb and footway."""
        size = stream.each(self.things.rail)
        lanes = road.keys["lanes"]
        inwards = 0.35 if lanes["shoulder_m"] >= 0.9 and lanes["sidewalk_m"] == 0 else -0.3
        within = self._part(stream, road, self.things.rail_parts, self.things.rail_part_m)
        self.placement.barrier(road, side * (road.carriageway_half_m - inwards), size, within)

    def _noise_wall(
        self, stream: RandomStream, road: PlannedRoad, side: int, out_m: float
    ) -> float:
        left_m = max(out_m, self.placement.beyond_mount(road, side))
        left_m += stream.within(self.things.noise_wall_away_m)
        height = stream.within(self.things.noise_wall_m)
        self.placement.barrier(road, side * left_m, {"height_m": height, "width_m": 0.3})
        return left_m + 0.5

    def _hedge(self, stream: RandomStream, road: PlannedRoad, side: int, out_m: float) -> float:
        size = stream.each(self.things.hedge)
        left_m = out_m + stream.within(self.things.verge_m) + size["width_m"] / 2
        within = self._part(stream, road, self.things.hedge_parts, self.things.hedge_part_m)
        if left_m < self.placement.beyond_mount(road, side):  # a high hedge would hide the road
            size["height_m"] = min(size["height_m"], 1.4)
        self.placement.hedge(road, side * left_m, size, within)
        return left_m + size["width_m"] / 2

    def _wood(self, stream: RandomStream, road: PlannedRoad, side: int, out_m: float) -> None:
        """Adds the edge of a wood, or other vegetation of similar height."""
        things = self.things
        size = stream.each(things.wood)
        left_m = max(out_m, self.placement.beyond_mount(road, side))
        left_m += stream.within(things.wood_away_m)
        within = self._part(stream, road, things.wood_parts, things.wood_part_m)
        self.placement.hedge(road, side * (left_m + size["width_m"] / 2), size, within)

    def _posts(self, stream: RandomStream, road: PlannedRoad, side: int, kerb: bool) -> None:
        things = self.things
        spacing, height = stream.within(things.post_every_m), stream.within(things.post_height_m)
        width = stream.within(things.post_width_m)
        edge = road.lanes_half_m + KERB_REACH_M if kerb else road.carriageway_half_m
        left_m = side * (edge + stream.within(things.post_away_m))
        nearest = self.free_space.nearest_station(road)
        rows = self.free_space.rows(road, left_m, 0.3)
        s = nearest - things.within_m + stream.within((0, spacing))
        while s < nearest + things.within_m:
            if any(start <= s <= end for start, end in rows):
                self.placement.building(
                    self.placement.base(road, s, left_m), (width, width, height)
                )
            s += spacing

    def _boxes(self, stream: RandomStream, road: PlannedRoad, side: int, out_m: float) -> None:
        """Adds cabinets, shelters, containers and stalls of about the size of vehicles."""
        things = self.things
        for _ in range(stream.whole(self.road_type.boxes) // len(self.free_space.layout.roads)):
            long_m, wide_m, high_m = stream.each(things.box).values()
            s = self._station(stream, road)
            left_m = out_m + stream.within(things.box_away_m) + wide_m / 2
            turn_deg = stream.within(things.box_turn_deg)
            self.placement.box(road, s, side * left_m, (long_m, wide_m, high_m), turn_deg)

    def _houses(self, stream: RandomStream, road: PlannedRoad, side: int, out_m: float) -> None:
        things, nearest = self.things, self.free_space.nearest_station(road)
        setback = max(out_m, self.placement.beyond_mount(road, side))
        setback += stream.within(things.house_setback_m)
        height = stream.within(things.house_height_m)
        s = nearest - things.within_m
        while s < nearest + things.within_m:
            long_m, deep_m = (
                stream.within(things.house_length_m),
                stream.within(things.house_depth_m),
            )
            size = long_m, deep_m, round(height * stream.within(things.house_heights), 2)
            s += long_m / 2
            self.placement.box(road, s, side * (setback + deep_m / 2), size)
            s += long_m / 2 + stream.within(things.house_gap_m)

    def _wild(self, stream: RandomStream, road: PlannedRoad, side: int, out_m: float) -> None:
        """Adds bushes, some as large as a car, and single trees at random positions."""
        things, mount = self.things, self.placement.mount
        for _ in range(stream.whole(self.road_type.wild)):
            s = self._station(stream, road)
            left_m = side * (out_m + 1 + stream.within(things.wild_m))
            is_tree = stream.chance(things.wild_trees)
            long_m = 0.8 if is_tree else stream.within(things.bush_m)
            wide_m = round(long_m * stream.within(things.bush_width), 2)
            box = box_at(road, s, left_m, (long_m, wide_m), stream.within((-180, 180), 0))
            tree, hedge = stream.each(things.tree), stream.each(things.hedge)
            near = np.hypot(box[0] - mount["x_m"], box[1] - mount["y_m"]) < tree["crown_m"]
            if near or not 0 < s < road.length_m or not self.free_space.holds(box):
                continue
            position = {"x_m": round(box[0], 2), "y_m": round(box[1], 2)}
            base = {"base_m": self.placement.slope_m(road, left_m)}
            if is_tree:
                plant = {"tree": position | self._raised(tree | base)}
            else:
                size = {"length_m": long_m, "width_m": wide_m, "height_m": hedge["height_m"]}
                way = {"heading_deg": round(float(np.degrees(box[6])) % 360, 1)}
                density = {"density_per_m": hedge["density_per_m"]}
                plant = {"hedge": position | size | way | base | density}
            self.placement.keys["vegetation"].append(plant)

    # --- sizes and positions ----------------------------------------------------------------------

    def _raised(self, shape: Size) -> Size:
        """Returns the shape of a tree whose crown is above the vehicles of the lane below."""
        trunk = round(self.things.free_trunk_m - shape["base_m"], 2)
        return shape | {"trunk_m": trunk, "height_m": max(shape["height_m"], round(trunk + 2, 2))}

    def _trees(self, stream: RandomStream, road: PlannedRoad, left_m: float) -> None:
        """Adds a row of trees. Crowns that reach over a lane are raised above the vehicles."""
        shape = stream.each(self.things.tree) | {"base_m": self.placement.slope_m(road, left_m)}
        reaches = abs(left_m) - shape["crown_m"] / 2 < road.lanes_half_m + 0.3
        if reaches or self.free_space.layout.junctions:
            shape = self._raised(shape)
        spacing = {"every_m": stream.within(self.things.tree_every_m)}
        self.placement.trees(road, left_m, shape | spacing)

    def _part(
        self, stream: RandomStream, road: PlannedRoad, share: float, long_m: Range
    ) -> Stretch:
        """Returns a section near the focus with probability `share`, else the whole road."""
        if not stream.chance(share):
            return WHOLE
        middle = self.free_space.nearest_station(road) + stream.within(self.things.part_within_m)
        half = stream.within(long_m) / 2
        return middle - half, middle + half

    def _station(self, stream: RandomStream, road: PlannedRoad) -> float:
        reach_m = self.things.within_m
        return self.free_space.nearest_station(road) + stream.within((-reach_m, reach_m))
