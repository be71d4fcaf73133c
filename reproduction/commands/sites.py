"""Measures ten maps from the import to the AP, with the commands that a user would type.

The command generates seven of the maps. The other three are towns (.xodr) in the folder that
--towns names; without --towns they are skipped. The command adds each row to out/sites.csv as soon
as it is computed. Existing rows are computed again only with --again.

    python -m reproduction sites --work out/sites --towns maps
"""

import shutil
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import pandas as pd
import yaml

from pyinfra.scenes.maps.sumo import sumo_folder
from reproduction import ROOT, provenance
from reproduction.arguments import Out, Work, command

TOWNS = ("Town04", "Town05", "Town10HD")
LIDARS = ("ruby_plus", "livox_avia")
PRESET, FRAMES, SEED = "datasheet", "0:5000:25", 1
VEHICLES_PER_HOUR = 600
SPLIT_S = (250, 260)  # end of the training part, start of the test part
COMMAND = "python -m reproduction sites --work DIR --towns DIR"


@dataclass
class Steps:
    """Runs the commands of one site; the time of a step is the sum over its commands."""

    log: Path
    seconds: dict[str, float] = field(default_factory=dict)

    def run(self, step: str, program: str, *words: object) -> str:
        """Runs a command and returns its standard output.

        Raises RuntimeError with the command's standard error if it fails.
        """
        start = time.perf_counter()
        command = [str(Path(sys.executable).parent / program), *map(str, words)]
        done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=ROOT)
        self.seconds[step] = self.seconds.get(step, 0) + time.perf_counter() - start
        with self.log.open("a") as stream:
            print(f"$ {program}", *words, file=stream)
            print(done.stdout, done.stderr, file=stream)
        if done.returncode:
            raise RuntimeError(f"{program} {words[0]}: {done.stderr.strip()}")
        return done.stdout


def measured(name: str, map_: Path, work: Path) -> Iterator[dict[str, object]]:
    """Imports and simulates the site of a map; yields a row for each LiDAR."""
    shutil.rmtree(work / name, ignore_errors=True)
    (work / name).mkdir(parents=True)
    steps = Steps(work / name / "log.txt")
    site, data = work / name / name, work / name / "data"
    steps.run("import_s", "pyinfra", "site", "import", map_, "--out", site)
    words = ["--vehicles-per-hour", VEHICLES_PER_HOUR, "--seed", SEED]
    steps.run("traffic_s", "pyinfra", "site", "traffic", site, *words)
    scene = site / "site.yaml"
    steps.run("check_s", "infrasim", "check", scene, "--traffic")
    words = ["--lidar", *LIDARS, "--preset", PRESET, "--frames", FRAMES, "--out", data]
    steps.run("run_s", "infrasim", "run", scene, *words)
    until, start = SPLIT_S
    steps.run("detect_s", "pyinfra", "split", data, "--train-until-s", until, "--val-from-s", start)
    shared = dict(steps.seconds)
    record = yaml.safe_load((site / "map.yaml").read_text())
    vehicles = pd.read_csv(site / "trajectories.csv", usecols=["id"]).id.nunique()
    counts = {"lanes": record["lanes"], "triangles": record["triangles"], "vehicles": vehicles}
    for lidar in LIDARS:
        steps.seconds = dict(shared)
        measures = with_background(steps, data / lidar, work / name / lidar)
        yield {
            "site": name,
            "map": map_.name,
            "lidar": lidar,
            **counts,
            **steps.seconds,
            **measures,
        }


def with_background(steps: Steps, data: Path, work: Path) -> dict[str, object]:
    """Trains and tests Background on a LiDAR's frames; returns its AP."""
    recipe, run = ROOT / "configs/detectors/background.yaml", work / "run"
    steps.run("detect_s", "pyinfra", "train", recipe, data, "--out", run)
    steps.run("detect_s", "pyinfra", "detect", data, "--model", run, "--out", run / "predictions")
    words = [data, run / "predictions", "--out", work / "ap"]
    steps.run("evaluate_s", "pyinfra", "evaluate", *words, "--no-figures")
    table = pd.read_csv(work / "ap" / "ap.csv").set_index("ground_truth")
    measures: dict[str, object] = {"frames": table.frames["all"]}
    for truth in ("captured", "all"):
        row = table.loc[truth]
        measures |= {
            f"ap_{truth}": row.ap_r1000,
            f"ap_{truth}_low": row.ap_r1000_low,
            f"ap_{truth}_high": row.ap_r1000_high,
            f"objects_{truth}": row.objects,
        }
    return measures


def maps_of(towns: Path | None, work: Path) -> Iterator[tuple[str, Path]]:
    import site_maps

    folder = work / "maps"
    folder.mkdir(parents=True, exist_ok=True)
    for name, make in site_maps.MAPS.items():
        yield name, make(folder, sumo_folder())
    if towns is None:
        print("--towns: not given: the three towns are left out")
    else:
        yield from ((town.lower(), towns / f"{town}.xodr") for town in TOWNS)


@command
def main(
    *,
    work: Work,
    towns: Path | None = None,
    sites: Sequence[str] | None = None,
    again: bool = False,
    out: Out = Path("sites.csv"),
) -> None:
    """
    Parameters
    ----------
    work : working folder for sites and frames
    towns : folder with Town04, Town05, Town10HD (.xodr)
    sites : run only these sites
    again : measure sites again that the table already has
    """
    made_by = {"preset": PRESET, "seed": SEED, **provenance("sites"), "command": COMMAND}
    table = pd.read_csv(out) if out.exists() else pd.DataFrame({"site": []})
    for name, map_ in maps_of(towns, work.resolve()):
        wanted = not sites or name in sites
        if not wanted or (name in set(table.site) and not again):
            continue
        try:
            rows = list(measured(name, map_, work.resolve()))
        except RuntimeError as error:
            print(f"{name}: {error}")
            continue
        new = pd.DataFrame(rows).assign(**made_by)
        table = pd.concat([table[table.site != name], new], ignore_index=True)
        table.to_csv(out, index=False, float_format="%.4g")
        print(new.T.to_string(header=False), flush=True)
