"""Hit points per frame beside the paper's, by running the `infrasim` binary; and `pyinfra demo`.

The paper's figures are its means over 5,000 frames; here every 25th of them is simulated. Beside
each scene stands what the same LiDAR hits on flat ground without vehicles, so that a reader sees
what the site's geometry did.
"""

import argparse
import hashlib
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from pyinfra import _launch, kitti
from pyinfra.atomic import replacing
from pyinfra.kitti import FloatArray

SCENES = ("highway", "crossroad", "curve")
LIDARS = ("livox_avia", "helios_16", "pandar_64", "ruby_plus")
FLAT = "flat"
PRESET = "paper"
FRAMES = "0:5000:25"
ANOTHER_RUN = "holds another run"  # the binary's words for a folder of another configuration
PATTERN_FRAMES = "0:20"
SUMMARY_COLUMNS = ("lidar", "frames", "hits_per_frame")

Say = Callable[[str], object]


class SimulatorError(RuntimeError):
    """The binary is missing or failed; `exit_code` is 2 for a wrong configuration, else 1."""

    def __init__(self, message: str, exit_code: int) -> None:
        super().__init__(message)
        self.exit_code = exit_code


def configs() -> Path:
    """The folder of scenes, LiDARs and references: that of the wheel, else of the source tree."""
    inside = _launch.PACKAGE / "configs"
    return inside if inside.is_dir() else _launch.PACKAGE.parent / "configs"


def scene_file(name: str) -> Path:
    """File of a scene that comes with the package."""
    return configs() / "scenes" / f"{name}.yaml"


def lidar_file(name: str) -> Path:
    """File of a LiDAR that comes with the package."""
    return configs() / "lidars" / f"{name}.yaml"


def infrasim(*words: str | Path) -> str:
    """Runs the binary and returns what it printed.

    Raises SimulatorError with the binary's own message, or if there is no binary.
    """
    binary = _launch.binary()
    if binary is None:
        raise SimulatorError("infrasim: no binary; run `make build` or install the wheel", 1)
    done = subprocess.run([binary, *words], capture_output=True, text=True, check=False)
    if done.returncode != 0:
        last = (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1]
        raise SimulatorError(f"infrasim {words[0]}: {last}", 2 if done.returncode == 2 else 1)
    return done.stdout


def simulate(scene: Path, lidars: Sequence[Path], frames: str, out: Path) -> None:
    """Writes frames with `fields` in the `paper` preset; frames that are there stay as they are.

    frames: A:B[:STEP], B excluded. out: data set folder, see pyinfra.kitti for its contents.
    Raises SimulatorError, also if the folder holds another run.
    """
    infrasim(*_run(scene, lidars, frames), "--out", out, "--fields")


def hits_per_frame(
    scene: Path, lidars: Sequence[Path], frames: str = FRAMES, cache: Path | None = None
) -> pd.Series:
    """Mean hit points per frame in the `paper` preset, by LiDAR name; no frames are written.

    frames: A:B[:STEP], B excluded. cache: a folder for the answers, so that the same binary is
    asked once for the same configuration.
    Raises SimulatorError.
    """
    if cache is None:
        with tempfile.TemporaryDirectory() as folder:
            return hits_per_frame(scene, lidars, frames, Path(folder))
    summary = cache / f"{scene.stem}-{_key(scene, lidars, frames)}.csv"
    if not summary.is_file():
        cache.mkdir(parents=True, exist_ok=True)
        infrasim(*_run(scene, lidars, frames), "--summary", summary)
    return read_hits(summary)


def scan_pattern(lidar: Path, frames: str = "0:1", preset: str = PRESET) -> FloatArray:
    """Azimuth, elevation (rad) and time (s) of every ray: (n, 3), sensor frame, phase 0.

    Raises SimulatorError.
    """
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "pattern.npy"
        infrasim("pattern", lidar, "--preset", preset, "--frames", frames, "--out", file)
        rays: FloatArray = np.load(file)
    return rays


def read_hits(summary: Path) -> pd.Series:
    """Hits per frame by LiDAR name, from the summary of a run.

    Raises ValueError if it has other columns, no LiDAR or no frames.
    """
    table = pd.read_csv(summary)
    missing = [column for column in SUMMARY_COLUMNS if column not in table.columns]
    if missing:
        raise ValueError(f"{summary}:1: found no column {missing[0]}, needed {SUMMARY_COLUMNS}")
    if len(table) == 0 or (table["frames"] < 1).any():
        raise ValueError(f"{summary}: found a summary without frames")
    hits = table.set_index("lidar")["hits_per_frame"].astype(float)
    return hits.rename("hits")


def paper_hits() -> pd.DataFrame:
    """The paper's table: columns lidar, scene, hits; LiDARs by the names they have here."""
    return pd.read_csv(configs() / "reference/paper_hit_points.csv")


def paper_ap() -> pd.DataFrame:
    """The paper's AP: columns scene, lidar, detector, ap; by the names they have here."""
    return pd.read_csv(configs() / "reference/paper_average_precision.csv")


def compare(simulated: pd.DataFrame, flat: pd.Series, paper: pd.DataFrame) -> pd.DataFrame:
    """One row for each row of `simulated`, in its order.

    simulated, paper: columns lidar, scene, hits; flat: hits by LiDAR.
    Columns scene, lidar, paper, simulated, error, flat, flat_error; an error is hits / paper - 1,
    nothing (NaN) where the paper has no figure.
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
    say: Say = lambda _: None,
) -> pd.DataFrame:
    """Hit points of LiDARs in scenes beside the paper's and those of flat ground: see compare().

    frames, cache: as in hits_per_frame(). say: is told what is simulated next.
    Raises SimulatorError.
    """
    parts = []
    for scene in scenes:
        say(f"hit points of {scene.stem}, frames {frames}")
        part = hits_per_frame(scene, lidars, frames, cache).reset_index()
        parts.append(part.assign(scene=scene.stem))
    say(f"hit points of flat ground, frames {frames}")
    flat = hits_per_frame(scene_file(FLAT), lidars, frames, cache)
    return compare(pd.concat(parts, ignore_index=True), flat, paper_hits())


def table_text(table: pd.DataFrame) -> str:
    """The table of compare() for a terminal, with the mean and the largest error below."""
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
    """Writes the table of compare() as CSV, hits to 0.1 and errors to 0.0001."""
    file.parent.mkdir(parents=True, exist_ok=True)
    digits = {"simulated": 1, "flat": 1, "error": 4, "flat_error": 4}
    with replacing(file) as beside:
        table.round(digits).to_csv(beside, index=False)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = (
        "Rebuilds the paper's table of hit points, simulates a few frames of each scene "
        "and draws them."
    )
    parser.epilog = "example: pyinfra demo --out out/demo --frames 0:3"
    parser.add_argument("--out", type=Path, default=Path("out/demo"), help="folder of the results")
    parser.add_argument(
        "--frames",
        default="0:3",
        help="frames to write, A:B[:STEP], B excluded; the first is drawn",
    )


def run(args: argparse.Namespace) -> int:
    from pyinfra.drawing import clouds  # needs matplotlib, which takes a second to load

    start = time.perf_counter()

    def say(step: str) -> None:
        print(f"[{time.perf_counter() - start:5.1f} s] {step}", file=sys.stderr, flush=True)

    out: Path = args.out
    lidars = [lidar_file(name) for name in LIDARS]
    scenes = [scene_file(name) for name in SCENES]
    data = [out / "data" / name for name in SCENES]
    for scene, folder in zip(scenes, data, strict=True):
        say(f"frames {args.frames} of {scene.stem}")
        try:
            simulate(scene, lidars, args.frames, folder)
        except SimulatorError as error:
            if ANOTHER_RUN not in str(error):
                raise
            advice = f"remove {folder} or choose another --out"
            raise SimulatorError(f"{error}; {advice}", error.exit_code) from None
    table = hit_table(scenes, lidars, cache=out / "summaries", say=say)
    write_table(table, out / "hit_points.csv")
    print(table_text(table), flush=True)

    say("pictures")
    data_sets = [[folder / lidar for lidar in LIDARS] for folder in data]
    frame = int(args.frames.split(":")[0])
    pictures = clouds.draw_frames(data_sets, frame, out / "pictures")
    patterns = {
        kitti.read_lidar(folder).model: scan_pattern(lidar_file(folder.name), PATTERN_FRAMES)
        for folder in data_sets[0]
    }
    pictures.append(clouds.draw_patterns(patterns, out / "pictures/patterns.png"))
    say("done")
    print(f"\nhit points   {out / 'hit_points.csv'}\nframes       {out / 'data'}")
    for file in pictures:
        print(f"picture      {file}")
    return 0


def _run(scene: Path, lidars: Sequence[Path], frames: str) -> list[str | Path]:
    return ["run", scene, "--lidar", *lidars, "--preset", PRESET, "--frames", frames]


def _key(scene: Path, lidars: Sequence[Path], frames: str) -> str:
    """Names all that a summary depends on: the binary, the resolved configuration, the frames."""
    key = hashlib.sha256(frames.encode())
    key.update(infrasim("check", scene).encode())
    for lidar in lidars:
        key.update(infrasim("check", lidar, "--preset", PRESET).encode())
    binary = _launch.binary()
    assert binary is not None
    key.update(binary.read_bytes())
    return key.hexdigest()[:12]


def _count(value: float) -> str:
    return "-" if pd.isna(value) else f"{value:,.0f}"


def _percent(value: float) -> str:
    return "-" if pd.isna(value) else f"{value:+.1%}"
