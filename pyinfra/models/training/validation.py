"""Which state of a network is the best: AP on frames that are not learnt from.

The frames are the last ones of each LiDAR's training time (`validate_frames` of a recipe), never
test frames. Its first seconds show vehicles that the last frames learnt from show as well, so the
AP chooses among states of one run and says nothing else.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from pyinfra.core.arrays import FloatArray, IntArray
from pyinfra.core.files import replacing
from pyinfra.metrics import ap, matching
from pyinfra.models.detectors.classes import METRICS, TYPES
from pyinfra.models.detectors.network import Network
from pyinfra.models.training.samples import Frames

CHECKS = 5  # over a run; with 40 frames, 4 % of the time of a quick PointPillars


def is_due(done: int, steps: int) -> bool:
    """At each fifth of the steps, the last one with them."""
    return done * CHECKS // steps > (done - 1) * CHECKS // steps


def average_precision(network: Network, frames: Frames) -> float:
    """AP (R1000) of all vehicles with a point, 0 to 100; leaves the network as it is.

    Of several classes the mean over those that are there.
    """
    training = network.training
    network.eval()
    per_frame = [network.predict(cloud()) for cloud in frames.clouds]
    network.train(training)
    values = []
    for number, name in enumerate(network.classes):
        masks = [detections.names == TYPES[name] for detections in per_frame]
        boxes = [d.boxes[of] for d, of in zip(per_frame, masks, strict=True)]
        scores = np.concatenate([d.scores[of] for d, of in zip(per_frame, masks, strict=True)])
        truth = [b[frames.numbers(i) == number] for i, b in enumerate(frames.boxes)]
        if not any(map(len, truth)):
            continue
        columns = _frame_of(boxes), np.concatenate(boxes), scores
        there = _frame_of(truth), np.concatenate(truth)
        hit = matching.hits(*columns, *there, METRICS[name])
        ranking = ap.rank(scores, hit, len(there[1]))
        values.append(ap.average_precision(ranking, ap.FINE_RECALLS)[0])
    return float(np.mean(values))


def _frame_of(parts: Sequence[FloatArray]) -> IntArray:
    return np.repeat(np.arange(len(parts)), [len(part) for part in parts])


class Checks:
    """Looks at held-out frames now and then.

    `validation.csv` has the step and AP of each check; those after a checkpoint are forgotten.
    """

    def __init__(self, frames: Frames, file: Path, done: int) -> None:
        self.frames, self.file = frames, file
        rows = file.read_text().split() if file.exists() else []
        cells = [row.split(",") for row in rows[1:]]
        self.history = [(int(step), float(value)) for step, value in cells if int(step) <= done]

    def find_best(self, network: Network, done: int, steps: int) -> bool:
        """Whether a check is due, and nothing before was better."""
        if not is_due(done, steps):
            return False
        value = average_precision(network, self.frames)
        best = all(value >= before for _, before in self.history)
        self.history.append((done, value))
        with replacing(self.file) as beside:
            rows = "".join(f"{step},{value!r}\n" for step, value in self.history)
            beside.write_text(f"step,ap\n{rows}")
        return best
