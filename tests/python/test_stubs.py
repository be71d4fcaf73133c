"""The checked-in stub agrees with the built extension."""

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def test_stub_is_what_make_stubs_writes(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "pybind11_stubgen", "pyinfra._core", "-o", str(tmp_path)]
    subprocess.run(command, check=True, cwd=ROOT)
    written = (tmp_path / "pyinfra/_core.pyi").read_text()
    assert written == (ROOT / "pyinfra/_core.pyi").read_text()
