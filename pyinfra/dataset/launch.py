"""Finds and starts the `infrasim` binary of this package."""

import os
import sys
from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[1]
NO_BINARY = (
    f"expected the program in {PACKAGE / 'bin'}, or a build in the source tree, got none; run "
    "`make build` or install the wheel"
)


def binary() -> Path | None:
    """Returns the simulator binary, from the wheel or from `make build` in the source tree."""
    candidates = [PACKAGE / "bin/infrasim", PACKAGE.parent / "build/dev/cpp/infrasim"]
    return next((path for path in candidates if path.is_file()), None)


def main() -> None:
    path = binary()
    if path is None:
        sys.exit(f"infrasim: {NO_BINARY}")
    os.execv(path, ["infrasim", *sys.argv[1:]])
