"""Writes the SHA-256 of PyPI's file for each pin of scripts/constraints.txt: `make hashes`.

The files are for x86-64 Linux and each supported Python. The script also uses the indexes and
folders in this machine's pip configuration, such as an index for a CPU build of PyTorch.
"""

import json
import os
import re
import subprocess
import sys
from collections import defaultdict
from pathlib import Path
from tempfile import TemporaryDirectory

CONSTRAINTS = Path(__file__).with_name("constraints.txt")
PYTHONS = ["3.11", "3.12", "3.13"]


def normal(name: str, version: str) -> str:
    """Returns a pin with a normalised name and without a local version such as `+cpu`.

    An example is `mujoco-lidar==0.3.5`.
    """
    return re.sub(r"[-_.]+", "-", name).lower() + "==" + version.partition("+")[0]


def hashes_for(pins: list[str], python: str, environment: dict[str, str]) -> dict[str, str]:
    """Returns the SHA-256 of the file that pip would install for each pin."""
    with TemporaryDirectory() as folder:
        names, report = Path(folder, "pins.txt"), Path(folder, "report.json")
        names.write_text("\n".join(pins))
        words = ["install", "--dry-run", "--quiet", "--ignore-installed", "--no-deps"]
        words += ["--python-version", python, "--target", folder]
        words += ["--report", str(report), "-r", str(names)]
        subprocess.run([sys.executable, "-m", "pip", *words], check=True, env=environment)
        items = json.loads(report.read_text())["install"]
    return {
        normal(item["metadata"]["name"], item["metadata"]["version"]): item["download_info"][
            "archive_info"
        ]["hashes"]["sha256"]
        for item in items
    }


def hashes_of_all(pins: list[str]) -> dict[str, set[str]]:
    """Returns the hashes of each pin for every supported Python.

    The hashes are read once from PyPI only, and once with the indexes of this machine's pip
    configuration.
    """
    added = {"PIP_FIND_LINKS", "PIP_EXTRA_INDEX_URL"}
    alone = {key: value for key, value in os.environ.items() if key not in added}
    hashes = defaultdict[str, set[str]](set)
    for environment in (dict(os.environ), alone | {"PIP_CONFIG_FILE": os.devnull}):
        for python in PYTHONS:
            for pin, file in hashes_for(pins, python, environment).items():
                hashes[pin].add(file)
    return hashes


def main() -> None:
    lines = CONSTRAINTS.read_text().splitlines()
    comment = [line for line in lines if line.startswith("#")]
    pins = [line.split()[0] for line in lines if "==" in line]
    hashes = hashes_of_all(pins)
    entries = [
        [pin, *(f"    --hash=sha256:{file}" for file in sorted(hashes[normal(*pin.split("=="))]))]
        for pin in pins
    ]
    CONSTRAINTS.write_text("\n".join([*comment, *map(" \\\n".join, entries)]) + "\n")


if __name__ == "__main__":
    main()
