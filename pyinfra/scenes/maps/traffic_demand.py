"""Generates trips that begin outside the region, pass through it, and end outside."""

from dataclasses import dataclass, field
from xml.sax.saxutils import quoteattr

import numpy as np

from pyinfra.core.arrays import FloatArray
from pyinfra.core.errors import Error
from pyinfra.scenes.maps.road_net import Edge, RoadNet
from pyinfra.scenes.maps.tracks import CLASSES
from pyinfra.scenes.maps.traffic_figures import REGION_M

MARGIN_M = 20.0  # trips begin and end at least this far outside the region
_MOST_SOURCES = 60  # maximum number of start edges; if there are more, some are sampled at random


@dataclass(frozen=True)
class Demand:
    """Numbers of objects per hour through the region. `class_shares` applies to vehicles."""

    vehicles_per_hour: float
    pedestrians_per_hour: float = 0
    bicycles_per_hour: float = 0
    class_shares: dict[str, float] = field(
        default_factory=lambda: {
            "Car": 0.74,
            "Van": 0.10,
            "Truck": 0.06,
            "Bus": 0.03,
            "Motorcycle": 0.07,
        }
    )

    def check(self) -> None:
        """Raises Error for a rate out of range, or if all rates are 0."""
        for name in ("vehicles_per_hour", "pedestrians_per_hour", "bicycles_per_hour"):
            rate = getattr(self, name)
            if not 0 <= rate <= 20_000:
                raise Error(f"{name}: expected 0 to 20000, got {rate:g}")
        if self.vehicles_per_hour + self.pedestrians_per_hour + self.bicycles_per_hour == 0:
            raise Error("vehicles_per_hour: expected a sum of all rates above 0, got 0")


@dataclass(frozen=True)
class Trips:
    """The text of SUMO's route file, and class and size of each object by name."""

    xml: str
    sizes: dict[str, tuple[str, FloatArray]]


def trips(net: RoadNet, feet: FloatArray, demand: Demand, seconds: float, seed: int) -> Trips:
    """Generates departures over `seconds`. The mounts' feet (k, 2) are in network coordinates."""
    rng = np.random.default_rng(seed)
    lines: list[tuple[float, str]] = []
    sizes: dict[str, tuple[str, FloatArray]] = {}
    rates = (
        (demand.vehicles_per_hour, demand.class_shares),
        (demand.bicycles_per_hour, {"Cyclist": 1.0}),
        (demand.pedestrians_per_hour, {"Pedestrian": 1.0}),
    )
    ways: dict[str, tuple[list[list[str]], FloatArray]] = {}
    for rate, shares in rates:
        names = sorted(shares)
        shares_of = np.array([shares[n] for n in names]) / sum(shares.values())
        count = rng.poisson(rate * seconds / 3600) if rate else 0
        for depart in np.sort(rng.uniform(0, seconds, count)):
            object_class = names[int(rng.choice(len(names), p=shares_of))]
            sumo_class = CLASSES[object_class].sumo_class
            if sumo_class not in ways:
                ways[sumo_class] = _ways(net, feet, sumo_class, np.random.default_rng([seed, 1]))
            routes, weights = ways[sumo_class]
            route = routes[int(rng.choice(len(routes), p=weights))]
            name = f"{object_class}_{len(sizes)}"
            sizes[name] = (object_class, _drawn_size(object_class, rng))
            is_walk = object_class == "Pedestrian"
            way = _walk(name, depart, route, net, feet) if is_walk else _drive(name, depart, route)
            lines.append((depart, _type(name, *sizes[name]) + way))
    text = "".join(line for _, line in sorted(lines))
    return Trips(f"<routes>\n{text}</routes>\n", sizes)


def _drawn_size(object_class: str, rng: np.random.Generator) -> FloatArray:
    row = CLASSES[object_class]
    draw = np.clip(rng.normal(size=3), -2, 2)
    return np.round(np.array(row.mean_m) + np.array(row.std_m) * draw, 4)


def _type(name: str, object_class: str, size: FloatArray) -> str:
    sumo_class = CLASSES[object_class].sumo_class
    length, width, height = (float(v) for v in size)
    shape = f'length="{length}" width="{width}" height="{height}"'
    return f'<vType id="{name}" vClass="{sumo_class}" {shape} {_MANNERS[object_class]}/>\n'


def _drive(name: str, depart: float, route: list[str]) -> str:
    start = f'<vehicle id="{name}" type="{name}" depart="{depart:.1f}"'
    how = 'departLane="best" departSpeed="max" departPos="base"'
    return f"{start} {how}><route edges={quoteattr(' '.join(route))}/></vehicle>\n"


def _walk(name: str, depart: float, route: list[str], net: RoadNet, feet: FloatArray) -> str:
    """Returns a walk that begins and ends just outside the region, on the route's outer edges."""
    ahead, back = _far_m(net.edges[route[0]], feet), _far_m(net.edges[route[-1]], feet, back=True)
    start = f'<person id="{name}" type="{name}" depart="{depart:.1f}" departPos="{ahead:.1f}">'
    ways = f'from={quoteattr(route[0])} to={quoteattr(route[-1])} arrivalPos="-{back:.1f}"'
    return f"{start}<walk {ways}/></person>\n"


def _far_m(edge: Edge, feet: FloatArray, *, back: bool = False) -> float:
    """Returns the distance along an edge from its start to the vicinity of the region.

    With `back`, the distance is measured from the edge's end. If the edge is not near the region,
    the distance is half its length.
    """
    marks = edge.marks[::-1] if back else edge.marks
    near = np.linalg.norm(marks[:, None] - feet, axis=2).min(1) < REGION_M + MARGIN_M
    last = int(near.argmax()) - 1 if near.any() else len(marks) // 2
    way = np.linalg.norm(np.diff(marks[: last + 1], axis=0), axis=1).sum()
    return max(float(way), 0.1)


_STEADY = 'sigma="0.2" decel="3.5" emergencyDecel="6" maxSpeedLat="0.8" minGapLat="0.5"'
_MANNERS = {
    "Car": f'accel="2.2" {_STEADY}',
    "Van": f'accel="2.0" {_STEADY}',
    "Truck": f'accel="1.2" {_STEADY}',
    "Bus": f'accel="1.2" {_STEADY}',
    "Motorcycle": f'accel="3.0" {_STEADY}',
    "Cyclist": 'accel="1.0" sigma="0.2" decel="2.5" emergencyDecel="5" maxSpeed="5.5"',
    "Pedestrian": "",
}


def _ways(
    net: RoadNet, feet: FloatArray, sumo_class: str, rng: np.random.Generator
) -> tuple[list[list[str]], FloatArray]:
    """Returns routes and their probabilities.

    Routes begin outside the region, pass through it, and end outside. They begin and end where
    roads enter or leave the map. If there is no such route, routes begin and end at any edges that
    are far enough from the region.
    """
    routes: list[tuple[list[str], int]] = []
    for between in (_ends(net, feet, sumo_class), _far_edges(net, feet, sumo_class)):
        routes = routes or _routes(net, feet, sumo_class, rng, between)
    if not routes:
        raise Error(_too_small(net, feet, sumo_class))
    weights = np.array([weight for _, weight in routes])
    return [way for way, _ in routes], weights / weights.sum()


def _routes(
    net: RoadNet,
    feet: FloatArray,
    sumo_class: str,
    rng: np.random.Generator,
    between: tuple[list[Edge], list[Edge]],
) -> list[tuple[list[str], int]]:
    """Returns the fastest route through the region, and its weight, for each start and end."""
    starts, ends = between
    if len(starts) > _MOST_SOURCES:
        starts = [starts[i] for i in sorted(rng.choice(len(starts), _MOST_SOURCES, replace=False))]
    inside = {e.name for e in net.edges.values() if _distance(e.marks, feet) < REGION_M}
    routes = []
    for start in starts:
        reached = net.routes_from(start, sumo_class)
        for end in ends:
            way = reached.get(end.name)
            if way is None or inside.isdisjoint(way) or len(way) < 2 - (start.name in inside):
                continue
            if end.start == start.end and end.end == start.start:
                continue  # the route would end on the edge opposite to the start
            routes.append((way, start.lanes_for(sumo_class) * end.lanes_for(sumo_class)))
    return routes


def _is_far(point: FloatArray, feet: FloatArray) -> bool:
    return _distance(point[None], feet) >= REGION_M + MARGIN_M


def _far_edges(net: RoadNet, feet: FloatArray, sumo_class: str) -> tuple[list[Edge], list[Edge]]:
    """Returns the edges that begin, and the edges that end, far enough from the region."""
    edges = [e for e in net.edges.values() if e.lanes_for(sumo_class)]
    starts = [e for e in edges if _is_far(e.shape[0], feet)]
    return starts, [e for e in edges if _is_far(e.shape[-1], feet)]


def _ends(net: RoadNet, feet: FloatArray, sumo_class: str) -> tuple[list[Edge], list[Edge]]:
    """Returns the edges where trips begin and end.

    These are the edges where roads enter or leave the map. For pedestrians, and if there are no
    such edges, the function returns all edges that are far enough from the region.
    """
    starts = [e for e in net.sources(sumo_class) if _is_far(e.shape[0], feet)]
    ends = [e for e in net.sinks(sumo_class) if _is_far(e.shape[-1], feet)]
    if not starts or not ends or sumo_class == "pedestrian":
        return _far_edges(net, feet, sumo_class)
    return starts, ends


def _distance(points: FloatArray, feet: FloatArray) -> float:
    """Returns the smallest horizontal distance of points (n, 2) from mounts (k, 2), in metres."""
    return float(np.linalg.norm(points[:, None] - feet, axis=2).min())


def _too_small(net: RoadNet, feet: FloatArray, sumo_class: str) -> str:
    edges = [e for e in net.edges.values() if e.lanes_for(sumo_class)]
    reach = REGION_M + MARGIN_M
    if not edges:
        return f"the map: expected a road for class '{sumo_class}', got none"
    far = max(float(np.linalg.norm(e.shape[:, None] - feet, axis=2).min(1).max()) for e in edges)
    starts, ends = (len(far_edges) for far_edges in _far_edges(net, feet, sumo_class))
    counts = f"{starts} edges begin and {ends} edges end at this distance"
    why = counts if far >= reach else f"the map reaches {far:.0f} m"
    return (
        f"the map: expected a route for class '{sumo_class}' that begins and ends at least "
        f"{reach:.0f} m from the mount and passes through the region, got none ({why}). Objects "
        "must not appear or vanish in the region; import more of the map, or move the mount"
    )
