"""Road types, with the distributions of their roads, traffic and roadside objects.

A range is a uniform distribution, a share is a probability, and a mapping contains weights. `RAA`,
`RAL` and `RASt` are the German guidelines for motorways, rural roads and town roads. Ranges without
a source are assumptions and are chosen wide rather than narrow.
"""

from collections.abc import Mapping
from dataclasses import dataclass

from pyinfra.scenes.generator.random_stream import Range, Weights


@dataclass(frozen=True)
class WalkRanges:
    """The distributions of pedestrians or cyclists on one side of a road."""

    share: float  # share of road sides with a row of pedestrians or cyclists
    per_km: Range  # people per km, both directions together; the simulator allows up to 60
    speed_km_h: Range  # mean speed
    speed_spread: Range  # standard deviation of speeds relative to the mean, at most a third


@dataclass(frozen=True)
class RoadType:
    """The distributions of the roads, traffic and roadside objects of a road type."""

    layouts: Weights
    each_way: Mapping[int, float]  # weights of the numbers of lanes each way
    lane_m: Range
    median: float  # share of roads with a median
    median_m: Range
    shoulder_m: Range
    sidewalk: float  # share of roads with a footway
    sidewalk_m: Range
    radius_m: Range
    turn_deg: Range
    speed_km_h: Range
    vehicles_per_km_lane: Range
    classes: Mapping[str, Range]  # weights of the vehicle classes
    in_median: Weights
    embankment: float  # share of roads on an embankment, at sites without junctions
    embankment_m: Range  # depth of the embankment's foot below the road
    # Each field from `rail` to `posts` is the share of road sides with this object.
    rail: float  # share of road sides with a guard rail
    noise_wall: float
    hedge: float
    trees: float
    houses: float
    posts: float  # share of road sides with sign posts or lamp posts
    boxes: tuple[int, int]  # number of cabinets, shelters and containers, which resemble vehicles
    wood: float  # share of road sides with a wood, among sides without houses
    wild: tuple[int, int]  # number of single bushes and trees per side
    kerb_parking: float  # share of roads with a parking lane
    car_park: float  # share of road sides with a car park
    gantry: float  # share of roads with a gantry
    walks: Mapping[str, WalkRanges]  # maps the class Pedestrian or Cyclist to its rows
    furniture: Mapping[str, tuple[int, int]]  # number of pieces of each kind per side
    grade_percent: Range  # grade of the roads at sites on a slope


# Adults walk at 4 to 6 km/h, and much slower while they look around or wait. Most cyclists ride at
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
    # Cyclists are as frequent as pedestrians, so that training frames contain enough cyclists.
    "Cyclist": WalkRanges(share=0.6, per_km=(8, 60), **ON_BICYCLES),
}

# The German guideline RAA specifies lanes of 3.5 to 3.75 m, shoulders up to 3 m, and radii from
# 280 m (EKA 3). Speeds range from jams to free flow. On working days, up to a third of the vehicles
# are lorries. Most motorways have guard rails on both sides, and a wall, rails or a hedge in the
# median. A network that was trained without these objects mistakes them for vehicles.
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

# The German guideline RAL specifies one lane each way, on some roads two, with a width of 3.25 to
# 3.5 m. The radii are those of EKL 4 and of older roads. Ditches, trees and hedges are close to the
# road. Steep sections have rails.
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

# The German guideline RASt specifies lanes of 2.75 to 3.5 m, footways from 1.5 m, and parking lanes
# of 2 m at the kerb. Trees stand in rows, houses are close to the footway, and queues form at
# signals.
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

ROAD_TYPES: Mapping[str, RoadType] = {"motorway": MOTORWAY, "rural": RURAL, "street": STREET}
