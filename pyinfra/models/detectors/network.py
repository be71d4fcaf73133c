"""What the learnt detectors have in common: losses from a batch, boxes from a cloud."""

from __future__ import annotations

import abc
import ctypes
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import cache

import numpy as np
import torch
from torch import Tensor, nn

from pyinfra.core.arrays import Points
from pyinfra.core.errors import Error
from pyinfra.core.vocabulary import VEHICLES, ObjectClass
from pyinfra.dataset.regions import Region
from pyinfra.models.detectors import Detections
from pyinfra.models.detectors.batch import Batch, Sample, make_batch
from pyinfra.models.detectors.calibration import calibrated
from pyinfra.models.detectors.classes import TYPES
from pyinfra.models.detectors.detection_area import Site
from pyinfra.models.ops.boxes import nms

MIN_SCORE = 0.1  # of boxes that are given, before calibration, which changes no box
NMS_IOU = 0.1  # of footprints: vehicles never overlap
CANDIDATES = 4096  # best ones at most that enter the suppression
MOST_BOXES = 200  # of a frame and class

Losses = dict[str, Tensor]  # of one element; their sum is minimised


@contextmanager
def one_thread() -> Iterator[None]:
    """Small operations get slower with a second thread, and sums depend on the number of them."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def device_of(name: str) -> torch.device:
    """Raises Error if there is no such device here."""
    kind, _, number = name.partition(":")
    gpus = torch.cuda.device_count()
    if kind == "cuda" and gpus > 0 and (not number or (number.isdigit() and int(number) < gpus)):
        return torch.device(name)
    if name != "cpu":
        allowed = f"cpu, cuda, cuda:0 to cuda:{gpus - 1}" if gpus else "cpu: there is no GPU here"
        raise Error(f"device: found '{name}', allowed {allowed}")
    return torch.device(name)


MMAP_THRESHOLD, TRIM_THRESHOLD = -3, -1  # of mallopt, <malloc.h> of glibc


@cache
def keep_memory() -> None:
    """Lets the C library keep what tensors give back, where it is glibc.

    Else it returns each large tensor to the system and gets it anew, page by page: a quarter of
    the time of a frame. Sums stay the same.
    """
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (OSError, TypeError, AttributeError):  # another system, another library
        return
    for what, size in ((MMAP_THRESHOLD, 1 << 30), (TRIM_THRESHOLD, (1 << 31) - 1)):
        mallopt(what, size)


class Network(nn.Module, abc.ABC):
    """A detector whose weights are learnt. Subclasses say what is lost and what is found."""

    learns_in_windows = False  # of a wide site (windows.py)
    balances_frames = False  # whether its losses know `Batch.balance`
    columns = 4  # of a cloud that it looks at: x y z intensity, and with 5 the age
    classes: tuple[ObjectClass, ...] = VEHICLES  # that it tells apart

    def __init__(self, site: Site) -> None:
        super().__init__()
        self.site = site
        self.calibration: tuple[float, ...] | None = None  # of scores: a line a class (calibrated)
        self.min_score = MIN_SCORE

    @abc.abstractmethod
    def losses(self, batch: Batch) -> Losses:
        """The parts of the loss, by name."""

    @abc.abstractmethod
    def candidates(self, batch: Batch) -> Sequence[tuple[Tensor, ...]]:
        """Of each frame: boxes (k, 7) and scores (k,), before suppression.

        Of more than one class also their numbers (k,).
        """

    def know(self, region: Region) -> None:
        """Takes what helps it of a region whose frames it will see; most need nothing."""

    @torch.inference_mode()
    @one_thread()
    def find(self, clouds: Sequence[Points]) -> list[Detections]:
        """The vehicles of some frames, or whatever its classes are. It must be in eval mode."""
        keep_memory()
        samples = [Sample(cloud, np.empty((0, 7))) for cloud in clouds]
        batch = make_batch(samples, self.site.area, self.columns)
        if len(batch.points) == 0:
            return [empty() for _ in clouds]
        device = next(self.parameters()).device
        return [self.best(*candidates) for candidates in self.candidates(batch.to(device))]

    def best(self, boxes: Tensor, scores: Tensor, numbers: Tensor | None = None) -> Detections:
        """Of candidates; those of a class suppress each other alone."""
        parts = []
        for i, name in enumerate(self.classes):
            mask = slice(None) if numbers is None else numbers == i
            detections = suppressed(boxes[mask], scores[mask], TYPES[name], self.min_score)
            if self.calibration is not None:
                line = self.calibration[2 * i], self.calibration[2 * i + 1]
                detections = replace(detections, scores=calibrated(detections.scores, line))
            parts.append(detections)
        return parts[0] if len(parts) == 1 else best_first(parts)

    def predict(self, points: Points) -> Detections:
        """See pyinfra.models.detectors.Detector."""
        return self.find([points])[0]


def best_first(parts: Sequence[Detections]) -> Detections:
    """Several detections as one; of equal scores those of the first part come first."""
    order = np.argsort(np.concatenate([-part.scores for part in parts]), kind="stable")
    return Detections(
        boxes=np.concatenate([part.boxes for part in parts])[order],
        scores=np.concatenate([part.scores for part in parts])[order],
        names=np.concatenate([part.names for part in parts])[order],
    )


def suppressed(
    boxes: Tensor, scores: Tensor, name: str = TYPES["vehicle"], min_score: float = MIN_SCORE
) -> Detections:
    """The best boxes (n, 7) with at least the least score, overlapping by NMS_IOU at most."""
    good = torch.isfinite(boxes).all(dim=1) & (scores >= min_score)
    boxes, scores = boxes[good], scores[good]
    best = scores.topk(min(CANDIDATES, len(scores))).indices
    kept = best[nms(boxes[best], scores[best], NMS_IOU, MOST_BOXES)]
    return Detections(
        boxes=boxes[kept].double().cpu().numpy(),
        scores=scores[kept].double().cpu().numpy(),
        names=np.full(len(kept), name),
    )


def empty() -> Detections:
    return Detections(np.empty((0, 7)), np.empty(0), np.empty(0, dtype=np.str_))
