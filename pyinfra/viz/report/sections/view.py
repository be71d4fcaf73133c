"""The section with an interactive 3-D view of one frame of each LiDAR."""

from pathlib import Path

from pyinfra.dataset.data_set import DataSet
from pyinfra.dataset.surroundings import read_surroundings
from pyinfra.viz.report.blocks import Block, Embed, Section
from pyinfra.viz.report.names import detector
from pyinfra.viz.report.report_data import Material
from pyinfra.viz.report.sections.pictures import frame_of, is_of
from pyinfra.viz.report.svg import identifier
from pyinfra.viz.viewer import frames, page

MOST_POINTS = 60_000  # largest number of points per frame
FIRST_RUNS = ("pointpillars", "pv-rcnn", "centerpoint-pillar")


def section(material: Material) -> Section | None:
    """Returns a view for each scene, then the script and style that the views need."""
    data_sets = {data.scene: data for data in reversed(material.data)}
    if not data_sets:
        return None
    blocks: list[Block] = [_view(material, data) for data in reversed(data_sets.values())]
    blocks.append(Embed(page.library(), ""))
    lead = "One frame in 3-D. Choose the LiDAR, the boxes and the quantity that colours the points."
    return Section("view", "3-D view", lead, blocks)


def _view(material: Material, data: DataSet) -> Embed:
    frame = frame_of(material, data)
    views = {}
    used = set()
    for name in material.names.sorted(data.names):
        run = _predictions(material, data, name)
        folder = data.lidar_folder(name)
        label = material.names.model(name)
        views[label] = frames.read_view_frames(
            folder, [frame], run / "predictions" if run else None
        )
        used |= {detector(r.detector) for r in material.runs if r.folder == run}
    name = identifier("view", data.scene, data.preset)
    markup = page.fragment(
        views,
        element_id=name,
        most_points=MOST_POINTS,
        around=read_surroundings(data.folder),
    )
    by = f"; predictions of {', '.join(sorted(used))}" if used else ""
    return Embed(markup, f"{data.scene}, preset {data.preset}, frame {frame}{by}.")


def _predictions(material: Material, data: DataSet, lidar: str) -> Path | None:
    """Returns the folder of the run whose boxes are shown for a LiDAR, None if there is no run."""
    runs = [run for run in material.runs if is_of(run, data) and run.lidar == lidar]
    order = {name: i for i, name in enumerate(FIRST_RUNS)}
    runs.sort(key=lambda run: (order.get(run.detector, len(order)), run.detector))
    return runs[0].folder if runs else None
