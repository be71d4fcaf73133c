"""Writes the 3-D view of the chosen option of a plan beside the plan's page."""

from pathlib import Path

from pyinfra.dataset.fused import fused
from pyinfra.dataset.surroundings import surroundings_of
from pyinfra.experiments.planner.plan import Plan
from pyinfra.experiments.planner.simulate import frames_at
from pyinfra.experiments.planner.tables import units_at
from pyinfra.formats.yaml_file import parse_yaml
from pyinfra.viz.viewer.frames import simulated_view
from pyinfra.viz.viewer.page import write_page

CHOSEN = 1  # number of the chosen option
MOST_POINTS = 150_000
VIEW_FILE = "view.html"


def write_view(plan: Plan, folder: Path) -> Path:
    """Writes one frame of the chosen option, with the points of all its LiDARs."""
    site, number = plan.site, plan.site.other_frames(1)
    units = units_at(plan.options, CHOSEN, plan.lidars)
    frames = fused(
        [frames_at(site, pose, lidar, number, seed=site.other_seed) for pose, lidar in units]
    )
    around = surroundings_of(parse_yaml(frames.world.dump(), "scene"), site.roads)
    rows = plan.options[plan.options.option == CHOSEN]
    name = " and ".join(rows.lidar)
    title = f"{site.name}, option {CHOSEN}: {name}"
    file = folder / VIEW_FILE
    write_page({name: [simulated_view(frames, number[0])]}, title, file, MOST_POINTS, around)
    return file
