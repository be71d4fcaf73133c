"""Writes the SHA-256 of what PyPI has for each pin of scripts/constraints.txt: `make hashes`, after a pin changed.

Asks for x86-64 Linux and each Python that the project is tried with; an index or a folder that this
machine's pip is set up with (a CPU build of PyTorch) counts as well.
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


def found(pins: list[str], python: str, environment: dict[str, str]) -> dict[str, str]:
    """The SHA-256 of the file that pip would install for each pin, by `name==version`."""
    with TemporaryDirectory() as folder:
        names, report = Path(folder, "pins.txt"), Path(folder, "report.json")
        names.write_text("\n".join(pins))
        words = ["install", "--dry-run", "--quiet", "--ignore-installed", "--no-deps"]
        words += ["--python-version", python, "--target", folder]
        words += ["--report", str(report), "-r", str(names)]
        subprocess.run([sys.executable, "-m", "pip", *words], check=True, env=environment)
        items = json.loads(report.read_text())["install"]
    files = [item["download_info"]["archive_info"]["hashes"]["sha256"] for item in items]
    return {
        f"{normal(item['metadata']['name'])}=={item['metadata']['version'].partition('+')[0]}": file
        for item, file in zip(items, files, strict=True)
    }


def normal(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def main() -> None:
    lines = CONSTRAINTS.read_text().splitlines()
    head = [line for line in lines if line.startswith("#")]
    pins = [line.split()[0] for line in lines if "==" in line]
    alone = {k: v for k, v in os.environ.items() if k not in {"PIP_FIND_LINKS", "PIP_EXTRA_INDEX_URL"}}
    hashes = defaultdict[str, set[str]](set)
    for environment in (dict(os.environ), alone | {"PIP_CONFIG_FILE": os.devnull}):
        for python in PYTHONS:
            for pin, file in found(pins, python, environment).items():
                hashes[pin].add(file)
    out = head
    for pin in pins:
        name, version = pin.split("==")
        out += [f"{pin} \\"]
        files = sorted(hashes[f"{normal(name)}=={version}"])
        out += [f"    --hash=sha256:{file} \\" for file in files[:-1]]
        out += [f"    --hash=sha256:{files[-1]}"]
    CONSTRAINTS.write_text("\n".join(out) + "\n")


if __name__ == "__main__":
    main()
