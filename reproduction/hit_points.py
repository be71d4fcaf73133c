"""Compares simulated hit points per frame with the paper's values and with hits on flat ground.

The paper's values are means over 5,000 frames. Here only every 25th frame is simulated. Each row
also has the hit points of the same LiDAR on flat ground without vehicles. The difference between
the scene and flat ground shows the effect of the scene's geometry.
"""

import hashlib
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

import pandas as pd

from pyinfra.core.errors import Error
from pyinfra.core.files import replacing
from pyinfra.dataset import launch
from pyinfra.dataset.catalogue import FLAT, scene_file
from pyinfra.dataset.runs import infrasim
from pyinfra.formats.csv_table import read_csv
from reproduction.paper_tables import paper_hits

PRESET = "paper"
FRAMES = "0:5000:25"
SUMMARY_COLUMNS = ("lidar", "frames", "hits_per_frame")
Progress = Callable[[str], object]


def compare(simulated: pd.DataFrame, flat: pd.Series, paper: pd.DataFrame) -> pd.DataFrame:
    """Returns one row per row of `simulated`, in the same order.

    An error is hits / paper - 1. It is NaN if the paper has no value.

    Parameters
    ----------
    simulated, paper : tables with the columns lidar, scene, hits
    flat : hit points per frame on flat ground, by LiDAR

    Returns
    -------
    Table with the columns scene, lidar, paper, simulated, error, flat, flat_error.
    """
    table = simulated.rename(columns={"hits": "simulated"})
    table = table.merge(
        paper.rename(columns={"hits": "paper"}),
        on=["lidar", "scene"],
        how="left",
        validate="one_to_one",
    )
    table["flat"] = table["lidar"].map(flat)
    table["error"] = table["simulated"] / table["paper"] - 1
    table["flat_error"] = table["flat"] / table["paper"] - 1
    return table[["scene", "lidar", "paper", "simulated", "error", "flat", "flat_error"]]


def hit_table(
    scenes: Sequence[Path],
    lidars: Sequence[Path],
    frames: str = FRAMES,
    *,
    cache: Path | None = None,
    progress: Progress = lambda _: None,
) -> pd.DataFrame:
    """Simulates all LiDARs in all scenes and on flat ground, and returns the table of compare().

    Raises SimulatorError if a simulation fails.

    Parameters
    ----------
    frames, cache : as in hits_per_frame()
    progress : callback that receives a message before each simulation
    """
    parts = []
    for scene in scenes:
        progress(f"hit points of {scene.stem}, frames {frames}")
        part = hits_per_frame(scene, lidars, frames, cache).reset_index()
        parts.append(part.assign(scene=scene.stem))
    progress(f"hit points of flat ground, frames {frames}")
    flat = hits_per_frame(scene_file(FLAT), lidars, frames, cache)
    return compare(pd.concat(parts, ignore_index=True), flat, paper_hits())


def hits_per_frame(
    scene: Path, lidars: Sequence[Path], frames: str = FRAMES, cache: Path | None = None
) -> pd.Series:
    """Returns the mean hit points per frame under preset `paper`, by LiDAR name.

    The function writes no frames. Raises SimulatorError if the simulation fails.

    Parameters
    ----------
    frames : frame range A:B[:STEP], B excluded
    cache : folder for summaries; a summary of the same binary, configuration and frames is reused
    """
    if cache is None:
        with tempfile.TemporaryDirectory() as folder:
            return hits_per_frame(scene, lidars, frames, Path(folder))
    summary = cache / f"{scene.stem}-{_key(scene, lidars, frames)}.csv"
    if not summary.is_file():
        cache.mkdir(parents=True, exist_ok=True)
        infrasim(*_run(scene, lidars, frames), "--summary", summary)
    return read_hits(summary)


def read_hits(summary: Path) -> pd.Series:
    """Returns the hit points per frame by LiDAR name, read from the summary of a run.

    Raises Error if a column is missing, or if the summary has no LiDAR or no frame.
    """
    table = read_csv(summary)
    missing = [column for column in SUMMARY_COLUMNS if column not in table.columns]
    if missing:
        names = ", ".join(SUMMARY_COLUMNS)
        raise Error(
            f"{summary}:1: expected the columns {names}; the column {missing[0]} is missing"
        )
    if len(table) == 0 or (table["frames"] < 1).any():
        raise Error(f"{summary}: expected one or more frames for each LiDAR, got none")
    hits = table.set_index("lidar")["hits_per_frame"].astype(float)
    return hits.rename("hits")


def _run(scene: Path, lidars: Sequence[Path], frames: str) -> list[str | Path]:
    return ["run", scene, "--lidar", *lidars, "--preset", PRESET, "--frames", frames]


def _key(scene: Path, lidars: Sequence[Path], frames: str) -> str:
    """Returns a hash of a summary's inputs: binary, resolved configuration and frames."""
    key = hashlib.sha256(frames.encode())
    key.update(infrasim("check", scene, "--preset", PRESET).encode())
    for lidar in lidars:
        key.update(infrasim("check", lidar, "--preset", PRESET).encode())
    binary = launch.binary()
    assert binary is not None
    key.update(binary.read_bytes())
    return key.hexdigest()[:12]


def table_text(table: pd.DataFrame) -> str:
    """Formats the table of compare() as text; its last lines are the mean and largest error."""
    lines = [
        f"{'':24}{'hit points per frame':>30}{'error':>20}",
        f"{'scene':<11}{'LiDAR':<13}{'paper':>10}{'simulated':>10}{'flat':>10}"
        f"{'simulated':>11}{'flat':>9}",
    ]
    previous = None
    for row in table.itertuples():
        scene = row.scene if row.scene != previous else ""
        previous = row.scene
        lines.append(
            f"{scene:<11}{row.lidar:<13}{_count(row.paper):>10}{_count(row.simulated):>10}"
            f"{_count(row.flat):>10}{_percent(row.error):>11}{_percent(row.flat_error):>9}"
        )
    for title, column in (("simulated", "error"), ("flat ground", "flat_error")):
        sizes = table[column].abs().dropna()
        if len(sizes) > 0:
            worst = table.loc[sizes.idxmax()]
            lines.append(
                f"{title}: mean error {sizes.mean():.1%}, largest {sizes.max():.1%} "
                f"({worst['scene']}, {worst['lidar']})"
            )
    return "\n".join(lines)


def write_table(table: pd.DataFrame, file: Path) -> None:
    """Writes the table of compare() as CSV; hits are rounded to 0.1 and errors to 0.0001."""
    file.parent.mkdir(parents=True, exist_ok=True)
    digits = {"simulated": 1, "flat": 1, "error": 4, "flat_error": 4}
    with replacing(file) as beside:
        table.round(digits).to_csv(beside, index=False)


def _count(value: float) -> str:
    return "-" if pd.isna(value) else f"{value:,.0f}"


def _percent(value: float) -> str:
    return "-" if pd.isna(value) else f"{value:+.1%}"
