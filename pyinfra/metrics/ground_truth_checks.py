"""Checks of ground truth whose files can be read: missing labels, unknown classes, region."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from pyinfra.dataset.data_set import without_region
from pyinfra.dataset.frame_readers import other_types
from pyinfra.dataset.frame_tables import Vehicles
from pyinfra.dataset.road_checks import other_roads
from pyinfra.metrics.prediction_checks import Finding


def ground_truth_findings(
    lidar_folder: Path, frames: Sequence[int], vehicles: Vehicles, types: Sequence[str]
) -> Iterator[Finding]:
    """Yields warnings about missing labels, labels that are not evaluated, and a wrong region.

    frames: frame numbers; `vehicles.frame` contains indices into `frames`. types: names of the
    types that are evaluated.
    """
    if len(vehicles) == 0:
        yield Finding(
            "warning",
            "no-labels",
            f"{lidar_folder}: no label in {len(frames)} frames, so AP is undefined; "
            "`pyinfra validate` can check predictions without labels",
        )
    if other := other_types(lidar_folder, frames, vehicles, types):
        yield Finding("warning", "other-types", other)
    if missing := without_region(lidar_folder):
        yield Finding("warning", "no-roads", missing)
    if other_region := other_roads(lidar_folder):
        yield Finding("warning", "other-roads", other_region)
