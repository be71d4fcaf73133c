"""The settings of an evaluation."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, get_args

from pyinfra.core.errors import Error
from pyinfra.core.names import suggestion
from pyinfra.core.vocabulary import OBJECT_CLASSES, SUBSETS, Subset
from pyinfra.metrics.matching import IOU, Metric

Protocol = Literal["definition", "r11", "kitti"]
PROTOCOLS: tuple[Protocol, ...] = get_args(Protocol)


@dataclass(frozen=True)
class Settings:
    """Settings of an evaluation. The first element of each list defines the primary result.

    Attributes
    ----------
    classes : names of classes, and the KITTI types that they include
    ground_truths : names of ground-truth subsets: `captured`, `all`, `common` or `present`
    ious : IoU thresholds, 0.1 to below 1
    protocols : `definition` is AP at 40 and at 1,000 recalls. `r11` is AP at 11 recalls. `kitti` is
        AP at 40 recalls, with the sampling and the strict threshold of KITTI's devkit
    metrics : `bev`, `3d` or `centre`
    min_score : least score of a prediction that counts
    min_points : least number of points on a captured vehicle
    min_objects : least number of objects in an area whose quality is determined
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
        for name in ("classes", "ground_truths", "ious", "protocols", "metrics"):
            if not getattr(self, name):
                raise Error(f"{name}: expected one or more entries, got none")
        for which in self.ground_truths:
            if which not in SUBSETS:
                near = suggestion(which, SUBSETS)
                raise Error(f"ground_truths: expected names of subsets, got '{which}'{near}")
        for iou in self.ious:
            if not 0.1 <= iou < 1:
                raise Error(f"iou: expected 0.1 to below 1, got {iou:g}")
        if self.block_s is not None and not 0 < self.block_s <= 1e6:
            raise Error(f"block_s: expected above 0 to 1e6, got {self.block_s:g}")
        if not 0 <= self.min_score <= 1:
            raise Error(f"min_score: expected 0 to 1, got {self.min_score:g}")
        for name, least in (("min_points", 1), ("min_objects", 1), ("replicates", 1), ("seed", 0)):
            if (value := getattr(self, name)) < least:
                raise Error(f"{name}: expected {least} or more, got {value}")

    def ious_of(self, metric: Metric) -> tuple[float, ...]:
        """Returns the IoU thresholds of a metric. For metric `centre` this is a single NaN."""
        return (math.nan,) if metric == "centre" else self.ious

    @property
    def types(self) -> list[str]:
        """The distinct names of vehicles and predictions that are evaluated."""
        names = (t for name, types in self.classes.items() for t in (*types, name))
        return list(dict.fromkeys(names))
