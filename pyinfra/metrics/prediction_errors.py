"""Recognises common errors in the positions, sizes and headings of predictions."""

import math
from collections.abc import Iterator

import numpy as np

from pyinfra.core.arrays import FloatArray, IntArray
from pyinfra.dataset.frame_tables import Predictions, Vehicles
from pyinfra.metrics.matching import pairs_of_frames

NEAR_M = 2.0  # largest horizontal distance of a near prediction from the centre of a vehicle
FAR_M = 20.0  # largest common displacement of all boxes in x or y that is recognised
LEAST_NEAR = 0.3  # below this share of near predictions, common errors of position are tested
FAR_OFF = 0.1  # below this share of near predictions, a warning says that all boxes are far off
MUCH_BETTER = 0.25  # minimum increase of the share by a correction for a warning to name the error
HEIGHT_OFF_M = 0.5
QUARTER_DEG = 60.0
LEAST_RATIO = 1.2  # above this length-to-width ratio of vehicles, swapped sizes are reported
CHANGES = {  # matrices for x and y that correct boxes with wrong axes
    "mirrored-left-right": [[1, 0], [0, -1]],
    "mirrored-front-back": [[-1, 0], [0, 1]],
    "turned-half": [[-1, 0], [0, -1]],
    "axes-swapped": [[0, 1], [1, 0]],
    "turned-quarter-left": [[0, -1], [1, 0]],
    "turned-quarter-right": [[0, 1], [-1, 0]],
}


def errors_of(predictions: Predictions, vehicles: Vehicles) -> Iterator[tuple[str, str]]:
    p, v = np.concatenate([*pairs_of_frames(predictions.frame, vehicles.frame)], axis=1)
    boxes, truth = predictions.boxes, vehicles.boxes
    share = _share_near(boxes, truth, p, v)
    if share < LEAST_NEAR:
        elsewhere = _elsewhere(boxes, truth, p, v, share)
        if elsewhere is not None:
            yield elsewhere
            return
    gap = np.hypot(boxes[p, 0] - truth[v, 0], boxes[p, 1] - truth[v, 1])
    close = gap <= NEAR_M
    p, v = p[close], v[close]
    yield from _heights(boxes[p], truth[v])
    yield from _headings(boxes[p], truth[v])
    ratio = np.median(truth[v, 3] / truth[v, 4])
    if np.median(boxes[p, 3] / boxes[p, 4]) < 1 and ratio > LEAST_RATIO:
        yield (
            "length-width",
            "most predictions are wider than long; length and width may be swapped",
        )


def _elsewhere(
    boxes: FloatArray, truth: FloatArray, p: IntArray, v: IntArray, share: float
) -> tuple[str, str] | None:
    """Returns the name and text of a warning about the positions of predictions, or None.

    The text names the change of axes, or the shift, that moves the predictions near vehicles.
    """
    text = f"{100 * share:.0f} % of the predictions lie within {NEAR_M:g} m of a vehicle"
    shares = {}
    for name, matrix in CHANGES.items():
        moved = boxes.copy()
        moved[:, :2] = boxes[:, :2] @ np.array(matrix, dtype=np.float64)
        shares[name] = _share_near(moved, truth, p, v)
    name = max(shares, key=lambda name: shares[name])
    if shares[name] > share + MUCH_BETTER:
        better = f"{100 * shares[name]:.0f} % would do so with the axes corrected ({name})"
        return name, f"{text}, but {better}"
    dx, dy = _shift(boxes[p, :2] - truth[v, :2])
    moved = boxes.copy()
    moved[:, :2] -= (dx, dy)
    shifted_share = _share_near(moved, truth, p, v)
    if shifted_share > share + MUCH_BETTER:
        return (
            "displaced",
            f"{text}, but {100 * shifted_share:.0f} % would do so if ({dx:.1f}, {dy:.1f}) m were "
            "subtracted from x and y",
        )
    if share > FAR_OFF:
        return None  # the frame of reference is right, but the detector is poor
    causes = "a different frame of reference, predictions of other frames, or poor boxes"
    return "far-from-vehicles", f"{text}; possible causes are {causes}"


def _shift(between: FloatArray) -> tuple[float, float]:
    """Returns the most frequent difference between centres in x and y, at most FAR_M each.

    between: (n, 2) differences of centres, metres.
    """
    edges = np.arange(-FAR_M, FAR_M + 1)
    counts, _, _ = np.histogram2d(between[:, 0], between[:, 1], bins=(edges, edges))
    i, j = np.unravel_index(counts.argmax(), counts.shape)
    middle = edges[[i, j]] + 0.5
    peak = between[(np.abs(between - middle) <= 1).all(axis=1)]
    if len(peak) == 0:
        return 0.0, 0.0
    dx, dy = np.median(peak, axis=0)
    return float(dx), float(dy)


def _heights(boxes: FloatArray, truth: FloatArray) -> Iterator[tuple[str, str]]:
    off = float(np.median(boxes[:, 2] - truth[:, 2]))
    half = float(np.median(truth[:, 5])) / 2
    if abs(off) <= HEIGHT_OFF_M:
        return
    text = f"boxes are {abs(off):.2f} m too {'high' if off > 0 else 'low'} (median)"
    if abs(abs(off) - half) < 0.25:
        text += (
            ", which is half of their height; z may be the bottom of the box instead of the "
            "centre, or the reverse."
        )
    else:
        text += (
            "; z may be relative to the road instead of the sensor, or the anchor height may be "
            "wrong."
        )
    yield "height-offset", f"{text} This changes the 3-D IoU, but not the BEV IoU"


def _headings(boxes: FloatArray, truth: FloatArray) -> Iterator[tuple[str, str]]:
    as_is = _median_turn(boxes[:, 6] - truth[:, 6])
    if as_is <= QUARTER_DEG / 4:
        return
    quarter = _median_turn(boxes[:, 6] - truth[:, 6] + math.pi / 2)
    mirrored = _median_turn(-boxes[:, 6] - truth[:, 6])
    text = f"headings are off by {as_is:.0f} degrees (median)"
    if quarter < as_is / 3:
        yield "heading-quarter", f"{text}, a quarter turn; in KITTI, rotation_y = -heading - pi/2"
    elif mirrored < as_is / 3:
        better = f"only by {mirrored:.0f} with the opposite sign"
        yield "heading-sign", f"{text}, but {better}; positive headings turn to the left"
    else:
        yield "heading-off", text


def _median_turn(turn: FloatArray) -> float:
    """Returns the median absolute difference of headings in degrees, 0 to 90.

    turn: differences of headings, radians. Headings that differ by 180 degrees are taken as equal.
    """
    return float(np.median(np.abs((np.degrees(turn) + 90) % 180 - 90)))


def _share_near(boxes: FloatArray, truth: FloatArray, p: IntArray, v: IntArray) -> float:
    gap = np.hypot(boxes[p, 0] - truth[v, 0], boxes[p, 1] - truth[v, 1])
    near = np.zeros(len(boxes), dtype=np.bool_)
    near[p[gap <= NEAR_M]] = True
    return float(near.mean())
