"""All distributions of the scene generator.

A range is a uniform distribution, a share is a probability, and a mapping contains weights. Ranges
without a source are assumptions and are chosen wide rather than narrow.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

from pyinfra.scenes.generator.random_stream import Range, Weights
from pyinfra.scenes.generator.roadside_ranges import (
    FurnitureRanges,
    ParkingRanges,
    ThingRanges,
    WayRanges,
)


@dataclass(frozen=True)
class MountRanges:
    """Distributions of the mounting position and orientation of a sensor."""

    height_m: Range = (3.5, 9.0)  # height on masts, signal posts or lamp posts
    over_m: Range = (5.5, 9.0)  # height above lanes, on an arm or a gantry
    # Weights with which a mount is over the lanes (`over_lanes`) or over the median. A mount
    # beside the road has weight 1.
    over_lanes: float = 0.08
    over_median: float = 0.12
    beside_m: Range = (0.3, 4.0)  # distance from the edge of the carriageway or of the footway
    before_junction_m: Range = (1.0, 30.0)  # distance from the corner of a junction
    along_m: Range = (-30, 30)  # distance from the focus along a road without a junction
    aims: Weights = field(default_factory=lambda: {"along": 0.7, "across": 0.15, "anywhere": 0.15})
    off_aim_deg: Range = (-20, 20)
    pitch_deg: Mapping[Range, float] = field(  # sensors are about level, or point down
        default_factory=lambda: {(-1.0, 2.0): 0.6, (2.0, 12.0): 0.4}
    )
    roll_deg: Range = (-1.5, 1.5)


@dataclass(frozen=True)
class RingRanges:
    """Distributions of single-lane roundabouts with outer diameters from 30 to 60 m.

    The German guideline `Merkblatt Kreisverkehre` specifies outer diameters of 26 to 40 m.
    """

    radius_m: Range = (12.5, 26)
    width_m: Range = (5, 7)
    island_m: Range = (0.1, 1.2)  # height of the island, from low stones to mounds


@dataclass(frozen=True)
class SkyRanges:
    rain: float = 0.15
    rain_mm_per_h: Range = (0.5, 20)
    night: float = 0.3
    sunlight_klux: Range = (2, 100)  # illuminance, from an overcast sky to full sun
    scan_labels: float = 0.5  # share of sites with label time `scan`; the others have `frame`


@dataclass(frozen=True)
class Ranges:
    """All distributions of the scene generator."""

    road_types: Mapping[str, float] = field(
        default_factory=lambda: {"motorway": 0.3, "rural": 0.25, "street": 0.45}
    )
    mount: MountRanges = MountRanges()
    things: ThingRanges = field(default_factory=ThingRanges)
    parking: ParkingRanges = field(default_factory=ParkingRanges)
    sky: SkyRanges = SkyRanges()
    ways: WayRanges = field(default_factory=WayRanges)
    half_length_m: Range = (170, 260)  # half length of roads; that of the region is 100 m
    crossing_deg: Range = (60, 120)  # angle between crossing roads; the simulator allows 45 to 135
    t_junctions: float = 0.35  # share of crossings that become T-junctions
    one_way: float = 0.15  # share of side roads of crossings that become one-way
    # Shares of sites with usual traffic, with many motorcycles, and with many buses.
    fleets: Weights = field(
        default_factory=lambda: {"as elsewhere": 0.75, "Motorcycle": 0.15, "Bus": 0.1}
    )
    fleet_weight: Range = (0.4, 1.0)  # weight of many motorcycles or buses; cars have 0.5 to 0.95
    roundabouts: float = 0.3  # share of crossings and T-junctions that become roundabouts
    ring: RingRanges = RingRanges()
    furniture: FurnitureRanges = field(default_factory=FurnitureRanges)
    grades: float = 0.4  # share of sites on a slope
    signal_green_s: Range = (8, 30)
    turns: Range = (0.05, 0.3)  # share of vehicles that turn left, and share that turn right
    ground_below_m: Range = (0.02, 0.2)
    slope_run_per_rise: Range = (1.5, 3.0)
    speed_spread: Range = (0.03, 0.15)  # standard deviation of speeds, relative to the mean
    lateral_m_s2: float = 3.0  # lateral acceleration that drivers accept in bends


RANGES = Ranges()
# Streets with much furniture, on which false positives are counted.
CLUTTERED = Ranges(
    road_types={"street": 1.0},
    furniture=FurnitureRanges(sites=1.0, times=2.5),
)
