"""All distributions of the scene generator, with their reasons or sources.

A range is a uniform distribution, a share is a probability, and a mapping holds weights. `RAA`,
`RAL` and `RASt` are the German guidelines for motorways, rural roads and town roads. Numbers
without a source are nominal, and rather too wide than too narrow.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from pyinfra.scenes.generator.random_stream import Range

Weights = Mapping[str, float]


@dataclass(frozen=True)
class WalkRanges:
    """Pedestrians or cyclists on one side of a road."""

    share: float  # share of road sides with a row
    per_km: Range  # both directions together; the simulator allows up to 60
    speed_km_h: Range  # mean speed
    speed_spread: Range  # standard deviation relative to the mean, at most a third


@dataclass(frozen=True)
class RoadType:
    """A road type: its roads, its traffic, and its roadside objects."""

    layouts: Weights
    each_way: Mapping[int, float]
    lane_m: Range
    median: float  # share of roads with one
    median_m: Range
    shoulder_m: Range
    sidewalk: float
    sidewalk_m: Range
    radius_m: Range
    turn_deg: Range
    speed_km_h: Range
    vehicles_per_km_lane: Range
    classes: Mapping[str, Range]  # weights of the vehicle classes
    in_median: Weights
    embankment: float
    embankment_m: Range  # depth of its foot below the road
    rail: float  # share of road sides; the same for the following shares
    noise_wall: float
    hedge: float
    trees: float
    houses: float
    posts: float
    boxes: tuple[int, int]  # cabinets, shelters, containers, which resemble vehicles
    wood: float  # share of road sides without houses
    wild: tuple[int, int]  # number of single bushes and trees per side
    kerb_parking: float  # share of roads with a parking lane
    car_park: float
    gantry: float  # share of roads
    walks: Mapping[str, WalkRanges]  # by class
    furniture: Mapping[str, tuple[int, int]]  # number of pieces of each kind per side
    grade_percent: Range  # of the roads of sites on a slope


# Adults walk at 4 to 6 km/h, or much slower while they look around or wait. Most cyclists ride at
# 12 to 25 km/h.
ON_FOOT = {"speed_km_h": (1.5, 6.0), "speed_spread": (0.05, 0.25)}
ON_BICYCLES = {"speed_km_h": (9.0, 26.0), "speed_spread": (0.05, 0.25)}
_NOBODY: Mapping[str, WalkRanges] = {}
_FEW = {
    "Pedestrian": WalkRanges(share=0.2, per_km=(4, 25), **ON_FOOT),
    "Cyclist": WalkRanges(share=0.25, per_km=(4, 25), **ON_BICYCLES),
}
_MANY = {
    "Pedestrian": WalkRanges(share=0.65, per_km=(8, 60), **ON_FOOT),
    # As many cyclists as pedestrians, for training.
    "Cyclist": WalkRanges(share=0.6, per_km=(8, 60), **ON_BICYCLES),
}

# RAA: lanes 3.5 to 3.75 m, shoulders up to 3 m, radii from 280 m (EKA 3). Speeds range from jams to
# free flow; up to a third of the traffic are lorries on working days. Most motorways have guard
# rails on both sides and a median with a wall, rails or a hedge. A network that was not trained
# with these mistakes them for vehicles.
MOTORWAY = RoadType(
    layouts={"straight": 0.6, "curve": 0.4},
    each_way={2: 0.45, 3: 0.35, 4: 0.2},
    lane_m=(3.4, 3.75),
    median=0.95,
    median_m=(2.0, 8.0),
    shoulder_m=(1.0, 3.5),
    sidewalk=0.0,
    sidewalk_m=(0.0, 0.0),
    radius_m=(280, 1200),
    turn_deg=(10, 40),
    speed_km_h=(60, 125),
    vehicles_per_km_lane=(2, 25),
    classes={
        "Car": (0.5, 0.9),
        "Van": (0.03, 0.2),
        "Truck": (0.03, 0.35),
        "Bus": (0, 0.04),
        "Motorcycle": (0, 0.06),
    },
    in_median={"wall": 0.35, "rails": 0.3, "hedge": 0.2, "trees": 0.05, "nothing": 0.1},
    embankment=0.5,
    embankment_m=(0.3, 8.0),
    rail=0.8,
    noise_wall=0.15,
    hedge=0.6,
    trees=0.5,
    houses=0.1,
    posts=0.4,
    boxes=(0, 3),
    wood=0.55,
    wild=(0, 15),
    kerb_parking=0.0,
    car_park=0.1,
    gantry=0.25,
    walks=_NOBODY,
    furniture={"signs": (0, 4), "trees": (0, 3), "bins": (0, 1)},
    grade_percent=(0, 6),
)

# RAL: one lane each way, on some roads two, 3.25 to 3.5 m wide. Radii are those of EKL 4 and of
# older roads. Ditches, trees and hedges are close to the road, and steep sections have rails.
RURAL = RoadType(
    layouts={"straight": 0.4, "curve": 0.4, "crossing": 0.2},
    each_way={1: 0.75, 2: 0.25},
    lane_m=(2.8, 3.6),
    median=0.08,
    median_m=(1.0, 3.0),
    shoulder_m=(0.25, 1.9),
    sidewalk=0.15,
    sidewalk_m=(1.5, 2.5),
    radius_m=(60, 400),
    turn_deg=(20, 80),
    speed_km_h=(40, 95),
    vehicles_per_km_lane=(2, 18),
    classes={
        "Car": (0.5, 0.9),
        "Van": (0.03, 0.2),
        "Truck": (0.02, 0.25),
        "Bus": (0, 0.04),
        "Motorcycle": (0, 0.12),
    },
    in_median={"wall": 0.2, "rails": 0.3, "hedge": 0.3, "nothing": 0.2},
    embankment=0.4,
    embankment_m=(0.3, 3.0),
    rail=0.4,
    noise_wall=0.02,
    hedge=0.55,
    trees=0.6,
    houses=0.2,
    posts=0.5,
    boxes=(0, 3),
    wood=0.55,
    wild=(0, 20),
    kerb_parking=0.02,
    car_park=0.15,
    gantry=0.02,
    walks=_FEW,
    furniture={
        "signs": (0, 4),
        "trees": (0, 5),
        "bins": (0, 2),
        "planters": (0, 1),
        "shelters": (0, 1),
        "groups": (0, 3),
    },
    grade_percent=(0, 10),
)

# RASt: lanes 2.75 to 3.5 m, footways from 1.5 m, parking lanes of 2 m at the kerb. Trees stand in
# rows, houses are close to the footway, and queues form at signals.
STREET = RoadType(
    layouts={"straight": 0.25, "curve": 0.2, "crossing": 0.55},
    each_way={1: 0.4, 2: 0.45, 3: 0.15},
    lane_m=(2.75, 3.6),
    median=0.3,
    median_m=(1.0, 6.0),
    shoulder_m=(0.2, 0.8),
    sidewalk=0.9,
    sidewalk_m=(1.5, 5.0),
    radius_m=(22, 120),
    turn_deg=(25, 100),
    speed_km_h=(18, 60),
    vehicles_per_km_lane=(4, 35),
    classes={
        "Car": (0.6, 0.95),
        "Van": (0.03, 0.2),
        "Truck": (0, 0.1),
        "Bus": (0, 0.07),
        "Motorcycle": (0, 0.2),
    },
    in_median={"wall": 0.1, "rails": 0.1, "hedge": 0.35, "trees": 0.2, "nothing": 0.25},
    embankment=0.0,
    embankment_m=(0.0, 0.0),
    rail=0.1,
    noise_wall=0.03,
    hedge=0.4,
    trees=0.55,
    houses=0.65,
    posts=0.7,
    boxes=(0, 6),
    wood=0.3,
    wild=(0, 8),
    kerb_parking=0.35,
    car_park=0.25,
    gantry=0.02,
    walks=_MANY,
    furniture={
        "signs": (0, 8),
        "trees": (0, 10),
        "bins": (0, 6),
        "planters": (0, 5),
        "shelters": (0, 2),
        "groups": (0, 6),
    },
    grade_percent=(0, 8),
)


@dataclass(frozen=True)
class MountRanges:
    """The mounting position and orientation of a sensor."""

    height_m: Range = (3.5, 9.0)  # on masts, signal posts or lamp posts
    over_m: Range = (5.5, 9.0)  # height above lanes, on an arm or a gantry
    over_lanes: float = 0.08  # weight relative to 1 for sensors beside the road
    over_median: float = 0.12  # weight relative to 1 for sensors beside the road
    beside_m: Range = (0.3, 4.0)  # from the edge of the carriageway or of the footway
    before_junction_m: Range = (1.0, 30.0)  # from the corner
    aims: Weights = field(default_factory=lambda: {"along": 0.7, "across": 0.15, "anywhere": 0.15})
    off_aim_deg: Range = (-20, 20)
    pitch_deg: Mapping[Range, float] = field(  # mounted level, or looking down
        default_factory=lambda: {(-1.0, 2.0): 0.6, (2.0, 12.0): 0.4}
    )
    roll_deg: Range = (-1.5, 1.5)


@dataclass(frozen=True)
class ThingRanges:
    """Sizes of roadside objects."""

    verge_m: Range = (0.4, 3.0)  # gap between successive rows of objects
    rail_height_m: Range = (0.7, 0.9)  # EN 1317 systems: 0.75
    wall_height_m: Range = (0.8, 1.15)  # New Jersey and step barriers: 0.81 to 1.1
    wall_width_m: Range = (0.25, 0.6)
    rail_width_m: Range = (0.15, 0.35)
    noise_wall_m: Range = (2.0, 4.5)
    hedge_height_m: Range = (0.7, 3.0)
    hedge_width_m: Range = (0.5, 2.5)
    hedge_density_per_m: Range = (0.5, 2.0)  # sparse shrubs to clipped hedges
    tree_every_m: Range = (6, 18)
    tree_height_m: Range = (7, 14)
    crown_m: Range = (2.5, 7.0)
    trunk_m: Range = (1.5, 3.5)
    trunk_width_m: Range = (0.15, 0.6)
    crown_density_per_m: Range = (0.4, 1.2)
    free_trunk_m: float = 4.7  # trunk height of trees whose crowns reach over a lane
    wood_height_m: Range = (3, 12)
    wood_width_m: Range = (4, 15)
    wood_density_per_m: Range = (0.2, 0.8)
    wood_away_m: Range = (0.5, 15)
    bush_m: Range = (0.8, 6.0)  # length; some are as large as a car
    wild_m: Range = (0, 30)  # distance beyond the rows
    wild_trees: float = 0.3
    house_length_m: Range = (7, 45)
    house_depth_m: Range = (7, 16)
    house_height_m: Range = (3, 20)
    house_gap_m: Range = (1, 25)
    house_setback_m: Range = (0.5, 12)
    post_every_m: Range = (18, 45)
    post_height_m: Range = (2.5, 9)  # sign posts to lamp posts
    post_width_m: Range = (0.1, 0.35)
    box_length_m: Range = (0.6, 6.5)
    box_width_m: Range = (0.5, 2.6)
    box_height_m: Range = (0.9, 2.8)
    # Houses, posts, boxes and bushes lie within this distance along the road of its station nearest
    # to the site's focus; farther ones would hardly be seen.
    within_m: float = 120


@dataclass(frozen=True)
class ParkingRanges:
    """Parked vehicles at kerbs and in car parks."""

    lane_m: Range = (2.0, 2.6)  # width of parking lanes at the kerb; RASt: 2.0
    kerb_gap_m: Range = (0.7, 2.0)
    bay_gap_m: Range = (0.4, 0.9)  # bays of 2.5 m
    bay_turn_deg: Mapping[float, float] = field(
        default_factory=lambda: {90: 0.7, 60: 0.15, -60: 0.15}
    )
    occupied: Range = (0.3, 1.0)
    rows: tuple[int, int] = (1, 4)
    length_m: Range = (18, 70)
    away_m: Range = (2.0, 10.0)  # distance of a car park from the outer edge of the road
    back_to_back_m: float = 6.8  # the longest car at 60 degrees needs 6.37 m, and may be 0.15 m off
    aisle_m: float = 6.0
    lorries: float = 0.2  # share of car parks with lorries, outside streets; rows along the road
    lorry_rows_m: float = 5.0


@dataclass(frozen=True)
class WayRanges:
    """Rows of pedestrians and cyclists."""

    sites: float = 0.85  # share of sites with rows, among road types that have them
    within_m: float = 120  # maximum distance from the site's focus
    verge_m: float = 3.0  # strip beyond the footway that rows may use; their region extends to 6 m
    shortest_m: float = 15.0  # minimum length; pedestrians and cyclists appear and end at its ends


@dataclass(frozen=True)
class FurnitureRanges:
    """Street furniture and standing groups; sizes are nominal unless a source is named."""

    sites: float = 0.7  # share of sites with furniture
    times: float = 1.0  # multiplies the numbers of pieces of the road type
    within_m: float = 80  # along the road, from its station nearest to the site's focus
    plate_m: Range = (0.4, 1.5)  # traffic signs of 0.42 to 0.9 m (StVO), larger ones at junctions
    plate_above_m: Range = (1.8, 3.0)  # StVO: 2.0 to 2.25 above footways
    pole_width_m: Range = (0.06, 0.25)
    bin_m: Range = (0.35, 0.9)
    bin_height_m: Range = (0.8, 1.5)
    planter_length_m: Range = (0.8, 2.5)
    planter_width_m: Range = (0.4, 1.2)
    planter_height_m: Range = (0.4, 1.1)
    shelter_length_m: Range = (2.5, 5.5)
    shelter_depth_m: Range = (1.2, 2.2)
    shelter_height_m: Range = (2.2, 2.7)
    crown_m: Range = (1.6, 4.5)
    crown_above_m: Range = (2.0, 3.5)  # height of the lowest leaves
    crown_height_m: Range = (1.5, 4.0)
    trunk_width_m: Range = (0.1, 0.4)
    crown_density_per_m: Range = (0.3, 1.5)
    group_of: tuple[int, int] = (2, 9)
    group_spacing_m: Range = (1.2, 1.8)


@dataclass(frozen=True)
class RingRanges:
    """Single-lane roundabouts, 30 to 60 m in outer diameter (Merkblatt Kreisverkehre: 26 to 40)."""

    radius_m: Range = (12.5, 26)
    width_m: Range = (5, 7)
    island_m: Range = (0.1, 1.2)  # height of the island, from low stones to mounds


@dataclass(frozen=True)
class SkyRanges:
    rain: float = 0.15
    rain_mm_per_h: Range = (0.5, 20)
    night: float = 0.3
    sunlight_klux: Range = (2, 100)  # overcast to full sun
    scan_labels: float = 0.5  # share of sites with label time `scan`; the others have `frame`


@dataclass(frozen=True)
class Ranges:
    """All distributions of the scene generator."""

    road_types: Mapping[str, float] = field(
        default_factory=lambda: {"motorway": 0.3, "rural": 0.25, "street": 0.45}
    )
    mount: MountRanges = MountRanges()
    things: ThingRanges = ThingRanges()
    parking: ParkingRanges = ParkingRanges()
    sky: SkyRanges = SkyRanges()
    ways: WayRanges = WayRanges()
    half_length_m: Range = (170, 260)  # of roads, beyond the region's 100 m to either side
    crossing_deg: Range = (60, 120)  # the simulator allows 45 to 135
    t_junctions: float = 0.35  # share of the crossings
    one_way: float = 0.15  # share of the side roads of crossings
    # Some sites have much traffic of a class that is rare elsewhere: motorcycles or buses.
    fleets: Weights = field(
        default_factory=lambda: {"as elsewhere": 0.75, "Motorcycle": 0.15, "Bus": 0.1}
    )
    fleet_weight: Range = (0.4, 1.0)  # weight of that class, at most 1; cars have 0.5 to 0.95
    roundabouts: float = 0.3  # share of the crossings and of the T-junctions
    ring: RingRanges = RingRanges()
    furniture: FurnitureRanges = FurnitureRanges()
    grades: float = 0.4  # share of sites on a slope
    signal_green_s: Range = (8, 30)
    turns: Range = (0.05, 0.3)  # share of vehicles that turn left, and share that turn right
    ground_below_m: Range = (0.02, 0.2)
    slope_run_per_rise: Range = (1.5, 3.0)
    lateral_m_s2: float = 3.0  # lateral acceleration that drivers accept in bends


ROAD_TYPES: Mapping[str, RoadType] = {"motorway": MOTORWAY, "rural": RURAL, "street": STREET}
RANGES = Ranges()
# Streets with much furniture, for counting false positives.
CLUTTERED = Ranges(
    road_types={"street": 1.0},
    furniture=FurnitureRanges(sites=1.0, times=2.5),
)
