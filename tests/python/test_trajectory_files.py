"""Python reads the trajectories of any scene, also with instants without objects."""

import ctypes
import os
from pathlib import Path

import numpy as np
import pytest
import yaml
from conftest import Infrasim

from pyinfra.core.errors import FormatError
from pyinfra.dataset import simulation
from pyinfra.dataset.frame_tables import Vehicles
from pyinfra.dataset.object_rows import scene_objects
from pyinfra.dataset.trajectories import read_objects_at, read_rows
from pyinfra.formats.kitti import WorldPose

HEADER = "t,id,class,x,y,z,heading,dx,dy,dz,speed\n"
NOBODY = ",,,,,,,,,,\n"
CAR = ",7,Car,{x},2,0.75,0,4.5,1.9,1.5,10\n"
LEVEL = WorldPose(0, 0, 0, 0)
LIDAR = Path(__file__).resolve().parents[2] / "configs/lidars/helios_16.yaml"
FRAMES = 60
# A straight road. Its only objects move on a short line beside it.
PEOPLE_ALONE = {
    "name": "walk",
    "duration_s": FRAMES / 10,
    "detail": "box",
    "mounts": {"pole": {"x_m": 0, "y_m": 0, "z_m": 6}},
    "roads": [
        {
            "name": "road",
            "start": {"x_m": -200, "y_m": 0},
            "centreline": [{"line_m": 400}],
            "lanes": {"each_way": 1},
        }
    ],
    "traffic": {
        "vehicles_per_km_lane": 0,
        "warm_up_s": 0,
        "speed": {"mean_km_h": 30, "std_km_h": 2},
        "class_shares": {"Car": 1},
    },
    "people": [
        {
            "road": "road",
            "class": "Pedestrian",
            "offset_m": 8,
            "from_m": 188,
            "to_m": 192,
            "per_km": 60,
            "speed": {"mean_km_h": 5, "std_km_h": 1},
        }
    ],
}


def file_of(folder: Path, *rows: str) -> Path:
    file = folder / "trajectories.csv"
    file.write_text(HEADER + "".join(rows))
    return file


def in_frame(objects: Vehicles, frame: int) -> list[tuple[int, str]]:
    at = objects.frame == frame
    return [*zip(objects.ids[at].tolist(), objects.names[at].tolist(), strict=True)]


def test_rows_of_their_time_alone_are_instants_without_objects(tmp_path: Path) -> None:
    middle = [f"{t}" + CAR.format(x=10 * t) for t in (0.2, 0.3, 0.4)]
    file = file_of(tmp_path, "0" + NOBODY, *middle, "0.6" + NOBODY)
    objects = read_objects_at(file, range(6), LEVEL)
    assert [in_frame(objects, k) for k in range(6)] == [[], [], [(7, "Car")], [(7, "Car")], [], []]
    np.testing.assert_allclose(objects.boxes[:, 0], [2.5, 3.5])
    assert len(read_rows(file, ["t", "id", "x", "y"])) == 3
    without = read_objects_at(file_of(tmp_path, *middle), range(6), LEVEL)
    np.testing.assert_array_equal(objects.boxes, without.boxes)


@pytest.mark.parametrize("rows", [[], ["0" + NOBODY, "0.5" + NOBODY]])
def test_a_file_without_objects_has_none(rows: list[str], tmp_path: Path) -> None:
    objects = read_objects_at(file_of(tmp_path, *rows), range(5), LEVEL)
    assert len(objects.ids) == 0
    assert objects.boxes.shape == (0, 7)


def test_a_row_with_a_part_of_its_cells_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match=r"trajectories\.csv:3: "):
        read_objects_at(file_of(tmp_path, "0" + NOBODY, "0.1,7,Car\n"), range(1), LEVEL)


@pytest.mark.nightly
def test_trajectories_of_people_alone_are_read_by_python_and_by_a_run(
    tmp_path: Path, infrasim: Infrasim
) -> None:
    """Before the fix, files whose first or last instants are empty were refused."""
    blank = 0
    for seed in range(1, 7):
        keys = PEOPLE_ALONE | {"seed": seed}
        scene, file = tmp_path / "walk.yaml", tmp_path / f"{seed}.csv"
        scene.write_text(yaml.safe_dump(keys))
        written = infrasim("trajectories", scene, "--out", file)
        assert written.returncode == 0, written.stderr
        blank += NOBODY in file.read_text()

        world = simulation.load_scene(scene)
        recorded = {k: v for k, v in keys.items() if k not in {"traffic", "people"}}
        again = tmp_path / "recorded.yaml"
        again.write_text(yaml.safe_dump(recorded | {"trajectories": file.name}))
        objects = read_objects_at(file, range(FRAMES), WorldPose(0, 0, 6, 0))
        for k in range(FRAMES):
            here = scene_objects(world.objects(k), k)
            assert in_frame(objects, k) == in_frame(here, k)
            np.testing.assert_allclose(
                objects.boxes[objects.frame == k], here.boxes, rtol=0, atol=1e-9
            )

        out = tmp_path / f"data_{seed}"
        run = ["--lidar", LIDAR, "--frames", "0:60:20"]
        done = infrasim("run", again, *run, "--out", out / "recorded")
        assert done.returncode == 0, done.stderr
        assert infrasim("run", scene, *run, "--out", out / "simulated").returncode == 0
        files = [
            sorted(p for p in (out / name).rglob("*.*") if p.suffix in {".bin", ".txt", ".csv"})
            for name in ("recorded", "simulated")
        ]
        assert len(files[0]) > 10
        # A run of recorded vehicles keeps all rows, and a simulated run those of its frames.
        own = {"summary.csv", "trajectories.csv"}
        for a, b in zip(*files, strict=True):
            assert a.name in own or a.read_bytes() == b.read_bytes(), a
    assert blank > 2


def test_check_reads_trajectories_once_for_presets_that_move_alike(
    tmp_path: Path, infrasim: Infrasim
) -> None:
    """Before the fix, all vehicles were simulated or read again for each preset."""
    file = tmp_path / "trajectories.csv"
    file.write_text(HEADER + "0" + NOBODY + "6" + NOBODY)
    presets = {name: {"detail": "low"} for name in ("paper", "equal", "datasheet")}
    keys = {k: v for k, v in PEOPLE_ALONE.items() if k not in {"traffic", "people"}}
    scene = tmp_path / "recorded.yaml"
    scene.write_text(yaml.safe_dump(keys | {"trajectories": file.name, "presets": presets}))
    opened, closed, bytes_of_event = 0x20, 0x10, 16  # of inotify(7)
    libc = ctypes.CDLL(None, use_errno=True)
    events = libc.inotify_init1(os.O_NONBLOCK)
    try:
        assert libc.inotify_add_watch(events, os.fsencode(file), opened | closed) >= 0
        done = infrasim("check", scene)
        masks = np.frombuffer(os.read(events, 100 * bytes_of_event), "<u4")[1::4]
    finally:
        os.close(events)
    assert done.returncode == 0, done.stderr
    assert (masks == opened).sum() == 1
