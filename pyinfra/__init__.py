"""Simulate roadside LiDARs, detect objects in their frames, evaluate and compare detectors.

    import pyinfra as pi

    scene = pi.load_scene("highway", seed=1)
    frames = pi.simulate(scene, pi.load_lidar("ruby_plus"), range(0, 1000, 10))
    detections = pi.detect(pi.load_detector("generalist"), frames)
    result = pi.evaluate(frames, detections)

Each public name is imported when it is first used. This keeps `import pyinfra` fast.
"""

import importlib
import sys
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pyinfra.api import benchmark, export_onnx, train
    from pyinfra.conversion import export, export_tracks, import_map, import_recording
    from pyinfra.core.errors import Error, FindingWarning
    from pyinfra.core.version import __version__
    from pyinfra.dataset.frame_sequence import FrameSequence, LidarFrame
    from pyinfra.dataset.lists import list_lidars, list_presets, list_scenes
    from pyinfra.dataset.loading import load_dataset, load_lidar, load_scene
    from pyinfra.dataset.simulated import simulate
    from pyinfra.dataset.simulation import Lidar, World
    from pyinfra.experiments.option_table import recommend
    from pyinfra.experiments.planner.candidates import PoseGrid
    from pyinfra.experiments.planner.plan import Plan, plan
    from pyinfra.experiments.stress.runner import stress
    from pyinfra.folders import (
        propose_region,
        split,
        statistics,
        trust,
        validate,
    )
    from pyinfra.metrics.compare import compare
    from pyinfra.metrics.comparison import Interval
    from pyinfra.metrics.evaluate import evaluate
    from pyinfra.metrics.evaluation_result import Evaluation
    from pyinfra.metrics.settings import Settings
    from pyinfra.models.inference.boxes_table import (
        TrainedDetector,
        detect,
        list_detectors,
        load_detector,
        register_detector,
    )
    from pyinfra.models.inference.detections import Detections
    from pyinfra.pages import pictures, report, view
    from pyinfra.sites import (
        draw_site,
        import_mesh,
        import_trajectories,
        make_sites,
        simulate_traffic,
    )
    from pyinfra.tracking.counts import count
    from pyinfra.tracking.evaluation import evaluate_tracks
    from pyinfra.tracking.tracker import TrackSettings
    from pyinfra.tracking.tracks import track
    from pyinfra.viz.frame_plot import plot_frame
    from pyinfra.viz.plots import plot_ap_by_distance, plot_scene, plot_stress

_MODULES = {
    "Detections": "pyinfra.models.inference.detections",
    "Error": "pyinfra.core.errors",
    "Evaluation": "pyinfra.metrics.evaluation_result",
    "FindingWarning": "pyinfra.core.errors",
    "FrameSequence": "pyinfra.dataset.frame_sequence",
    "Interval": "pyinfra.metrics.comparison",
    "Lidar": "pyinfra.dataset.simulation",
    "LidarFrame": "pyinfra.dataset.frame_sequence",
    "Plan": "pyinfra.experiments.planner.plan",
    "PoseGrid": "pyinfra.experiments.planner.candidates",
    "Settings": "pyinfra.metrics.settings",
    "TrackSettings": "pyinfra.tracking.tracker",
    "TrainedDetector": "pyinfra.models.inference.boxes_table",
    "World": "pyinfra.dataset.simulation",
    "__version__": "pyinfra.core.version",
    "benchmark": "pyinfra.api",
    "compare": "pyinfra.metrics.compare",
    "count": "pyinfra.tracking.counts",
    "detect": "pyinfra.models.inference.boxes_table",
    "draw_site": "pyinfra.sites",
    "evaluate": "pyinfra.metrics.evaluate",
    "evaluate_tracks": "pyinfra.tracking.evaluation",
    "export": "pyinfra.conversion",
    "export_tracks": "pyinfra.conversion",
    "export_onnx": "pyinfra.api",
    "import_map": "pyinfra.conversion",
    "import_mesh": "pyinfra.sites",
    "import_recording": "pyinfra.conversion",
    "import_trajectories": "pyinfra.sites",
    "list_detectors": "pyinfra.models.inference.boxes_table",
    "list_lidars": "pyinfra.dataset.lists",
    "list_presets": "pyinfra.dataset.lists",
    "list_scenes": "pyinfra.dataset.lists",
    "load_dataset": "pyinfra.dataset.loading",
    "load_detector": "pyinfra.models.inference.boxes_table",
    "load_lidar": "pyinfra.dataset.loading",
    "load_scene": "pyinfra.dataset.loading",
    "make_sites": "pyinfra.sites",
    "pictures": "pyinfra.pages",
    "plan": "pyinfra.experiments.planner.plan",
    "plot_ap_by_distance": "pyinfra.viz.plots",
    "plot_frame": "pyinfra.viz.frame_plot",
    "plot_scene": "pyinfra.viz.plots",
    "plot_stress": "pyinfra.viz.plots",
    "propose_region": "pyinfra.folders",
    "recommend": "pyinfra.experiments.option_table",
    "register_detector": "pyinfra.models.inference.boxes_table",
    "report": "pyinfra.pages",
    "simulate": "pyinfra.dataset.simulated",
    "simulate_traffic": "pyinfra.sites",
    "split": "pyinfra.folders",
    "statistics": "pyinfra.folders",
    "stress": "pyinfra.experiments.stress.runner",
    "track": "pyinfra.tracking.tracks",
    "train": "pyinfra.api",
    "trust": "pyinfra.folders",
    "validate": "pyinfra.folders",
    "view": "pyinfra.pages",
}

__all__ = [
    "Detections",
    "Error",
    "Evaluation",
    "FindingWarning",
    "FrameSequence",
    "Interval",
    "Lidar",
    "LidarFrame",
    "Plan",
    "PoseGrid",
    "Settings",
    "TrackSettings",
    "TrainedDetector",
    "World",
    "__version__",
    "benchmark",
    "compare",
    "count",
    "detect",
    "draw_site",
    "evaluate",
    "evaluate_tracks",
    "export",
    "export_onnx",
    "export_tracks",
    "import_map",
    "import_mesh",
    "import_recording",
    "import_trajectories",
    "list_detectors",
    "list_lidars",
    "list_presets",
    "list_scenes",
    "load_dataset",
    "load_detector",
    "load_lidar",
    "load_scene",
    "make_sites",
    "pictures",
    "plan",
    "plot_ap_by_distance",
    "plot_frame",
    "plot_scene",
    "plot_stress",
    "propose_region",
    "recommend",
    "register_detector",
    "report",
    "simulate",
    "simulate_traffic",
    "split",
    "statistics",
    "stress",
    "track",
    "train",
    "trust",
    "validate",
    "view",
]


def _check_no_namesake() -> None:
    """Raises ImportError if PyPI's package `pyinfra` is in this folder; warns if it is in another.

    That package, a tool for servers, has the same import name. Its folder `operations` shows it.
    """
    here = Path(__file__).parent
    folders = [here, *(Path(folder, "pyinfra") for folder in sys.path)]
    other = next((f for f in folders if (f / "operations/__init__.py").is_file()), None)
    if not other:
        return
    text = (
        f"the package 'pyinfra' of PyPI (a tool for servers) is in {other} and has the import name "
        "of this package; use an environment of its own for infrasim, or run: pip uninstall "
        "pyinfra infrasim, then: pip install infrasim"
    )
    if other == here:
        raise ImportError(text)
    import warnings

    warnings.warn(text, stacklevel=3)


_check_no_namesake()


def __getattr__(name: str) -> object:
    if name in _MODULES:
        value = getattr(importlib.import_module(_MODULES[name]), name)
        globals()[name] = value
        return value
    raise AttributeError(f"module 'pyinfra' has no attribute '{name}'")


def __dir__() -> list[str]:
    return sorted(__all__)
