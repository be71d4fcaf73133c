"""Places the parked vehicles of a site, in rows at kerbs and in car parks."""

import numpy as np

from pyinfra.scenes.generator.layout import SIDES, Keys, PlannedRoad
from pyinfra.scenes.generator.placement import Placement, along, box_at
from pyinfra.scenes.generator.random_stream import RandomStream
from pyinfra.scenes.generator.road_types import RoadType
from pyinfra.scenes.generator.roadside_ranges import ParkingRanges

# Distance from the lanes to the centres of parked vehicles. It is half the width of a van that is
# slightly turned.
KERB_ROW_M = 1.6
KERB_REACH_M = 3.2  # distance from the lanes to the far sides of parked vehicles
TRIES = 6  # number of positions that are tried for each car park


class Parking:
    """Places parked vehicles. Other objects are placed later, and avoid the vehicles."""

    def __init__(self, placement: Placement, road_type: RoadType, how: ParkingRanges) -> None:
        self.placement, self.road_type, self.how = placement, road_type, how
        self.free_space = placement.free_space
        self.kerbs: set[tuple[str, int]] = set()  # roads and sides with cars parked at the kerb

    def add(self, road: PlannedRoad, seed: int) -> None:
        """Adds parked vehicles on both sides of a road."""
        for side, word in SIDES:
            if self._kerb_row(RandomStream(seed, f"{road.name} {word} kerb"), road, side):
                self.kerbs.add((road.name, side))
            self._car_park(RandomStream(seed, f"{road.name} {word} car park"), road, side)

    def outer_m(self, road: PlannedRoad, side: int) -> float:
        """Returns the distance from the centreline to the outer edge of road and parked cars."""
        kerb = (road.name, side) in self.kerbs
        return max(road.outer_half_m, road.lanes_half_m + KERB_REACH_M if kerb else 0.0)

    def _kerb_row(self, stream: RandomStream, road: PlannedRoad, side: int) -> bool:
        """Adds cars that are parked at a kerb. Returns whether the kerb has a parking lane."""
        wide = road.keys["lanes"]["shoulder_m"] >= self.how.lane_m[0]
        if self.road_type.kerb_parking == 0 or not wide:
            return False
        left_m = round(side * (road.lanes_half_m + KERB_ROW_M), 3)
        nearest, classes = self.free_space.nearest_station(road), dict(self.how.kerb_classes)
        for start, end in self.free_space.rows(road, left_m, KERB_ROW_M):
            low = min(max(start, nearest - self.how.kerb_within_m), end)
            row = {
                "gap_m": stream.within(self.how.kerb_gap_m),
                "occupied": stream.within(self.how.occupied),
                "class_shares": classes,
            }
            if end - low > 10:
                self.placement.keys["parked"].append(along(road, left_m, (low, end), row))
        return True

    def _car_park(self, stream: RandomStream, road: PlannedRoad, side: int) -> None:
        """Adds rows of parking bays beside a straight section of a road on level ground."""
        how, out_m = self.how, self.outer_m(road, side)
        if not stream.chance(self.road_type.car_park) or "embankment" in road.keys:
            return
        lorries = self.road_type.kerb_parking < 0.1 and stream.chance(how.lorries)
        offsets = [0.0]
        for i in range(1, stream.whole(how.rows)):
            aisle = how.aisle_m if i % 2 else 0.0
            offsets.append(
                offsets[-1] + (how.lorry_rows_m if lorries else how.back_to_back_m + aisle)
            )
        deep = 2.0 if lorries else 3.4
        first = out_m + stream.within(how.away_m) + deep
        half = (offsets[-1] + 2 * deep) / 2
        middle_m = first - deep + half
        for _ in range(TRIES):
            s = self.free_space.nearest_station(road) + stream.within(how.along_m)
            long_m = stream.within(how.length_m)
            if not _is_straight(road, s - long_m / 2 - 1, s + long_m / 2 + 1):
                continue
            box = box_at(road, s, side * middle_m, (long_m, 2 * half))
            if not self.free_space.holds(box):
                continue
            self.free_space.take([*box[:3], long_m + 2, 2 * half + 2, 1, box[6]])
            part = s - long_m / 2, s + long_m / 2
            for offset in offsets:
                row = along(road, side * (first + offset), part, self._bays(stream, lorries))
                self.placement.keys["parked"].append(row)
            return

    def _bays(self, stream: RandomStream, lorries: bool) -> Keys:
        how = self.how
        return {
            "turn_deg": 0 if lorries else stream.one_of(how.bay_turn_deg),
            "gap_m": stream.within(how.lorry_gap_m if lorries else how.bay_gap_m),
            "occupied": stream.within(how.occupied),
            "base_m": self.placement.foot_m,
            "class_shares": dict(how.lorry_classes if lorries else how.bay_classes),
        }


def _is_straight(road: PlannedRoad, start: float, end: float) -> bool:
    if start < 2 or end > road.length_m - 2:
        return False
    inside = (road.stations[:, 0] >= start - 1) & (road.stations[:, 0] <= end + 1)
    return bool(np.ptp(road.stations[inside, 3]) < 1e-6)
