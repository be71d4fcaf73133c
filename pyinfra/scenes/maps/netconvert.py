"""Converts maps to SUMO networks with SUMO's tool netconvert."""

import contextlib
import re
import subprocess
from collections.abc import Sequence
from pathlib import Path
from xml.sax.saxutils import quoteattr

from pyinfra.core.files import write
from pyinfra.scenes.maps.lane_map import MapError
from pyinfra.scenes.maps.sumo import SumoError, run_tool

LONGEST_S = 600.0  # maximum run time of netconvert
DETAIL = ["--junctions.internal-link-detail", "20"]
OPENDRIVE = ["--opendrive.import-all-lanes", "--opendrive.internal-shapes", "--tls.guess"]
OSM = (
    "--osm.elevation --geometry.remove --roundabouts.guess --ramps.guess --junctions.join "
    "--tls.guess-signals --tls.discard-simple --tls.join --sidewalks.guess --crossings.guess"
).split()


def without_sidewalk(edges: Sequence[str], file: Path) -> list[str]:
    """Returns arguments that stop netconvert from guessing sidewalks at the given edges.

    The edges are written to `file`, because they may be too many for a command line. Sidewalks that
    the map contains are always imported.
    """
    if not edges:
        return ["--osm.sidewalks"]
    names = quoteattr(",".join(edges))
    text = f"<configuration><sidewalks.guess.exclude value={names}/></configuration>"
    file.write_text(text, encoding="utf-8")
    return ["-c", str(file), "--osm.sidewalks"]


# Options that improve networks but are not necessary. If netconvert crashes, the program runs again
# without one of these options.
OPTIONAL = (
    *("--junctions.join", "--opendrive.internal-shapes", "--crossings.guess", "--ramps.guess"),
    *("--roundabouts.guess", "--tls.join", "--geometry.remove"),
)


def netconvert(source: Path, arguments: Sequence[str], out: Path) -> list[str]:
    """Writes the network, and returns SUMO's warnings. Raises MapError and ImportError."""
    words = [*arguments, *DETAIL, "--output-file", str(out)]
    try:
        warnings = _run(words)
    except subprocess.TimeoutExpired as error:
        raise MapError(
            f"{source}: netconvert of SUMO took more than {LONGEST_S:g} s; use a smaller map"
        ) from error
    except SumoError as error:
        advice = "; use a smaller map, or another version of SUMO" if error.crashed else ""
        raise MapError(f"{source}: netconvert of SUMO failed: {error}{advice}") from error
    if not out.exists():
        raise MapError(
            f"{source}: expected a network from netconvert of SUMO, got none; use another version "
            "of SUMO"
        )
    # netconvert writes comments with the date and local paths, which are removed here.
    write(out, re.sub(r"<!--.*?-->\s*", "", out.read_text(encoding="utf-8"), flags=re.DOTALL))
    return warnings


def _run(words: Sequence[str]) -> list[str]:
    """Runs netconvert. If it crashes, runs it without one of OPTIONAL, and adds a warning."""
    try:
        return run_tool("netconvert", words, longest_s=LONGEST_S)
    except SumoError as error:
        if not error.crashed:
            raise
        for option in OPTIONAL:
            if option not in words:
                continue
            with contextlib.suppress(SumoError):
                fewer = [word for word in words if word != option]
                warnings = run_tool("netconvert", fewer, longest_s=LONGEST_S)
                return [f"netconvert crashed with {option} and ran without it", *warnings]
        raise
