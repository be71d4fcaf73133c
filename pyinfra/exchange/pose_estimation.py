"""Estimates properties of a recording's clouds that neither the user nor the format states.

The length unit, the upward axis, the tilt of the sensor and its height above the road are estimated
from some of the frames. All assumptions are listed as texts in `assumed`.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from pyinfra.core.arrays import FloatArray, Floats
from pyinfra.core.errors import Error
from pyinfra.dataset.ground import SHAPE_REACH_M
from pyinfra.dataset.regions import Region
from pyinfra.dataset.road_plane import (
    FIT_M,
    HEIGHTS_M,
    LEAST_SHARE,
    MOST_POINTS,
    RoadPlane,
    find_plane,
)
from pyinfra.exchange.data_set import LidarFacts, levelled
from pyinfra.exchange.record_clouds import readable
from pyinfra.exchange.recording import Options, RecordedFrame, Recording
from pyinfra.exchange.road_shape import shape_of
from pyinfra.exchange.units import brightest_of, unit_of, usual_intensity_max

Read = Callable[[Path, Options], Recording]

FRAMES = 30  # number of frames used, evenly distributed
# Options with which clouds in metres or millimetres pass the range checks of the reader.
WIDE = Options(unit_m=1e-3, intensity_max=65535.0)
MILLIMETRES = "coordinates are millimetres: divided by 1000"
# Possible rotations to the upright frame. Their rows are the axes x, y, z of the upright frame in
# the source's frame.
UPS: dict[str, list[list[int]]] = {
    "z up": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
    "z down": [[1, 0, 0], [0, -1, 0], [0, 0, -1]],
    "y up": [[0, 0, 1], [1, 0, 0], [0, 1, 0]],
    "y down": [[0, 0, 1], [-1, 0, 0], [0, -1, 0]],
    "x up": [[0, 1, 0], [0, 0, 1], [1, 0, 0]],
    "x down": [[0, 1, 0], [0, 0, -1], [-1, 0, 0]],
}
# If at least this share of the near ground lies on a road plane, z is assumed to be up.
SURE_SHARE = 0.3
# Lowest height of a sensor. If the estimate is lower, the origin of the clouds is on the road.
LOWEST_M = 1.0
# Tolerated error of a height that the user sets, in metres and as a share of the height. The larger
# tolerance applies.
AS_GIVEN_M = 0.5
AS_GIVEN_SHARE = 0.15
GIVEN_TILT_DEG = 10.0  # largest tilt of the road after the correction by the user's tilt
WORTH_DEG = 0.05  # tilts smaller than this are not corrected


@dataclass(frozen=True, eq=False)
class Survey:
    """The estimated options and transform of a recording, and the assumptions made."""

    options: Options
    turn: FloatArray  # (3, 3) rotation from the source's axes to upright axes
    lift_m: float  # height that is added to z after the rotation
    facts: LidarFacts
    plane: RoadPlane | None
    assumed: tuple[str, ...]
    # (3,) translation that is subtracted before the rotation
    back_m: FloatArray = field(default_factory=lambda: np.zeros(3))


def survey(source: Path, read: Read, options: Options, given: LidarFacts, *, road: bool) -> Survey:
    """Estimates the properties of a recording from some of its frames.

    `road` states whether to estimate unit, axes and road. If it is false, only the intensity scale
    is estimated. Raises Error if the unit or height cannot be determined. The message names the
    argument that sets it.
    """
    wide = replace(options, unit_m=WIDE.unit_m, intensity_max=WIDE.intensity_max)
    recording = read(source, wide)
    clouds = _clouds(recording)
    origin = recording.origin() if road else None
    if origin is not None:
        clouds = [cloud - [*origin, 0] for cloud in clouds]
    unit = unit_of(source, clouds, options) if road else 1.0
    highest = options.intensity_max or usual_intensity_max(brightest_of(clouds))
    assumed = []
    if unit != options.unit_m:
        assumed.append(MILLIMETRES)
    if highest != 1 and options.intensity_max is None:
        assumed.append(
            f"the highest intensity is {brightest_of(clouds):.6g}: intensities are divided by "
            f"{highest:g}"
        )
    result = Survey(
        replace(options, intensity_max=highest, unit_m=unit),
        np.eye(3),
        0.0,
        given,
        None,
        tuple(assumed),
    )
    if not road:
        return result
    metres = [cloud[:, :3] * unit for cloud in clouds]
    result = _with_road(source, result, metres, labelled=recording.labelled)
    if origin is None or result.plane is None:
        return result
    text = "the sensor becomes the origin: points are moved back by ({:.6g}, {:.6g}, {:.6g}) m"
    back_m = origin * unit
    return replace(result, back_m=back_m, assumed=(*result.assumed, text.format(*back_m)))


def turned(recording: Recording, estimate: Survey) -> Recording:
    """Returns the recording transformed to upright axes with the sensor as the origin."""
    up = [0.0, 0.0, estimate.lift_m]
    shift = up - estimate.turn @ estimate.back_m
    if np.array_equal(estimate.turn, np.eye(3)) and not shift.any():
        return recording
    read = recording.read

    def frame(i: int) -> RecordedFrame:
        recorded = levelled(read(i), estimate.turn)
        is_return = recorded.points[:, :3].any(axis=1)  # the point 0 0 0 means no return
        recorded.points[is_return, :3] += shift.astype(np.float32)
        recorded.boxes.boxes[:, :3] += shift
        return recorded

    return replace(recording, read=frame)


def check_region(file: Path, region: Region, recording: Recording, estimate: Survey) -> None:
    """Raises Error if none of the sampled frames has a return inside the region."""
    tilt = Rotation.from_euler("ZYX", [0, *(estimate.facts.tilt or (0.0, 0.0))]).as_matrix()
    chosen = _spread(recording)
    reach = 0.0
    for frame in readable(recording.read, chosen):  # the import reports the other frames
        xyz = frame.points[:, :3].astype(np.float64) @ tilt.T
        xyz = xyz[np.isfinite(xyz).all(axis=1)]
        if region.holds(xyz, 0.0).any():
            return
        reach = max(reach, float(np.abs(xyz[:, :2]).max(initial=0)))
    raise Error(
        f"{file}: outline_m: expected one or more returns inside the outline, got none in "
        f"{len(chosen)} frames; the outline must be in metres from the sensor, and all returns "
        f"have x and y within {reach:.0f} m"
    )


def _spread(recording: Recording) -> list[int]:
    count = len(recording.names)
    return sorted({i * count // FRAMES for i in range(FRAMES)})


def _clouds(recording: Recording) -> list[Floats]:
    """Returns the points (k, 4) of some frames in the source's units, without invalid frames."""
    clouds: list[Floats] = []
    for frame in readable(recording.read, _spread(recording)):
        points = frame.points[:: 1 + len(frame.points) // MOST_POINTS]
        points = points[np.isfinite(points[:, :3]).all(axis=1) & points[:, :3].any(axis=1)]
        scale = [1 / WIDE.unit_m] * 3 + [WIDE.intensity_max or 1]
        clouds.append(points.astype(np.float64) * scale)
    return clouds


def _with_road(
    source: Path, estimate: Survey, clouds: Sequence[Floats], *, labelled: bool
) -> Survey:
    facts = estimate.facts
    if facts.tilt:
        leaning = Rotation.from_euler("ZYX", [0, *facts.tilt]).as_matrix()
        plane = find_plane([c @ leaning.T for c in clouds], HEIGHTS_M, GIVEN_TILT_DEG)
        up = "z up"
    else:
        up, plane = _upright(clouds)
    if plane is None or plane.share < LEAST_SHARE:
        if facts.height_m is None and not any(map(len, clouds)):
            return estimate
        _check_millimetres(source, estimate, "no road was found")
        text = (
            "no road was found: points are turned by `tilt_deg` only"
            if facts.tilt
            else (
                "no road was found: points are not turned; check that they are in metres, with z "
                "up and the sensor near the origin"
            )
        )
        height = "" if facts.height_m is not None else "; the height of the sensor is not known"
        return replace(estimate, assumed=(*estimate.assumed, text + height))
    turn = np.array(UPS[up], dtype=np.float64)
    assumed = list(estimate.assumed)
    if up[0] != "z" and labelled:
        raise Error(
            f"{source}: expected z up in clouds with labels, got {up}; the `heading` of a label "
            "is an angle about z"
        )
    if up != "z up":
        assumed.append(
            f"{up}: points are turned so that z is up (x, y, z are {_axes(turn)} of the source)"
        )
    if plane.height_m < LOWEST_M:
        return _from_road_level(source, replace(estimate, turn=turn, assumed=tuple(assumed)), plane)
    upright = [c @ turn.T for c in clouds]
    plane = _as_given(source, facts, upright, plane)
    return _shaped(_level(replace(estimate, turn=turn, assumed=tuple(assumed)), plane), upright)


def _shaped(estimate: Survey, clouds: Sequence[Floats]) -> Survey:
    """Adds the road shape if the road is not a plane. Clouds are upright except for the tilt."""
    facts = estimate.facts
    lean = Rotation.from_euler("ZYX", [0, *(facts.tilt or (0.0, 0.0))]).as_matrix()
    shape = shape_of([cloud @ lean.T for cloud in clouds], facts.height_m or 0.0)
    if shape is None:
        return estimate
    text = (
        f"the road is not a plane: its height profile is used up to {SHAPE_REACH_M:g} m from the "
        "sensor, and extended in straight lines beyond"
    )
    return replace(estimate, facts=replace(facts, shape=shape), assumed=(*estimate.assumed, text))


def _upright(clouds: Sequence[Floats]) -> tuple[str, RoadPlane | None]:
    """Returns which axis is up, and the road plane in that orientation."""
    best_up, best = "z up", find_plane(clouds)
    if best is not None and best.share >= SURE_SHARE and best.height_m >= LOWEST_M:
        return best_up, best
    few, best = clouds[::3], None
    for up, rows in UPS.items():
        turn = np.array(rows, dtype=np.float64)
        plane = find_plane([cloud @ turn.T for cloud in few], crowned=False)
        if plane is not None and _better(plane, best):
            best_up, best = up, plane
    return best_up, find_plane([cloud @ np.array(UPS[best_up]).T for cloud in clouds])


def _better(plane: RoadPlane, best: RoadPlane | None) -> bool:
    """Returns whether a plane is a better estimate of the road than the best plane so far.

    If the origin is on the road, both orientations of an axis give the same plane. In the right
    orientation, more points are above the road.
    """
    if best is None:
        return True
    if max(plane.height_m, best.height_m) < LOWEST_M and abs(plane.share - best.share) < 0.1:
        return plane.above > best.above + 0.1
    return plane.score > 1.3 * best.score


def _axes(turn: FloatArray) -> str:
    """Returns a text such as `-z, x, y`. Each row of `turn` has one entry of 1 or -1."""
    return ", ".join(("-" if row.min() < 0 else "") + "xyz"[np.abs(row).argmax()] for row in turn)


def _from_road_level(source: Path, estimate: Survey, plane: RoadPlane) -> Survey:
    """Moves clouds whose origin is on the road down by the sensor height that the user set."""
    height = estimate.facts.height_m
    below = f"the road is {plane.height_m:.2f} m below the origin"
    _check_millimetres(source, estimate, below)
    if height is None or height < LOWEST_M:
        raise Error(
            f"{source}: expected the road {LOWEST_M:g} m or more below the origin, got "
            f"{plane.height_m:.2f} m; if the origin is on the road, set `height_m` to the height "
            "of the sensor above the road"
        )
    text = (
        f"{below}: points are moved down by {height - plane.height_m:.2f} m, so that the origin is "
        "`height_m` above the road"
    )
    return replace(
        estimate, lift_m=plane.height_m - height, plane=plane, assumed=(*estimate.assumed, text)
    )


def _check_millimetres(source: Path, estimate: Survey, why: str) -> None:
    """Raises Error if millimetres were assumed.

    The function is called if the estimate has no road at least LOWEST_M below the origin.
    """
    if MILLIMETRES in estimate.assumed:
        raise Error(
            f"{source}: expected the road {LOWEST_M:g} m or more below the origin, but {why}; "
            "the coordinates were assumed to be in millimetres; `unit_m` sets their unit"
        )


def _as_given(
    source: Path, facts: LidarFacts, clouds: Sequence[Floats], plane: RoadPlane
) -> RoadPlane:
    """Returns the road plane near the sensor height that the user set.

    plane: the estimated plane, which is returned if the user set no height. Raises Error if there
    is no plane near this height.
    """
    if facts.height_m is None:
        return plane
    off = max(AS_GIVEN_M, AS_GIVEN_SHARE * facts.height_m)
    near = (facts.height_m - off, facts.height_m + off)
    if near[0] <= plane.height_m <= near[1]:
        return plane
    near_given = find_plane(clouds, near) if not facts.tilt else None
    if near_given is None or near_given.share < LEAST_SHARE or near_given.score < plane.score / 3:
        raise Error(
            f"{source}: height_m: expected a height within {off:.2g} m of the estimate of "
            f"{plane.height_m:.2f} m, got {facts.height_m:g} m; without `height_m`, the estimate "
            "is used"
        )
    return near_given


def _level(estimate: Survey, plane: RoadPlane) -> Survey:
    user_facts = estimate.facts
    pitch, roll = (math.degrees(angle) for angle in plane.tilt)
    share = f"{100 * plane.share:.0f} % of the ground near the sensor is on this plane"
    if not math.isnan(plane.moved_share):
        share += f", and {100 * plane.moved_share:.0f} % of the ground under traffic"
    notes = [
        f"the road is {plane.height_m:.2f} m below the sensor: {share}; the root mean "
        "square distance of the ground to the plane is "
        f"{100 * plane.residual_m:.0f} cm within {FIT_M:g} m"
    ]
    if plane.crown:
        notes.append(f"the road falls by {100 * plane.crown:.1f} % to either side of its crown")
    lean = f"pitch {pitch:.2f} and roll {roll:.2f} degrees"
    if user_facts.tilt:
        notes.append(f"points are levelled by `tilt_deg`; the road is then still tilted by {lean}")
    elif math.hypot(pitch, roll) >= WORTH_DEG:
        notes.append(f"the sensor is tilted by {lean} from the road, which is assumed level")
    tilt = user_facts.tilt or (plane.tilt if math.hypot(pitch, roll) >= WORTH_DEG else None)
    facts = replace(user_facts, height_m=round(plane.height_m, 3), tilt=tilt)
    return replace(estimate, facts=facts, plane=plane, assumed=(*estimate.assumed, *notes))
