"""Simulate roadside LiDARs, detect objects in their frames, evaluate and compare detectors.

    import pyinfra as pi

    scene = pi.load_scene("highway", seed=1)
    frames = pi.simulate(scene, pi.load_lidar("ruby_plus"), range(0, 1000, 10))
    detections = pi.detect(pi.load_detector("generalist"), frames)
    result = pi.evaluate(frames, detections)

Each public name is imported when it is first used. This keeps `import pyinfra` fast.
"""

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pyinfra.api import benchmark, train
    from pyinfra.conversion import export, import_map, import_recording
    from pyinfra.core.errors import Error
    from pyinfra.core.version import __version__
    from pyinfra.dataset.loading import load_dataset, load_lidar, load_scene, simulate
    from pyinfra.experiments.option_table import recommend
    from pyinfra.experiments.planner.candidates import PoseGrid
    from pyinfra.experiments.planner.plan import plan
    from pyinfra.experiments.stress.runner import stress
    from pyinfra.metrics.compare import compare
    from pyinfra.metrics.evaluate import evaluate
    from pyinfra.metrics.settings import Settings
    from pyinfra.models.inference.boxes_table import detect, load_detector
    from pyinfra.tracking.counts import count
    from pyinfra.tracking.evaluation import evaluate_tracks
    from pyinfra.tracking.tracker import TrackSettings
    from pyinfra.tracking.tracks import track
    from pyinfra.viz.frame_plot import plot_frame
    from pyinfra.viz.plots import plot_ap_by_distance, plot_scene, plot_stress

_MODULES = {
    "Error": "pyinfra.core.errors",
    "PoseGrid": "pyinfra.experiments.planner.candidates",
    "Settings": "pyinfra.metrics.settings",
    "TrackSettings": "pyinfra.tracking.tracker",
    "__version__": "pyinfra.core.version",
    "benchmark": "pyinfra.api",
    "compare": "pyinfra.metrics.compare",
    "count": "pyinfra.tracking.counts",
    "detect": "pyinfra.models.inference.boxes_table",
    "evaluate": "pyinfra.metrics.evaluate",
    "evaluate_tracks": "pyinfra.tracking.evaluation",
    "export": "pyinfra.conversion",
    "import_map": "pyinfra.conversion",
    "import_recording": "pyinfra.conversion",
    "load_dataset": "pyinfra.dataset.loading",
    "load_detector": "pyinfra.models.inference.boxes_table",
    "load_lidar": "pyinfra.dataset.loading",
    "load_scene": "pyinfra.dataset.loading",
    "plan": "pyinfra.experiments.planner.plan",
    "plot_ap_by_distance": "pyinfra.viz.plots",
    "plot_frame": "pyinfra.viz.frame_plot",
    "plot_scene": "pyinfra.viz.plots",
    "plot_stress": "pyinfra.viz.plots",
    "recommend": "pyinfra.experiments.option_table",
    "simulate": "pyinfra.dataset.loading",
    "stress": "pyinfra.experiments.stress.runner",
    "track": "pyinfra.tracking.tracks",
    "train": "pyinfra.api",
}

__all__ = [
    "Error",
    "PoseGrid",
    "Settings",
    "TrackSettings",
    "__version__",
    "benchmark",
    "compare",
    "count",
    "detect",
    "evaluate",
    "evaluate_tracks",
    "export",
    "import_map",
    "import_recording",
    "load_dataset",
    "load_detector",
    "load_lidar",
    "load_scene",
    "plan",
    "plot_ap_by_distance",
    "plot_frame",
    "plot_scene",
    "plot_stress",
    "recommend",
    "simulate",
    "stress",
    "track",
    "train",
]


def __getattr__(name: str) -> object:
    if name in _MODULES:
        value = getattr(importlib.import_module(_MODULES[name]), name)
        globals()[name] = value
        return value
    raise AttributeError(f"module 'pyinfra' has no attribute '{name}'")


def __dir__() -> list[str]:
    return sorted(__all__)
