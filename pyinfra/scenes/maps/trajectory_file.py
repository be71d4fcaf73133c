"""Writes `trajectories.csv`, with the checks of the simulator's reader."""

from pathlib import Path

import numpy as np
import pandas as pd

from pyinfra.core import files
from pyinfra.core.boxes import wrapped
from pyinfra.core.errors import Error
from pyinfra.scenes.maps.tracks import HEADING, PITCH, SPEED, STEP_S, Track, table

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
    x, y, z, dx, dy, dz = np.round(rows.boxes[:, :6], 4).T
    columns = {
        "t": np.round(rows.instant * STEP_S, 1),
        "id": rows.track + 1,
        "class": np.array([t.object_class for t in tracks])[rows.track],
        "x": x,
        "y": y,
        "z": z,
        "heading": np.round(wrapped(rows.states[:, HEADING]), 6),
        "dx": dx,
        "dy": dy,
        "dz": dz,
        "speed": np.round(rows.states[:, SPEED], 4),
    }
    if (np.abs(rows.states[:, PITCH]) > _LEVEL_RAD).any():
        columns["pitch"] = np.round(rows.states[:, PITCH], 6) + 0.0
    return str(pd.DataFrame(columns).to_csv(index=False, lineterminator="\n"))


def _check(track: Track) -> None:
    """Checks a track by the rules of the simulator's reader. Raises Error that names the track."""
    name, size_m, states = f"track '{track.name}'", track.size_m, track.states
    if not (finite := np.isfinite(states).all(axis=1)).all():
        first = int(np.argmin(finite))
        raise Error(f"{name}: state {first}: expected finite numbers, got {states[first].tolist()}")
    if not np.isfinite(size_m).all():
        raise Error(f"{name}: size_m: expected finite numbers, got {size_m.tolist()}")
    if (size_m < _SIZES_M[0]).any() or (size_m > _SIZES_M[1]).any():
        raise Error(f"{name}: expected sizes of 0.1 to 50 m, got a size of {size_m.tolist()} m")
    step_m = np.linalg.norm(np.diff(states[:, :3], axis=0), axis=1).max(initial=0)
    if step_m > _MAX_STEP_M:
        raise Error(
            f"{name}: expected steps of at most 10 m in 0.1 s, got a step of {step_m:.1f} m"
        )
    turn = np.abs(wrapped(np.diff(states[:, HEADING]))).max(initial=0)
    if turn > _MAX_TURN_RAD:
        raise Error(
            f"{name}: expected turns of at most 60 degrees in 0.1 s, got a turn of "
            f"{np.degrees(turn):.0f} degrees"
        )
