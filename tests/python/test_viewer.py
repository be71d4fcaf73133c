"""The data that the viewer reads and writes, tested without a browser."""

import base64
import hashlib
import html.parser
import json
import re
import sys
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import Infrasim
from evaluation_data import car, perfect, write_lidar, write_predictions
from tracking_data import PERIOD_S, boxes, straight
from view_data import blob, view_frame

import pyinfra as pi
from pyinfra.cli import main
from pyinfra.core.errors import FormatError
from pyinfra.formats import kitti
from pyinfra.viz.viewer.encoding import pack_points
from pyinfra.viz.viewer.frames import read_view_frames
from pyinfra.viz.viewer.page import fragment, library, page, write_page

ROOT = Path(__file__).resolve().parents[2]
BUNDLE = ROOT / "pyinfra/viz/viewer/viewer.min.js"
HOSTILE = "</script><script>document.title='taken'</script><!-- \"'&"


class Elements(html.parser.HTMLParser):
    """Collects the tags of a page in their order, and the text of its first script."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.scripts: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: Any) -> None:
        self.tags.append(tag)

    def handle_data(self, data: str) -> None:
        if self.tags and self.tags[-1] == "script" and data.strip():
            self.scripts.append(data)


def data_of(text: str) -> Any:
    return json.loads(Elements(text).scripts[0])


def unpacked(packed: Any, columns: int) -> tuple[Any, bytes]:
    """Returns the coordinates (n, 3) and the other bytes, according to the description in
    encoding.py."""
    raw, n = zlib.decompress(base64.b64decode(packed["data"])), packed["count"]
    axes = np.frombuffer(raw[: 6 * n], np.uint8).reshape(3, 2, n).astype(np.int64)
    steps = (axes[:, 0] + 256 * axes[:, 1]).cumsum(axis=1) % 65536
    assert len(raw) == columns * n
    return packed["origin"] + packed["step_m"] * steps.T, raw[6 * n :]


def test_the_bundle_is_made_of_the_sources() -> None:
    folder = ROOT / "viewer"
    names = ["build.mjs", "package-lock.json", "package.json"]
    digest = hashlib.sha256()
    for name in sorted([*names, *(f"src/{file.name}" for file in (folder / "src").iterdir())]):
        digest.update(f"{name}\0".encode() + (folder / name).read_bytes() + b"\0")
    first = BUNDLE.read_text().splitlines()[0]
    assert first == f"/*! sources sha256 {digest.hexdigest()}", "run `make viewer`"


def test_the_bundle_is_small_has_its_licence_and_ends_no_script() -> None:
    text = BUNDLE.read_text()
    assert BUNDLE.stat().st_size <= 700_000
    assert "Permission is hereby granted, free of charge" in text
    assert "</script" not in text.lower()
    assert library().count("<script") == library().count("</script>") == 1


def test_coordinates_are_within_half_a_centimetre_and_the_rest_stays_with_its_point() -> None:
    random = np.random.default_rng(1)
    points = random.uniform((-250, -80, -18), (250, 80, 20), (5000, 3))
    ids = random.integers(-1, 40, 5000).astype(np.int32) * 1000
    time = random.uniform(0, 0.1, 5000).astype(np.float32)
    view = view_frame(points, time_s=time, object_id=ids, intensity=(ids % 7 / 7).astype("f4"))
    packed = pack_points(view)
    xyz, rest = unpacked(packed, columns=10)
    order = np.lexsort(np.rint(100 * (xyz - packed["origin"])).T)
    truth = view.points.astype(np.float64)
    truth_order = np.lexsort(np.rint(100 * (truth - packed["origin"])).T)
    assert np.abs(xyz[order] - truth[truth_order]).max() <= 0.00501
    n = packed["count"]
    columns = np.frombuffer(rest, np.uint8).reshape(4, n)[:, order]
    decoded = np.array(packed["objects"])[columns[2] + 256 * columns[3].astype(int)]
    assert (decoded == ids[truth_order]).all()
    assert np.abs(columns[0] / 255 - view.intensity[truth_order]).max() <= 0.5 / 255 + 1e-6
    assert np.abs(columns[1] / 2550 - time[truth_order]).max() <= 0.05 / 255 + 1e-6


def test_a_frame_wider_than_16_bits_of_centimetres_has_a_larger_step_and_the_page_says_it() -> None:
    view = view_frame([[0, 0, 0], [1310.7, 0, 0]])
    packed = pack_points(view)
    assert packed["step_m"] == pytest.approx(0.02)
    assert unpacked(packed, columns=7)[0][:, 0] == pytest.approx([0, 1310.7], abs=1e-3)
    assert "rounded to 2 cm" in data_of(fragment({"a": [view]}, element_id="v"))["note"]


def test_a_frame_without_points_or_vehicles_is_one() -> None:
    view = view_frame([])
    assert pack_points(view)["count"] == 0
    assert data_of(fragment({"a": [view]}, element_id="v"))["ground_m"] == 0


def test_points_are_left_out_only_if_asked_and_the_page_says_so() -> None:
    view = view_frame(blob(10, 0, count=1000))
    whole = data_of(fragment({"a": [view]}, element_id="v"))
    thin = data_of(fragment({"a": [view]}, element_id="v", most_points=100))
    points = [data["lidars"][0]["frames"][0]["points"] for data in (whole, thin)]
    assert [(p["count"], p["of"]) for p in points] == [(1000, 1000), (100, 1000)]
    assert ["more points than are shown" in data["note"] for data in (whole, thin)] == [False, True]
    away = unpacked(points[1], columns=7)[0][:, None] - view.points[None]
    assert (np.abs(away).max(axis=2).min(axis=1) <= 0.00501).all()


def lidar_folder(folder: Path, frames: int = 2) -> Path:
    """Writes cars 20 m ahead with 3 points each. The sensor is at (10, 20, 6) and looks along
    +y."""
    vehicles = [[car(20.0, 0.0), car(30.0, 4.0, points=0)] for _ in range(frames)]
    write_lidar(folder, vehicles)
    cloud = np.array([[19, 0, -5, 0.2], [20, 0, -5, 0.4], [1, 0, 0, 1]], np.float32)
    for k in range(frames):
        kitti.write_points(kitti.frame_file(folder, "velodyne", k), cloud)
    write_predictions(folder.parent / "predictions", perfect(vehicles))
    return folder


def test_points_boxes_and_predictions_are_in_the_world(tmp_path: Path) -> None:
    folder = lidar_folder(tmp_path / "data/one")
    first, second = read_view_frames(folder, [0, 1], folder.parent / "predictions")
    # The points are rotated by 90 degrees: the LiDAR's x is the world's y. The sensor is 6 m high.
    assert first.points == pytest.approx(np.array([[10, 39, 1], [10, 40, 1], [10, 21, 6]]))
    assert first.intensity == pytest.approx([0.2, 0.4, 1.0])
    expected = [[10, 40, 0.75, 4, 2, 1.5, np.pi / 2], [6, 50, 0.75, 4, 2, 1.5, np.pi / 2]]
    assert first.boxes == pytest.approx(np.array(expected))
    assert first.hits is not None
    assert first.hits.tolist() == [20, 0]
    assert first.predictions is not None
    assert first.predictions.boxes == pytest.approx(first.boxes[:1], abs=1e-5)
    assert (first.time_s, first.object_id, second.frame) == (None, None, 1)


def test_a_folder_of_labels_alone_stands_at_the_origin(tmp_path: Path) -> None:
    folder = tmp_path / "kitti"
    write_lidar(folder, [[car(20.0, 0.0)]], objects=False)
    (folder / "lidar.yaml").unlink()
    (view,) = read_view_frames(folder, [0])
    assert view.boxes[0] == pytest.approx([20, 0, -5.25, 4, 2, 1.5, 0], abs=1e-5)
    assert view.hits is None
    data = data_of(fragment({"a": [view]}, element_id="v"))
    assert data["ground_m"] == pytest.approx(-6, abs=1e-5)


def test_tracks_have_their_id_speed_and_path(tmp_path: Path) -> None:
    folder = lidar_folder(tmp_path / "a", frames=3)
    tracks = pi.track(boxes([straight(20, 0, 10)], 3), period_s=PERIOD_S)
    (number,) = tracks.id.unique()
    pi.export_tracks(tracks, tmp_path / "tracks.csv")
    shown = pi.view(folder, tmp_path / "v.html", frames=[0, 2], predictions=tmp_path / "tracks.csv")
    first, last = data_of(shown.read_text())["lidars"][0]["frames"]
    assert [p["name"] for p in last["predictions"]] == [f"Car {number} at 35 km/h"]
    (trail,) = last["trails"]
    end = last["predictions"][0]["box"][:3]
    assert trail[-3:] == pytest.approx(end, abs=0.006)
    assert len(trail) == 9
    assert np.hypot(*np.subtract(trail[-3:-1], trail[:2])) == pytest.approx(2, abs=0.1)
    assert first["trails"] == []
    default = pi.view(folder, tmp_path / "w.html", predictions=tmp_path / "tracks.csv")
    assert data_of(default.read_text())["frames"][0]["number"] == 0


def test_no_file_of_predictions_is_not_a_frame_without_detections(
    tmp_path: Path,
) -> None:
    folder = lidar_folder(tmp_path / "data/one")
    predictions = folder.parent / "predictions"
    (predictions / "000001.txt").unlink()
    first, second = read_view_frames(folder, [0, 1], predictions)
    assert first.predictions is not None
    assert second.predictions is None


def test_fields_of_another_cloud_are_refused(tmp_path: Path) -> None:
    folder = lidar_folder(tmp_path / "data/one")
    file = kitti.frame_file(folder, "fields", 0)
    file.parent.mkdir()
    kitti.write_fields(file, np.zeros(2, kitti.FIELDS))
    with pytest.raises(FormatError, match=r"fields/000000.bin: expected 3 records, .*, got 2"):
        read_view_frames(folder, [0])


def test_names_are_text_and_never_markup() -> None:
    box = np.array([[28.0, 0, 0.75, 4, 2, 1.5, 0]])
    view = view_frame(blob(28, 0), boxes=box, names=np.array([HOSTILE]), hits=np.array([3]))
    text = page({HOSTILE: [view]}, title=HOSTILE)
    plain = page({"a": [view_frame(blob(28, 0))]}, title="a")
    assert Elements(text).tags == Elements(plain).tags
    data = data_of(text[text.index("<figure") :])
    assert data["lidars"][0]["name"] == HOSTILE
    assert data["lidars"][0]["frames"][0]["vehicles"][0]["name"] == HOSTILE


@pytest.mark.parametrize(
    ("views", "element_id", "words"),
    [
        ({"a": [view_frame([])]}, "1 2", "element_id: expected .*, got '1 2'"),
        ({}, "v", "view: expected one or more frames for each LiDAR, got none"),
        ({"a": []}, "v", "view: expected one or more frames for each LiDAR, got none"),
        (
            {"a": [view_frame([])], "b": [view_frame([], frame=7)]},
            "v",
            r"view: b: expected frames \[0\], .*, got \[7\]",
        ),
    ],
)
def test_what_is_no_view_is_refused(views: Any, element_id: str, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        fragment(views, element_id=element_id)


def test_the_command_writes_one_page_and_says_its_size(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("one", "two"):
        lidar_folder(tmp_path / "data" / name, frames=4)
    out = tmp_path / "new/view.html"
    assert main.main(["view", str(tmp_path / "data"), "--frames", "1:4:2", "--out", str(out)]) == 0
    size = out.stat().st_size / 1e6
    assert capsys.readouterr().out == f"{out}: {size:.2f} MB, 2 LiDARs, 2 frames\n"
    data = data_of(out.read_text()[out.read_text().index("<figure") :])
    assert [frame["number"] for frame in data["frames"]] == [1, 3]
    assert [frame["start_s"] for frame in data["frames"]] == [0.1, 0.3]
    # Both LiDARs have the same model, so the view names them by their folders.
    assert [lidar["name"] for lidar in data["lidars"]] == [
        "made up (data/one)",
        "made up (data/two)",
    ]


def test_with_predictions_the_first_frame_that_has_some_is_shown(tmp_path: Path) -> None:
    folder = lidar_folder(tmp_path / "data/one", frames=3)
    (tmp_path / "data/predictions/000000.txt").unlink()
    pred = str(tmp_path / "data/predictions")
    out = tmp_path / "view.html"
    assert main.main(["view", str(folder), "--pred", pred, "--out", str(out)]) == 0
    data = data_of(out.read_text()[out.read_text().index("<figure") :])
    assert data["frames"][0]["number"] == 1
    assert len(data["lidars"][0]["frames"][0]["predictions"]) == 1


def test_a_run_of_the_simulator_has_time_and_objects(
    infrasim: Callable[..., Any], run_command: Callable[..., list[str]], tmp_path: Path
) -> None:
    data, out = tmp_path / "data", tmp_path / "view.html"
    infrasim(*run_command("helios_16", "livox_avia", frames="0:2", out=data), "--fields")
    assert main.main(["view", str(data), "--frames", "0:2", "--out", str(out)]) == 0
    lidars = data_of(out.read_text()[out.read_text().index("<figure") :])["lidars"]
    assert [lidar["name"] for lidar in lidars] == ["RoboSense Helios 16P", "Livox Avia"]
    for lidar in lidars:
        for k, frame in enumerate(lidar["frames"]):
            assert frame["points"]["time"]
            folder = data / ("helios_16" if "Helios" in lidar["name"] else "livox_avia")
            objects = kitti.read_objects(kitti.frame_file(folder, "objects", k))
            hit = set(objects.ids[objects.points > 0].tolist())
            assert set(frame["points"]["objects"]) == {-1} | hit
            assert sum(v["points"] for v in frame["vehicles"]) == objects.points.sum()


@pytest.mark.parametrize(
    ("words", "error"),
    [
        ("--frames 5:9", "frames: expected 0 to 1, got 5:9"),
        ("--frame 5", "frames: expected 0 to 1, got 5"),
        ("--frames 0-4", "--frames: expected A:B or A:B:STEP, got '0-4'"),
        ("--frames 0:4:0", "--frames: expected A:B or A:B:STEP, got '0:4:0'"),
        ("--lidar three", "--lidar: expected one of one, two; got 'three'"),
        ("--pred there", "--pred: expected LIDAR=DIR with LIDAR one of one, two; got 'there'"),
        ("--pred one=there one=here", "--pred: expected .*, got a second for one: 'one=here'"),
        ("--pred three=there", "--pred: expected LIDAR=DIR .*; got 'three=there'"),
        ("DATA/one", "expected each LiDAR once, got DATA/one, DATA/two, DATA/one"),
        ("--max-points 0", "--max-points: expected 1 or more, got 0"),
    ],
)
def test_wrong_words_end_in_one_line_and_no_page(
    words: str, error: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("one", "two"):
        lidar_folder(tmp_path / "data" / name)
    data, out = str(tmp_path / "data"), tmp_path / "view.html"
    words = words.replace("DATA", data)
    assert main.main(["view", data, *words.split(), "--out", str(out)]) == 2
    message = capsys.readouterr().err.replace(data, "DATA")
    assert re.search(error, message)
    assert message.count("\n") == 1
    assert not out.exists()


@pytest.mark.parametrize("more", [[], ["--rerun"]])
def test_a_folder_in_place_of_the_page_is_named(
    more: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, out = lidar_folder(tmp_path / "data/one"), tmp_path / "pages"
    out.mkdir()
    allowed = f"--out: expected the name of a file, got the folder {out}"
    assert main.main(["view", str(folder), *more, "--out", str(out)]) == 2
    assert capsys.readouterr().err == f"pyinfra: {allowed}\n"
    with pytest.raises(ValueError, match="got the folder"):
        write_page({}, "title", out)
    assert list(out.iterdir()) == []


def test_a_page_above_the_limit_is_refused_and_the_old_one_stays(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = lidar_folder(tmp_path / "data/one")
    out = tmp_path / "view.html"
    out.write_text("<!doctype html>old")
    monkeypatch.setattr("pyinfra.viz.viewer.page.LARGEST_MB", 0.5)
    assert main.main(["view", str(folder), "--out", str(out)]) == 2
    error = capsys.readouterr().err
    assert "view.html: expected up to 0.5 MB, got" in error
    assert "MB; choose fewer --frames, one --lidar or a lower --max-points" in error
    assert out.read_text() == "<!doctype html>old"
    assert set(tmp_path.iterdir()) == {tmp_path / "data", out}


def test_a_folder_that_is_none_is_named(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert main.main(["view", str(tmp_path), "--out", str(tmp_path / "view.html")]) == 1
    assert "expected a LiDAR folder with a lidar.yaml, got none" in capsys.readouterr().err


def test_without_the_extra_a_recording_is_refused_with_its_name(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = lidar_folder(tmp_path / "data/one")
    monkeypatch.setitem(sys.modules, "rerun", None)
    monkeypatch.delitem(sys.modules, "pyinfra.viz.viewer.recording", raising=False)
    assert main.main(["view", str(folder), "--rerun", "--out", str(tmp_path / "a.rrd")]) == 2
    assert "pip install 'infrasim[rerun]'" in capsys.readouterr().err
    assert not (tmp_path / "a.rrd").exists()


def test_a_recording_has_every_frame_and_opens_for_this_machine_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("rerun", reason="the extra `rerun` is not installed")
    import subprocess

    folder = lidar_folder(tmp_path / "data/one")
    pred, out = str(tmp_path / "data/predictions"), tmp_path / "view.rrd"
    opened: list[list[str]] = []

    def start(words: list[str], check: bool) -> Any:
        opened.append(words)
        return subprocess.CompletedProcess(words, 0)

    with monkeypatch.context() as patch:
        patch.setattr("pyinfra.viz.viewer.recording.subprocess.run", start)
        words = ["--frames", "0:2", "--pred", pred, "--rerun", "--out", str(out)]
        assert main.main(["view", str(folder), *words]) == 0
    assert capsys.readouterr().out.endswith("MB, 1 LiDAR, 2 frames\n")
    assert opened[0][opened[0].index("--bind") + 1] == "127.0.0.1"
    assert opened[0][-1] == str(out)
    read = [sys.executable, "-m", "rerun", "rrd", "print", "-vv", str(out)]
    text = subprocess.run(read, capture_output=True, text=True, check=True).stdout
    for part in ("points", "vehicles", "predictions"):
        assert f"/world/made\\ up/{part}" in text


def test_road_and_buildings_of_the_data_set_are_in_the_page(
    infrasim: Callable[..., Any], run_command: Callable[..., list[str]], tmp_path: Path
) -> None:
    data, out = tmp_path / "data", tmp_path / "view.html"
    infrasim(*run_command("livox_avia", frames="0:1", out=data), check=True)
    building = (
        "{x_m: 10, y_m: 30, length_m: 20, width_m: 8, height_m: 5, heading_deg: 0, base_m: 1}"
    )
    file = data / "dataset.yaml"
    file.write_text(file.read_text().replace("buildings: []", f"buildings: [{building}]"))
    assert main.main(["view", str(data), "--out", str(out)]) == 0
    around = data_of(out.read_text()[out.read_text().index("<figure") :])["around"]
    assert around["buildings"] == [[10, 30, 3.5, 20, 8, 5, 0]]
    # The motorway lies along y = 0. Its edges are 21 m from the middle.
    ends = sorted((line[:2], line[-3:-1]) for line in around["edge"])
    assert ends == [([-100, y], [100, y]) for y in (-21, 21)]
    assert len(around["dashed"]) == 6
    assert around["further_mounts"] == []


def test_all_poles_of_a_fused_set_are_in_the_page(infrasim: Infrasim, tmp_path: Path) -> None:
    words = ["--lidar", "configs/lidars/helios_16.yaml", "--frames", "0:1", "--fuse"]
    assert infrasim("run", "crossroad_poles", *words, "--out", tmp_path / "data").returncode == 0
    out = tmp_path / "view.html"
    assert main.main(["view", str(tmp_path / "data/fused"), "--out", str(out)]) == 0
    around = data_of(out.read_text()[out.read_text().index("<figure") :])["around"]
    assert around["further_mounts"] == [[25, 10, 6], [10, -25, 6], [-10, 25, 6]]


def test_a_recording_has_neither_road_nor_buildings(tmp_path: Path) -> None:
    folder, out = lidar_folder(tmp_path / "data/one", frames=1), tmp_path / "view.html"
    (tmp_path / "data/dataset.yaml").write_text("name: here\npreset: recorded\n")
    assert main.main(["view", str(folder), "--out", str(out)]) == 0
    around = data_of(out.read_text()[out.read_text().index("<figure") :])["around"]
    kinds = ("edge", "solid", "dashed", "buildings", "further_mounts")
    assert around == {kind: [] for kind in kinds}
