"""Simulates the traffic of a site with SUMO, and converts it to smooth tracks."""

import math
import re
import tempfile
from dataclasses import dataclass
from pathlib import Path

from pyinfra.core.arrays import FloatArray
from pyinfra.core.errors import Error
from pyinfra.scenes.maps.fcd import Recorded, read_fcd
from pyinfra.scenes.maps.netconvert import DETAIL
from pyinfra.scenes.maps.road_net import TURN_LIMIT_M_S2, RoadNet, read_road_net
from pyinfra.scenes.maps.site_folder import NET
from pyinfra.scenes.maps.smoothing import smooth
from pyinfra.scenes.maps.sumo import SumoError, run_tool
from pyinfra.scenes.maps.tracks import STEP_S, FrontPath, Track, from_zero
from pyinfra.scenes.maps.traffic_demand import Demand, Trips, trips
from pyinfra.scenes.maps.traffic_figures import without_overlaps

# Tracks end at this distance from the mounts. An object that returns becomes a new track.
REACH_M = 300.0
STRIPE_M = "0.8"  # width of SUMO's pedestrian lanes, so that two pedestrians can pass each other
_WARM_UP_S, _WALKING_S = 200, 400  # durations of the warm-up without and with pedestrians
MOST_UNROUTED = 0.5  # maximum share of trips without a route
_AROUND_S = 4.0  # additional time at both ends of a track, which the averaging needs
_TURN_LIMIT = (
    *("--offset.disable-normalization", "true"),
    *("--junctions.limit-turn-speed", str(TURN_LIMIT_M_S2), *DETAIL),
)
_WALKS = (
    *("--sidewalks.guess", "true", "--crossings.guess", "true"),
    *("--sidewalks.guess.max-speed", "14"),  # roads of up to 50 km/h get sidewalks
)


@dataclass(frozen=True)
class Traffic:
    """Tracks, and the names of objects that were left out. The first track starts at instant 0."""

    tracks: list[Track]
    asked: int  # number of planned trips
    rough: list[str]  # names of objects that no averaging made smooth enough
    overlapping: list[str]  # names of objects that overlapped other objects
    unrouted: list[str]  # names of objects for which SUMO found no valid route


@dataclass(frozen=True)
class SumoRun:
    """The result of a SUMO run. Instants of the paths count from the start of the warm-up."""

    paths: list[FrontPath]
    asked: int  # number of planned trips
    start: int  # instant at which the warm-up ends
    count: int  # number of instants after the warm-up
    unrouted: list[str]  # names of objects for which SUMO found no valid route


def simulate(
    net_file: Path, feet: FloatArray, demand: Demand, seconds: float, seed: int
) -> Traffic:
    """Simulates traffic on a SUMO network in world coordinates around the mounts' feet (k, 2).

    Raises Error, FormatError, OSError, and SumoError if SUMO fails.
    """
    return cleaned(record(net_file, feet, demand, seconds, seed), feet)


def record(net_file: Path, feet: FloatArray, demand: Demand, seconds: float, seed: int) -> SumoRun:
    """Runs SUMO like `simulate`, but without smoothing and filtering."""
    demand.check()
    if not 1 <= seconds <= 3600:
        raise Error(f"seconds: expected 1 to 3600, got {seconds:g}")
    if not 0 <= seed < 2**31:
        raise Error(f"seed: expected 0 to {2**31 - 1}, got {seed}")
    warm_up = _WALKING_S if demand.pedestrians_per_hour else _WARM_UP_S
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        net_used = _prepared(net_file, read_road_net(net_file), demand, work)
        asked = trips(read_road_net(net_used), feet, demand, warm_up + seconds + _AROUND_S, seed)
        recorded, unrouted = _run_sumo(net_used, asked, warm_up, seconds, seed, work)
    paths = [_front_path(r, asked) for r in recorded]
    start, count = round(warm_up / STEP_S), round(seconds / STEP_S)
    return SumoRun(paths, len(asked.sizes), start, count, unrouted)


def cleaned(sumo_run: SumoRun, feet: FloatArray) -> Traffic:
    """Smooths the paths, and keeps their parts near the mounts after the warm-up.

    Removes tracks that overlap other tracks.
    """
    tracks, rough = [], []
    start, end = sumo_run.start, sumo_run.start + sumo_run.count
    for path in sumo_run.paths:
        track = smooth(path)
        if track is None:
            rough.append(path.name)
        elif (part := track.between(start, end)) is not None:
            tracks += part.near(feet, REACH_M)
    kept, overlapping = without_overlaps(tracks)
    return Traffic(from_zero(kept), sumo_run.asked, rough, overlapping, sumo_run.unrouted)


def _front_path(recorded: Recorded, asked: Trips) -> FrontPath:
    object_class, size = asked.sizes[recorded.type_name]
    first = round(float(recorded.rows[0, 0]) / STEP_S)
    points = recorded.rows[:, 1:4]
    return FrontPath(recorded.name, object_class, size, first, points, recorded.rows[:, 4])


def _prepared(net_file: Path, net: RoadNet, demand: Demand, work: Path) -> Path:
    """Returns a network with limited turn speeds, and with sidewalks if there are pedestrians.

    If the network lacks limits or sidewalks, netconvert rebuilds it.
    """
    walks = demand.pedestrians_per_hour > 0 and not net.walkable
    if net.turn_speed_limited and not walks:
        return net_file
    out = work / NET
    words = ["--sumo-net-file", str(net_file), "--output-file", str(out), *_TURN_LIMIT]
    run_tool("netconvert", [*words, *(_WALKS if walks else ())])
    return out


def _run_sumo(
    net: Path, asked: Trips, warm_up: float, seconds: float, seed: int, work: Path
) -> tuple[list[Recorded], list[str]]:
    """Returns the recorded objects, and the names of objects without a valid route."""
    routes, fcd = work / "trips.rou.xml", work / "fcd.xml"
    begin, end = warm_up - _AROUND_S, math.ceil(warm_up + seconds + _AROUND_S)
    options = {
        "--net-file": str(net),
        "--route-files": str(routes),
        "--seed": str(seed),
        "--step-length": str(STEP_S),
        "--lateral-resolution": "0.8",
        "--end": str(end),
        "--fcd-output": str(fcd),
        "--device.fcd.begin": str(begin),
        "--precision": "4",
        "--fcd-output.attributes": "x,y,z,angle,type",
        "--time-to-teleport": "-1",
        "--collision.action": "none",
        "--pedestrian.model": "striping",
        "--pedestrian.striping.stripe-width": STRIPE_M,
        "--no-step-log": "true",
        "--no-warnings": "true",
    }
    xml, unrouted = asked.xml, list[str]()
    while True:
        routes.write_text(xml, encoding="utf-8")
        try:
            run_tool("sumo", [word for option in options.items() for word in option])
            break
        except SumoError as error:
            xml, gone = without_route(xml, str(error))
            if not gone or len(unrouted) + len(gone) > MOST_UNROUTED * len(asked.sizes):
                raise
            unrouted += gone
    return read_fcd(fcd), unrouted


def without_route(xml: str, error: str) -> tuple[str, list[str]]:
    """Removes the trip that SUMO's error names, and trips of the same class with the same turn.

    Returns the remaining trips and the names of the removed trips. For an unrelated error, no trip
    is removed.
    """
    named = re.search(r"(?:[Vv]ehicle|[Pp]erson) '([^']+)'", error)
    if not named or not re.search("no valid route|[Nn]o connection|[Nn]o route", error):
        return xml, []
    turn = re.search(r"between edge '([^']+)' and edge '([^']+)'", error)
    object_class = named[1].rpartition("_")[0]
    kept, gone = [], []
    for line in xml.splitlines(keepends=True):
        who = re.match(r'<(?:vehicle|person) id="([^"]+)"', line)
        takes = turn is not None and re.search(
            rf'[" ]{re.escape(turn[1])} {re.escape(turn[2])}[" ]', line
        )
        same = who and who[1].rpartition("_")[0] == object_class
        if who and (who[1] == named[1] or (takes and same)):
            gone.append(who[1])
        else:
            kept.append(line)
    return "".join(kept), gone
