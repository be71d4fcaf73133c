"""Distributions of roadside objects, parked vehicles, pedestrians, cyclists and furniture.

A range is a uniform distribution, a share is a probability, and a mapping contains weights, or the
ranges of keys of the scene in the order in which they are sampled. Ranges without a source are
assumptions and are chosen wide rather than narrow.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

from pyinfra.scenes.generator.random_stream import Range, Spans, Weights


@dataclass(frozen=True)
class ThingRanges:
    """Distributions of the sizes and positions of roadside objects."""

    verge_m: Range = (0.4, 3.0)  # gap between successive rows of objects
    rail: Spans = field(  # guard rails; a height of 0.75 is common in EN 1317
        default_factory=lambda: {"height_m": (0.7, 0.9), "width_m": (0.15, 0.35)}
    )
    wall: Spans = field(  # New Jersey and step barriers, 0.81 to 1.1 m high
        default_factory=lambda: {"height_m": (0.8, 1.15), "width_m": (0.25, 0.6)}
    )
    rail_parts: float = 0.3  # share of rails that stand along only a part of the road
    rail_part_m: Range = (30, 150)  # length of the part that has a rail
    part_within_m: Range = (-70, 70)  # middle of such a part, relative to the focus
    noise_wall_m: Range = (2.0, 4.5)
    noise_wall_away_m: Range = (1, 5)
    gantry_away_m: Range = (6, 90)  # distance of a gantry from the station nearest to the focus
    clearance_m: Range = (4.7, 7)  # free height below gantries
    hedge: Spans = field(
        default_factory=lambda: {
            "height_m": (0.7, 3.0),
            "width_m": (0.5, 2.5),
            "density_per_m": (0.5, 2.0),  # from sparse to clipped hedges
        }
    )
    hedge_parts: float = 0.4  # share of hedges that stand along only a part of the road
    hedge_part_m: Range = (8, 60)
    tree_every_m: Range = (6, 18)
    tree: Spans = field(
        default_factory=lambda: {
            "height_m": (7, 14),
            "crown_m": (2.5, 7.0),
            "trunk_m": (1.5, 3.5),
            "trunk_width_m": (0.15, 0.6),
            "density_per_m": (0.4, 1.2),
        }
    )
    free_trunk_m: float = 4.7  # trunk height of trees whose crowns reach over a lane
    wood: Spans = field(
        default_factory=lambda: {
            "height_m": (3, 12),
            "width_m": (4, 15),
            "density_per_m": (0.2, 0.8),
        }
    )
    wood_away_m: Range = (0.5, 15)
    wood_parts: float = 0.5  # share of woods that stand along only a part of the road
    wood_part_m: Range = (30, 150)
    bush_m: Range = (0.8, 6.0)  # length of a bush; some bushes are as large as a car
    bush_width: Range = (0.4, 1)  # width of a bush, relative to the length
    wild_m: Range = (0, 30)  # distance of single bushes and trees beyond the rows
    wild_trees: float = 0.3
    house_length_m: Range = (7, 45)
    house_depth_m: Range = (7, 16)
    house_height_m: Range = (3, 20)
    house_heights: Range = (0.8, 1.2)  # height of a house, relative to its row's common height
    house_gap_m: Range = (1, 25)
    house_setback_m: Range = (0.5, 12)
    post_every_m: Range = (18, 45)
    post_height_m: Range = (2.5, 9)  # height of posts, from sign posts to lamp posts
    post_width_m: Range = (0.1, 0.35)
    post_away_m: Range = (0.45, 1.2)  # distance of posts from the carriageway or from parked cars
    box: Spans = field(
        default_factory=lambda: {
            "length_m": (0.6, 6.5),
            "width_m": (0.5, 2.6),
            "height_m": (0.9, 2.8),
        }
    )
    box_away_m: Range = (0.5, 6.0)
    box_turn_deg: Range = (-8, 8)
    # Maximum distance of houses, posts, boxes and bushes along the road from the station nearest to
    # the site's focus. Objects farther away would have few points.
    within_m: float = 120


@dataclass(frozen=True)
class ParkingRanges:
    """Distributions of parked vehicles at kerbs and in car parks."""

    lane_m: Range = (2.0, 2.6)  # width of parking lanes at the kerb; RASt specifies 2.0
    kerb_gap_m: Range = (0.7, 2.0)
    kerb_classes: Weights = field(
        default_factory=lambda: {"Car": 0.85, "Van": 0.12, "Motorcycle": 0.03}
    )
    # Maximum distance from the start of a parked row to the station nearest to the focus.
    kerb_within_m: float = 130
    bay_gap_m: Range = (0.4, 0.9)  # gap between cars in bays of 2.5 m
    bay_turn_deg: Mapping[float, float] = field(
        default_factory=lambda: {90: 0.7, 60: 0.15, -60: 0.15}
    )
    bay_classes: Weights = field(default_factory=lambda: {"Car": 1.0})
    occupied: Range = (0.3, 1.0)
    rows: tuple[int, int] = (1, 4)
    length_m: Range = (18, 70)
    along_m: Range = (-90, 90)  # middle of a car park, from the station nearest to the focus
    away_m: Range = (2.0, 10.0)  # distance of a car park from the outer edge of the road
    # Distance between the centres of two rows of bays that stand back to back. The longest car at
    # 60 degrees needs 6.37 m, and may be parked 0.15 m off.
    back_to_back_m: float = 6.8
    aisle_m: float = 6.0
    # Share of car parks, except at streets, with lorries instead of cars. Lorries park in rows
    # along the road.
    lorries: float = 0.2
    lorry_rows_m: float = 5.0
    lorry_gap_m: Range = (1.0, 6.0)
    lorry_classes: Weights = field(default_factory=lambda: {"Truck": 0.8, "Van": 0.2})


@dataclass(frozen=True)
class WayRanges:
    """Distributions of rows of pedestrians and cyclists."""

    sites: float = 0.85  # share of sites with rows, among sites whose road type can have rows
    within_m: float = 120  # maximum distance of rows from the site's focus
    verge_m: float = 3.0  # width of the strip beyond the footway that rows may use
    # Minimum length of a row. Pedestrians and cyclists appear and vanish at the ends of the row.
    shortest_m: float = 15.0


@dataclass(frozen=True)
class FurnitureRanges:
    """Distributions of street furniture and standing groups of pedestrians."""

    sites: float = 0.7  # share of sites with furniture
    times: float = 1.0  # factor for the road type's numbers of pieces of furniture
    within_m: float = 80  # maximum distance of furniture from the station nearest to the focus
    plate_m: Range = (0.4, 1.5)  # sides of sign plates: 0.42 to 0.9 in StVO, larger at junctions
    plate_above_m: Range = (1.8, 3.0)  # height below sign plates; StVO: 2.0 to 2.25 over footways
    plate_turn_deg: Mapping[float, float] = field(  # plates are across the road, or along it
        default_factory=lambda: {90.0: 0.8, 0.0: 0.2}
    )
    plate_off_deg: Range = (-15, 15)  # deviation from `plate_turn_deg`
    pole_width_m: Range = (0.06, 0.25)
    bin_m: Range = (0.35, 0.9)
    bin_height_m: Range = (0.8, 1.5)
    bin_turn_deg: Range = (-20, 20)
    planter: Spans = field(
        default_factory=lambda: {
            "length_m": (0.8, 2.5),
            "width_m": (0.4, 1.2),
            "height_m": (0.4, 1.1),
        }
    )
    planter_turn_deg: Range = (-5, 5)
    shelter: Spans = field(
        default_factory=lambda: {
            "length_m": (2.5, 5.5),
            "width_m": (1.2, 2.2),
            "height_m": (2.2, 2.7),
        }
    )
    crown_m: Range = (1.6, 4.5)
    crown_above_m: Range = (2.0, 3.5)  # height of the lowest leaves
    crown_height_m: Range = (1.5, 4.0)
    trunk_width_m: Range = (0.1, 0.4)
    crown_density_per_m: Range = (0.3, 1.5)
    group_of: tuple[int, int] = (2, 9)
    group_spacing_m: Range = (1.2, 1.8)
