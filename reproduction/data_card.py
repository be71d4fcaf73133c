"""Writes a data card, which describes the content, origin and limits of a data set."""

from collections import Counter
from collections.abc import Sequence

import pandas as pd

from pyinfra.dataset.data_set import DataSet
from pyinfra.dataset.split import TRAIN_UNTIL_S, VAL_FROM_S, by_time
from pyinfra.formats import kitti

TEXT = """\
# Simulated roadside LiDAR frames

{count} scenes ({scenes}), of each {frames} frames of 0.1 s,
every {step_s:g} s from 0 to {until_s:g} s, seen at the same instants from one pole by {lidars}.
All of it is simulated: no recording, no person, no number plate.

## What it holds
Means per frame, from each scene's `summary.csv`; a vehicle in the LiDAR's range counts, hit or not.

{composition}

| scene | train frames | val frames | labels of all LiDARs |
|---|---|---|---|
{split}

Train are the frames that start before {train_s:g} s, `val` those from {val_s:g} s on; those between
are in neither, because neighbouring frames show the same vehicles (`ImageSets`).

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
threads. Another CPU, compiler or library moves last digits: compare ranges within 1e-3 m there.
`sha256sum --quiet -c SHA256SUMS` checks a copy; `summary.csv` holds times and is not in the list.

## Frames of reference
Points, boxes and objects are in the levelled LiDAR frame: origin at the sensor, z up, x along the
mount's yaw, metres. `lidar.yaml` has the poses to the world and to the tilted sensor. A box is
x y z dx dy dz heading, centre first; in `label_2` it is in KITTI's camera frame (x right, y down,
z forward; rotation_y = -heading - pi/2; the location is the bottom centre) and the 2-D box is a
stand-in. Each ray was cast at its own firing time. With `label_time: {label_time}` a label shows
{label_text}.
`objects/` has both poses.

## Known limits
- Vehicles are lofted bodies that reach down to the road; those longer than 6 m do not turn at a
  junction, and traffic keeps its lanes. No vegetation, and nobody on foot or on a bicycle but for
  `people` of the scene and those of its trajectories.
- One echo a ray; no back-scatter from rain and fog, no wet-road mirror, no interference.
- Intensity is a model, not a calibrated reflectance.
- One seed: one traffic. Motors of spinning LiDARs are locked to the clock, with the cut angle
behind
  their view; how many points leave a mid-frame box depends on where the cut angle is.
- A LiDAR's range and drop-off are those of its preset and decide comparisons at a distance.
- Visibility is unknown (-1) outside the evaluation region (`region_half_length_m`).

## Licence
The data: Creative Commons Attribution 4.0 (CC-BY-4.0). The software that made it: Apache-2.0.
"""
PRESETS = {
    "paper": "Evenly spaced channels; CARLA's drop-off of points and a range of 100 m for the\n"
    "spinning LiDARs, none and 260 m for the Avia, as the study's hit points imply.",
    "equal": "Evenly spaced channels, one range of 260 m and no drop-off for all.",
    "datasheet": "The vendors' channels, firing times and ranges, detection by received power,\n"
    "range noise, beam width.",
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
