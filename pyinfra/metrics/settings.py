"""The settings of an evaluation."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, get_args

from pyinfra.core.arguments import check_fields
from pyinfra.core.errors import Error
from pyinfra.core.vocabulary import OBJECT_CLASSES, Subset
from pyinfra.metrics.matching import IOU, Metric

Protocol = Literal["definition", "r11", "kitti"]
PROTOCOLS: tuple[Protocol, ...] = get_args(Protocol)
_RANGES = {
    "ious": (0.1, 0.999),
    "block_s": (1e-3, 1e6),
    "min_score": (0, 1),
    "min_points": (1, math.inf),
    "min_objects": (1, math.inf),
    "replicates": (1, 100_000),
    "seed": (0, math.inf),
}


@dataclass(frozen=True)
class Settings:
    """Settings of an evaluation. The first element of each list defines the primary result.

    Attributes
    ----------
    classes : names of classes, and the KITTI types that they include
    ground_truths : names of ground-truth subsets: `captured`, `all`, `common` or `present`
    ious : IoU thresholds, 0.1 to 0.999
    protocols : `definition` is AP at 40 and at 1,000 recalls. `r11` is AP at 11 recalls. `kitti` is
        AP at 40 recalls, with the sampling and the strict threshold of KITTI's devkit
    metrics : `bev`, `3d` or `centre`
    min_score : minimum score of a prediction that is evaluated
    min_points : minimum number of points on a captured vehicle
    min_objects : minimum number of objects in an area whose quality is determined
    cut_first : whether to also compute the AP of each window after all boxes outside the window
        are removed before matching
    block_s : block length of the bootstrap in seconds; by default the mean stay of a vehicle
    replicates : number of bootstrap replicates
    seed : seed of the bootstrap
    """

    classes: Mapping[str, tuple[str, ...]] = field(
        default_factory=lambda: {"vehicle": OBJECT_CLASSES["vehicle"]}
    )
    ground_truths: tuple[Subset, ...] = ("captured", "all")
    ious: tuple[float, ...] = (IOU,)
    protocols: tuple[Protocol, ...] = ("definition",)
    metrics: tuple[Metric, ...] = ("bev",)
    min_score: float = 0.0
    min_points: int = 1
    min_objects: int = 20
    cut_first: bool = False
    block_s: float | None = None
    replicates: int = 200
    seed: int = 1

    def __post_init__(self) -> None:
        check_fields(self, _RANGES)
        for name in ("classes", "ground_truths", "ious", "protocols", "metrics"):
            if not getattr(self, name):
                raise Error(f"{name}: expected one or more entries, got none")
        given: Mapping[str, object] = self.classes
        for name, types in given.items():
            if isinstance(types, str) or not types:
                raise Error(f"classes: {name}: expected a list of types, got {types!r}")

    def ious_of(self, metric: Metric) -> tuple[float, ...]:
        """Returns the IoU thresholds of a metric. For metric `centre` this is a single NaN."""
        return (math.nan,) if metric == "centre" else self.ious

    @property
    def types(self) -> list[str]:
        """The distinct class names of the evaluated vehicles and predictions."""
        names = (t for name, types in self.classes.items() for t in (*types, name))
        return list(dict.fromkeys(names))
