"""Scripts of a researcher that use the API, as in a notebook."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest
import seaborn as sns
from scipy.spatial import cKDTree

import pyinfra as pi

QUICK = {"duration_s": 30, "traffic.warm_up_s": 20}


@pytest.fixture(autouse=True)
def _close() -> Iterator[None]:
    yield
    plt.close("all")


def test_simulate_detect_evaluate_plot() -> None:
    """The script of the documentation has 10 lines."""
    pytest.importorskip("torch", reason="the extra `train` is not installed")
    scene = pi.load_scene("highway", seed=1, set=QUICK)
    lidar = pi.load_lidar("ruby_plus", preset="datasheet")
    frames = pi.simulate(scene, lidar, range(0, 300, 30))
    model = pi.load_detector("generalist")
    detections = pi.detect(model, frames)
    result = pi.evaluate(frames, detections)
    lines = sns.lineplot(result.by_distance, x="distance_m", y="ap_r1000")
    ax = pi.plot_frame(frames[3], detections)

    assert result.by_distance.ap_r1000.max() > 60
    assert len(lines.lines) >= 1
    assert len(ax.collections) == 3


def dbscan(xy: np.ndarray, radius_m: float = 0.8, least: int = 5) -> np.ndarray:
    """Returns the cluster of each point (Ester et al. 1996): (n,), -1 for noise."""
    near = cKDTree(xy).query_ball_point(xy, radius_m)
    core = np.array([len(neighbours) >= least for neighbours in near])
    labels, count = np.full(len(xy), -1), 0
    for start in np.flatnonzero(core):
        if labels[start] >= 0:
            continue
        queue = [start]
        while queue:
            point = queue.pop()
            if labels[point] < 0:
                labels[point] = count
                queue += [k for k in near[point] if labels[k] < 0] if core[point] else []
        count += 1
    return labels


def clusters_as_boxes(points: np.ndarray) -> pd.DataFrame:
    """A detector in one function. It groups the points above the road with DBSCAN, and puts a box
    of a car on each group."""
    road = np.median(points[np.abs(points[:, 1]) < 20, 2])
    raised = points[(np.abs(points[:, 1]) < 20) & (points[:, 2] > road + 0.4)].astype(float)
    raised = raised[np.hypot(raised[:, 0], raised[:, 1]) < 60]
    labels = dbscan(raised[:, :2]) if len(raised) else np.empty(0, int)
    rows = []
    for k in range(labels.max(initial=-1) + 1):
        part = raised[labels == k]
        size = np.maximum(np.ptp(part[:, :3], axis=0), (4.4, 1.8, 1.5))
        middle = (part[:, :3].min(axis=0) + part[:, :3].max(axis=0)) / 2
        rows.append([*middle[:2], road + size[2] / 2, *size, 0.0, 1 - math.exp(-len(part) / 50)])
    return pd.DataFrame(rows, columns=["x", "y", "z", "dx", "dy", "dz", "heading", "score"])


@pytest.mark.nightly
def test_an_own_detector_is_compared_with_the_pretrained_one() -> None:
    """The difference between DBSCAN and the pretrained detector is paired and has an interval."""
    pytest.importorskip("torch", reason="the extra `train` is not installed")
    frames = pi.simulate("highway", "ruby_plus", range(0, 5000, 100))
    ours = pi.evaluate(frames, pi.detect(clusters_as_boxes, frames))
    theirs = pi.evaluate(frames, pi.detect("generalist", frames))
    difference = pi.compare(theirs, ours)
    ax = pi.plot_ap_by_distance({"DBSCAN": ours, "generalist": theirs})

    assert len(ours.matches.query("outcome == 'true positive'")) > 50
    assert difference.value > 10
    assert difference.low <= difference.value <= difference.high
    assert len(ax.lines) == 2


def test_simulated_frames_go_to_openpcdet(tmp_path: Path) -> None:
    frames = pi.simulate(pi.load_scene("crossroad", set=QUICK), "helios_16", range(0, 200, 20))
    out = pi.export(frames, "openpcdet", tmp_path / "openpcdet")

    numbers = [k for part in ("train", "val") for k in _list(out / f"ImageSets/{part}.txt")]
    assert numbers == list(frames.numbers)
    for frame in frames:
        points = np.load(out / f"points/{frame.number:06d}.npy")
        np.testing.assert_array_equal(points[:, :2], frame.points[:, :2])
        lines = (out / f"labels/{frame.number:06d}.txt").read_text().splitlines()
        assert len(lines) == len(frame.labels)


def _list(file: Path) -> list[int]:
    return [int(line) for line in file.read_text().split()]
