"""Labels of several tools beside clouds: each kind gives the same boxes, and none is dropped."""

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from exchange_data import write_recording
from recording_files import road, write_bag
from scipy.spatial.transform import Rotation
from test_import import LAYOUTS as EXPORTED
from test_import import source_of
from test_import_public import LAYOUTS as PUBLIC

import pyinfra as pi
from pyinfra.cli import main
from pyinfra.core.errors import Error, FormatError
from pyinfra.exchange.box_text import read_boxes
from pyinfra.exchange.data_set import LidarFacts
from pyinfra.exchange.formats import reader
from pyinfra.exchange.guess import guess_format
from pyinfra.exchange.imports import import_recording, warnings
from pyinfra.exchange.recording import Options
from pyinfra.exchange.unread import unread_files
from pyinfra.formats import kitti
from pyinfra.formats.box_csv import read_box_csv
from pyinfra.formats.pcd_file import write_pcd
from pyinfra.formats.track_names import track_name

# Class, track, x y z length width height heading, and the roll of the box.
BOXES = [
    ("Car", "7", (12.0, -3.0, -5.25, 4.5, 1.9, 1.5, 2.5), 0.05),
    ("Truck", "9", (-20.0, 6.0, -4.5, 9.0, 2.5, 3.0, -0.5), 0.0),
]
FRAMES = ("000004", "000005", "000006")
Write = Callable[[Path], Options]


def boxes_in(frame: int) -> list[tuple[str, str, list[float], float]]:
    """Returns the boxes of a frame. Their order changes, and the last frame has none."""
    moved = [(n, t, [b[0] + frame, *b[1:]], roll) for n, t, b, roll in BOXES]
    return moved[:: 1 if frame % 2 else -1] if frame < 2 else []


def write_clouds(folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for k, name in enumerate(FRAMES):
        kind = [(axis, "<f4") for axis in ("x", "y", "z", "intensity")]
        records = np.array([tuple(point) for point in road(k, 300)], dtype=kind)
        write_pcd(folder / f"{name}.pcd", records)


def write_json(folder: Path, content: Callable[[list[Any]], object]) -> None:
    folder.mkdir()
    for k, name in enumerate(FRAMES):
        (folder / f"{name}.json").write_text(json.dumps(content(boxes_in(k))))


def label_cloud(*, degrees: bool) -> Write:
    def turn(yaw: float) -> float:
        return math.degrees(yaw) % 360 if degrees else yaw

    def entry(name: str, box: list[float]) -> dict[str, Any]:
        return {
            "name": name,
            "centroid": dict(zip("xyz", box[:3], strict=True)),
            "dimensions": dict(zip(("length", "width", "height"), box[3:6], strict=True)),
            "rotations": {"x": 0, "y": 0, "z": turn(box[6])},
        }

    def write(source: Path) -> Options:
        write_clouds(source / "pointclouds")
        write_json(
            source / "labels",
            lambda boxes: {
                "folder": "pointclouds",
                "objects": [entry(n, b) for n, _, b, _ in boxes],
            },
        )
        (source / "labels/_classes.json").write_text('{"classes": []}')
        return Options()

    return write


def label_cloud_corners(source: Path) -> Options:
    signs = [(-1, -1, -1), (-1, 1, -1), (1, 1, -1), (1, -1, -1)]
    signs += [(x, y, 1) for x, y, _ in signs]

    def corners(box: list[float]) -> list[list[float]]:
        turn = Rotation.from_euler("Z", box[6])
        return (turn.apply(np.array(signs) * box[3:6] / 2) + box[:3]).tolist()

    write_clouds(source / "pointclouds")
    write_json(
        source / "labels",
        lambda boxes: {"objects": [{"name": n, "vertices": corners(b)} for n, _, b, _ in boxes]},
    )
    return Options()


def sustech(source: Path) -> Options:
    def entry(name: str, track: str, box: list[float], roll: float) -> dict[str, Any]:
        groups = {"position": box[:3], "scale": box[3:6], "rotation": [roll, 0, box[6]]}
        psr = {key: dict(zip("xyz", value, strict=True)) for key, value in groups.items()}
        return {"obj_id": track, "obj_type": name, "psr": psr}

    write_clouds(source / "lidar")
    write_json(source / "label", lambda boxes: [entry(*box) for box in boxes])
    return Options()


def open_label(source: Path) -> Options:
    def entry(name: str, box: list[float]) -> dict[str, Any]:
        turn = Rotation.from_euler("Z", box[6]).as_quat().tolist()
        return {"object_data": {"type": name, "cuboid": {"val": [*box[:3], *turn, *box[3:6]]}}}

    write_clouds(source)
    write_json(
        source / "labels",
        lambda boxes: {
            "openlabel": {"frames": {"0": {"objects": {t: entry(n, b) for n, t, b, _ in boxes}}}}
        },
    )
    return Options()


def dair(source: Path) -> Options:
    def entry(name: str, track: str, box: list[float]) -> dict[str, Any]:
        sizes = dict(zip("lwh", box[3:6], strict=True))
        place = dict(zip("xyz", box[:3], strict=True))
        return {"type": name, "track_id": track, "3d_location": place, "3d_dimensions": sizes} | {
            "rotation": box[6]
        }

    write_clouds(source)
    write_json(source / "labels", lambda boxes: [entry(n, t, b) for n, t, b, _ in boxes])
    return Options()


def csv_of_frames(source: Path) -> Options:
    write_clouds(source)
    (source / "labels").mkdir()
    for k, name in enumerate(FRAMES):
        rows = ["Track ID;Class;center_x;center_y;center_z;length_m;width_m;height_m;yaw (rad)"]
        rows += [";".join([t, n, *map(str, b)]) for n, t, b, _ in boxes_in(k)]
        (source / f"labels/{name}.csv").write_text("\n".join(rows) + "\n")
    return Options()


def one_csv(header: str, frames: tuple[str, ...], columns: dict[str, str]) -> Write:
    """The headers of this table state degrees and the bottom of the box."""

    def write(source: Path) -> Options:
        write_clouds(source / "clouds")
        rows = [header]
        for k, name in enumerate(frames):
            for kind, track, b, _ in boxes_in(k):
                cells = [b[0], b[1], b[2] - b[5] / 2, *b[3:6], math.degrees(b[6]), 0.5]
                rows.append(",".join([name, track, kind, *map(str, cells)]))
        (source / "boxes.csv").write_text("\ufeff" + "\r\n".join(rows) + "\r\n")
        return Options(labels=source / "boxes.csv", label_columns=columns)

    return write


PLAIN = "frame,id,label,x,y,z_bottom,length,width,height,yaw_deg,colour"
OTHER = "cloud,nr,kind,a,b,c,l,w,h,angle,colour"
MAPPED = {"frame": "cloud", "id": "nr", "class": "kind", "x": "a", "y": "b", "z_bottom": "c"} | {
    "yaw_deg": "angle"
}
KINDS: dict[str, Write] = {
    "labelCloud radians": label_cloud(degrees=False),
    "labelCloud degrees": label_cloud(degrees=True),
    "labelCloud corners": label_cloud_corners,
    "SUSTechPOINTS": sustech,
    "OpenLABEL": open_label,
    "DAIR-V2X": dair,
    "csv of frames": csv_of_frames,
    "csv with numbers": one_csv(PLAIN, ("4", "5", "6"), {}),
    "csv with names": one_csv(PLAIN, FRAMES, {}),
    "csv with paths": one_csv(PLAIN, tuple(f"velodyne/{name}.pcd" for name in FRAMES), {}),
    "csv with other names": one_csv(OTHER, FRAMES, MAPPED),
}
TRACKED = [kind for kind in KINDS if not kind.startswith("labelCloud")]


@pytest.mark.parametrize("kind", KINDS)
def test_labels_of_each_tool_give_the_same_boxes(kind: str, tmp_path: Path) -> None:
    source = tmp_path / "source"
    options = KINDS[kind](source)
    clouds = source / "clouds" if options.labels else source
    assert guess_format(clouds)[0] == "pcd"
    lidar = tmp_path / "in/pole"
    facts = LidarFacts("pole", "junction")
    summary, labelled = import_recording(clouds, "pcd", lidar, facts, options)
    assert labelled
    assert kitti.frames(lidar) == [4, 5, 6]
    ids: dict[str, set[int]] = {}
    for k in range(3):
        got = kitti.read_objects(kitti.frame_file(lidar, "objects", 4 + k))
        want = boxes_in(k)
        assert got.names.tolist() == [name for name, *_ in want]
        boxes = np.array([box for _, _, box, _ in want]).reshape(-1, 7)
        assert np.allclose(got.boxes[:, :6], boxes[:, :6], atol=1e-4)
        assert np.allclose(np.sin((got.boxes[:, 6] - boxes[:, 6]) / 2), 0, atol=2e-3)
        for (_, track, *_), number in zip(want, got.ids.tolist(), strict=True):
            ids.setdefault(track, set()).add(number)
    assert all(len(found) == 1 for found in ids.values())
    assert all((kind in TRACKED) == (min(found) >= 0) for found in ids.values())
    unread = ["keys of labels: colour"] if kind in TRACKED[-4:] else []
    assert [text for text in summary.not_read if "fields of points" not in text] == unread


def test_frames_that_were_not_labelled_are_left_out(tmp_path: Path) -> None:
    """A labelling tool writes no file for them, so that an empty frame would be wrong."""
    sustech(tmp_path / "source")
    (tmp_path / "source/label/000005.json").unlink()
    facts = LidarFacts("pole", "junction")
    summary, _ = import_recording(tmp_path / "source", "pcd", tmp_path / "a/b", facts, Options())
    assert kitti.frames(tmp_path / "a/b") == [4, 6]
    assert any("1 of 3 clouds, such as 000005.pcd" in text for text in summary.assumed)


def one_open_label(folder: Path, frames: dict[str, dict[str, Any]]) -> None:
    cuboid = {"val": [12.0, -3.0, -5.25, 0, 0, 0, 1, 4.5, 1.9, 1.5]}
    frames["4"] = {"objects": {"7": {"object_data": {"type": "Car", "cuboid": cuboid}}}}
    (folder / "labels.json").write_text(json.dumps({"openlabel": {"frames": frames}}))


def test_clouds_that_one_file_does_not_contain_are_left_out(tmp_path: Path) -> None:
    """A frame that the file contains, but without objects, was labelled and stays."""
    write_clouds(tmp_path / "source")
    one_open_label(tmp_path / "source", {"000006": {"frame_properties": {}}})
    facts = LidarFacts("pole", "junction")
    summary, _ = import_recording(tmp_path / "source", "pcd", tmp_path / "a/b", facts, Options())
    assert kitti.frames(tmp_path / "a/b") == [4, 6]
    counts = [
        len(kitti.read_objects(kitti.frame_file(tmp_path / "a/b", "objects", k))) for k in (4, 6)
    ]
    assert counts == [1, 0]
    assert any("1 of 3 clouds, such as 000005.pcd, are not in" in text for text in summary.assumed)


def test_a_file_without_frames_is_refused(tmp_path: Path) -> None:
    write_clouds(tmp_path)
    (tmp_path / "labels.json").write_text('{"openlabel": {"frames": {}}}')
    with pytest.raises(FormatError, match=r"expected one or more frames, got none"):
        reader("pcd")(tmp_path, Options())


@pytest.mark.parametrize("kind", ["csv of frames", "csv with names"])
def test_clouds_without_a_row_have_no_objects(kind: str, tmp_path: Path) -> None:
    """In one table, a frame without objects has no row. A missing table of a frame is no label."""
    options = KINDS[kind](tmp_path / "source")
    clouds = tmp_path / "source/clouds" if options.labels else tmp_path / "source"
    if not options.labels:
        (tmp_path / "source/labels/000006.csv").unlink()
    facts = LidarFacts("pole", "junction")
    summary, _ = import_recording(clouds, "pcd", tmp_path / "a/b", facts, options)
    assert kitti.frames(tmp_path / "a/b") == ([4, 5, 6] if options.labels else [4, 5])
    assert any("1 of 3 clouds" in text for text in summary.assumed)


def made(name: str, motorway: Path, tmp_path: Path) -> Path:
    if name in PUBLIC:
        return PUBLIC[name](motorway, tmp_path / "set")
    if name in EXPORTED:
        pole = write_recording(tmp_path / "made_up")
        return source_of(name, pole, [5, 6, 7], tmp_path / "source")
    return write_bag(tmp_path / "street", "mcap", "hesai", 2).parent / "street"


@pytest.mark.parametrize("name", [*PUBLIC, *EXPORTED, "bag"])
def test_what_is_not_read_is_listed(name: str, motorway: Path, tmp_path: Path) -> None:
    """Nothing of a complete recording is listed; a folder and a file that are added are."""
    source = made(name, motorway, tmp_path)
    recording = reader(name)(source, Options())
    own = ["lidar.yaml"] if name == "kitti" else []  # the layout is known, but not this file
    assert unread_files(source, recording.reads) == own
    (source / "camera/front").mkdir(parents=True)
    for i in range(3):
        (source / f"camera/front/{i}.jpg").touch()
    (source / "boxes.xlsx").touch()
    (source / "README.md").touch()
    (source / "make_labels.py").touch()
    (source.parent / "annotations").mkdir()
    (source.parent / "label_files.py").touch()
    found = unread_files(source, reader(name)(source, Options()).reads)
    assert [text for text in found if text not in own] == [
        "camera/ (3 .jpg)",
        "boxes.xlsx",
        "../annotations/ (empty)",
    ]


def test_an_import_lists_it_once_and_warns_of_labels(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_clouds(tmp_path / "source")
    (tmp_path / "source/annotation").mkdir()
    (tmp_path / "source/annotation/000004.xml").touch()
    out = tmp_path / "data/pole"
    words = ["import", str(tmp_path / "source"), "--out", str(out), "--upright", "as-is"]
    assert main.main(words) == 0
    printed = capsys.readouterr()
    assert printed.out.count("not read: ") == 1
    assert "not read: annotation/ (1 .xml)" in printed.out
    assert "annotation/ (1 .xml) may be labels, which are not read; --label-folder" in printed.err
    assert "annotation/ (1 .xml)" in (out / "lidar.yaml").read_text()
    facts = LidarFacts("pole", "junction")
    summary, labelled = import_recording(
        tmp_path / "source", "pcd", tmp_path / "b/pole", facts, Options(), upright="as-is"
    )
    assert any("may be labels" in text for text in warnings(summary, labelled))


def test_keys_fields_and_topics_that_are_not_read_are_named(motorway: Path, tmp_path: Path) -> None:
    source = PUBLIC["dair-v2x"](motorway, tmp_path / "set")
    file = next(source.rglob("label/virtuallidar/*.json"))
    entries = json.loads(file.read_text())
    file.write_text(json.dumps([entry | {"2d_box": {}, "alpha": 0} for entry in entries]))
    facts = LidarFacts("pole", "junction")
    summary, _ = import_recording(source, "dair-v2x", tmp_path / "a/b", facts, Options())
    assert summary.not_read == ["keys of labels: 2d_box, alpha"]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ('{"shapes": [], "version": 1}', "got the keys shapes, version; a .csv file"),
        ('[{"points": []}]', "got the keys points; a .csv file"),
        ("[1]", "got a list with unexpected entries"),
    ],
)
def test_unknown_json_is_refused_with_its_keys(content: str, message: str, tmp_path: Path) -> None:
    write_clouds(tmp_path)
    (tmp_path / "labels").mkdir()
    (tmp_path / "labels/000004.json").write_text(content)
    with pytest.raises(FormatError, match=message):
        reader("pcd")(tmp_path, Options())


ROW = "1,2,3,4,2,1.5,0"


@pytest.mark.parametrize(
    ("text", "columns", "message"),
    [
        ("x,y,z,l,w,h\n1,2,3,4,5,6\n", {}, ":1: expected columns for yaw, got x, y, z, l, w, h"),
        (f"x,cx,y,z,l,w,h,yaw\n0,{ROW}\n", {}, "one column for `x`, got x, cx; `x=x` selects"),
        (f"x,y,z,l,w,h,yaw\n{ROW}\n", {"score": "p"}, "one column 'p' for `score`, got x, y"),
        ("x,y,z,l,w,h,yaw\n1,2,3,4,2,1.5,90\n", {}, "yaw: expected radians.*`yaw_deg=yaw`"),
        ("x,y,z,l,w,h,yaw\n1,2,3,0,2,1.5,1\n", {}, ":2: l: expected 0.001 to 1000 m, got 0"),
        ("x,y,z,l,w,h,yaw\n1,2,3e5,4,2,1.5,1\n", {}, ":2: z: expected -10000 to 10000 m"),
        ("x,y,z,l,w,h,yaw\n1,2,,4,2,1.5,1\n", {}, ":2: z: expected a number, got ''"),
        (f"x,y,z,l,w,h,yaw\n{ROW},9\n", {}, ":2: expected 7 columns, got 8"),
        ("", {}, "got an empty file"),
    ],
)
def test_wrong_tables_are_named(
    text: str, columns: dict[str, str], message: str, tmp_path: Path
) -> None:
    (tmp_path / "boxes.csv").write_text(text)
    with pytest.raises(FormatError, match=message):
        read_box_csv(tmp_path / "boxes.csv", columns)


def test_rows_of_unknown_frames_are_refused(tmp_path: Path) -> None:
    options = one_csv(PLAIN, ("4", "5", "6"), {})(tmp_path / "source")
    text = (tmp_path / "source/boxes.csv").read_text().replace("\n5,", "\n17,")
    (tmp_path / "source/boxes.csv").write_text(text)
    with pytest.raises(Error, match=r"boxes.csv:4: frame: expected the name or number .*got '17'"):
        reader("pcd")(tmp_path / "source/clouds", options)


def test_boxes_of_a_detector_in_a_table_become_predictions(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The frames are those of a recording, by number or by the name of the cloud."""
    dair(tmp_path / "source")
    facts = LidarFacts("pole", "junction")
    lidar = tmp_path / "data/pole"
    import_recording(tmp_path / "source", "pcd", lidar, facts, Options())
    header = "cloud,p,kind,a,b,c,l,w,h,angle,colour"
    one_csv(header, tuple(f"x/{name}.pcd" for name in FRAMES), {})(tmp_path / "other")
    table = tmp_path / "other/boxes.csv"
    text = table.read_text().replace(",7,", ",0.9,").replace(",9,", ",0.25,")
    table.write_text(text)
    words = ["frame=cloud", "score=p", "class=kind", "x=a", "y=b", "z_bottom=c", "yaw_deg=angle"]
    command = ["import", str(table), "--boxes-of", str(lidar), "--out", str(tmp_path / "boxes")]
    assert main.main([*command, "--label-columns", *words]) == 0
    assert "4 boxes in 3 frames" in capsys.readouterr().out
    assert [f.name for f in sorted((tmp_path / "boxes").iterdir())] == [f"{n}.txt" for n in FRAMES]
    read = pi.Detections.from_kitti(tmp_path / "boxes", lidar)
    assert sorted(read.score) == [0.25, 0.25, 0.9, 0.9]
    truth = kitti.read_objects(kitti.frame_file(lidar, "objects", 4))
    found = read[read.frame == 4].sort_values("score")[["x", "y", "z", "dx", "dy", "dz", "heading"]]
    assert np.allclose(found.to_numpy(), truth.boxes, atol=1e-3)
    assert main.main([*command, "--label-columns", *words]) == 2
    assert "--out: expected a new or empty folder" in capsys.readouterr().err
    table.write_text(text.replace("0.25", "25"))
    with pytest.raises(FormatError, match="p: expected 0 to 1, got 25"):
        pi.Detections.from_csv(table, lidar, dict(word.split("=") for word in words))


def test_predictions_have_the_calibrations_of_their_frames(tmp_path: Path) -> None:
    """The frames are those of KITTI, whose camera is not at the sensor, and differs by frame."""
    frames, rows = [4, 5, 6], ["frame,class,x,y,z,length,width,height,yaw,score"]
    training = tmp_path / "kitti/training"
    for k, frame in enumerate(frames):
        calibration = kitti.simulated()
        calibration.Tr_velo_to_cam[:, 3] = [0.02 * k, -0.08, -0.27]
        (_, _, box, _), *_ = boxes_in(0)
        labels = kitti.Labels(np.array(["Car"]), np.array([box]), None)
        kitti.write_frame(tmp_path / "kitti", frame, road(k), labels, calibration=calibration)
        rows.append(",".join(map(str, (frame, "Car", *box, 0.9))))
    (tmp_path / "boxes.csv").write_text("\n".join(rows) + "\n")
    words = ["import", str(tmp_path / "boxes.csv"), "--boxes-of", str(training.parent)]
    assert main.main([*words, "--out", str(tmp_path / "boxes")]) == 0
    for part in (tmp_path / "boxes", training / "label_2"):
        for frame in frames:
            calibration = kitti.read_calibration(training / f"calib/{frame:06d}.txt")
            labels = kitti.read_labels(
                part / f"{frame:06d}.txt",
                calibration=calibration,
                scores=part.name == "boxes",
            )
            assert labels.boxes[0] == pytest.approx(box, abs=1e-3)
    read = pi.Detections.from_kitti(tmp_path / "boxes", training.parent)
    again = read.save(tmp_path / "again", frames, training.parent)
    for frame in frames:
        name = f"{frame:06d}.txt"
        assert (again / name).read_bytes() == (tmp_path / "boxes" / name).read_bytes()


@pytest.mark.parametrize(
    ("word", "name"),
    [
        *((word, "") for word in ("", " ", "-1", "-1.0", "NaN", "nan", "None", None, "NULL", -1.0)),
        *((word, "7") for word in ("7", "7.0", "7.", "007", 7, 7.0)),
        ("1.6e+18", "1600000000000000000"),
        *((word, word) for word in ("a1-uuid", "7.5", "12e4", "0e1", "car/-1", "1" * 5000)),
    ],
)
def test_equal_ids_of_tracks_have_one_name(word: object, name: str) -> None:
    assert track_name(word) == name


def table_of(ids: list[list[str]]) -> str:
    """Returns a table with a box for each id of each frame."""
    rows = [
        f"{4 + k},{word},car,{10 * j},0,-5.25,4.5,1.9,1.5,0"
        for k, words in enumerate(ids)
        for j, word in enumerate(words)
    ]
    return "\n".join(["frame,id,class,x,y,z,length,width,height,yaw", *rows]) + "\n"


IDS = [["-1.0", "NaN", "7", "9", "9"], ["-1", "", "9.0", "7.0", "a"], ["nan", "None", "9", "a"]]


@pytest.mark.parametrize("kind", ["csv", "json"])
def test_unknown_and_repeated_ids_join_no_boxes(kind: str, tmp_path: Path) -> None:
    """Table programs write -1.0 and 7.0 if a column of ids has an empty cell."""
    write_clouds(tmp_path / "source")
    if kind == "csv":
        (tmp_path / "boxes.csv").write_text(table_of(IDS))
    else:
        (tmp_path / "labels").mkdir()
        box = {"3d_location": dict.fromkeys("xyz", 1), "3d_dimensions": dict.fromkeys("lwh", 2)}
        for name, words in zip(FRAMES, IDS, strict=True):
            entries = [{"type": "Car", "track_id": word, **box, "rotation": 0} for word in words]
            (tmp_path / f"labels/{name}.json").write_text(json.dumps(entries))
    labels = tmp_path / ("boxes.csv" if kind == "csv" else "labels")
    recording = reader("pcd")(tmp_path / "source", Options(labels=labels))
    first, second, third = (recording.read(k).boxes.ids.tolist() for k in range(3))
    assert first[2] == second[3]
    assert (second[2], second[4]) == (third[2], third[3])
    known = [*first, *second[2:3], *second[4:]]
    unknown = [*first[:2], *second[:2], *third[:2]]
    if kind == "csv":
        assert set(unknown) == {-1}
        known = known[2:]
    else:
        known += [*second[:2], *third[:2]]
    assert len(set(known)) == len(known)  # the repeated 9 has two ids, and neither is that of 9
    facts = LidarFacts("pole", "junction")
    import_recording(tmp_path / "source", "pcd", tmp_path / "a/b", facts, Options(labels=labels))


def test_a_repeated_id_in_a_text_file_is_refused_with_its_line(tmp_path: Path) -> None:
    row = "1 2 3 4 2 1.5 0 Car 7 0.5\n"
    (tmp_path / "a.txt").write_text(row + row.replace(" 7 ", " -1 ") * 2 + row)
    with pytest.raises(FormatError, match=r"a.txt:4: id: expected each id once"):
        read_boxes(tmp_path / "a.txt")


def marked(folder: Path) -> None:
    """Writes a byte order mark into all text files of a folder."""
    for file in folder.rglob("*"):
        if file.suffix in (".json", ".csv", ".txt", ".yaml"):
            file.write_bytes(b"\xef\xbb\xbf" + file.read_bytes().removeprefix(b"\xef\xbb\xbf"))


@pytest.mark.parametrize("name", [*KINDS, *PUBLIC, "nuscenes"])
def test_files_may_begin_with_a_byte_order_mark(name: str, motorway: Path, tmp_path: Path) -> None:
    """Editors of Windows write this mark."""
    if name in KINDS:
        options = KINDS[name](tmp_path / "set")
        source, kind = tmp_path / "set" / ("clouds" if options.labels else ""), "pcd"
    else:
        source, kind, options = made(name, motorway, tmp_path), name, Options()
    plain = reader(kind)(source, options)
    boxes = [plain.read(i).boxes for i in range(len(plain.names))]
    marked(tmp_path)
    again = reader(kind)(source, options)
    for i, before in enumerate(boxes):
        after = again.read(i).boxes
        assert np.array_equal(after.boxes, before.boxes)
        assert np.array_equal(after.names, before.names)
    assert again.pose == plain.pose


def recording_of(numbers: dict[str, int], folder: Path) -> Path:
    """Writes a recording whose clouds (keys) have the numbers of frames."""
    for number in numbers.values():
        labels = kitti.Labels(np.empty(0, dtype=np.str_), np.empty((0, 7)), None)
        kitti.write_frame(folder, number, road(number, 300), labels)
    rows = "".join(f"{number},{name}\n" for name, number in numbers.items())
    (folder / "sources.csv").write_text(f"frame,source\n{rows}")
    return folder


@pytest.mark.parametrize("word", ["1", "000001", "1.0", "01"])
def test_a_number_of_two_frames_is_refused(word: str, tmp_path: Path) -> None:
    """The cloud 000001 is frame 2, and frame 1 is the cloud 000000."""
    lidar = recording_of({"000000": 1, "000001": 2}, tmp_path / "data/pole")
    header = "frame,class,x,y,z,length,width,height,yaw\n"
    table = tmp_path / "boxes.csv"
    table.write_text(f"{header}{word},Car,{ROW}\n")
    with pytest.raises(FormatError, match=r"boxes.csv:2: frame: .* a number that fits one frame"):
        pi.Detections.from_csv(table, lidar)
    table.write_text(f"{header}000001.pcd,Car,{ROW}\n2,Car,{ROW}\n0,Car,{ROW}\n")
    assert pi.Detections.from_csv(table, lidar).frame.tolist() == [2, 2, 1]


def test_a_number_of_two_clouds_is_refused(tmp_path: Path) -> None:
    write_clouds(tmp_path / "source")
    for old, new in zip(FRAMES, ("1", "01", "2"), strict=True):
        (tmp_path / f"source/{old}.pcd").rename(tmp_path / f"source/{new}.pcd")
    (tmp_path / "boxes.csv").write_text(table_of([["7"]]).replace("\n4,", "\n1,"))
    with pytest.raises(FormatError, match=r"boxes.csv:2: frame: .* a number that fits one frame"):
        reader("pcd")(tmp_path / "source", Options(labels=tmp_path / "boxes.csv"))
    one_open_label(tmp_path, {"001": {}})
    with pytest.raises(FormatError, match=r"frame 001: expected a number that fits one cloud"):
        reader("pcd")(tmp_path / "source", Options(labels=tmp_path / "labels.json"))
