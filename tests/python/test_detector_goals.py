"""Figures of detectors on the frozen sites: pairs and queues."""

from functools import partial
from typing import Any, cast

import numpy as np
import pytest

pytest.importorskip("torch", reason="the extra `train` is not installed")

from pyinfra.dataset.regions import Region
from pyinfra.models.detectors import Detections
from pyinfra.models.detectors.network import Network
from reproduction import frozen_sites, site_boxes
from reproduction.commands import detector_goals as goals

NEAR = Region(lambda boxes, margin_m: np.hypot(*boxes[:, :2].T) < 20 + margin_m, np.zeros((4, 2)))
CARS = np.array(
    [[10.0, 0, 0.8, 4, 2, 1.6, 0], [0, 10, 0.8, 4, 2, 1.6, 0], [50, 0, 0.8, 4, 2, 1.6, 0]]
)


def sample(points: np.ndarray[Any, Any] | None = None) -> frozen_sites.TestSample:
    cloud = np.zeros((5, 6), np.float32) if points is None else points
    queues = np.array([True, False, True])
    return frozen_sites.TestSample(cloud, CARS, np.zeros(3, np.int64), region=NEAR, queues=queues)


def vehicles(boxes: np.ndarray[Any, Any], scores: list[float]) -> Detections:
    return Detections(boxes, np.array(scores), np.array(["vehicle"] * len(boxes)))


def test_kinds_count_boxes_in_the_region_anywhere_and_in_queues() -> None:
    far = np.add(CARS[2], [0, 30, 0, 0, 0, 0, 0])
    found = vehicles(np.stack([CARS[0], CARS[2], far]), [0.9, 0.8, 0.7])
    scores, right, objects = goals.in_frame(sample(), found, goals.VEHICLES)
    assert (scores.tolist(), right.tolist(), objects) == ([0.9], [True], 2)
    scores, right, objects = goals.in_frame(sample(), found, goals.ANYWHERE)
    assert (right.tolist(), objects) == ([True, True, False], 3)
    _, right, objects = goals.in_frame(sample(), found, goals.QUEUES)
    assert (right.tolist(), objects) == ([True], 1)  # the other one in a queue is off the region
    weak = vehicles(CARS[:1], [0.4])
    assert not goals.in_frame(sample(), weak, goals.QUEUES)[1].any()


def test_figures_of_replicates_are_those_of_their_sites() -> None:
    matches = site_boxes.Boxes(
        slot=np.array([0, 0, 1, 1]),
        scores=np.array([0.9, 0.6, 0.8, 0.3]),
        right=np.array([True, False, True, True]),
        objects=np.array([1, 4]),
        frames=np.array([2, 2]),
    )
    weights = np.array([[1, 1], [2, 0], [0, 2]])
    figures = goals.figures(matches, "vehicle", weights)
    np.testing.assert_allclose(figures["false_per_frame"], [1 / 4, 1 / 2, 0])
    np.testing.assert_allclose(figures["recall_at_half"], [3 / 5, 1, 2 / 4])
    assert figures["ap_r1000"][1] == 100
    queues = goals.figures(matches, goals.QUEUES, weights)["recall"]
    np.testing.assert_allclose(queues, [3 / 5, 1, 2 / 4])


class Perfect:
    """Finds all vehicles of a sample, and further boxes where there is nothing."""

    def __init__(self, wrong: int) -> None:
        off = [[0, 5 + 5 * i, 0, 0, 0, 0, 0] for i in range(wrong)]
        self.boxes = np.concatenate([CARS, *(np.add(CARS[:1], one) for one in off)])

    def know(self, _: Region) -> None:
        pass

    def predict(self, _: np.ndarray[Any, Any]) -> Detections:
        return vehicles(self.boxes, [0.9] * len(self.boxes))


def test_the_rows_of_two_models_are_paired(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = list[int]()

    def tested_at(*args: Any) -> Any:
        asked.append(args[-1])
        return [("ruby_plus", [sample(), sample()])]

    monkeypatch.setattr(frozen_sites, "tested_at", tested_at)
    networks = {digest: cast(Network, Perfect(wrong)) for digest, wrong in (("a", 0), ("b", 1))}
    pooled = site_boxes.gathered("plain", 2, 2, partial(goals.measured, networks))
    assert asked == [2, 2]
    rows = list(goals.rows("plain", pooled, {"a": "one", "b": "two"}))
    false = [
        (row["model"], row["difference"])
        for row in rows
        if row["kind"] == "vehicle" and row["figure"] == "false_per_frame"
    ]
    assert false == [("one", 0), ("two", 1)]


def test_a_vehicle_in_a_queue_stands_for_30_s_and_drives_at_another_time(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    at = {  # x of objects 1: parked, 2: in a queue, 3: drives
        frame: {1: 5.0, 2: min(frame, 100) * 0.5, 3: frame * 0.5} for frame in range(600)
    }

    def positions(_: object, frame: int, __: float) -> dict[int, np.ndarray[Any, Any]]:
        return {i: np.array([x, 0.0]) for i, x in at[frame].items()}

    monkeypatch.setattr(frozen_sites, "positions", positions)
    world = cast(Any, None)
    ids = np.array([1, 2, 3])
    assert frozen_sites.stands(world, 420, 0.1, 600, ids).tolist() == [False, True, False]
    assert frozen_sites.stands(world, 380, 0.1, 600, ids).tolist() == [False, False, False]
    assert not frozen_sites.stands(world, 200, 0.1, 600, ids).any()


@pytest.mark.nightly
def test_sites_of_the_calibration_are_no_test_sites_and_no_training_sites() -> None:
    ((keys, visits),) = frozen_sites.calibration_visits(1)
    tested = {site["name"] for name in frozen_sites.SETS
              for site, _ in frozen_sites.read_visits(name)}  # fmt: skip
    assert keys["name"] not in tested
    assert not {visit.lidar for visit in visits} & set(frozen_sites.HELD_OUT)
    assert frozen_sites.CALIBRATION_SITE > 1_000_119
