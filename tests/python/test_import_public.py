"""Layouts of public roadside data sets, tested with hand-made files."""

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pyinfra.core.errors import FormatError
from pyinfra.exchange.data_set import LidarFacts
from pyinfra.exchange.imports import import_recording, warnings
from pyinfra.exchange.recording import Options
from pyinfra.formats import kitti
from pyinfra.formats.pcd_file import write_pcd

FACTS = LidarFacts("pole", "junction")
LEAN = (math.radians(9), math.radians(-3))  # pitch, roll
TIMES = ("1693908913.282000", "1693908913.382000", "1693908913.482000")
TUM_TIMES = ("1651673050_454284855", "1651673050_554284855", "1651673050_654284855")
LIDAR = "s110_lidar_ouster_south"


def leaning(lean: tuple[float, float]) -> np.ndarray:
    """Returns T_levelled_sensor: (3, 3)."""
    return Rotation.from_euler("ZYX", [0, *lean]).as_matrix()


def truth(motorway: Path, frame: int) -> kitti.Labels:
    return kitti.read_labels(kitti.frame_file(motorway / "livox_avia", "label_2", frame))


def write_cloud(
    file: Path, motorway: Path, frame: int, lean: tuple[float, float] = (0.0, 0.0)
) -> None:
    """Writes a frame in the sensor's own frame of reference, with intensities up to 255."""
    points = kitti.read_points(kitti.frame_file(motorway / "livox_avia", "velodyne", frame))
    xyz = points[:, :3] @ leaning(lean)
    kind = [(name, "<f4") for name in ("x", "y", "z", "intensity")]
    records = np.zeros(len(points), dtype=kind)
    for i, name in enumerate(("x", "y", "z")):
        records[name] = xyz[:, i]
    records["intensity"] = np.rint(255 * points[:, 3])
    file.parent.mkdir(parents=True, exist_ok=True)
    write_pcd(file, records)


def objects(labels: kitti.Labels, lean: tuple[float, float], **more: Any) -> list[dict[str, Any]]:
    """Returns objects as in DAIR-V2X and RCooper. Some of their files have numbers as text."""
    entries = []
    for i, (x, y, z, length, width, height, heading) in enumerate(labels.boxes):
        cx, cy, cz = np.array([x, y, z]) @ leaning(lean)
        ahead = np.array([math.cos(heading), math.sin(heading), 0]) @ leaning(lean)
        entries.append(
            {
                "type": "Car",
                "occluded_state": 1,
                "3d_dimensions": {"h": str(height), "w": width, "l": length},
                "3d_location": {"x": cx, "y": cy, "z": cz},
                "rotation": math.atan2(ahead[1], ahead[0]),
                "track_id": 100 + i,
                **more,
            }
        )
    return entries


def write_json(file: Path, content: object) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(json.dumps(content))


def dair(motorway: Path, top: Path) -> Path:
    side = top / "single-infrastructure-side"
    infos = []
    for i in range(3):
        write_cloud(side / f"velodyne/{i:06d}.pcd", motorway, i)
        write_json(side / f"label/virtuallidar/{i:06d}.json", objects(truth(motorway, i), (0, 0)))
        stamp = str(1626155123_000000 + (2, 0, 1)[i] * 100_000)
        infos.append({"pointcloud_path": f"velodyne/{i:06d}.pcd", "pointcloud_timestamp": stamp})
    write_json(side / "data_info.json", infos)
    return top


def rcooper(motorway: Path, top: Path) -> Path:
    for i, time in enumerate(TIMES):
        write_cloud(top / f"data/106-105/105/seq-0/lidar/{time}.pcd", motorway, i, LEAN)
        labels = objects(truth(motorway, i), LEAN)
        write_json(top / f"label/106-105/105/seq-0/{time}.json", labels)
    turn = Rotation.from_euler("ZYX", [0.5, *LEAN]).as_matrix().tolist()
    pose = {"rotation": turn, "translation": [10.0, 20.0, 6.0]}
    write_json(top / "calib/lidar2world/105.json", pose)
    return top / "data/106-105/105/seq-0"


def tumtraf(motorway: Path, top: Path) -> Path:
    for i, time in enumerate(TUM_TIMES):
        name = f"{time}_{LIDAR}"
        write_cloud(top / f"point_clouds/{LIDAR}/{name}.pcd", motorway, i, LEAN)
        labels, entries = truth(motorway, i), {}
        for j, (x, y, z, *size, heading) in enumerate(labels.boxes):
            turn = leaning(LEAN).T @ Rotation.from_euler("Z", heading).as_matrix()
            position = np.array([x, y, z]) @ leaning(LEAN)
            val = [*position, *Rotation.from_matrix(turn).as_quat(), *size]
            occluded = {"name": "occlusion_level", "val": "PARTIALLY_OCCLUDED"}
            cuboid = {"name": "shape3D", "val": val, "attributes": {"text": [occluded]}}
            kind = "TRAILER" if j == 0 else "CAR"
            entries[f"uuid-{j}"] = {"object_data": {"type": kind, "cuboid": cuboid}}
        frames = {"0": {"frame_properties": {}, "objects": entries}}
        write_json(
            top / f"labels_point_clouds/{LIDAR}/{name}.json", {"openlabel": {"frames": frames}}
        )
    return top


LAYOUTS = {"dair-v2x": dair, "rcooper": rcooper, "tumtraf": tumtraf}


@pytest.mark.parametrize("layout", LAYOUTS)
def test_clouds_and_boxes_stand_upright(layout: str, motorway: Path, tmp_path: Path) -> None:
    source = LAYOUTS[layout](motorway, tmp_path / "set")
    summary, labelled = import_recording(source, layout, tmp_path / "in/pole", FACTS, Options())
    assert labelled
    assert summary.frames == 3
    order = (1, 2, 0) if layout == "dair-v2x" else (0, 1, 2)
    # For tumtraf, the import estimates the road's plane to a tenth of a degree. The other layouts
    # contain the tilt of the LiDAR.
    off = 0.002 if layout == "tumtraf" else 1e-5
    for new, old in enumerate(order):
        want = truth(motorway, old)
        imported = kitti.read_objects(kitti.frame_file(tmp_path / "in/pole", "objects", new))
        far = np.hypot(want.boxes[:, 0], want.boxes[:, 1]).max(initial=1)
        assert np.abs(imported.boxes[:, :6] - want.boxes[:, :6]).max() < off * far + 1e-3
        assert np.abs(np.sin((imported.boxes[:, 6] - want.boxes[:, 6]) / 2)).max() < 0.01
        assert set(imported.names) <= {"Car", "vehicle"}
        assert set(imported.visibility) == {0.6}
        cloud = kitti.frame_file(motorway / "livox_avia", "velodyne", old)
        points = kitti.read_points(kitti.frame_file(tmp_path / "in/pole", "velodyne", new))
        apart = np.abs(points[:, :3] - kitti.read_points(cloud)[:, :3]).max()
        assert apart < 250 * off + 1e-3
        assert points[:, 3].max() <= 1
    assert not warnings(summary, labelled)


def test_what_is_known_of_time_and_place(motorway: Path, tmp_path: Path) -> None:
    for layout, make in LAYOUTS.items():
        source = make(motorway, tmp_path / layout)
        out = tmp_path / f"in_{layout}/pole"
        summary, _ = import_recording(source, layout, out, FACTS, Options())
        assert kitti.read_lidar(out).period_s == pytest.approx(0.1)
        assert any("out of order" in line for line in summary.assumed) == (layout == "dair-v2x")
    pose = kitti.read_lidar(tmp_path / "in_rcooper/pole").T_world_levelled
    assert (pose.x, pose.y, pose.z, pose.yaw) == pytest.approx((10, 20, 6, 0.5))
    for layout in ("rcooper", "tumtraf"):
        tilt = kitti.read_tilt(tmp_path / f"in_{layout}/pole")
        assert (tilt.pitch, tilt.roll) == pytest.approx(LEAN, abs=0.002)
    height = kitti.read_lidar(tmp_path / "in_tumtraf/pole").T_world_levelled.z
    assert height == pytest.approx(6, abs=0.02)


@pytest.mark.parametrize("height_m", [None, 5.9])
def test_the_height_is_that_above_the_road(
    height_m: float | None, motorway: Path, tmp_path: Path
) -> None:
    """The world of the recording begins at sea level."""
    source = rcooper(motorway, tmp_path / "set")
    file = tmp_path / "set/calib/lidar2world/105.json"
    pose = json.loads(file.read_text())
    write_json(file, pose | {"translation": [10.0, 20.0, 31.0]})
    facts = LidarFacts("pole", "junction", height_m=height_m)
    summary, _ = import_recording(source, "rcooper", tmp_path / "in/pole", facts, Options())
    z = kitti.read_lidar(tmp_path / "in/pole").T_world_levelled.z
    assert z == pytest.approx(height_m or 6.0, abs=0.02)
    said = any("the sensor is at z = 31.00 m in the world" in note for note in summary.assumed)
    assert said == (height_m is None)


def test_names_of_the_sets_and_those_that_are_not_understood(
    motorway: Path, tmp_path: Path
) -> None:
    source = dair(motorway, tmp_path / "set")
    kinds = ["Car", "Van", "Truck", "Bus", "Motorcyclist", "Tricyclist", "CarIgnore", "Tank"]
    first = objects(truth(motorway, 0), (0, 0))[0]
    file = source / "single-infrastructure-side/label/virtuallidar/000000.json"
    write_json(file, [{**first, "type": kind} for kind in kinds])
    summary, labelled = import_recording(source, "dair-v2x", tmp_path / "in/p", FACTS, Options())
    imported = kitti.read_objects(kitti.frame_file(tmp_path / "in/p", "objects", 2))
    assert imported.names.tolist() == [*kinds[:4], "Motorcycle", "Misc", "Misc", "Tank"]
    (line,) = warnings(summary, labelled)
    assert line.startswith("unknown classes, which do not count as vehicles: Tank (1)")


def with_first(change: Callable[[dict[str, Any]], object]) -> Callable[[Any], Any]:
    def changed(content: Any) -> Any:
        change(content[0])
        return content

    return changed


WRONG: dict[str, tuple[Callable[[Any], Any], str]] = {
    "no list": (lambda c: {"a": 1}, "expected a list of objects"),
    "no size": (
        with_first(lambda o: o.pop("3d_dimensions")),
        "object 0: expected the key '3d_dimensions', got none",
    ),
    "no number": (
        with_first(lambda o: o["3d_location"].update(x="far")),
        r"object 0: 3d_location\.x: expected a finite number, got 'far'",
    ),
    "flat": (with_first(lambda o: o["3d_dimensions"].update(h=0)), "expected sizes above 0.001 m"),
    "degrees": (
        with_first(lambda o: o.update(rotation=90)),
        "rotation: expected -2 pi to 2 pi rad, got 90",
    ),
    "no rotation": (
        with_first(lambda o: o.update(rotation=None)),
        "rotation: expected a finite number, got 'None'",
    ),
}


@pytest.mark.parametrize("case", WRONG)
def test_wrong_objects_are_named(case: str, motorway: Path, tmp_path: Path) -> None:
    change, message = WRONG[case]
    source = dair(motorway, tmp_path / "set")
    file = source / "single-infrastructure-side/label/virtuallidar/000001.json"
    write_json(file, change(json.loads(file.read_text())))
    with pytest.raises(FormatError, match=f"000001.json: .*{message}"):
        import_recording(source, "dair-v2x", tmp_path / "in/p", FACTS, Options(), strict=True)
    assert not (tmp_path / "in/p").exists()


@pytest.mark.parametrize("case", ["no size", "no number", "flat", "no rotation"])
def test_a_wrong_object_is_left_out_alone(case: str, motorway: Path, tmp_path: Path) -> None:
    source = dair(motorway, tmp_path / "set")
    import_recording(source, "dair-v2x", tmp_path / "whole/p", FACTS, Options())
    file = source / "single-infrastructure-side/label/virtuallidar/000001.json"
    write_json(file, WRONG[case][0](json.loads(file.read_text())))
    summary, labelled = import_recording(source, "dair-v2x", tmp_path / "in/p", FACTS, Options())
    assert len(summary.left_out) == 1
    assert file.name in summary.left_out[0]
    assert any("left out 1 objects" in line for line in warnings(summary, labelled))
    whole, less = (
        kitti.read_objects(kitti.frame_file(tmp_path / name, "objects", 0))
        for name in ("whole/p", "in/p")
    )
    assert np.array_equal(whole.boxes[1:], less.boxes)


def test_a_bad_frame_is_skipped_and_counted(motorway: Path, tmp_path: Path) -> None:
    source = dair(motorway, tmp_path / "set")
    file = source / "single-infrastructure-side/velodyne/000001.pcd"
    file.write_bytes(file.read_bytes()[:-7])
    with pytest.raises(FormatError, match="`skip_bad` leaves out"):
        import_recording(source, "dair-v2x", tmp_path / "in/p", FACTS, Options())
    summary, _ = import_recording(
        source, "dair-v2x", tmp_path / "in/p", FACTS, Options(), skip_bad=True
    )
    assert (summary.frames, len(summary.bad)) == (2, 1)
    assert kitti.frames(tmp_path / "in/p") == [1, 2]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("[", "cannot be read as JSON"),
        ("{}", "expected openlabel.frames with objects, got none"),
        (
            '{"openlabel": {"frames": {"0": {}, "1": {}}}}',
            "expected one frame in a label file, got 2",
        ),
        (
            '{"openlabel": {"frames": {"0": {"objects": {"a": {"object_data": {}}}}}}}',
            "object a: expected a cuboid of ten numbers, got none",
        ),
        (
            '{"openlabel": {"frames": {"0": {"objects": {"a": {"object_data": {"cuboid": {"val": '
            "[1, 2, 3, 0, 0, 0, 0, 4, 2, 2]}}}}}}}}",
            "expected a quaternion of length 1",
        ),
    ],
)
def test_wrong_cuboids_are_named(
    content: str, message: str, motorway: Path, tmp_path: Path
) -> None:
    source = tumtraf(motorway, tmp_path / "set")
    file = source / f"labels_point_clouds/{LIDAR}/{TUM_TIMES[0]}_{LIDAR}.json"
    file.write_text(content)
    with pytest.raises(FormatError, match=f"{file.name}: .*{message}"):
        import_recording(source, "tumtraf", tmp_path / "in/p", FACTS, Options(), strict=True)


def test_one_of_several_lidars_is_chosen(motorway: Path, tmp_path: Path) -> None:
    source = tumtraf(motorway, tmp_path / "set")
    write_cloud(source / "point_clouds/north/1651673050_454284855_north.pcd", motorway, 0)
    with pytest.raises(ValueError, match=f"expected one LiDAR, got the LiDARs north, {LIDAR}; "):
        import_recording(source, "tumtraf", tmp_path / "in/p", FACTS, Options())
    chosen = Options(channel=LIDAR)
    assert import_recording(source, "tumtraf", tmp_path / "in/p", FACTS, chosen)[0].frames == 3


def test_without_labels_the_clouds_come_alone(motorway: Path, tmp_path: Path) -> None:
    source = rcooper(motorway, tmp_path / "set")
    (tmp_path / "set/label").rename(tmp_path / "elsewhere")
    summary, labelled = import_recording(source, "rcooper", tmp_path / "in/p", FACTS, Options())
    assert (summary.frames, labelled) == (3, False)
