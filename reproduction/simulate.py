"""Simulates frames for the study's commands."""

from collections.abc import Iterable
from pathlib import Path

from pyinfra.dataset.catalogue import lidar_file, scene_file
from pyinfra.dataset.runs import infrasim
from pyinfra.experiments.benchmark.frames import split_by_time
from pyinfra.experiments.benchmark.matrix import Parts


def simulate(
    scene: str | Path,
    lidars: Iterable[str | Path],
    out: Path,
    *,
    parts: Parts | None = None,
    **options: object,
) -> Path:
    """Simulates the frames that do not exist yet with `infrasim run`; returns their folder `out`.

    Parameters
    ----------
    scene, lidars : files, or names of the catalogue
    parts : parts of a split by time; None for no split
    options : options of `infrasim run`: `seed=1` is `--seed 1`. A list gives several values;
        True gives the option without a value. None, False and [] leave the option out.
    """
    words: list[str | Path] = ["--out", out]
    for name, value in options.items():
        if value is not None and value is not False and value != []:
            values = value if isinstance(value, list) else [] if value is True else [value]
            words += [f"--{name.replace('_', '-')}", *map(str, values)]
    file = scene if isinstance(scene, Path) else scene_file(scene)
    files = (lidar if isinstance(lidar, Path) else lidar_file(lidar) for lidar in lidars)
    infrasim("run", file, "--lidar", *files, *words)
    if parts is not None:
        split_by_time(out, parts)
    return out
