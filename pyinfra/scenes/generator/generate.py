"""Generates a random site from a seed, as the keys and values of a scene file.

The same seed and version always give the same site. Each part of a site (roads, sensor, traffic,
each side of each road) has a separate random stream. A new kind of object in one part therefore
changes little in the other parts.
"""

import numpy as np

from pyinfra.core.errors import Error
from pyinfra.core.vocabulary import KM_H
from pyinfra.scenes.generator.furniture import Furniture
from pyinfra.scenes.generator.layout import LAYOUTS, FreeSpace, Keys, Layout, PlannedRoad, varied
from pyinfra.scenes.generator.parking import Parking
from pyinfra.scenes.generator.people import Walks
from pyinfra.scenes.generator.placement import Placement
from pyinfra.scenes.generator.random_stream import RandomStream
from pyinfra.scenes.generator.ranges import RANGES, Ranges
from pyinfra.scenes.generator.road_types import ROAD_TYPES, RoadType
from pyinfra.scenes.generator.roadside import Roadside

DURATION_S = 60.0  # duration of a run; long enough for queues to form and dissolve
WARM_UP_S = 60.0
BOX_OF_SENSOR_M = 2.0  # side of the square around the sensor that stays free

# Mean length and width of the vehicles of each class, equal to the simulator's table.
MEAN_SIZE_M = {
    "Car": (4.53, 1.95),
    "Van": (5.3, 2.05),
    "Truck": (6.97, 2.7),
    "Bus": (10.5, 2.94),
    "Motorcycle": (2.1, 0.82),
}


def make_site(seed: int, ranges: Ranges = RANGES) -> Keys:
    """Returns the keys of a scene file. Raises Error for a seed below 0."""
    if seed < 0:
        raise Error(f"seed: expected 0 or more, got {seed}")
    stream = RandomStream(seed, "roads")
    road_type = ROAD_TYPES[stream.one_of(ranges.road_types)]
    layout = LAYOUTS[stream.one_of(road_type.layouts)](stream, road_type, ranges)
    layout = varied(layout, RandomStream(seed, "junction"), ranges)
    foot_m = _embank(RandomStream(seed, "ground"), road_type, ranges, layout)
    free_space = FreeSpace(layout)
    mount = _mount(RandomStream(seed, "mount"), ranges, layout)
    mount |= _on_a_slope(RandomStream(seed, "grade"), road_type, ranges, mount, layout)
    free_space.take([mount["x_m"], mount["y_m"], 0, BOX_OF_SENSOR_M, BOX_OF_SENSOR_M, 1, 0])
    placement = Placement(free_space, foot_m, mount)
    parking = Parking(placement, road_type, ranges.parking)
    for road in layout.roads:
        parking.add(road, seed)
    roadside = Roadside(parking, road_type, ranges.things)
    for road in layout.roads:
        roadside.add(road, seed)
    # People and furniture are placed last, so that other static objects do not depend on them.
    walks = Walks(free_space, road_type, ranges.ways, placement.keys)
    if RandomStream(seed, "people").chance(ranges.ways.sites):
        for road in layout.roads:
            walks.add(road, seed)
    things = placement.keys | {"people": walks.rows}
    if RandomStream(seed, "furniture").chance(ranges.furniture.sites):
        furniture = Furniture(placement, walks, road_type, ranges.furniture)
        for road in layout.roads:
            furniture.add(road, seed)
        things["standing_people"] = furniture.groups
    return _scene(seed, road_type, ranges, layout, mount, things, foot_m)


def _scene(
    seed: int,
    road_type: RoadType,
    ranges: Ranges,
    layout: Layout,
    mount: Keys,
    things: Keys,
    foot_m: float,
) -> Keys:
    sky, how = RandomStream(seed, "sky"), ranges.sky
    weather = {
        "rain_mm_per_h": sky.within(how.rain_mm_per_h) if sky.chance(how.rain) else 0,
        "sunlight_klux": 0 if sky.chance(how.night) else sky.within(how.sunlight_klux),
    }
    half = max(float(np.abs(road.stations[:, 1:3]).max()) for road in layout.roads) + 150
    corners = [[-half, -half], [half, -half], [half, half], [-half, half]]
    return {
        "name": f"site_{seed:06d}",
        "seed": seed,
        "duration_s": DURATION_S,
        "label_time": "scan" if sky.chance(how.scan_labels) else "frame",
        "mounts": {"pole": mount},
        "weather": weather,
        "roads": [road.keys for road in layout.roads],
        "ground": [
            {
                "elevation_m": foot_m,
                "outline_m": [[round(x), round(y)] for x, y in corners],
            }
        ],
        **{key: value for key, value in things.items() if value},
        **({"junctions": list(layout.junctions)} if layout.junctions else {}),
        "traffic": _traffic(seed, road_type, ranges, layout),
    }


def _embank(stream: RandomStream, road_type: RoadType, ranges: Ranges, layout: Layout) -> float:
    """Returns the elevation of the ground in metres.

    The function may add an embankment to the road of a layout without junctions.
    """
    below = -stream.within(ranges.ground_below_m)
    if layout.junctions or not stream.chance(road_type.embankment):
        return below
    depth = stream.within(road_type.embankment_m)
    run = stream.within(ranges.slope_run_per_rise)
    (road,) = layout.roads
    if road.outer_half_m + depth * run > road.radius_m / 2:
        return below
    road.keys["embankment"] = {"run_per_rise": run, "foot_elevation_m": -depth}
    return -depth


def _mount(stream: RandomStream, ranges: Ranges, layout: Layout) -> Keys:
    """Returns the pose of a sensor beside a road, over its median, or over its lanes."""
    how, road, side = ranges.mount, layout.roads[0], stream.side()
    height = stream.within(how.height_m)
    s, left_m = layout.focus
    if layout.junctions:
        s += stream.side() * (layout.corner_m + stream.within(how.before_junction_m))
    else:
        s += stream.within(how.along_m)
    word = stream.one_of({"lanes": how.over_lanes, "median": how.over_median, "beside": 1.0})
    if word == "median" and road.keys["lanes"]["median_m"] >= 1:
        left_m = 0.0
    elif word == "lanes":
        left_m = side * stream.within((0, road.lanes_half_m))
        height = stream.within(how.over_m)
    else:
        edge = road.carriageway_half_m if stream.chance(0.5) else road.outer_half_m
        left_m = side * (edge + stream.within(how.beside_m))
    x, y, heading = road.pose_at(s, left_m)
    yaw = np.degrees(heading) + stream.within(how.off_aim_deg)
    yaw += _aim(stream, ranges, layout, s - layout.focus[0], left_m)
    return {
        "x_m": round(float(x), 2),
        "y_m": round(float(y), 2),
        "z_m": height,
        "yaw_deg": round(float((yaw + 180) % 360 - 180), 1),
        "pitch_deg": stream.within(stream.one_of(how.pitch_deg)),
        "roll_deg": stream.within(how.roll_deg),
    }


def _on_a_slope(
    stream: RandomStream, road_type: RoadType, ranges: Ranges, mount: Keys, layout: Layout
) -> Keys:
    """Returns pitch and roll for a sensor on a vertical pole beside roads with a grade.

    The roads of the scene stay level, and the sensor is tilted instead. For networks, a tilted
    sensor is equivalent to a sloping road, because their inputs are heights above the road.
    """
    if not stream.chance(ranges.grades):
        return {}
    slope_deg = np.degrees(np.arctan(stream.side() * stream.within(road_type.grade_percent) / 100))
    off = np.radians(layout.roads[0].keys["start"]["heading_deg"] - mount["yaw_deg"])
    return {
        "pitch_deg": round(float(mount["pitch_deg"] + slope_deg * np.cos(off)), 2),
        "roll_deg": round(float(mount["roll_deg"] - slope_deg * np.sin(off)), 2),
    }


def _aim(
    stream: RandomStream, ranges: Ranges, layout: Layout, ahead_m: float, left_m: float
) -> float:
    """Returns the sensor's yaw relative to the road in degrees.

    With the aim `along`, the sensor faces the junction, if there is one.
    """
    word = stream.one_of(ranges.mount.aims)
    if word == "anywhere":
        return stream.within((-180, 180))
    if word == "across":
        return -90.0 if left_m > 0 else 90.0
    back = ahead_m > 0 if layout.junctions else stream.chance(0.5)
    return 180.0 if back else 0.0


def _traffic(seed: int, road_type: RoadType, ranges: Ranges, layout: Layout) -> Keys:
    stream, fleet = RandomStream(seed, "traffic"), RandomStream(seed, "fleet")
    radius = min(_inner_radius(road) for road in layout.roads)
    width = min(road.keys["lanes"]["width_m"] for road in layout.roads)
    fastest = KM_H * float(np.sqrt(ranges.lateral_m_s2 * radius))
    speed = min(stream.within(road_type.speed_km_h, 1), round(fastest, 1))
    shares = {name: stream.within(weight, 3) for name, weight in road_type.classes.items()}
    if (frequent := fleet.one_of(ranges.fleets)) in shares:
        shares[frequent] = fleet.within(ranges.fleet_weight, 3)
    return {
        "vehicles_per_km_lane": stream.within(road_type.vehicles_per_km_lane, 1),
        "speed": {
            "mean_km_h": speed,
            "std_km_h": round(speed * stream.within(ranges.speed_spread), 1),
        },
        "warm_up_s": WARM_UP_S,
        "class_shares": {n: v for n, v in shares.items() if fits(n, width, radius)},
    }


def _inner_radius(road: PlannedRoad) -> float:
    """Returns the radius of the innermost lane in the tightest bend."""
    return road.radius_m - road.lanes_half_m + float(road.keys["lanes"]["width_m"]) / 2


def fits(name: str, lane_m: float, radius_m: float) -> bool:
    """Returns whether the mean vehicle of a class stays in its lane in a bend.

    The simulator has the same rule.
    """
    length, width = MEAN_SIZE_M[name]
    if np.isinf(radius_m):
        return width <= lane_m - 0.01
    middle = np.sqrt(max(radius_m**2 - length**2 / 8, 0))
    reach = max(np.hypot(middle + width / 2, length / 2) - radius_m, radius_m - middle + width / 2)
    return bool(reach <= lane_m / 2 - 0.02)
