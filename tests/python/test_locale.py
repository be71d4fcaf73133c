"""A process whose locale has a decimal comma gets the same texts from the extension."""

import ast
import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
SOURCES = ROOT / "tests/data/locale"
TEXTS = """
import ctypes, locale, sys
import pyinfra as pi
from pyinfra.dataset import simulation

if sys.argv[1] != "C":
    locale.setlocale(locale.LC_NUMERIC, sys.argv[1])
text = ctypes.create_string_buffer(8)
ctypes.CDLL(None).snprintf(text, ctypes.c_size_t(8), b"%.1f", ctypes.c_double(1.5))
print(text.value.decode(), file=sys.stderr)

short = {"duration_s": 1, "traffic.warm_up_s": 5, "mounts.pole.yaw_deg": 12.5}
world = simulation.load_scene("configs/scenes/curve.yaml", set=short)
lidar = simulation.load_lidar("configs/lidars/helios_16.yaml")
print(world.roads_csv(), world.regions_csv(), world.dump(), world.lidar_yaml(lidar), lidar.dump())
frames = pi.simulate(world, lidar, [3])
print(frames[0].labels.to_csv(), frames.roads[0])
try:
    world.mesh(0, 1234.5)
except ValueError as error:
    print(error)
"""


def texts(name: str, folder: Path) -> tuple[str, str]:
    """Returns the texts that a process with a locale writes, and the text that its C library prints
    for 1.5."""
    command = [sys.executable, "-c", TEXTS, name]
    environment = os.environ | {"LOCPATH": str(folder)}
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout, done.stderr.strip()


def test_texts_do_not_depend_on_the_decimal_point_of_the_process(tmp_path: Path) -> None:
    """Before the fix, lines of `World.roads_csv` had more columns than its header."""
    made = ["-f", SOURCES / "ascii", "-i", SOURCES / "decimal_comma", tmp_path / "comma"]
    # The program warns of categories that are missing in the source, and then exits with 1.
    subprocess.run(["localedef", "-c", "--no-archive", *made], capture_output=True)
    point, comma = texts("C", tmp_path), texts("comma", tmp_path)
    assert (point[1], comma[1]) == ("1.5", "1,5")
    assert point[0] == comma[0]
    assert len(point[0].splitlines()) > 300


def is_text_without_encoding(call: ast.Call) -> bool:
    """Returns whether a call reads or writes text in the encoding of the locale."""
    name = call.func.attr if isinstance(call.func, ast.Attribute) else getattr(call.func, "id", "")
    owner = ast.unparse(call.func).rpartition(".")[0]
    if owner in ("os", "bz2", "gzip", "laspy", "Image", "self._reader"):
        return False
    modes = [a.value for a in call.args if isinstance(a, ast.Constant)]
    if any(key.arg == "encoding" for key in call.keywords):
        return False
    if name == "open":
        return not any("b" in str(mode) for mode in modes)
    return len(call.args) == {"read_text": 0, "write_text": 1}.get(name)


def test_text_files_do_not_depend_on_the_encoding_of_the_locale() -> None:
    """Names with letters beyond ASCII, in any locale, are those of the file."""
    found = [
        f"{file.relative_to(ROOT)}:{node.lineno}"
        for file in sorted((ROOT / "pyinfra").rglob("*.py"))
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8")))
        if isinstance(node, ast.Call) and is_text_without_encoding(node)
    ]
    assert found == []
