"""Writes `trajectories.csv`, with the checks of the simulator's reader."""

from pathlib import Path

import numpy as np
import pandas as pd

from pyinfra.core import files
from pyinfra.core.errors import Error
from pyinfra.scenes.maps.tracks import CLASSES, HEADING, PITCH, SPEED, STEP_S, Track, table, wrap

NAME = "trajectories.csv"
_MAX_STEP_M, _MAX_TURN_RAD = 10.0, np.pi / 3  # maximum movement and turn in 0.1 s
_SIZES_M = (0.1, 50.0)  # minimum and maximum side of a box
_LEVEL_RAD = 1e-4  # maximum pitch of a box that counts as level


def write_trajectories(file: Path, tracks: list[Track]) -> None:
    """Writes the tracks, numbered from 1 in the order of their starts.

    The column `pitch` is only written if a box has a pitch. Raises Error for tracks that the
    simulator would refuse.
    """
    ordered = sorted(tracks, key=lambda t: (t.first, t.name))
    if not ordered or ordered[0].first != 0:
        raise Error(f"{file}: expected one or more objects at t = 0, got none")
    for track in ordered:
        _check(track)
    files.write(file, _text(ordered))


def _text(tracks: list[Track]) -> str:
    rows = table(tracks)
    columns: dict[str, object] = {
        "t": np.round(rows.instant * STEP_S, 1),
        "id": rows.track + 1,
        "class": np.array([t.object_class for t in tracks])[rows.track],
    }
    for i, name in enumerate("xyz"):
        columns[name] = np.round(rows.boxes[:, i], 4)
    columns["heading"] = np.round(wrap(rows.states[:, HEADING]), 6)
    for i, name in enumerate(("dx", "dy", "dz")):
        columns[name] = np.round(rows.boxes[:, 3 + i], 4)
    columns["speed"] = np.round(rows.states[:, SPEED], 4)
    if (np.abs(rows.states[:, PITCH]) > _LEVEL_RAD).any():
        columns["pitch"] = np.round(rows.states[:, PITCH], 6) + 0.0
    return str(pd.DataFrame(columns).to_csv(index=False, lineterminator="\n"))


def _check(track: Track) -> None:
    """Checks a track by the rules of the simulator's reader. Raises Error that names the track."""
    if track.object_class not in CLASSES:
        _refuse(track, f"class '{track.object_class}'", f"a class among {', '.join(CLASSES)}")
    if not np.isfinite(track.states).all() or not np.isfinite(track.size_m).all():
        _refuse(track, "a value that is not finite", "finite numbers")
    if (track.size_m < _SIZES_M[0]).any() or (track.size_m > _SIZES_M[1]).any():
        _refuse(track, f"a size of {track.size_m.tolist()} m", "sizes of 0.1 to 50 m")
    steps = np.linalg.norm(np.diff(track.states[:, :3], axis=0), axis=1)
    if (steps > _MAX_STEP_M).any():
        _refuse(track, f"a step of {steps.max():.1f} m", "steps of at most 10 m in 0.1 s")
    turns = np.abs(wrap(np.diff(track.states[:, HEADING])))
    if (turns > _MAX_TURN_RAD).any():
        turn = f"a turn of {np.degrees(turns.max()):.0f} degrees"
        _refuse(track, turn, "turns of at most 60 degrees in 0.1 s")


def _refuse(track: Track, actual: str, allowed: str) -> None:
    raise Error(f"track '{track.name}': expected {allowed}, got {actual}")
