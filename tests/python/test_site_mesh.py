"""Surfaces from other tools in a site: at the given positions, or refused with a reason."""

import shutil
from pathlib import Path

import numpy as np
import pytest
import yaml
from conftest import Infrasim

from pyinfra.cli.main import main
from pyinfra.formats.ply import read_ply

trimesh = pytest.importorskip("trimesh", reason="needs the extra `site`")

SCENE = """name: corner
mounts:
  pole: {x_m: 12, y_m: 12, z_m: 6}
roads:
  - name: main
    start: {x_m: -100, y_m: 0}
    centreline: [{line_m: 200}]
    lanes: {each_way: 1}
# surfaces of the map
meshes:
  - {file: meshes/road.ply, material: road}  # paved
duration_s: 1
traffic: {vehicles_per_km_lane: 5, speed: {mean_km_h: 40, std_km_h: 3}, class_shares: {Car: 1}}
"""


@pytest.fixture
def site(tmp_path: Path) -> Path:
    folder = tmp_path / "corner"
    (folder / "meshes").mkdir(parents=True)
    (folder / "site.yaml").write_text(SCENE)
    sheet = trimesh.Trimesh([[-9, -9, -1], [9, -9, -1], [0, 9, -1]], [[0, 1, 2]])
    sheet.export(folder / "meshes/road.ply")
    return folder


def house(folder: Path, name: str) -> Path:
    """Writes a house of 20 m along x, 10 m along y and a height of 6 m, with the floor at z = 0. In
    glTF files, y is up."""
    box = trimesh.creation.box((20, 10, 6))
    box.apply_translation((0, 0, 3))
    if name.endswith((".glb", ".gltf")):
        box.apply_transform(trimesh.transformations.rotation_matrix(-np.pi / 2, (1, 0, 0)))
    if name.endswith(".gltf"):
        trimesh.Scene(box).export(folder / name, merge_buffers=True)
    else:
        box.export(folder / name)
    return folder / name


@pytest.mark.parametrize("ending", ["obj", "glb", "gltf", "stl", "ply"])
def test_a_house_stands_where_it_is_moved(site: Path, tmp_path: Path, ending: str) -> None:
    file = house(tmp_path, f"House.{ending}")
    assert main(["site", "mesh", str(file), "--out", str(site), "--offset=40,30,0"]) == 0
    mesh = read_ply(site / "meshes/house.ply")
    assert len(mesh.faces) == 12
    np.testing.assert_allclose(mesh.vertices.min(0), [30, 25, 0], atol=1e-5)
    np.testing.assert_allclose(mesh.vertices.max(0), [50, 35, 6], atol=1e-5)
    text = (site / "site.yaml").read_text()
    line = "  - {file: meshes/house.ply, material: structure}\n"
    assert text == SCENE.replace("meshes:\n", "meshes:\n" + line)


def test_triangles_face_as_they_did(site: Path, tmp_path: Path) -> None:
    """The rotation from y up to z up does not mirror the mesh, so its volume stays positive."""
    assert main(["site", "mesh", str(house(tmp_path, "a.obj")), "--out", str(site), "--up=y"]) == 0
    mesh = read_ply(site / "meshes/a.ply")
    assert trimesh.Trimesh(mesh.vertices, mesh.faces).volume == pytest.approx(1200)
    assert mesh.vertices[:, 1].min() == pytest.approx(-6)


def test_a_scene_without_meshes_gets_some(site: Path, tmp_path: Path) -> None:
    (site / "site.yaml").write_text(SCENE.partition("# surfaces")[0])
    words = ["site", "mesh", str(house(tmp_path, "a.stl")), "--out", str(site)]
    assert main([*words, "--material", "terrain"]) == 0
    scene = yaml.safe_load((site / "site.yaml").read_text())
    assert scene["meshes"] == [{"file": "meshes/a.ply", "material": "terrain"}]


def test_a_scene_may_begin_with_a_byte_order_mark(site: Path, tmp_path: Path) -> None:
    """The names in the scene may have any letters, whatever the locale is."""
    text = SCENE.replace("# surfaces", "# Straßen")
    file = site / "site.yaml"
    file.write_bytes(b"\xef\xbb\xbf" + text.encode())
    assert main(["site", "mesh", str(house(tmp_path, "a.stl")), "--out", str(site)]) == 0
    line = "  - {file: meshes/a.ply, material: structure}\n"
    assert file.read_text(encoding="utf-8") == text.replace("meshes:\n", f"meshes:\n{line}")


def test_the_simulator_takes_it(site: Path, tmp_path: Path, infrasim: Infrasim) -> None:
    file = house(tmp_path, "house.glb")
    assert main(["site", "mesh", str(file), "--out", str(site), "--offset=40,30,-0.5"]) == 0
    done = infrasim("check", site / "site.yaml")
    assert done.returncode == 0, done.stderr
    assert "meshes/house.ply" in done.stdout


def _written(file: Path, data: str | bytes) -> Path:
    file.write_bytes(data if isinstance(data, bytes) else data.encode())
    return file


TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
BROKEN = {
    "empty": ("a.obj", "", "got an empty file"),
    "no faces": ("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\n", "a.obj: "),
    "not a number": ("a.obj", TRIANGLE.replace("v 1 0 0", "v nan 0 0"), "vertex "),
    "infinite": ("a.obj", TRIANGLE.replace("v 1 0 0", "v inf 0 0"), "vertex "),
    "no such corner": ("a.obj", TRIANGLE.replace("f 1 2 3", "f 1 2 9"), "a.obj: "),
    "words": ("a.obj", TRIANGLE.replace("v 1 0 0", "v one 0 0"), "a.obj: "),
    "millimetres": ("a.obj", TRIANGLE.replace("1", "90000").replace("f 90000", "f 1"),
                    "in millimetres, set --scale to 0.001"),
    "no area": ("a.obj", TRIANGLE.replace("v 0 1 0", "v 2 0 0"), "without an area"),
    "far": ("a.obj", TRIANGLE.replace("v ", "v 40000"), "--offset moves the mesh"),
    "cut": ("a.glb", b"glTF\x02\x00\x00\x00", "cannot be read as a mesh"),
    "bytes": ("a.stl", b"\x00\xff" * 100, "a.stl: "),
    "another ending": ("a.fbx", TRIANGLE, "got '.fbx'"),
    "not JSON": ("a.gltf", "{", "cannot be read as a mesh"),
}  # fmt: skip


@pytest.mark.parametrize("what", BROKEN)
def test_a_broken_mesh_gives_one_line_and_leaves_the_site(
    what: str, site: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    name, data, expected = BROKEN[what]
    file = _written(tmp_path / name, data)
    assert main(["site", "mesh", str(file), "--out", str(site)]) == 2
    out, err = capsys.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    assert err.startswith(f"pyinfra: {file}: ")
    assert expected in err
    assert (site / "site.yaml").read_text() == SCENE
    assert [p.name for p in (site / "meshes").iterdir()] == ["road.ply"]


def test_what_is_there_stays(
    site: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = (site / "meshes/road.ply").read_bytes()
    words = ["site", "mesh", str(house(tmp_path, "road.obj")), "--out", str(site)]
    assert main(words) == 1
    assert (site / "meshes/road.ply").read_bytes() == before
    shutil.rmtree(site / "meshes")
    flow = "meshes: [{file: meshes/sheet.ply, material: road}]\n"
    (site / "site.yaml").write_text(SCENE.partition("# surfaces")[0] + flow)
    assert main(words) == 2
    assert (
        "add this entry by hand: - {file: meshes/road.ply, material: structure}"
        in capsys.readouterr().err
    )
    assert not (site / "meshes").exists()


@pytest.mark.parametrize("words", [["--scale", "0"], ["--scale", "nan"]])
def test_impossible_options_are_refused(site: Path, tmp_path: Path, words: list[str]) -> None:
    file = house(tmp_path, "a.obj")
    assert main(["site", "mesh", str(file), "--out", str(site), *words]) == 2
