"""Answers that were wrong without a message: ids of recordings, intervals, caches, findings."""

from __future__ import annotations

import shutil
import subprocess
import sys
import tracemalloc
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import torch
from exchange_data import write_recording

import pyinfra as pi
from pyinfra.core.errors import FindingWarning
from pyinfra.core.files import alone
from pyinfra.dataset.data_set import read_data_set
from pyinfra.dataset.frame_sequence import FrameSequence
from pyinfra.dataset.object_rows import BOX
from pyinfra.exchange.formats import FORMATS
from pyinfra.exchange.series import read_frames, read_series
from pyinfra.formats import kitti
from pyinfra.formats.csv_table import write_csv
from pyinfra.metrics.frame_checks import validate
from pyinfra.metrics.ground_truth import read_ground_truth
from pyinfra.metrics.intervals import UNKNOWN_BLOCK_S
from pyinfra.metrics.match_input import block_seconds
from pyinfra.metrics.observations import accumulated, read_observations

KNOWN = ("pcd", "nuscenes")  # formats in which objects keep their track


def recording(folder: Path, layout: str, *, fields: bool = True) -> FrameSequence:
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


# --- frames in memory ----------------------------------------------------------------------------

SHORT = {"duration_s": 6, "traffic.warm_up_s": 20}


@pytest.fixture(scope="module")
def frames() -> FrameSequence:
    return pi.simulate(pi.load_scene("highway", seed=1, set=SHORT), "helios_16", range(0, 60, 6))


@pytest.fixture(scope="module")
def found(frames: FrameSequence) -> pd.DataFrame:
    return frames.labels[["frame", "type", *BOX]].assign(score=0.5)


def test_writing_to_points_changes_no_other_frame(frames: FrameSequence) -> None:
    frame = frames[0]
    before = frame.points.copy()
    for array in (frame.points, frame.fields["time_s"]):
        array[...] = 0
    np.testing.assert_array_equal(frames[0].points, before)
    assert frames[0].fields["time_s"].any()

    def changing(points: np.ndarray) -> np.ndarray:
        points[:] = 0
        return np.empty((0, 7))

    pi.detect(changing, frames[:1])
    np.testing.assert_array_equal(frames[0].points, before)


def test_frames_in_a_list_keep_no_clouds(frames: FrameSequence) -> None:
    tracemalloc.start()
    kept = [*frames, *frames, *frames]
    size = tracemalloc.get_traced_memory()[0]
    tracemalloc.stop()
    one = frames[0].points.nbytes + frames[0].fields.nbytes
    assert len(kept) == 30
    assert size < (frames.kept + 2) * one  # the last clouds stay in the sequence
    np.testing.assert_array_equal(kept[0].points, frames[0].points)


@pytest.mark.parametrize("of", ["frames", "frame", "result"])
def test_repr_is_one_line(frames: FrameSequence, found: pd.DataFrame, of: str) -> None:
    shown = {"frames": frames, "frame": frames[0], "result": pi.evaluate(frames, found)}[of]
    assert len(repr(shown)) < 200
    assert "\n" not in repr(shown)
    assert shown._repr_html_().startswith("<table>")


# --- round trips ---------------------------------------------------------------------------------

# What comes back from an export: the columns of `labels` and whether points have their fields. The
# table in docs/formats.md says the same.
KEPT = {
    "kitti": ({"type", "id", "visibility"}, True),
    "pcd": ({"type", "id", "visibility"}, True),
    "nuscenes": ({"type", "visibility"}, False),  # ids are numbered again, but identify tracks
    "openpcdet": (set(), False),
    "mcap": ({"type", "id"}, True),
    "openlabel": ({"type", "visibility"}, False),  # as for nuscenes
}
ALL_OBJECTS = ("nuscenes", "mcap", "openlabel")  # also those without points
NEW_IDS = ("nuscenes", "openlabel")


def test_the_table_has_all_formats_that_are_read_back() -> None:
    assert {name for name, format in FORMATS.items() if format.back} == set(KEPT)


@pytest.mark.parametrize("layout", KEPT)
def test_a_round_trip_keeps_what_the_table_says(
    frames: FrameSequence, layout: str, tmp_path: Path
) -> None:
    columns, fields = KEPT[layout]
    source = frames[:3].save(tmp_path / "source", format=layout)
    source = source / "helios_16" if layout == "kitti" else source
    back = pi.import_recording(source, FORMATS[layout].back, tmp_path / "in/pole")
    assert len(back) == 3
    for ours, theirs in zip(frames[:3], back, strict=True):
        order = np.lexsort
        every = layout in ALL_OBJECTS
        one, two = (f.objects if every else f.labels for f in (ours, theirs))
        one, two = (t.iloc[order((t.y.round(2), t.x.round(2)))] for t in (one, two))
        np.testing.assert_allclose(two[BOX[:6]], one[BOX[:6]], atol=2e-3)
        for column in columns:
            if layout == "openlabel":  # an unknown visibility is not written
                one = one.replace({"visibility": {-1.0: 1.0}})
            want = one[column].round(3).tolist() if column == "visibility" else one[column].tolist()
            got = two[column].round(3).tolist() if column == "visibility" else two[column].tolist()
            assert got == want, column
        if not fields:
            assert theirs.fields is None
        else:
            np.testing.assert_array_equal(theirs.fields, ours.fields)
    if layout in NEW_IDS:
        known = back.objects.drop_duplicates(["frame", "id"])
        assert len(known) == len(back.objects)
        assert back.objects.id.nunique() == frames[:3].objects.id.nunique()
    if layout == "nuscenes":
        everyone = [f.objects.visibility for f in (frames[:3], back)]
        assert (everyone[0] >= 0.2).sum() == (everyone[1] >= 0.2).sum()


def test_a_saved_sequence_is_a_data_set(frames: FrameSequence, tmp_path: Path) -> None:
    frames[:2].save(tmp_path / "data")
    (loaded,) = pi.load_dataset(tmp_path / "data").values()
    pd.testing.assert_frame_equal(loaded.labels, frames[:2].labels, atol=2e-3)
    np.testing.assert_array_equal(loaded[0].points, frames[0].points)
    np.testing.assert_array_equal(loaded[0].fields, frames[0].fields)
    loaded[1:].save(tmp_path / "again")
    (again,) = pi.load_dataset(tmp_path / "again").values()
    assert again.numbers == loaded.numbers[1:]


def test_splits_of_a_nuscenes_export_come_back(tmp_path: Path) -> None:
    pole = write_recording(tmp_path / "made_up")
    (pole / "ImageSets").mkdir()
    (pole / "ImageSets/train.txt").write_text("000005\n000006\n")
    (pole / "ImageSets/val.txt").write_text("000007\n")
    pi.export(pole, "nuscenes", tmp_path / "source")
    pi.import_recording(tmp_path / "source", "nuscenes", tmp_path / "in/pole")
    lists = [(tmp_path / f"in/pole/ImageSets/{part}.txt") for part in ("train", "val")]
    assert [len(file.read_text().split()) for file in lists] == [2, 1]


# --- predictions ---------------------------------------------------------------------------------


def test_predictions_of_every_form_have_the_same_ap(
    frames: FrameSequence, found: pd.DataFrame
) -> None:
    parts = dict(list(found.groupby("frame")))
    arrays = {k: rows[[*BOX, "score"]].to_numpy() for k, rows in parts.items()}
    forms = {
        "table": found,
        "column class": found.rename(columns={"type": "class"}),
        "dict": arrays,
        "dict of NumPy keys": {np.int64(k): rows for k, rows in arrays.items()},
        "list": list(arrays.values()),
        "list of lists": [rows.tolist() for rows in arrays.values()],
        "list of tables": list(parts.values()),
        "dicts": [{"boxes": a[:, :7], "scores": a[:, 7]} for a in arrays.values()],
        "OpenPCDet": [{"pred_boxes": a[:, :7], "pred_scores": a[:, 7]} for a in arrays.values()],
        "columns": [dict(zip([*BOX, "score"], a.T, strict=True)) for a in arrays.values()],
        "tensors": [torch.tensor(a) for a in arrays.values()],
    }
    want = pi.evaluate(frames, found).ap.ap_r1000[0]
    assert want > 90
    assert {name: pi.evaluate(frames, form).ap.ap_r1000[0] for name, form in forms.items()} == (
        dict.fromkeys(forms, want)
    )


class Both:
    """A detector whose `predict` finds a box, and whose `__call__` does not."""

    def __call__(self, points: np.ndarray) -> np.ndarray:
        return np.empty((0, 7))

    def predict(self, points: np.ndarray) -> pd.DataFrame:
        return pd.DataFrame([[10.0, 0, -5, 4, 2, 1.5, 0, "Van"]], columns=[*BOX, "class"])


@pytest.mark.parametrize(
    ("boxes", "score"),
    [
        (np.array([[10.0, 0, -5, 4, 2, 1.5, 0]]), 1.0),
        (np.array([[10.0, 0, -5, 4, 2, 1.5, 0, 0.25]]), 0.25),
        ([[10.0, 0, -5, 4, 2, 1.5, 0]], 1.0),
        (torch.tensor([[10.0, 0, -5, 4, 2, 1.5, 0, 0.25]], requires_grad=True), 0.25),
        ({"boxes": [[10.0, 0, -5, 4, 2, 1.5, 0]], "scores": [0.25], "names": ["Car"]}, 0.25),
        ([dict(zip(BOX, [10.0, 0, -5, 4, 2, 1.5, 0], strict=True))], 1.0),
    ],
)
def test_detectors_return_boxes_in_any_form(boxes: object, score: float) -> None:
    cloud = np.zeros((5, 4), np.float32)
    for frames in (cloud, [cloud], cloud.tolist(), torch.tensor(cloud), cloud[:, :3]):
        table = pi.detect(lambda points: boxes, frames)
        assert table[["frame", "x", "score"]].values.tolist() == [[0, 10, score]]


def test_predict_of_a_detector_counts_and_its_table_has_types() -> None:
    table = pi.detect(Both(), [np.zeros((5, 4))] * 2)
    assert table[["frame", "type"]].values.tolist() == [[0, "Van"], [1, "Van"]]


def test_a_blank_label_line_is_valid(tmp_path: Path) -> None:
    file = kitti.frame_file(write_recording(tmp_path), "label_2", 5)
    file.write_text(file.read_text() + "\n")
    assert [f for f in validate(tmp_path / "pole") if f.level == "error"] == []


# --- evaluations ---------------------------------------------------------------------------------

SUSPICIOUS = {
    "heading-degrees": lambda t: t.assign(heading=np.degrees(t.heading) + 720),
    "far-from-vehicles": lambda t: t.assign(x=t.x * 0 + 900, y=t.y + 900),
    "height-offset": lambda t: t.assign(z=t.z + 3),
    "frames-without-predictions": lambda t: t[t.frame < 12],
    "other-classes": lambda t: t.assign(type=["Bycicle", *t.type[1:]]),
}


@pytest.mark.parametrize("name", SUSPICIOUS)
def test_findings_are_warnings(frames: FrameSequence, found: pd.DataFrame, name: str) -> None:
    with pytest.warns(FindingWarning, match=f"{name}: ") as caught:
        pi.evaluate(frames, SUSPICIOUS[name](found))
    assert caught[0].filename == __file__


def test_frames_and_split_exclude_each_other(tmp_path: Path) -> None:
    pole = write_recording(tmp_path)
    with pytest.raises(pi.Error, match="use frames or split, not both"):
        pi.evaluate(pole, pole, frames=[5], split="train")


def test_labels_have_no_numbers_of_points(tmp_path: Path) -> None:
    pole = write_recording(tmp_path, objects=False)
    found = pi.load_dataset(pole).labels[["frame", "type", *BOX]].assign(score=0.5)
    few = pi.Settings(ground_truths=("captured",), min_points=2)
    with pytest.raises(pi.Error, match="min_points: expected 1 for labels"):
        pi.evaluate(pole, found, few)


def test_an_evaluation_is_not_two_seeds(frames: FrameSequence, found: pd.DataFrame) -> None:
    half = found[::2]
    a, b = ([pi.evaluate(frames, table) for _ in range(2)] for table in (found, half))
    with pytest.raises(pi.Error, match="the same two results twice"):
        pi.compare(a, b)
    same = pi.compare(a[0], a[1])
    assert not same.is_significant


def test_a_comparison_by_distance_is_that_of_the_rings(
    frames: FrameSequence, found: pd.DataFrame
) -> None:
    a, b = pi.evaluate(frames, found), pi.evaluate(frames, found[::2])
    table = pi.compare(a, b, by="distance").set_index("distance_m")
    rings = [e.by_distance.query("ground_truth == 'captured'") for e in (a, b)]
    one, other = (ring.set_index("distance_m").ap_r1000 for ring in rings)
    np.testing.assert_allclose(table.value, (one - other)[table.index])
    assert len(table) >= 3


def test_a_choice_is_checked_everywhere() -> None:
    for wrong in ({"protocols": ("KITTI",)}, {"metrics": ("BEV",)}, {"ground_truths": ("All",)}):
        (name, (word,)) = next(iter(wrong.items()))
        with pytest.raises(pi.Error, match=f"{name}: .*did you mean '{word.lower()}'"):
            pi.Settings(**wrong)


# --- the other package of this name ---------------------------------------------------------------


def test_the_other_package_of_this_name_is_reported(tmp_path: Path) -> None:
    """Its files are beside this package's, or in another folder of the environment."""
    (tmp_path / "pyinfra/operations").mkdir(parents=True)
    (tmp_path / "pyinfra/operations/__init__.py").touch()
    init = Path(pi.__file__).read_text()
    run = partial(subprocess.run, capture_output=True, text=True, check=False)
    beside = run(
        [sys.executable, "-c", f"import sys; sys.path.append({str(tmp_path)!r}); import pyinfra"]
    )
    assert beside.returncode == 0
    assert "UserWarning: the package 'pyinfra' of PyPI" in beside.stderr
    (tmp_path / "pyinfra/__init__.py").write_text(init)
    mixed = run([sys.executable, "-c", "import pyinfra"], cwd=tmp_path)
    assert "ImportError: the package 'pyinfra' of PyPI" in mixed.stderr
    assert "pip uninstall pyinfra infrasim" in mixed.stderr


# --- files of results -----------------------------------------------------------------------------


def test_whole_numbers_of_tables_are_exact(tmp_path: Path) -> None:
    rows = pd.DataFrame(
        {"a": [1234567.0, np.nan, 123456789.0, 0.123456789], "b": [12345678, 1, 2, 3]}
    )
    write_csv(tmp_path / "t.csv", rows)
    back = pd.read_csv(tmp_path / "t.csv")
    assert back.a.tolist()[::2] == [1234567, 123456789]
    assert back.a[3] == pytest.approx(0.123457)
    assert back.b.tolist() == rows.b.tolist()


def test_one_process_alone_writes_to_a_folder(tmp_path: Path) -> None:
    """Two trainings, or two detections, of one folder would mix their files."""
    with alone(tmp_path / "out"):
        with pytest.raises(pi.Error, match="another process writes"), alone(tmp_path / "out"):
            pass
        with alone(tmp_path / "other"):
            pass
    with alone(tmp_path / "out"):
        pass
