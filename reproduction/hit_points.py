"""Compares the simulated numbers of hit points per frame with those of the paper.

The paper's values are means over 5,000 frames. Here only every 25th frame is simulated.
"""

import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

import pandas as pd

from pyinfra.dataset.runs import infrasim
from pyinfra.formats.csv_table import read_csv, write_csv
from reproduction.paper_tables import paper_hits

PRESET = "paper"
FRAMES = "0:5000:25"
Progress = Callable[[str], object]


def compare(simulated: pd.DataFrame, paper: pd.DataFrame) -> pd.DataFrame:
    """Compares simulated hit points with the paper's, in the order of `simulated`.

    An error is hits / paper - 1. It is NaN if the paper has no value.

    Parameters
    ----------
    simulated, paper : tables with the columns lidar, scene, hits

    Returns
    -------
    Table with the columns scene, lidar, paper, simulated, error.
    """
    table = simulated.rename(columns={"hits": "simulated"})
    table = table.merge(
        paper.rename(columns={"hits": "paper"}),
        on=["lidar", "scene"],
        how="left",
        validate="one_to_one",
    )
    table["error"] = table["simulated"] / table["paper"] - 1
    return table[["scene", "lidar", "paper", "simulated", "error"]]


def hit_table(
    scenes: Sequence[Path],
    lidars: Sequence[Path],
    frames: str = FRAMES,
    *,
    progress: Progress = lambda _: None,
) -> pd.DataFrame:
    """Simulates all LiDARs in all scenes, and returns the table of compare().

    Raises SimulatorError if a simulation fails.

    Parameters
    ----------
    frames : frame range A:B[:STEP], B excluded
    progress : callback that receives a message before each simulation
    """
    parts = []
    for scene in scenes:
        progress(f"hit points of {scene.stem}, frames {frames}")
        part = hits_per_frame(scene, lidars, frames).reset_index()
        parts.append(part.assign(scene=scene.stem))
    return compare(pd.concat(parts, ignore_index=True), paper_hits())


def hits_per_frame(scene: Path, lidars: Sequence[Path], frames: str = FRAMES) -> pd.Series:
    """Returns the mean hit points per frame under preset `paper`, by LiDAR name.

    The function writes no frames. Raises SimulatorError if the simulation fails.
    """
    words: list[str | Path] = ["--preset", PRESET, "--frames", frames]
    with tempfile.TemporaryDirectory() as folder:
        summary = Path(folder) / "summary.csv"
        infrasim("run", scene, "--lidar", *lidars, *words, "--summary", summary)
        return read_csv(summary).set_index("lidar").hits_per_frame.astype(float).rename("hits")


def table_text(table: pd.DataFrame) -> str:
    """Formats the table of compare() as text; its last lines are the mean and largest error."""
    lines = [
        f"{'':24}{'hit points per frame':>20}",
        f"{'scene':<11}{'LiDAR':<13}{'paper':>10}{'simulated':>10}{'error':>11}",
    ]
    previous = None
    for row in table.itertuples():
        scene = row.scene if row.scene != previous else ""
        previous = row.scene
        lines.append(
            f"{scene:<11}{row.lidar:<13}{_count(row.paper):>10}{_count(row.simulated):>10}"
            f"{_percent(row.error):>11}"
        )
    sizes = table["error"].abs().dropna()
    if len(sizes) > 0:
        worst = table.loc[sizes.idxmax()]
        lines.append(
            f"simulated: mean error {sizes.mean():.1%}, largest {sizes.max():.1%} "
            f"({worst['scene']}, {worst['lidar']})"
        )
    return "\n".join(lines)


def write_table(table: pd.DataFrame, file: Path) -> None:
    """Writes the table of compare() as CSV; hits are rounded to 0.1 and errors to 0.0001."""
    write_csv(file, table.round({"simulated": 1, "error": 4}), str)


def _count(value: float) -> str:
    return "-" if pd.isna(value) else f"{value:,.0f}"


def _percent(value: float) -> str:
    return "-" if pd.isna(value) else f"{value:+.1%}"
