"""Measures the effect of cheaper scene models: detail, aggregation, vehicle parts.

The command writes fidelity.csv, aggregation.csv, fidelity_parts.csv and a picture to out:

    python -m reproduction fidelity
"""

import time
from pathlib import Path

import matplotlib
import numpy as np
import pandas as pd

from pyinfra.core.vocabulary import KM_H
from pyinfra.dataset import simulation
from pyinfra.dataset.catalogue import lidar_file, scene_file
from reproduction import RECORDED, ROOT, provenance
from reproduction.arguments import Out, command

matplotlib.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.patches import Rectangle

from reproduction.commands.ladder import SETTINGS, parts_of

LIDARS = ["livox_avia", "helios_16", "pandar_64", "ruby_plus"]
DETAILS: dict[str, dict[str, object]]
DETAILS = {value: {"detail": value} for value in ("fine", "box", "low", "mid")}
PART_MODELS: dict[str, dict[str, object]]
PART_MODELS = {value: dict(parts_of(value)) for value in SETTINGS["parts"]}
BINS = [10, 20, 40, 60, 80, 100]


def objects(world: simulation.World, lidars: list[simulation.Lidar], frames: range) -> pd.DataFrame:
    """Returns a row for each vehicle, frame and LiDAR."""
    rows = []
    for number, per_lidar in simulation.simulate(world, lidars, frames):
        for lidar, frame in zip(lidars, per_lidar, strict=True):
            table = pd.DataFrame(frame.objects)
            rows.append(table.assign(frame=number, lidar=lidar.name))
    return pd.concat(rows, ignore_index=True)


def scene(name: str, preset: str, **overrides: object) -> simulation.World:
    return simulation.load_scene(scene_file(name), preset=preset, set=overrides)


def seen(table: pd.DataFrame) -> pd.DataFrame:
    """Returns the rows of vehicles with a visible share of at least 0.2."""
    return table[table.visibility >= 0.2]


def by_distance(table: pd.DataFrame) -> pd.Series:
    bins = pd.cut(table.distance, BINS)
    return table.groupby(["lidar", bins], observed=True).points.mean()


def points_ladder(
    severity: str, models: dict[str, dict[str, object]], frames: range, preset: str
) -> pd.DataFrame:
    """Returns points per vehicle by distance for each model, and their change from the first one.

    Parameters
    ----------
    severity : name of the setting, and of the result's first column
    models : the scene keys that each value of the setting changes
    """
    first = next(iter(models))
    lidars = [simulation.load_lidar(lidar_file(n), preset) for n in LIDARS]
    means = {
        value: by_distance(seen(objects(scene("highway", preset, **keys), lidars, frames)))
        for value, keys in models.items()
    }
    rows = []
    for model, mean in means.items():
        for (lidar, interval), value in mean.items():
            rows.append(
                {
                    severity: model,
                    "lidar": lidar,
                    "distance_m": f"{interval.left:.0f}-{interval.right:.0f}",
                    "points_per_vehicle": round(value, 3),
                    "change_percent": round(100 * (value / means[first][lidar, interval] - 1), 2),
                }
            )
    return pd.DataFrame(rows)


def aggregation_table(frames: range, preset: str) -> pd.DataFrame:
    """Returns points per vehicle, and the share outside the boxes, by aggregation mode."""
    lidars = [simulation.load_lidar(lidar_file(n), preset) for n in LIDARS]
    rows = []
    for mode in ("exact", "slices:100", "instant"):
        world = scene("highway", preset, aggregation=mode)
        start = time.perf_counter()
        table = objects(world, lidars, frames)
        seconds = time.perf_counter() - start
        for lidar, part in seen(table).groupby("lidar"):
            rows.append(
                {
                    "aggregation": mode,
                    "lidar": lidar,
                    "points_per_vehicle": round(part.points.mean(), 3),
                    "outside_box_percent": round(
                        100 * (1 - part.points_in_box.sum() / part.points.sum()), 2
                    ),
                    "ms_per_frame_set": round(1000 * seconds / len(frames), 2),
                }
            )
    return pd.DataFrame(rows)


def aggregation_picture(file: Path, number: int = 300) -> None:
    """Draws one vehicle from above under the three aggregation modes, with its mid-frame box."""
    lidar = simulation.load_lidar(lidar_file("ruby_plus"), "equal")
    modes = ("exact", "slices:100", "instant")
    figure, axes = plt.subplots(len(modes), 1, figsize=(6, 7), sharex=True, layout="constrained")
    for mode, axis in zip(modes, axes, strict=True):
        world = scene("highway", "equal", aggregation=mode)
        ((_, (frame,)),) = simulation.simulate(world, [lidar], [number])
        rows = frame.objects
        near = rows[(rows["x"] > 15) & (rows["x"] < 60) & (rows["visibility"] > 0.9)]
        car = near[np.argmax(near["points"])]
        xyz = frame.xyz[frame.object_id == car["id"]]
        axis.scatter(xyz[:, 0] - car["x"], xyz[:, 1] - car["y"], s=2, color="black")
        axis.add_patch(
            Rectangle(
                (-car["dx"] / 2, -car["dy"] / 2), car["dx"], car["dy"], fill=False, color="tab:blue"
            )
        )
        axis.set(title=f"{mode}: {car['points']} points, {car['points_in_box']} in the box")
        axis.set(aspect="equal", ylabel="y (m)")
    axes[-1].set_xlabel(f"x (m); {car['speed'] * KM_H:.0f} km/h at {car['distance']:.0f} m")
    file.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(file, dpi=90)


@command
def main(*, frames: int = 100, out: Out = Path()) -> None:
    """
    Parameters
    ----------
    frames : number of frames, evenly spaced over the run (default: %(default)s)
    """
    numbers = range(0, 5000, 5000 // frames)
    recorded = out.resolve() == RECORDED
    pictures = ROOT / "docs" / "pictures" if recorded else out
    aggregation_picture(pictures / "aggregation.png")
    made_by = provenance(f"fidelity --frames {frames}")
    for name, table in (
        ("fidelity", points_ladder("detail", DETAILS, numbers, "equal")),
        ("fidelity_parts", points_ladder("parts", PART_MODELS, numbers, "datasheet")),
        ("aggregation", aggregation_table(numbers, "equal")),
    ):
        print(f"\n{name}\n{table.to_string(index=False)}")
        table.assign(seed=1, **made_by).to_csv(out / f"{name}.csv", index=False)
