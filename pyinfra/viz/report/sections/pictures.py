"""The section with pictures of the frames and scenes of data sets."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure as Drawing

from pyinfra.core.arrays import FloatArray
from pyinfra.core.boxes import footprints
from pyinfra.dataset.catalogue import shipped
from pyinfra.dataset.data_set import DataSet
from pyinfra.dataset.frame_readers import read_cameras, read_predictions
from pyinfra.dataset.prediction_origin import check_origin
from pyinfra.experiments.result_tables import TableFile
from pyinfra.metrics import scan_patterns
from pyinfra.metrics.scanning_statistics import described, speed_table
from pyinfra.viz import clouds, cutouts, scene_pictures
from pyinfra.viz.clouds import Snapshot, read_snapshot
from pyinfra.viz.pattern_picture import pattern_picture
from pyinfra.viz.picture_style import STYLE, draw_scale
from pyinfra.viz.report import svg
from pyinfra.viz.report.blocks import Block, Figure, LegendEntry, Panel, Section
from pyinfra.viz.report.names import detector
from pyinfra.viz.report.report_data import Material, Run
from pyinfra.viz.report.style import drawing, panel

PATTERN_S = 2.0
SHOWN_SCORE = 0.3  # minimum score of predicted boxes
FIRST_RUNS = ("pv-rcnn", "pointpillars")
PREDICTED = "#b3006e"
WIDE_DPI = 110


def section(material: Material) -> Section | None:
    """Returns pictures of scan patterns, plans, clouds, vehicles, predicted boxes and speeds."""
    if not material.data:
        plans = _plans(material, [])
        return Section("pictures", "Plans of the scenes", "", plans) if plans else None
    exact = [d for d in material.data if d.aggregation == "exact"] or list(material.data)
    blocks: list[Block] = [*_plans(material, exact), _sheet(material, exact), *_boxes(material)]
    blocks += [_cutouts(material, d) for d in exact]
    blocks += [*_patterns(material, exact[0]), *_aggregations(material), _speeds(exact)]
    lead = (
        "Pictures of frames on disk. The x axis points in the LiDAR's viewing direction, the y "
        "axis to its left; both are in metres."
    )
    return Section("pictures", "Pictures of the frames", lead, blocks)


def frame_of(material: Material, data: DataSet) -> int:
    """Returns the frame to draw: the first one for which all runs of the data set have boxes."""
    runs = [run for run in material.runs if is_of(run, data)]
    common = [k for k in data.frames if all(run.prediction(k).is_file() for run in runs)]
    return common[0] if common else data.frames[0]


def is_of(run: Run, data: DataSet) -> bool:
    """Returns whether a run used a LiDAR of this data set."""
    return (run.scene, run.preset) == (data.scene, data.preset) and run.lidar in data.names


def folders(material: Material, data: DataSet) -> list[Path]:
    """Returns the LiDAR folders in the report's order."""
    return [data.lidar_folder(name) for name in material.names.sorted(data.names)]


def _drawn(figure: Drawing, name: str, label: str, title: str = "") -> Panel:
    return Panel(title, svg.inline(figure, svg.identifier(name), label, WIDE_DPI))


def _patterns(material: Material, data: DataSet) -> list[Block]:
    """Draws the scan patterns of the LiDARs that have a scan pattern; recordings have none."""
    patterns = {}
    for folder in folders(material, data):
        if not scan_patterns.has_pattern(folder / "lidar.yaml"):
            continue
        rays = scan_patterns.read_rays(folder / "lidar.yaml", PATTERN_S, data.period_s)
        angles = np.radians([rays.azimuth_deg, rays.elevation_deg])
        patterns[material.names.model(folder.name)] = np.stack([*angles, rays.time_s], axis=1)
    if not patterns:
        return []
    picture = pattern_picture(patterns, dict.fromkeys(patterns, data.period_s))
    panel_of = _drawn(picture, "patterns", f"Rays of {', '.join(patterns)} in one frame")
    caption = (
        f"Scan patterns of one frame, preset {data.preset}, and the rays on a car's rear at 60 m."
    )
    return [Figure("figure-patterns", caption, [panel_of], layout="wide", plate=True)]


def _plans(material: Material, data_sets: Sequence[DataSet]) -> list[Block]:
    """Draws the scenes of the data sets, and this package's scenes that have no data set."""
    by_scene = {data.scene: data for data in data_sets}
    panels, missing = [], []
    for scene in material.scenes():
        data = by_scene.get(scene)
        figure = _plan_of_data(data) if data else _plan_of_package(scene)
        if figure is None:
            missing.append(scene)
            continue
        label = f"Plan of {scene} with the LiDAR's pose"
        panels.append(_drawn(figure, f"plan {scene}", label))
    if not panels:
        return []
    views = ", fields of view" if by_scene else ""
    caption = (
        f"Plans of the scenes in the world frame: pose of the LiDARs{views}, evaluation region."
    )
    caption += " Footways, plants and meshes, such as the houses of a map, are not drawn."
    if missing:
        caption += f" No plan of {', '.join(missing)}: the report has no data set of it."
    layout = "wide" if by_scene else "half"
    return [Figure("figure-plans", caption, panels, layout=layout, plate=True)]


def _plan_of_data(data: DataSet) -> Drawing:
    read = scene_pictures.read_scene([data.lidar_folder(name) for name in data.names])
    return scene_pictures.plan(read)


def _plan_of_package(scene: str) -> Drawing | None:
    """Draws a scene of this package. None: the scene is unknown, or the C++ extension not built."""
    if scene not in shipped("scenes"):
        return None
    try:
        from pyinfra.viz.plots import plot_scene
    except ImportError:
        return None
    with mpl.rc_context(STYLE):
        figure = Drawing(layout="constrained")
        axes = plot_scene(scene, ax=figure.subplots())
        (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
        figure.set_size_inches(5.6, 5.6 * (high - low) / (right - left) + 0.7)
        draw_scale(axes, left + 0.3 * (right - left), low + 2.5, scene_pictures.SCALE_M)
    return figure


def _sheet(material: Material, data_sets: Sequence[DataSet]) -> Block:
    """Draws one frame of each LiDAR of each data set from above."""
    panels, views = [], []
    for data in data_sets:
        frame = frame_of(material, data)
        for folder in folders(material, data):
            view = read_snapshot(folder, frame)
            views.append(view)
            title = f"{view.lidar.model}: {view.counts()}"
            title = f"{data.scene}, {data.preset}: {title}" if len(data_sets) > 1 else title
            name = f"above {data.scene} {data.preset} {folder.name}"
            panels.append(_drawn(_above(view), name, f"{title}, from above", title))
    caption = (
        "One frame from above. The box of a vehicle with more points is darker and more solid. "
        "Boxes without points are crossed out. Dashed lines: field of view and range."
    )
    legend = _box_legend(views)
    return Figure("figure-sheet", caption, panels, legend=legend, layout="half", plate=True)


def _box_legend(views: Sequence[Snapshot]) -> list[LegendEntry]:
    return [
        LegendEntry(q.name, svg.line_swatch(q.colour, q.line, "x" if q.most == 0 else ""))
        for q in clouds.qualities(views)
    ]


def _above(view: Snapshot, boxes: FloatArray | None = None) -> Drawing:
    """Draws a frame from above, with boxes (k, 7) over it."""
    window = clouds.region_window(view)
    width, height = window.shape()
    with mpl.rc_context(STYLE):
        figure = Drawing(figsize=(5.6, 5.6 * height / width + 0.3), layout="constrained")
        axes = figure.subplots()
        clouds.bird_view(axes, view, window, point_size=0.6, headings=False)
        axes.tick_params(labelsize=7, length=2)
        if boxes is not None:
            look: Any = {"facecolors": "none", "edgecolors": PREDICTED, "linewidths": 1.4}
            axes.add_collection(PolyCollection(list(footprints(boxes)), zorder=4, **look))
    return figure


def _cutouts(material: Material, data: DataSet) -> Block:
    frame = frame_of(material, data)
    picture = cutouts.cutouts(scene_pictures.read_scene(folders(material, data)), frame)
    label = f"The same cars as each LiDAR sees them, {data.scene}"
    drawn = _drawn(picture, f"cutouts {data.scene} {data.preset} {data.aggregation}", label)
    name = f"figure-cutouts-{data.scene}-{data.preset}"
    caption = f"Cut-outs of cars at five distances, {data.scene}, preset {data.preset}."
    return Figure(name, caption, [drawn], layout="wide", plate=True)


def _aggregations(material: Material) -> list[Block]:
    """Draws the same vehicles under each aggregation, if data sets have several aggregations."""
    groups: dict[tuple[str, str, int], list[DataSet]] = {}
    for data in material.data:
        groups.setdefault((data.scene, data.preset, data.seed), []).append(data)
    figures: list[Block] = []
    for (scene, preset, _), group in groups.items():
        if len({d.aggregation for d in group}) < 2:
            continue
        frame = min(set.intersection(*(set(d.frames) for d in group)), default=None)
        if frame is not None:
            panels = [_one_way(material, data, frame) for data in group]
            caption = f"The same cars under each aggregation, {scene}, preset {preset}."
            name = f"figure-aggregation-{scene}-{preset}"
            figures.append(Figure(name, caption, panels, layout="wide", plate=True))
    return figures


def _one_way(material: Material, data: DataSet, frame: int) -> Panel:
    picture = cutouts.cutouts(scene_pictures.read_scene(folders(material, data)), frame)
    name = f"aggregation {data.scene} {data.preset} {data.aggregation}"
    return _drawn(picture, name, f"Cars, aggregation {data.aggregation}", data.aggregation)


def _boxes(material: Material) -> list[Block]:
    """Draws predicted boxes of two detectors on one frame of a LiDAR, for each data set."""
    figures: list[Block] = []
    for data in material.data:
        frame = frame_of(material, data)
        shown_runs = [r for r in material.runs if is_of(r, data) and r.prediction(frame).is_file()]
        pairs = [_pair(shown_runs, lidar) for lidar in material.names.sorted(data.names)]
        runs = max(pairs, key=lambda p: (sum(r.detector in FIRST_RUNS for r in p), len(p)))
        if runs:
            figures.append(_boxes_figure(material, data, runs, frame))
    return figures


def _pair(runs: list[Run], lidar: str) -> list[Run]:
    """Returns at most two runs of a LiDAR. Runs of FIRST_RUNS come first."""
    of_lidar = [run for run in runs if run.lidar == lidar]
    return sorted(of_lidar, key=lambda r: (r.detector not in FIRST_RUNS, r.detector))[:2]


def _boxes_figure(material: Material, data: DataSet, runs: list[Run], frame: int) -> Block:
    lidar = runs[0].lidar
    view = read_snapshot(data.lidar_folder(lidar), frame)
    panels = [_boxes_panel(data, view, run, frame) for run in runs]
    caption = (
        f"Predicted boxes (thick lines, score {SHOWN_SCORE:g} or more) and labels (thin lines) in "
        f"frame {frame} of {material.names.model(lidar)}, {data.scene}, preset {data.preset}."
    )
    predicted = LegendEntry("predicted", svg.line_swatch(PREDICTED, "-", ""))
    entries = [predicted, *_box_legend([view])]
    name = f"figure-boxes-{data.scene}-{data.preset}-{lidar}"
    return Figure(name, caption, panels, None, entries, layout="half", plate=True)


def _boxes_panel(data: DataSet, view: Snapshot, run: Run, frame: int) -> Panel:
    boxes = _predicted(data, run, frame)
    title = f"{detector(run.detector)}: {len(boxes)} boxes"
    label = f"Boxes of {title} on {view.lidar.model}, {data.scene}, frame {frame}"
    name = f"boxes {data.scene} {data.preset} {run.lidar} {run.detector}"
    return _drawn(_above(view, boxes), name, label, title)


def _predicted(data: DataSet, run: Run, frame: int) -> FloatArray:
    """Returns the predicted boxes (k, 7) of a frame with a score of at least SHOWN_SCORE."""
    folder = data.lidar_folder(run.lidar)
    check_origin(run.prediction(frame).parent, folder)
    cameras = read_cameras(folder, [frame])
    predictions = read_predictions([run.prediction(frame)], cameras)
    return np.asarray(predictions.boxes[predictions.scores >= SHOWN_SCORE])


def _speeds(data_sets: Sequence[DataSet]) -> Block:
    """Draws a histogram of the vehicles' speeds in each scene."""
    first = list({d.scene: d for d in data_sets}.values())
    table = pd.concat([described(d, speed_table(d), above_road=False) for d in first])
    panels = [_speed_panel(rows) for _, rows in table.groupby("scene", sort=False)]
    caption = "Speeds of all vehicles at the middle of each frame."
    return Figure("figure-speeds", caption, panels, TableFile("report_speeds.csv", table))


def _speed_panel(rows: pd.DataFrame) -> Panel:
    scene = str(rows.scene.iloc[0])
    inside = rows[np.isfinite(rows.to_km_h)]
    beyond = int(rows.samples.sum() - inside.samples.sum())
    with drawing():
        figure, ax = panel()
        width = inside.to_km_h - inside.from_km_h
        share = 100 * inside.samples / max(int(rows.samples.sum()), 1)
        style: dict[str, Any] = {"color": "#0b5cad", "edgecolor": "none", "align": "edge"}
        ax.bar(inside.from_km_h, share, width=width * 0.92, **style)
        ax.grid(visible=False, axis="x")
        ax.set(xlabel="speed (km/h)", ylabel="samples (%)")
        label = f"Speeds of vehicles, {scene}"
        drawn = svg.inline(figure, svg.identifier("speeds", scene), label)
    return Panel(f"{scene}, {beyond:,} samples above the scale" if beyond else scene, drawn)
