"""Selects the best state of a network by its AP on held-out training frames.

The held-out frames are the last training frames of each LiDAR (`validate_frames` of a recipe),
never test frames. The first held-out frames show vehicles that are also in the frames used for
training. Therefore the AP on held-out frames can only be used to compare states of one training.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from pyinfra.core.arrays import FloatArray, IntArray
from pyinfra.core.files import replacing
from pyinfra.metrics import ap, matching
from pyinfra.models.detectors.classes import METRICS, TYPES
from pyinfra.models.detectors.network import Network
from pyinfra.models.training.samples import Frames

CHECKS = 5  # checks per training; with 40 frames they take 4 % of the time of a quick PointPillars


def is_due(done: int, steps: int) -> bool:
    """Returns whether a check is due: after each 1 / CHECKS of the steps, and at the end."""
    return done * CHECKS // steps > (done - 1) * CHECKS // steps


def average_precision(network: Network, frames: Frames) -> float:
    """Returns the AP (R1000) of all objects with a point, 0 to 100.

    If the network has several classes, the result is the mean over the classes that occur. The mode
    of the network (train or eval) is restored.
    """
    training = network.training
    network.eval()
    per_frame = [network.predict(cloud()) for cloud in frames.clouds]
    network.train(training)
    values = []
    for number, name in enumerate(network.classes):
        masks = [detections.names == TYPES[name] for detections in per_frame]
        boxes = [d.boxes[mask] for d, mask in zip(per_frame, masks, strict=True)]
        scores = np.concatenate([d.scores[mask] for d, mask in zip(per_frame, masks, strict=True)])
        truth = [b[frames.numbers(i) == number] for i, b in enumerate(frames.boxes)]
        if not any(map(len, truth)):
            continue
        columns = _frame_of(boxes), np.concatenate(boxes), scores
        objects = _frame_of(truth), np.concatenate(truth)
        true_positive = matching.true_positives(*columns, *objects, METRICS[name])
        ranking = ap.rank(scores, true_positive, len(objects[1]))
        values.append(ap.average_precision(ranking, ap.R1000_RECALLS)[0])
    return float(np.mean(values))


def _frame_of(parts: Sequence[FloatArray]) -> IntArray:
    return np.repeat(np.arange(len(parts)), [len(part) for part in parts])


class Checks:
    """Evaluates a network on held-out frames during training.

    `validation.csv` has the step and AP of each check. When a training resumes, rows of checks
    after its checkpoint are removed.
    """

    def __init__(self, frames: Frames, file: Path, done: int) -> None:
        self.frames, self.file = frames, file
        rows = file.read_text(encoding="utf-8").split() if file.exists() else []
        cells = [row.split(",") for row in rows[1:]]
        self.history = [(int(step), float(value)) for step, value in cells if int(step) <= done]

    def find_best(self, network: Network, done: int, steps: int) -> bool:
        """Makes a check if it is due; returns whether no earlier check has a higher AP."""
        if not is_due(done, steps):
            return False
        value = average_precision(network, self.frames)
        best = all(value >= before for _, before in self.history)
        self.history.append((done, value))
        with replacing(self.file) as beside:
            rows = "".join(f"{step},{value!r}\n" for step, value in self.history)
            beside.write_text(f"step,ap\n{rows}", encoding="utf-8")
        return best
