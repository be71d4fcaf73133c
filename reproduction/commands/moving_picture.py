"""Draws the moving picture of the README: two LiDARs see the same three seconds of a junction.

Each point lights up at the time at which its ray is fired, and fades. Boxes are the true vehicles.

    python -m reproduction moving_picture --out docs/pictures/junction.webp
"""

import itertools
import math
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import numpy as np
from matplotlib import font_manager
from PIL import Image, ImageDraw, ImageFont

import pyinfra as pi
from pyinfra.core.arrays import FloatArray
from pyinfra.dataset.lidars import LidarSheet, read_catalogue
from pyinfra.dataset.object_rows import BOX
from reproduction.arguments import command

LIDARS = ("livox_avia", "ruby_plus")
SECONDS, STEPS = 3.0, 2  # duration of the moving picture, and number of pictures per frame
SIZE = (460, 380)  # size of each half, pixels
DRAWN = 2  # factor by which more pixels are computed in each direction, and then averaged
# Position of the camera behind and above the sensor, and distance of its target ahead.
BACK_M, UP_M, AHEAD_M = 30.0, 26.0, 26.0
FIELD_OF_VIEW_DEG = 50.0
FADE_S = 0.25  # duration for which a point is visible
GROUND = np.array([11, 15, 20])
RAMP = np.array([[120, 140, 170], [90, 200, 250], [120, 235, 160], [250, 240, 140]])
RAMP_M = 4.0  # height above the road from which points have the last colour of RAMP
BOX_COLOUR = (255, 140, 40)
QUALITY = 50


EDGES = [(a, b) for a, b in itertools.combinations(range(8), 2) if (a ^ b) in (1, 2, 4)]
CORNERS = np.array(list(itertools.product((-0.5, 0.5), repeat=3)))
Camera = Callable[[FloatArray], FloatArray]


@command
def main(
    *,
    out: Annotated[Path, {"recorded": "docs/pictures/junction.webp"}] = Path("junction.webp"),
) -> None:
    halves = [pictures(sheet.name, title) for sheet, title in titles()]
    both = [Image.fromarray(np.concatenate(pair, axis=1)) for pair in zip(*halves, strict=True)]
    each_ms = round(1000 * SECONDS / len(both))
    both[0].save(
        out, save_all=True, append_images=both[1:], duration=each_ms, loop=0,
        quality=QUALITY, method=6,
    )  # fmt: skip
    print(f"{out}: {len(both)} pictures, {out.stat().st_size / 1e6:.2f} MB")


def titles() -> list[tuple[LidarSheet, str]]:
    """Returns the LiDARs, and the title above the picture of each."""
    sheets = {sheet.name: sheet for sheet in read_catalogue("datasheet")}
    return [
        (sheets[name], f"{sheets[name].model}, US$ {sheets[name].price_low_usd:,.0f}")
        for name in LIDARS
    ]


def pictures(name: str, title: str) -> list[np.ndarray]:
    """Returns the pictures of a LiDAR, each (height, width, 3)."""
    frames = pi.simulate(pi.load_scene("crossroad", seed=2), name, range(round(SECONDS / 0.1)))
    period_s, ground_m = frames.period_s, -frames.lidar.T_world_levelled.z
    camera = camera_above(ground_m)
    clouds, fired, boxes = [], [], []
    for frame in frames:
        clouds.append(frame.points[:, :3].astype(np.float64))
        assert frame.fields is not None
        fired.append(frame.number * period_s + frame.fields["time_s"])
        boxes.append(frame.objects[frame.objects.points > 0])
    cloud, at = np.concatenate(clouds), np.concatenate(fired)
    place, colour = camera(cloud), colours(cloud[:, 2] - ground_m)
    out = []
    for k, step in itertools.product(range(len(boxes)), range(STEPS)):
        time_s = (k + (step + 1) / STEPS) * period_s
        lit = (at <= time_s) & (at > time_s - FADE_S)
        light = 1 - (time_s - at[lit]) / FADE_S
        canvas = drawn(place[lit], colour[lit] * (0.15 + 0.85 * light[:, None]))
        ahead_s = ((step + 1) / STEPS - 0.5) * period_s  # the labels hold at mid-frame
        moved = boxes[k][BOX].to_numpy(float)
        moved[:, :2] += ahead_s * boxes[k][["vx", "vy"]].to_numpy(float)
        out.append(finished(canvas, moved, camera, title))
    return out


def camera_above(ground_m: float) -> Camera:
    """Returns a function of points (n, 3): (n, 3) image column and row (pixels), and depth (m)."""
    eye = np.array([-BACK_M, 0.0, ground_m + UP_M])
    ahead = np.array([AHEAD_M, 0.0, ground_m]) - eye
    ahead /= np.linalg.norm(ahead)
    right = np.cross(ahead, [0, 0, 1])
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(ahead, right), ahead])
    scale = DRAWN * SIZE[0] / 2 / math.tan(math.radians(FIELD_OF_VIEW_DEG / 2))

    def camera(points: FloatArray) -> FloatArray:
        x, y, far = axes @ (points - eye).T
        far = np.maximum(far, 0.1)
        middle = DRAWN * np.array(SIZE) / 2
        return np.stack([middle[0] + scale * x / far, middle[1] + scale * y / far, far], axis=1)

    return camera


def colours(above_m: FloatArray) -> FloatArray:
    """Returns colours (n, 3) of heights above the road (n,)."""
    at = np.clip(above_m / RAMP_M, 0, 1)
    knots = np.linspace(0, 1, len(RAMP))
    return np.stack([np.interp(at, knots, RAMP[:, i]) for i in range(3)], axis=1)


def drawn(place: FloatArray, colour: FloatArray) -> np.ndarray:
    """Returns a picture of points. Where points overlap, each channel has the largest value."""
    width, height = DRAWN * SIZE[0], DRAWN * SIZE[1]
    canvas: FloatArray = np.zeros((height, width, 3)) + GROUND
    column, row = place[:, 0].astype(int), place[:, 1].astype(int)
    inside = (column >= 0) & (column < width - 1) & (row >= 0) & (row < height - 1)
    inside &= place[:, 2] > 1
    for dx, dy in itertools.product((0, 1), repeat=2):  # a point fills 2 x 2 pixels
        np.maximum.at(canvas, (row[inside] + dy, column[inside] + dx), colour[inside])
    return canvas


def finished(canvas: np.ndarray, boxes: FloatArray, camera: Camera, title: str) -> np.ndarray:
    """Returns the picture with boxes (k, 7) and the title."""
    picture = Image.fromarray(canvas.astype(np.uint8))
    pen = ImageDraw.Draw(picture)
    for box in boxes:
        turn = np.array(
            [[math.cos(box[6]), -math.sin(box[6])], [math.sin(box[6]), math.cos(box[6])]]
        )
        local = CORNERS * box[3:6]
        corners = np.column_stack([local[:, :2] @ turn.T + box[:2], local[:, 2] + box[2]])
        spots = camera(corners)
        if spots[:, 2].min() > 1:
            for a, b in EDGES:
                pen.line([*spots[a, :2], *spots[b, :2]], fill=BOX_COLOUR, width=DRAWN)
    font = ImageFont.truetype(font_manager.findfont("DejaVu Sans"), 18 * DRAWN)
    pen.text((12 * DRAWN, 10 * DRAWN), title, fill=(255, 255, 255), font=font)
    return np.asarray(picture.resize(SIZE, Image.Resampling.LANCZOS))
