"""Answers that were wrong without a message: ids of recordings, intervals, caches, findings."""

from __future__ import annotations

import shutil
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from exchange_data import write_recording

import pyinfra as pi
from pyinfra.dataset.data_set import read_data_set
from pyinfra.dataset.frame_sequence import BOX
from pyinfra.exchange.series import read_frames, read_series
from pyinfra.formats import kitti
from pyinfra.metrics.ground_truth import read_ground_truth
from pyinfra.metrics.intervals import UNKNOWN_BLOCK_S
from pyinfra.metrics.match_input import block_seconds
from pyinfra.metrics.observations import accumulated, read_observations

KNOWN = ("pcd", "nuscenes")  # formats in which objects keep their track


def recording(folder: Path, layout: str, *, fields: bool = True) -> pi.FrameSequence:
    """Writes the artificial recording in a layout and imports it."""
    pole = write_recording(folder / "made_up", fields=fields)
    source = folder / "source"
    if layout == "kitti":
        shutil.copytree(pole, source, ignore=shutil.ignore_patterns("objects", "fields"))
    else:
        pi.export(pole, layout, source)
    return pi.import_recording(source, layout, folder / "in/pole")


# --- ids of tracks -------------------------------------------------------------------------------


@pytest.mark.parametrize("layout", ["kitti", "openpcdet", "pcd", "nuscenes"])
def test_ids_are_known_everywhere_or_nowhere(layout: str, tmp_path: Path) -> None:
    frames = recording(tmp_path, layout, fields=layout == "pcd")
    folder = tmp_path / "in/pole"
    data = read_data_set(folder.parent)
    stay = block_seconds(read_ground_truth(folder))
    vehicles = read_observations(data)
    assert len(vehicles) == 3
    if layout in KNOWN:
        assert stay == 20
        first, last = (set(frames[i].labels.id) for i in (0, 2))
        assert last < first
        assert min(first) >= 0
        assert len(accumulated(vehicles, data.frames, 2)) == 1
    else:
        assert stay == UNKNOWN_BLOCK_S
        assert set(frames.labels.id) == {-1}
        assert set(vehicles.ids) == {-1}
        with pytest.raises(pi.Error, match="accumulate: expected vehicles with track ids"):
            accumulated(vehicles, data.frames, 2)
        ids = [i for f in read_frames(read_series(folder), frames.numbers) for i in f.objects.ids]
        assert ids == [0, 1, 2]  # exports give every box an id of its own


def test_points_and_labels_have_the_same_ids(tmp_path: Path) -> None:
    frames = recording(tmp_path, "pcd")
    assert [frame.labels.id.tolist() for frame in frames] == [[3, 8], [], [3]]
    for frame in frames:
        assert frame.fields is not None
        assert set(frame.labels.id) <= set(frame.fields["object_id"].tolist())


def test_row_numbers_of_earlier_imports_are_no_ids(tmp_path: Path) -> None:
    pole = write_recording(tmp_path / "made_up")
    assert max(pi.load_dataset(pole).labels.id) == 8
    with (pole.parent / "dataset.yaml").open("a") as stream:
        stream.write("ids: rows\n")
    assert set(pi.load_dataset(pole).labels.id) == {-1}


def test_a_recording_without_tracks_has_an_interval(tmp_path: Path) -> None:
    """Before, the first row of all frames was one vehicle, which stayed for the whole recording."""
    source = tmp_path / "source"
    labels = kitti.Labels(np.array(["Car"]), np.array([[20.0, 3, -5, 4, 2, 1.5, 0]]), None)
    cloud = np.array([[20, 3, -5, 0.5]], np.float32)
    for k in range(100):
        kitti.write_frame(source, k, cloud + np.float32(k * 1e-3), labels)
    frames = pi.import_recording(source, "kitti", tmp_path / "in/pole", period_s=1.0)
    found = frames.labels[["frame", "type", *BOX]].assign(score=0.5)[:60]
    row = pi.evaluate(frames, found).ap.iloc[0]
    assert row.ap_r1000_low < row.ap_r1000 < row.ap_r1000_high
