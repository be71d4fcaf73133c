"""Plots results of the public API. Each function draws into axes and writes no file."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
import pandas as pd

from pyinfra.core.errors import Error
from pyinfra.core.names import suggestion
from pyinfra.core.public import public
from pyinfra.dataset import simulation
from pyinfra.dataset.loading import load_scene
from pyinfra.dataset.simulated_frames import SimulatedFrames, roads_of_world
from pyinfra.dataset.surroundings import surroundings_of
from pyinfra.formats.yaml_file import parse_yaml
from pyinfra.metrics.evaluation_result import Evaluation

if TYPE_CHECKING:
    from matplotlib.axes import Axes

ARROW_M = 14.0
AnyScene: TypeAlias = "simulation.World | SimulatedFrames | str | os.PathLike[str]"
AnyResult: TypeAlias = "Evaluation | Mapping[str, Evaluation]"


@public()
def plot_scene(scene: AnyScene, *, ax: Axes | None = None) -> Axes:
    """Draws the plan of a scene: evaluation region, roads with lanes, buildings, sensors.

    Parameters
    ----------
    scene : result of `load_scene`, or an argument of `load_scene`, or frames of `simulate`
    ax : axes to draw into; by default those of a new figure

    Returns
    -------
    Matplotlib axes, metres in the scene's frame: x to the right, y up

    Raises
    ------
    Error : if the scene is unknown

    Examples
    --------
    >>> import pyinfra as pi
    >>> pi.plot_scene("crossroad").get_title()
    'crossroad'
    """
    from pyinfra.viz.picture_style import window_around
    from pyinfra.viz.scene_pictures import draw_surroundings

    if isinstance(scene, SimulatedFrames):
        scene = scene.world
    world = scene if isinstance(scene, simulation.World) else load_scene(scene)
    top = parse_yaml(world.dump(), "scene")
    around = surroundings_of(top, roads_of_world(world, "roads.csv"))
    ax = _axes(ax, (8, 6))
    draw_surroundings(ax, around)
    for mount in top.values("mounts"):
        x, y, yaw_deg = (mount.at(key).number() for key in ("x_m", "y_m", "yaw_deg"))
        yaw = np.radians(yaw_deg)
        tip = (x + ARROW_M * np.cos(yaw), y + ARROW_M * np.sin(yaw))
        ax.annotate("", tip, (x, y), arrowprops={"arrowstyle": "-|>", "color": "black"}, zorder=5)
        ax.plot(x, y, marker="^", color="black", markersize=6, zorder=5)
    window = window_around([road.outline for road in around.roads])
    ax.set(aspect="equal", xlim=window.x, ylim=window.y, title=top.at("name").text())
    ax.set(xlabel="x, m", ylabel="y, m")
    return ax


@public()
def plot_ap_by_distance(
    results: AnyResult, *, ground_truth: str | None = None, ax: Axes | None = None
) -> Axes:
    """Draws AP (R1000) against the distance from the sensor, with its 95 % interval.

    Parameters
    ----------
    results : result of `evaluate`, or a mapping of names in the legend to results
    ground_truth : `captured`, `all`, ...; by default the first ground truth of each result
    ax : axes to draw into; by default those of a new figure

    Returns
    -------
    Matplotlib axes: horizontal metres to the right, AP 0 to 100 up

    Raises
    ------
    Error : if results is of another type, or a result lacks the ground truth

    Examples
    --------
    >>> import pyinfra as pi
    >>> frames = pi.simulate(pi.load_scene("highway"), "helios_16", range(0, 500, 100))
    >>> result = pi.evaluate(frames, frames.labels.assign(score=1.0))
    >>> len(pi.plot_ap_by_distance(result).lines)
    1
    """
    named = {"": results} if isinstance(results, Evaluation) else results
    if not isinstance(named, Mapping) or not named:
        raise Error(
            "results: expected a result of evaluate, or a mapping of names to results, got "
            f"{type(results).__name__}"
        )
    ax = _axes(ax, (6, 4))
    for name, result in named.items():
        if not isinstance(result, Evaluation):
            raise Error(
                f"results: {name}: expected a result of evaluate, got {type(result).__name__}"
            )
        table = result.by_distance
        known = list(table.ground_truth.unique())
        which = ground_truth or known[0]
        if which not in known:
            raise Error(f"ground_truth: expected one of {', '.join(known)}, got '{which}'")
        rows = table[(table.ground_truth == which) & (table.objects > 0)]
        (line,) = ax.plot(rows.distance_m, rows.ap_r1000, marker="o", label=name or which)
        ends = (rows.ap_r1000_low, rows.ap_r1000_high)
        ax.fill_between(rows.distance_m, *ends, color=line.get_color(), alpha=0.2, linewidth=0)
    ax.set(xlabel="distance, m", ylabel="AP (R1000)", ylim=(0, 102))
    ax.legend()
    return ax


@public()
def plot_stress(
    rows: pd.DataFrame | str | os.PathLike[str], stressor: str, *, ax: Axes | None = None
) -> Axes:
    """Draws AP against the severity of one stressor, with a line and its interval per detector.

    Parameters
    ----------
    rows : table read from stress.csv, or the output folder of `stress`; of one LiDAR, preset and
        scene only
    stressor : name of the stressor, such as `rain`
    ax : axes to draw into; by default those of a new figure

    Returns
    -------
    Matplotlib axes: severity to the right, AP 0 to 100 up

    Raises
    ------
    Error : if the stressor has no rows, the folder has no stress.csv, or the rows are of several
        LiDARs, presets or scenes

    Examples
    --------
    >>> import pandas as pd
    >>> import pyinfra as pi
    >>> stressors = ["none", "drop_out", "drop_out"]
    >>> rows = pd.DataFrame({"severity": ["0", "0.5", "0.9"], "stressor": stressors})
    >>> rows = rows.assign(ap=[90, 80, 40], ap_low=0, ap_high=100, detector="mine", run="a")
    >>> rows = rows.assign(ap_r1000=rows.ap, ap_r1000_low=0, ap_r1000_high=100)
    >>> rows = rows.assign(lidar="l", preset="p", scene="s", seed="1", frames="60")
    >>> len(pi.plot_stress(rows, "drop_out").lines)
    1
    """
    from pyinfra.experiments.stress import trials
    from pyinfra.experiments.stress.summary import curves
    from pyinfra.viz import stress_plots

    if not isinstance(rows, pd.DataFrame):
        file = Path(rows) / "stress.csv"
        if not file.is_file():
            raise Error(f"rows: expected a folder with stress.csv, got '{rows}'")
        rows = trials.read(file)
    needed = (*trials.KEY, "ap_r1000", "ap_r1000_low", "ap_r1000_high")
    missing = [name for name in needed if name not in rows.columns]
    if missing:
        raise Error(f"rows: expected the column '{missing[0]}' of stress.csv, got none")
    for name in ("lidar", "preset", "scene"):
        some = list(dict.fromkeys(rows[name].astype(str)))
        if len(some) > 1:
            raise Error(f"rows: expected rows of one {name}, got {', '.join(some)}")
    stressor_curves = [(key["detector"], s, curve) for key, s, curve in curves(rows)]
    known = list(dict.fromkeys(s.name for _, s, _ in stressor_curves))
    if stressor not in known:
        near = suggestion(stressor, known)
        raise Error(f"stressor: expected a stressor with rows, got '{stressor}'{near}")
    ax = _axes(ax, (5, 4))
    stress_plots.panel(
        ax, [(name, s, curve) for name, s, curve in stressor_curves if s.name == stressor]
    )
    ax.set_ylabel("AP (R1000)")
    ax.legend()
    return ax


def _axes(ax: Axes | None, size: tuple[float, float]) -> Axes:
    """Returns `ax`, or the axes of a new figure if it is None."""
    if ax is not None:
        return ax
    import matplotlib.pyplot as plt

    return plt.subplots(figsize=size, layout="constrained")[1]
