"""`infrasim static` and the key `static_layers` give the same frames without casting the scene."""

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml

from pyinfra.dataset import simulation

ROOT = Path(__file__).resolve().parents[2]
LIDARS = ROOT / "configs/lidars"
SHORT = ("--set", "duration_s=3", "traffic.warm_up_s=10")
FRAMES = ("velodyne", "label_2", "objects", "fields")

Infrasim = Callable[..., Any]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, infrasim: Infrasim) -> Path:
    """Writes a scene, the layers of a LiDAR under the scene's two presets, and a scene that names
    these layers."""
    folder = tmp_path_factory.mktemp("scenes")
    text = (ROOT / "configs/scenes/curve.yaml").read_text()
    (folder / "curve.yaml").write_text(text)
    for preset in ("equal", "datasheet"):
        words = ["--lidar", LIDARS / "helios_16.yaml", "--preset", preset, *SHORT]
        layer = folder / f"{preset}.layer"
        made = infrasim("static", folder / "curve.yaml", *words, "--out", layer)
        assert made.returncode == 0, made.stderr
        assert made.stdout.startswith("28800 rays, ")
        assert layer.read_bytes().startswith(b"infrasim-static-layer 2\n")
        named = text + f"static_layers: {{helios_16: {preset}.layer}}\n"
        (folder / f"{preset}.yaml").write_text(named)
    return folder


def run(infrasim: Infrasim, scene: Path, preset: str, out: Path, *more: str) -> Any:
    words = ["--lidar", LIDARS / "helios_16.yaml", "--preset", preset, "--frames", "0:6"]
    return infrasim("run", scene, *words, "--fields", "--out", out, *more, *SHORT)


def digests(data: Path) -> dict[str, str]:
    files = [f for part in FRAMES for f in (data / "helios_16/training" / part).iterdir()]
    return {
        str(f.relative_to(data)): hashlib.sha256(f.read_bytes()).hexdigest() for f in sorted(files)
    }


@pytest.mark.parametrize("preset", ["equal", "datasheet"])
def test_a_layer_gives_the_bytes_of_the_scene_that_it_was_cast_in(
    folder: Path, infrasim: Infrasim, tmp_path: Path, preset: str
) -> None:
    runs = {
        "cast": (folder / "curve.yaml", "1"),
        "read": (folder / f"{preset}.yaml", "1"),
        "threads": (folder / f"{preset}.yaml", "2"),
    }
    hashes = {}
    for name, (scene, threads) in runs.items():
        done = run(infrasim, scene, preset, tmp_path / name, "--threads", threads)
        assert done.returncode == 0, done.stderr
        hashes[name] = digests(tmp_path / name)
    assert len(hashes["cast"]) == 24
    assert hashes["cast"] == hashes["read"] == hashes["threads"]


def test_what_stands_still_is_cast_without_trajectories(
    folder: Path, infrasim: Infrasim, tmp_path: Path
) -> None:
    """Before the fix, `static` simulated all traffic, and a scene of an hour needed 260 MB."""
    keys = yaml.safe_load((folder / "curve.yaml").read_text())
    del keys["traffic"]
    scene = tmp_path / "curve.yaml"
    scene.write_text(yaml.safe_dump(keys | {"trajectories": "none.csv"}))
    lidar = ["--lidar", LIDARS / "helios_16.yaml", "--preset", "datasheet"]
    made = infrasim("static", scene, *lidar, "--out", tmp_path / "layer")
    assert made.returncode == 0, made.stderr
    assert (tmp_path / "layer").read_bytes() == (folder / "datasheet.layer").read_bytes()


def test_the_stream_of_python_reads_the_layer(folder: Path) -> None:
    short = {"duration_s": 3, "traffic.warm_up_s": 10}
    lidar = simulation.load_lidar(LIDARS / "helios_16.yaml", "datasheet")
    streams = []
    for name in ("curve", "datasheet"):
        world = simulation.load_scene(folder / f"{name}.yaml", set=short)
        streams.append(
            [
                simulation.points(f).tobytes()
                for _, (f,) in simulation.simulate(world, [lidar], range(4))
            ]
        )
    assert streams[0] == streams[1]
    world = simulation.load_scene(folder / "equal.yaml", set=short)
    with pytest.raises(
        ValueError, match=r"equal\.layer: unit 0: max_range_m: expected 180, .*, got 260"
    ):
        list(simulation.simulate(world, [lidar], range(1)))


def test_check_shows_the_key_and_reads_the_file(folder: Path, infrasim: Infrasim) -> None:
    shown = infrasim("check", folder / "datasheet.yaml")
    assert 'static_layers:\n  helios_16: "datasheet.layer"\n' in shown.stdout
    cut = folder / "cut.layer"
    cut.write_bytes((folder / "datasheet.layer").read_bytes()[:-1])
    refused = infrasim(
        "check", folder / "datasheet.yaml", "--set", "static_layers.helios_16=cut.layer"
    )
    assert refused.returncode == 2
    assert (
        "cut.layer: byte 288103: expected 1 bytes more, got the end of the file" in refused.stderr
    )
    missing = infrasim("check", folder / "datasheet.yaml", "--set", "static_layers.helios_16=no")
    assert missing.returncode == 1
    assert f"{folder / 'no'}: can't be read" in missing.stderr


def test_a_folder_is_of_one_layer(folder: Path, infrasim: Infrasim, tmp_path: Path) -> None:
    layer, scene = tmp_path / "datasheet.layer", tmp_path / "scene.yaml"
    scene.write_text((folder / "datasheet.yaml").read_text())
    whole = (folder / "datasheet.layer").read_bytes()
    layer.write_bytes(whole)
    assert run(infrasim, scene, "datasheet", tmp_path / "data").returncode == 0
    assert run(infrasim, scene, "datasheet", tmp_path / "data").returncode == 0
    changed = bytearray(whole)
    changed[-2] = 4 if whole[-2] != 4 else 3  # the class of the last ray
    layer.write_bytes(bytes(changed))
    refused = run(infrasim, scene, "datasheet", tmp_path / "data")
    assert refused.returncode == 1
    assert "the folder holds another run: it has 'static_layer: " in refused.stderr


def test_a_layer_is_of_one_mount_and_of_one_scene(
    folder: Path, infrasim: Infrasim, tmp_path: Path
) -> None:
    """Before the check, a layer that was made at z 6 gave a wrong ground and no vehicles at z
    12."""
    scene, out = folder / "datasheet.yaml", tmp_path / "data"
    moved = ("--set", "mounts.pole.z_m=12")
    for refused in (
        infrasim("check", scene, *moved),
        run(infrasim, scene, "datasheet", out, *moved),
        run(infrasim, scene, "datasheet", out, "--set", "ground=[]"),
    ):
        assert refused.returncode == 2
        assert f"{folder / 'datasheet.layer'}: " in refused.stderr
    with pytest.raises(ValueError, match=r"datasheet\.layer: mounts\.z_m: expected 6"):
        simulation.load_scene(scene, set={"mounts.pole.z_m": 12})
    assert not list(out.rglob("*.bin"))


def test_what_a_file_holds_is_not_cast(folder: Path, infrasim: Infrasim, tmp_path: Path) -> None:
    refused = run(infrasim, folder / "equal.yaml", "equal", tmp_path / "data", "--cast-all")
    assert refused.returncode == 2
    assert "--cast-all: expected" in refused.stderr
    assert "got static_layers.helios_16" in refused.stderr


def test_lidars_that_never_repeat_have_no_layer(infrasim: Infrasim, tmp_path: Path) -> None:
    out = tmp_path / "avia.layer"
    refused = infrasim("static", "highway", "--lidar", "livox_avia", "--out", out)
    assert refused.returncode == 2
    assert "livox_avia, preset datasheet: unit 0: expected" in refused.stderr
    assert "got a pattern that never repeats" in refused.stderr
    assert not out.exists()


def test_a_recording_of_the_empty_site_gives_a_layer(
    folder: Path, infrasim: Infrasim, tmp_path: Path
) -> None:
    scene, data = folder / "curve.yaml", tmp_path / "data"
    empty = ("--set", "traffic.vehicles_per_km_lane=0", "duration_s=3", "vegetation=[]")
    words = ["--lidar", LIDARS / "helios_16.yaml"]
    done = infrasim("run", scene, *words, "--frames", "0:20", "--fields", "--out", data, *empty)
    assert done.returncode == 0, done.stderr
    words += ["--recording", data / "helios_16", "--out", tmp_path / "a.layer"]
    made = infrasim("static", scene, *words, *empty)
    assert made.returncode == 0, made.stderr
    assert made.stdout.startswith("20 frames, largest difference of elevations 0.000 degrees\n")
    assert (
        "assumes that the pose of the sensor is that of the mount (x_m -30, y_m 10, z_m 6,"
        in made.stdout
    )
    (data / "helios_16/training/velodyne/000003.bin").unlink()
    refused = infrasim("static", scene, *words, *empty)
    assert refused.returncode == 2
    assert "expected 20 or more frames, got 19" in refused.stderr
