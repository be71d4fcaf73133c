"""The input of a report: results and, optionally, data sets and runs of detectors."""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from pyinfra.core.errors import Error, not_found
from pyinfra.dataset.catalogue import SCENES
from pyinfra.dataset.data_set import DataSet, read_data_set
from pyinfra.experiments.requirements import Requirements
from pyinfra.experiments.result_tables import KINDS, Kind, Results, read_results
from pyinfra.formats import kitti
from pyinfra.metrics.row_selection import preset_of_answers
from pyinfra.viz.report.names import Names, in_order, read_names

ANY_PRICE = Requirements()


@dataclass(frozen=True)
class Run:
    """Predictions of a detector, and the scene, LiDAR and preset that they belong to."""

    folder: Path
    scene: str
    lidar: str
    preset: str
    detector: str

    def prediction(self, frame: int) -> Path:
        return self.folder / "predictions" / f"{frame:06d}.txt"


@dataclass(frozen=True, eq=False)
class Material:
    """The input of all sections."""

    results: Results
    names: Names
    data: tuple[DataSet, ...]
    runs: tuple[Run, ...]
    requirements: Requirements = ANY_PRICE

    def scenes(self) -> list[str]:
        """Returns the scenes of the results and of the data sets."""
        scenes = set(self.results.table("experiments").scene) | {d.scene for d in self.data}
        return in_order(scenes, SCENES)

    def of_answers(self, rows: pd.DataFrame) -> pd.DataFrame:
        """Returns the rows of one preset per scene, which `preset_of_answers` selects.

        rows: a table with the columns scene, preset, lidar and detector.
        """
        chosen = {str(s): preset_of_answers(group) for s, group in rows.groupby("scene")}
        return rows[rows.preset == rows.scene.map(chosen)]


def read_material(
    folder: Path,
    data: Sequence[Path],
    runs: Sequence[Path],
    tier: str | None,
    requirements: Requirements = ANY_PRICE,
    more: Mapping[str, Kind] | None = None,
) -> Material:
    """Reads results, data sets and runs, but no frames; `more` declares more tables.

    Raises the exceptions of read_results, read_data_set and read_run.
    """
    results = read_results(folder, tier, more)
    sets = tuple(read_data_set(folder) for folder in data)
    tables = [results.table(name) for name in KINDS]
    named = [name for table in tables if "lidar" in table for name in table.lidar]
    simulated = {lidar.name: lidar.model for d in sets for lidar in d.lidars}
    lidars = results.table("lidars")
    models = dict(zip(lidars.lidar, lidars.model, strict=True)) if "model" in lidars else {}
    return Material(
        results=results,
        names=read_names([*named, *simulated], models | simulated),
        data=sets,
        runs=tuple(read_run(run, sets) for run in runs),
        requirements=requirements,
    )


def read_run(folder: Path, data: Iterable[DataSet]) -> Run:
    """Reads scene, LiDAR, preset and detector of a run.

    The values are read from run.yaml, else from the folder's name SCENE_LIDAR_PRESET_DETECTOR_...
    Raises FileNotFoundError if there are no predictions, and Error if neither source has the
    values.
    """
    if not (folder / "predictions").is_dir():
        raise not_found(folder, "expected a subfolder predictions, got none")
    if (folder / "run.yaml").is_file():
        top = kitti.read_yaml(folder / "run.yaml")
        fields = {key: top.at(key).text() for key in ("scene", "lidar", "preset", "detector")}
        return Run(folder, **fields)
    for data_set in data:
        for lidar in data_set.names:
            start = re.escape(f"{data_set.scene}_{lidar}_{data_set.preset}_")
            if match := re.match(rf"{start}([^_]+)", folder.name):
                return Run(folder, data_set.scene, lidar, data_set.preset, match[1])
    raise Error(
        f"{folder}: expected a run.yaml in the folder, or a folder name that begins with "
        "SCENE_LIDAR_PRESET_DETECTOR of a given data set, got neither"
    )
