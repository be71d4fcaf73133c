"""Display names and order of LiDARs and detectors on the page."""

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from pyinfra.core.vocabulary import PRESETS
from pyinfra.dataset.catalogue import LIDARS, SCENES, configs
from pyinfra.experiments.result_tables import DETECTOR_WORDS
from pyinfra.formats.kitti import read_keys
from pyinfra.viz.report.style import Look, look

KINDS = {
    "livox_avia": "non-repetitive",
    "helios_16": "16 lines",
    "pandar_64": "64 lines",
    "ruby_plus": "128 lines",
}
DETECTORS = {
    "pointpillars": "PointPillars",
    "pv-rcnn": "PV-RCNN",
    "dsvt": "DSVT",
    "pointrcnn": "PointRCNN",
    "pointrcnn-remedied": "PointRCNN, remedied",
    "centerpoint-pillar": "CenterPoint-Pillar",
    "background": "Background",
    **DETECTOR_WORDS,
}
ORDER = {"scene": SCENES, "preset": PRESETS, "detector": tuple(DETECTORS)}  # by column
OF_PACKAGE = tuple(DETECTOR_WORDS)  # detectors whose name is an adjective, such as `pretrained`


@dataclass(frozen=True)
class Names:
    """All LiDARs of a report, by their names in the tables.

    Their order determines colours and markers.
    """

    lidars: tuple[str, ...]
    models: dict[str, str]

    def model(self, lidar: str) -> str:
        """Returns a LiDAR's model, or its name if the model is unknown."""
        return self.models.get(lidar, lidar)

    def label(self, lidar: str) -> str:
        """Returns a LiDAR's model and kind, for legends."""
        kind = KINDS.get(lidar)
        return f"{self.model(lidar)}, {kind}" if kind else self.model(lidar)

    def spelled(self, text: str) -> str:
        """Replaces the names of LiDARs in a text by their models."""
        for name, model in self.models.items():
            text = re.sub(rf"\b{re.escape(name)}\b", model, text)
        return text

    def look(self, lidar: str) -> Look:
        return look(self.lidars.index(lidar))

    def sorted(self, lidars: Iterable[str]) -> list[str]:
        """Returns the distinct names in the report's order."""
        wanted = set(lidars)
        return [name for name in self.lidars if name in wanted]


def read_names(lidars: Iterable[str], models: Mapping[str, str]) -> Names:
    """Returns the names of LiDARs, those of this package (LIDARS) first.

    Therefore the LiDARs of this package have the same colours in every report. models: models by
    name, if known. Other models are read from this package's LiDAR files.
    """
    order = tuple(dict.fromkeys([*LIDARS, *sorted(set(lidars))]))
    plain = [name for name in order if re.fullmatch(r"[\w-]+", name)]
    shipped = {name: _model(configs() / "lidars" / f"{name}.yaml") for name in plain}
    return Names(order, {name: model for name, model in (shipped | dict(models)).items() if model})


def detector(name: str) -> str:
    """Returns the display name of a detector."""
    return DETECTORS.get(name, name)


def with_detector(name: str) -> str:
    """Returns "with" and the detector, for sentences."""
    return (
        f"with the {DETECTORS[name]} detector" if name in OF_PACKAGE else f"with {detector(name)}"
    )


def capitalized(name: str) -> str:
    """Returns a name with a capital first letter; the other letters stay as they are."""
    return name[:1].upper() + name[1:]


def option_columns(names: Names) -> dict[str, Callable[[Any], str]]:
    """Returns the columns that name the options of a table: for each title a function of a row."""
    return {
        "LiDAR": lambda row: names.model(str(row.lidar)),
        "Scene": lambda row: str(row.scene),
        "Preset": lambda row: str(row.preset),
        "Detector": lambda row: detector(str(row.detector)),
    }


def in_order(names: Iterable[str], first: Iterable[str]) -> list[str]:
    """Returns the distinct names: first the names in `first`, in its order, then others sorted."""
    present = set(names)
    known = [name for name in first if name in present]
    return known + sorted(present - set(known))


def ordered(column: pd.Series) -> list[str]:
    """Returns the distinct names of a column of scenes, presets or detectors, as `in_order`."""
    return in_order(column, ORDER[str(column.name)])


def _model(file: Path) -> str:
    """Returns the model in a LiDAR's file, or an empty text if there is none."""
    if not file.is_file():
        return ""
    return str(read_keys(file).get("model", ""))
