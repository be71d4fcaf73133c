"""Writes the study's data set of three scenes and four LiDARs, with split and data card."""

from functools import partial
from pathlib import Path

from reproduction.arguments import command
from reproduction.data_release import CARD, FRAMES, SUMS, spread, write


@command
def main(*, frames: int = FRAMES, preset: str = "paper", out: Path) -> None:
    """Simulates three scenes with four LiDARs and writes the split, a data card (DATASET.md) and
    the SHA-256 of every file (SHA256SUMS, for `sha256sum -c`). Run the same command again to
    resume.

    example: python -m reproduction dataset --frames 500 --out data/paper

    Parameters
    ----------
    frames : maximum number of frames per scene (default: %(default)s)
    preset : preset of the LiDARs (default: %(default)s)
    out : output folder, with a folder for each scene
    """
    write(out, spread(frames), preset, partial(print, flush=True))
    print(f"card {out / CARD}\nsums {out / SUMS}")
