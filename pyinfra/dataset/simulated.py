"""Frames of LiDARs in a scene, which are simulated on demand."""

from __future__ import annotations

import itertools
import math
import os
import warnings
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, Literal, overload

import numpy as np

from pyinfra.core.errors import Error, FindingWarning
from pyinfra.core.names import repeated
from pyinfra.core.public import CALLER, public
from pyinfra.dataset.loading import AnyLidar, AnyLidars, load_lidar, load_scene
from pyinfra.dataset.simulated_frames import SimulatedFrames

if TYPE_CHECKING:
    from pyinfra.dataset import simulation


@overload
def simulate(
    scene: simulation.World | str | os.PathLike[str],
    lidar: AnyLidar,
    frames: Sequence[int],
    *,
    mount: str | None = ...,
    returns: Callable[..., Any] | None = ...,
    threads: int | None = ...,
) -> SimulatedFrames: ...
@overload
def simulate(
    scene: simulation.World | str | os.PathLike[str],
    lidar: AnyLidar,
    frames: Sequence[int],
    *,
    mount: list[str] | tuple[str, ...],
    fuse: Literal[True],
    returns: Callable[..., Any] | None = ...,
    threads: int | None = ...,
) -> SimulatedFrames: ...
@overload
def simulate(
    scene: simulation.World | str | os.PathLike[str],
    lidar: AnyLidar,
    frames: Sequence[int],
    *,
    mount: list[str] | tuple[str, ...],
    returns: Callable[..., Any] | None = ...,
    threads: int | None = ...,
) -> dict[str, SimulatedFrames]: ...
@overload
def simulate(
    scene: simulation.World | str | os.PathLike[str],
    lidar: AnyLidars,
    frames: Sequence[int],
    *,
    mount: str | None = ...,
    returns: Callable[..., Any] | None = ...,
    threads: int | None = ...,
) -> dict[str, SimulatedFrames]: ...
@public(threads=(1, math.inf))
def simulate(
    scene: simulation.World | str | os.PathLike[str],
    lidar: AnyLidar | AnyLidars,
    frames: Sequence[int],
    *,
    mount: str | list[str] | tuple[str, ...] | None = None,
    fuse: bool = False,
    returns: Callable[..., Any] | None = None,
    threads: int | None = None,
) -> SimulatedFrames | dict[str, SimulatedFrames]:
    """Returns the frames of one or several LiDARs in a scene, simulated on demand.

    Parameters
    ----------
    scene : a result of `load_scene`, or a name or file of a scene
    lidar : a result of `load_lidar`, or a name or file of a LiDAR; or a list of these
    frames : frame numbers, such as `range(0, 1000, 10)`; frame k begins after k periods of the
        LiDAR, which are usually 0.1 s long
    mount : name of the mount, if the scene has several; or a list of names, for one LiDAR at each
    fuse : whether to put the points of the mounts together, in the levelled frame of the first,
        with the `calibration_error` of each mount; `fields["mount"]` is then the index of the mount
        of each point. Mounts with different clocks need `infrasim run`
    returns : a model of returns of your own: a function of the hits of a frame, records (n,) with
        x y z intensity, time_s, ring, class, echo and object_id, and of a NumPy random generator,
        which returns the records that become points, with any changes. It replaces the LiDAR's
        own model: in any weather, all rays that hit something within the maximum range are hits,
        at their exact range, without width of the beam and further echoes
    threads : number of threads that cast rays; by default the number of processors

    Returns
    -------
    A sequence of frames. For a list of LiDARs, a dict that maps LiDAR names to sequences, and for a
    list of mounts without `fuse`, one that maps mounts to sequences. In a
    sequence `result`, `result[3].points` is (n, 4) float32, x y z intensity, in the levelled LiDAR
    frame. `result.labels` is a table of all labels. No file is written.

    Raises
    ------
    Error : for frames that the scene does not have, a LiDAR whose preset does not fit the scene, or
        LiDARs of different frame periods

    Examples
    --------
    >>> import pyinfra as pi
    >>> scene = pi.load_scene("highway", set={"duration_s": 2})
    >>> frames = pi.simulate(scene, pi.load_lidar("helios_16"), range(0, 20, 10))
    >>> len(frames), frames[1].number, frames[1].points.shape[1]
    (2, 10, 4)
    >>> poles = ["west", "east"]
    >>> both = pi.simulate("crossroad_poles", "helios_16", range(1), mount=poles, fuse=True)
    >>> sorted(set(both[0].fields["mount"].tolist()))
    [0, 1]
    """
    from pyinfra.dataset import simulation

    if isinstance(mount, (list, tuple)) or fuse:
        return _at_mounts(scene, lidar, frames, mount, fuse, returns, threads)
    several = isinstance(lidar, (list, tuple))
    asked: list[AnyLidar] = list(lidar) if isinstance(lidar, (list, tuple)) else [lidar]
    if not asked:
        raise Error("lidar: expected one or more LiDARs, got an empty list")
    world = _world(scene, mount if isinstance(mount, str) else "")
    units = [x if isinstance(x, simulation.Lidar) else load_lidar(x) for x in asked]
    numbers = tuple(frames)
    if not numbers:
        raise Error("frames: expected one or more frame numbers, got none")
    for before, number in itertools.pairwise(numbers):
        if number <= before:
            raise Error(f"frames: expected ascending numbers, got {number} after {before}")
    existing = world.frames_of(units[0].period_s)
    if numbers[0] < 0 or numbers[-1] >= existing:
        raise Error(f"frames: expected 0 to {existing - 1}, got {numbers[0]} to {numbers[-1]}")
    simulation.simulate(world, units, [])  # raises an error for a wrong preset or different periods
    steps = set(np.diff(numbers).tolist())
    for unit in units if len(steps) == 1 else ():
        for text in unit.period_warnings(numbers[0], numbers[-1] + 1, *steps):
            warnings.warn(text, FindingWarning, stacklevel=CALLER)
    sequences = {
        unit.name: SimulatedFrames(world, unit, numbers, threads, returns=returns) for unit in units
    }
    if twice := repeated([unit.name for unit in units]):
        raise Error(f"lidar: expected different LiDARs, got {twice} twice")
    for sequence in sequences.values():
        sequence.beside = {n: other for n, other in sequences.items() if other is not sequence}
    return sequences if several else next(iter(sequences.values()))


def _world(scene: simulation.World | str | os.PathLike[str], mount: str) -> simulation.World:
    """Returns a scene at a mount; without a name, at the mount that it has or was loaded with."""
    from pyinfra.dataset import simulation

    if not isinstance(scene, simulation.World):
        return load_scene(scene, mount=mount)
    return simulation.with_mount(scene, mount) if mount else scene


def _at_mounts(
    scene: simulation.World | str | os.PathLike[str],
    lidar: AnyLidar | AnyLidars,
    frames: Sequence[int],
    mounts: str | list[str] | tuple[str, ...] | None,
    fuse: bool,
    returns: Callable[..., Any] | None,
    threads: int | None,
) -> SimulatedFrames | dict[str, SimulatedFrames]:
    """Returns the frames of one LiDAR at several mounts, by mount or fused."""
    from pyinfra.dataset.fused import check_clocks, error_of, fused

    if not isinstance(mounts, (list, tuple)) or not mounts or len(set(mounts)) < len(mounts):
        raise Error(f"mount: expected a list of different mounts, got {mounts!r:.40}")
    if isinstance(lidar, (list, tuple)):
        raise Error(f"lidar: expected one LiDAR at several mounts, got {len(lidar)} LiDARs")
    given: Any = lidar
    alone = {
        name: simulate(_world(scene, name), given, frames, returns=returns, threads=threads)
        for name in mounts
    }
    if not fuse:
        return alone
    check_clocks({name: one.world for name, one in alone.items()})
    errors = [error_of(one.world, name) for name, one in alone.items()]
    return fused(list(alone.values()), errors=errors)
