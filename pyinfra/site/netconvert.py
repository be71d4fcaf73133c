"""SUMO's netconvert as a process: offline, its errors in one line."""

import importlib.util
import subprocess
from collections.abc import Sequence
from pathlib import Path

from pyinfra.site.lane_map import MapError

LONGEST_S = 600.0
INSTALL = "needs SUMO, which is not installed: pip install 'infrasim[site]'"
ALL = ["--junctions.internal-link-detail", "20", "--xml-validation", "never"]
OPENDRIVE = ["--opendrive.import-all-lanes", "--opendrive.internal-shapes", "--tls.guess"]
OSM = (
    "--osm.elevation --geometry.remove --roundabouts.guess --ramps.guess --junctions.join "
    "--tls.guess-signals --tls.discard-simple --tls.join --sidewalks.guess --crossings.guess"
).split()


def sumo_folder() -> Path:
    """Where SUMO lies. Raises ImportError that says what to install."""
    spec = importlib.util.find_spec("sumo")
    if spec is None or not spec.submodule_search_locations:
        raise ImportError(f"pyinfra site {INSTALL}")
    return Path(spec.submodule_search_locations[0])


def netconvert(source: Path, arguments: Sequence[str], out: Path) -> list[str]:
    """Writes the network; returns what SUMO warns of. Raises MapError, and ImportError."""
    home = sumo_folder()
    command = [str(home / "bin/netconvert"), *arguments, *ALL, "--output-file", str(out)]
    try:
        done = subprocess.run(
            command,
            capture_output=True,
            text=True,
            errors="replace",
            timeout=LONGEST_S,
            env={"SUMO_HOME": str(home)},
            check=False,
        )
    except subprocess.TimeoutExpired as error:
        raise MapError(f"{source}: SUMO took more than {LONGEST_S:g} s; cut the map") from error
    lines = [line.strip() for line in done.stderr.splitlines() if line.strip()]
    if done.returncode != 0 or not out.exists():
        errors = [line for line in lines if line.startswith("Error:")] or lines or ["no reason"]
        said = errors[0].removeprefix("Error: ")
        raise MapError(f"{source}: SUMO can't read it: {said} (exit {done.returncode})")
    return [line.removeprefix("Warning: ") for line in lines if line.startswith("Warning:")]
