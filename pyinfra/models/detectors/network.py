"""Base class of the networks: losses of a batch, and boxes of a cloud."""

import abc
import ctypes
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import cache

import numpy as np
import torch
from torch import Tensor, nn

from pyinfra.core.arrays import Points
from pyinfra.core.errors import Error
from pyinfra.core.vocabulary import VEHICLES, ObjectClass
from pyinfra.dataset.regions import Region
from pyinfra.models.detectors import Detections
from pyinfra.models.detectors.batch import Batch, make_batch
from pyinfra.models.detectors.classes import TYPES
from pyinfra.models.detectors.detection_area import Site
from pyinfra.models.detectors.sample import Sample
from pyinfra.models.detectors.suppression import (
    CANDIDATES,
    MIN_SCORE,
    MOST_BOXES,
    NMS_IOU,
    empty,
    of_classes,
)
from pyinfra.models.ops.boxes import nms

Losses = dict[str, Tensor]  # terms of the loss by name; their sum is minimised


@contextmanager
def one_thread() -> Iterator[None]:
    """Context manager in which PyTorch uses one thread.

    Small operations are slower with more threads, and sums depend on the number of threads.
    """
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def device_of(name: str) -> torch.device:
    """Returns a device by its name. Raises Error if it does not exist."""
    kind, _, number = name.partition(":")
    gpus = torch.cuda.device_count()
    if kind == "cuda" and gpus > 0 and (not number or (number.isdigit() and int(number) < gpus)):
        return torch.device(name)
    if name != "cpu":
        allowed = (
            f"cpu, cuda, cuda:0 to cuda:{gpus - 1}"
            if gpus
            else "cpu, because this machine has no GPU"
        )
        raise Error(f"device: expected {allowed}, got '{name}'")
    return torch.device(name)


MMAP_THRESHOLD, TRIM_THRESHOLD = -3, -1  # parameters of mallopt, from <malloc.h> of glibc


@cache
def keep_memory() -> None:
    """Makes glibc keep the memory of freed tensors.

    By default glibc returns the memory of each large tensor to the system and later requests it
    page by page again. These requests take a quarter of the time of a frame. Results do not change.
    """
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (OSError, TypeError, AttributeError):  # another operating system or C library
        return
    for what, size in ((MMAP_THRESHOLD, 1 << 30), (TRIM_THRESHOLD, (1 << 31) - 1)):
        mallopt(what, size)


class Network(nn.Module, abc.ABC):
    """A detector whose weights are learnt. Subclasses define the losses and the candidates."""

    learns_in_windows = False  # whether the network can be trained on windows (windows.py)
    balances_frames = False  # whether the losses use `Batch.balance`
    columns = 4  # columns of a cloud that the network uses: x y z intensity [age]
    classes: tuple[ObjectClass, ...] = VEHICLES  # classes that the network distinguishes

    def __init__(self, site: Site) -> None:
        super().__init__()
        self.site = site
        self.calibration: tuple[float, ...] | None = None  # a, b of `calibrated` for each class
        self.min_score = MIN_SCORE

    @abc.abstractmethod
    def losses(self, batch: Batch) -> Losses:
        """Returns the terms of the loss, by name."""

    @abc.abstractmethod
    def candidates(self, batch: Batch) -> Sequence[tuple[Tensor, ...]]:
        """Returns boxes (k, 7) and scores (k,) of each frame, before suppression.

        If there is more than one class, the third element of a tuple has the class numbers (k,).
        """

    def know(self, region: Region) -> None:
        """Prepares the network for frames of a region. The base class does nothing."""

    @torch.inference_mode()
    @one_thread()
    def find(self, clouds: Sequence[Points]) -> list[Detections]:
        """Returns the detections in each cloud (n, 4 or 5). The network must be in eval mode."""
        keep_memory()
        samples = [Sample(cloud, np.empty((0, 7))) for cloud in clouds]
        batch = make_batch(samples, self.site.area, self.columns)
        if len(batch.points) == 0:
            return [empty() for _ in clouds]
        device = next(self.parameters()).device
        # On a GPU, the suppression would take longer, because the CPU would wait several times.
        return [
            self.best(*(part.cpu() for part in candidates))
            for candidates in self.candidates(batch.to(device))
        ]

    def best(self, boxes: Tensor, scores: Tensor, numbers: Tensor | None = None) -> Detections:
        """Returns the detections of candidates; each class is suppressed separately."""
        parts = []
        for i, name in enumerate(self.classes):
            mask = slice(None) if numbers is None else numbers == i
            parts.append(suppressed(boxes[mask], scores[mask], TYPES[name], self.min_score))
        return of_classes(parts, self.calibration)

    def predict(self, points: Points) -> Detections:
        """Returns the boxes in a cloud, as `Detector.predict` does."""
        return self.find([points])[0]


def suppressed(
    boxes: Tensor, scores: Tensor, name: str = TYPES["vehicle"], min_score: float = MIN_SCORE
) -> Detections:
    """Returns the boxes (n, 7) that remain after non-maximum suppression with NMS_IOU.

    Boxes with a score below `min_score` are left out.
    """
    good = torch.isfinite(boxes).all(dim=1) & (scores >= min_score)
    boxes, scores = boxes[good], scores[good]
    best = scores.topk(min(CANDIDATES, len(scores))).indices
    remaining = best[nms(boxes[best], scores[best], NMS_IOU, MOST_BOXES)]
    return Detections(
        boxes=boxes[remaining].double().cpu().numpy(),
        scores=scores[remaining].double().cpu().numpy(),
        names=np.full(len(remaining), name),
    )
