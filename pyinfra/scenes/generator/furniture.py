"""Places street furniture beside roads: signs, bins, planters, shelters, small trees.

Groups of standing pedestrians are placed in the same way. A detector that was not trained with
furniture mistakes it for vehicles. Furniture is placed last, in the remaining free space, so that
no other part of a site depends on it.
"""

import numpy as np

from pyinfra.core.arrays import FloatArray
from pyinfra.scenes.generator.layout import SIDES, FreeSpace, Keys, PlannedRoad
from pyinfra.scenes.generator.people import Walks
from pyinfra.scenes.generator.placement import Base, BuildingSize, Placement
from pyinfra.scenes.generator.random_stream import RandomStream
from pyinfra.scenes.generator.road_types import RoadType
from pyinfra.scenes.generator.roadside_ranges import FurnitureRanges

TRIES = 8  # number of positions that are tried for each piece of furniture
GAP_M = 0.4  # minimum gap around each piece of furniture
VERGE_M = 1.5  # width of the strip beyond the footway in which furniture may also stand
# Width of the strip beyond the footway in which groups of pedestrians may stand. The evaluation
# region includes this strip.
GROUP_VERGE_M = 6.0
LANE_GAP_M = 0.3  # minimum gap between the carriageway and a piece of furniture


class Furniture:
    """Places the street furniture of a site, and collects the scene keys of standing groups."""

    def __init__(
        self, placement: Placement, walks: Walks, road_type: RoadType, how: FurnitureRanges
    ) -> None:
        self.placement, self.walks = placement, walks
        self.counts, self.how = road_type.furniture, how
        mount = placement.mount
        self.placed = np.array([[mount["x_m"], mount["y_m"], 1.0]])  # x y radius of placed objects
        self.groups: list[Keys] = []

    def add(self, road: PlannedRoad, seed: int) -> None:
        """Adds furniture on both sides of a road, large pieces first."""
        make = {
            "shelters": self._shelter,
            "groups": self._group,
            "trees": self._tree,
            "planters": self._planter,
            "bins": self._bin,
            "signs": self._sign,
        }
        for side, word in SIDES:
            for kind, build in make.items():
                stream = RandomStream(seed, f"{road.name} {word} {kind}")
                for _ in range(round(self.how.times * stream.whole(self.counts.get(kind, (0, 0))))):
                    build(stream, road, side)

    def _free_position(
        self,
        stream: RandomStream,
        road: PlannedRoad,
        side: int,
        radius_m: float,
        verge_m: float = VERGE_M,
    ) -> Base | None:
        """Returns the middle of a free circle beside a road, or None if all TRIES fail."""
        nearest = self.placement.free_space.nearest_station(road)
        for _ in range(TRIES):
            s = nearest + stream.within((-self.how.within_m, self.how.within_m))
            wide_m = road.keys["lanes"]["sidewalk_m"] + verge_m - 2 * radius_m
            out_m = LANE_GAP_M + radius_m + stream.within((0, max(wide_m, 0.2)))
            left_m = side * (road.carriageway_half_m + out_m)
            x, y, heading, base_m = self.placement.base(road, s, left_m)
            if 2 < s < road.length_m - 2 and self._is_free(np.array([[x, y]]), radius_m):
                self.placed = np.vstack([self.placed, [x, y, radius_m]])
                return round(x, 2), round(y, 2), heading, base_m
        return None

    def _is_free(self, position: FloatArray, radius_m: float) -> bool:
        """Returns whether the circle with a given radius around a position (1, 2) is free."""
        free_space: FreeSpace = self.placement.free_space
        if np.hypot(*(position[0] - free_space.centre)) < free_space.layout.junction_m + radius_m:
            return False
        for road in free_space.layout.roads:
            if road.distance(position)[0] < road.carriageway_half_m + LANE_GAP_M + radius_m:
                return False
        apart = np.hypot(*(self.placed[:, :2] - position).T) - self.placed[:, 2]
        return bool(apart.min() > radius_m + GAP_M) and self.walks.is_free(
            position, radius_m + GAP_M
        )

    def _box(
        self,
        at: Base,
        size: BuildingSize,
        *,
        turn_deg: float = 0.0,
        ahead_m: float = 0.0,
        left_m: float = 0.0,
        above_m: float = 0.0,
    ) -> None:
        """Adds a box of length, width and height, shifted along and across the road's direction."""
        x, y, heading, base_m = at
        cos, sin = np.cos(heading), np.sin(heading)
        x, y = x + cos * ahead_m - sin * left_m, y + sin * ahead_m + cos * left_m
        self.placement.building((x, y, heading, base_m + above_m), size, turn_deg)

    def _sign(self, stream: RandomStream, road: PlannedRoad, side: int) -> None:
        """Adds a sign, which is a plate on a pole, across the road or along it."""
        how = self.how
        plate = stream.within(how.plate_m), 0.1, stream.within(how.plate_m)
        pole_m, above_m = stream.within(how.pole_width_m), stream.within(how.plate_above_m)
        turn_deg = stream.one_of(how.plate_turn_deg) + stream.within(how.plate_off_deg, 0)
        if (at := self._free_position(stream, road, side, max(plate[0] / 2, 0.2))) is not None:
            self._box(at, (pole_m, pole_m, round(above_m + plate[2], 2)))
            self._box(at, plate, turn_deg=turn_deg, above_m=above_m)

    def _bin(self, stream: RandomStream, road: PlannedRoad, side: int) -> None:
        how = self.how
        size = stream.within(how.bin_m), stream.within(how.bin_m), stream.within(how.bin_height_m)
        if (at := self._free_position(stream, road, side, max(size[:2]) * 0.71)) is not None:
            self._box(at, size, turn_deg=stream.within(how.bin_turn_deg, 0))

    def _planter(self, stream: RandomStream, road: PlannedRoad, side: int) -> None:
        """Adds a bench or a planter along the road."""
        how = self.how
        long_m, wide_m, high_m = stream.each(how.planter).values()
        radius_m = float(np.hypot(long_m, wide_m)) / 2
        if (at := self._free_position(stream, road, side, radius_m)) is not None:
            self._box(at, (long_m, wide_m, high_m), turn_deg=stream.within(how.planter_turn_deg, 0))

    def _shelter(self, stream: RandomStream, road: PlannedRoad, side: int) -> None:
        """Adds a bus shelter with a roof, a back wall and one end wall, open to the road."""
        long_m, deep_m, high_m = stream.each(self.how.shelter).values()
        end = stream.side()
        if (
            at := self._free_position(stream, road, side, float(np.hypot(long_m, deep_m)) / 2)
        ) is None:
            return
        self._box(at, (long_m, deep_m, 0.15), above_m=high_m)
        self._box(at, (long_m, 0.1, high_m), left_m=side * (deep_m / 2 - 0.05))
        self._box(at, (0.1, deep_m, high_m), ahead_m=end * (long_m / 2 - 0.05))

    def _tree(self, stream: RandomStream, road: PlannedRoad, side: int) -> None:
        """Adds a small tree, whose crown hangs over the footway."""
        how = self.how
        crown_m, trunk_m = stream.within(how.crown_m), stream.within(how.crown_above_m)
        tree = {
            "height_m": round(trunk_m + stream.within(how.crown_height_m), 2),
            "crown_m": crown_m,
            "trunk_m": trunk_m,
            "trunk_width_m": stream.within(how.trunk_width_m),
            "density_per_m": stream.within(how.crown_density_per_m),
        }
        if (at := self._free_position(stream, road, side, crown_m / 2)) is not None:
            plant = {"x_m": at[0], "y_m": at[1], **tree, "base_m": at[3]}
            self.placement.keys["vegetation"].append({"tree": plant})

    def _group(self, stream: RandomStream, road: PlannedRoad, side: int) -> None:
        """Adds a group of pedestrians who stand close together."""
        group = {
            "count": stream.whole(self.how.group_of),
            "spacing_m": stream.within(self.how.group_spacing_m),
        }
        radius_m = group["spacing_m"] * (0.58 * np.sqrt(group["count"]) + 0.05) + 0.6
        # The simulator keeps the square around the group's circle free.
        if (
            at := self._free_position(stream, road, side, float(1.42 * radius_m), GROUP_VERGE_M)
        ) is not None:
            self.groups.append({"x_m": at[0], "y_m": at[1], **group, "base_m": at[3]})
