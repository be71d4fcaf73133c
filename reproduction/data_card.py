"""Writes a data card, which describes the content, origin and limits of a data set."""

from collections import Counter
from collections.abc import Sequence

import pandas as pd

from pyinfra.dataset.data_set import DataSet
from pyinfra.dataset.split import TRAIN_UNTIL_S, VAL_FROM_S, by_time
from pyinfra.formats import kitti

TEXT = """\
# Simulated roadside LiDAR frames

This data set has simulated frames of {count} scenes ({scenes}), with labels. Each scene has
{frames} frames of 0.1 s, every {step_s:g} s from 0 to {until_s:g} s. In each scene, {lidars} are
on one pole and scan at the same times. The data contain no recording, real person or number
plate.

## Contents
The table has means per frame, from the `summary.csv` of each scene. All vehicles within the range
of the LiDAR count, with or without a hit.

{composition}

| scene | train frames | val frames | labels of all LiDARs |
|---|---|---|---|
{split}

Frames that start before {train_s:g} s are for training, and frames from {val_s:g} s are `val`.
Frames between them are in neither list of `ImageSets`, because neighbouring frames show the same
vehicles.

```
SCENE/        dataset.yaml (the resolved scene)   trajectories.csv   roads.csv   summary.csv
  LIDAR/      lidar.yaml (pattern, pose, range, price)   ImageSets/
    training/ velodyne/NNNNNN.bin  float32 x y z intensity
              label_2/  calib/     KITTI's formats
              objects/NNNNNN.csv   every vehicle in range, hit or not
```

## How it was made
`python -m reproduction dataset --preset {preset} --frames {frames} --out DIR`,
infrasim {version}, seed {seeds}, aggregation `{aggregation}`.
{preset_text}

The same command and version give the same bytes on the same kind of machine, for any number of
threads. With another CPU, compiler or library the last digits differ, so compare ranges within
1e-3 m. `sha256sum --quiet -c SHA256SUMS` checks a copy. `summary.csv` is not in the list, because
it contains run times.

## Frames of reference
Points, boxes and objects are in the levelled LiDAR frame, in metres. Its origin is at the sensor,
z is up, and x is along the mount's yaw. `lidar.yaml` has the poses of the world and of the tilted
sensor. A box is x y z dx dy dz heading, with x y z of its centre. Files in `label_2` use KITTI's
camera frame: x right, y down, z forward, rotation_y = -heading - pi/2, location at the bottom
centre. Their 2-D box is a placeholder. Each ray was cast at its own firing time. With
`label_time: {label_time}` a label shows {label_text}. `objects/` has both poses.

## Known limits
- {plants_text}
- Vehicles do not change lanes. A vehicle that cannot stay within its lane in a turn does not
  turn.
- Pedestrians and cyclists exist only if the scene has `people`, or its trajectories contain them.
- Each ray has one echo. Back-scatter from rain and fog, mirror reflections on wet roads and
  interference of LiDARs are not modelled.
- Intensity is a model, not a calibrated reflectance.
- Each scene has one traffic seed. Motors of spinning LiDARs are locked to the clock, with the cut
  angle behind their view. The number of points outside a mid-frame box depends on the cut angle.
- The range and the drop-off of a LiDAR depend on the preset, and determine comparisons at a
  distance.
- Visibility is unknown (-1) outside the evaluation region (`region_half_length_m`).

## Licence
The licence of the data is Creative Commons Attribution 4.0 (CC-BY-4.0). That of the software is
Apache-2.0.
"""
PRESETS = {
    "paper": "Channels are evenly spaced. The spinning LiDARs have CARLA's drop-off of points and\n"
    "a range of 100 m. The Avia has no drop-off and 260 m, as the study's hit points imply.",
    "equal": "Channels are evenly spaced. All LiDARs have a range of 260 m and no drop-off.",
    "datasheet": "Channels, firing times, ranges, range noise and beam width are the vendors'.\n"
    "Received power decides whether a hit becomes a point.",
}
BODIES = (
    "Vehicles are closed bodies down to the road, without windows. The scenes have no vegetation."
)
PLANTS = {
    "paper": BODIES,
    "equal": BODIES,
    "datasheet": "Vehicles have windows and a gap below the body. Hedges and trees are\n"
    "  volumes that stop a random share of the rays.",
}
LABEL_TIMES = {
    "frame": "the vehicle in the middle of the frame: when it moves, points lie partly outside",
    "scan": "the vehicle at the mean time of its points",
}
COLUMNS = ("rays", "hits", "vehicles", "vehicle_points")


def data_card(sets: Sequence[DataSet], summaries: Sequence[pd.DataFrame]) -> str:
    """Returns the Markdown text of the data card.

    Parameters
    ----------
    sets : one data set per scene, all with the same frames, LiDARs and preset
    summaries : the `summary.csv` of each data set
    """
    first = sets[0]
    return TEXT.format(
        scenes=", ".join(data.scene for data in sets),
        count=len(sets),
        frames=len(first.frames),
        step_s=(first.frames[1] - first.frames[0]) * first.period_s,
        until_s=(first.frames[-1] + 1) * first.period_s,
        lidars=", ".join(first.names),
        composition=composition(sets, summaries),
        split="\n".join(split_row(data) for data in sets),
        train_s=TRAIN_UNTIL_S,
        val_s=VAL_FROM_S,
        preset=first.preset,
        preset_text=PRESETS[first.preset],
        plants_text=PLANTS[first.preset],
        version=first.version,
        seeds=", ".join(sorted({str(data.seed) for data in sets})),
        aggregation=first.aggregation,
        label_time=first.label_time,
        label_text=LABEL_TIMES[first.label_time],
    )


def composition(sets: Sequence[DataSet], summaries: Sequence[pd.DataFrame]) -> str:
    """Returns a table row for each scene and LiDAR."""
    lines = [
        "| scene | LiDAR | frames | rays | points | vehicles | points on vehicles |",
        "|---|---|---|---|---|---|---|",
    ]
    for data, summary in zip(sets, summaries, strict=True):
        for row in summary.itertuples():
            means = " | ".join(f"{getattr(row, f'{name}_per_frame'):,.1f}" for name in COLUMNS)
            lines.append(f"| {data.scene} | {row.lidar} | {row.frames} | {means} |")
    return "\n".join(lines)


def split_row(data: DataSet) -> str:
    parts = by_time(data.frames, data.period_s)
    labels = ", ".join(f"{name} {count:,}" for name, count in sorted(label_counts(data).items()))
    return f"| {data.scene} | {len(parts.train)} | {len(parts.val)} | {labels} |"


def label_counts(data: DataSet) -> Counter[str]:
    """Counts the labels of all frames and LiDARs by class."""
    counts: Counter[str] = Counter()
    for name in data.names:
        for frame in data.frames:
            file = kitti.frame_file(data.lidar_folder(name), "label_2", frame)
            lines = file.read_text(encoding="utf-8").splitlines()
            counts.update(line.partition(" ")[0] for line in lines)
    return counts
