"""What a minute without labels says of a site: precision of the generalist, promised and found.

At generated sites that neither training nor calibration saw, a LiDAR each in turn: boxes from the
cut on, as they come and without those that come back where nothing ever moves (`--drop-standing`).
A second seed is another minute of the same sites: how much of a difference the traffic makes.
    .venv/bin/python benchmarks/unlabelled.py --work data/unlabelled
Rows go to results/unlabelled.csv as they come; what is there is not computed again.
"""

from __future__ import annotations

import argparse
import itertools
import shutil
from collections.abc import Iterator
from pathlib import Path

import pandas as pd
import yaml
from generalist import CUT, HELD_OUT, STUDIED, at_cut

from pyinfra.core.version import __version__, machine
from pyinfra.dataset.catalogue import lidar_file
from pyinfra.dataset.frames import frame_numbers
from pyinfra.dataset.runs import infrasim
from pyinfra.experiments import store
from pyinfra.formats import kitti
from pyinfra.metrics.evaluate import judged
from pyinfra.metrics.match_results import Settings
from pyinfra.models.detectors import Detections
from pyinfra.models.inference import detect
from pyinfra.models.inference.static_filter import without_standing
from pyinfra.scenes.generator.generate import make_site
from pyinfra.scenes.generator.random_stream import VERSION

ROOT = Path(__file__).resolve().parent.parent
MODEL = Path("generalist")
FIRST_SITE = 3_000_000  # streams, calibration and benchmarks/generalist.py end before it
FRAMES = "0:600:5"  # a minute
SETTINGS = Settings(ground_truths=("captured",))
KEY = ["site", "lidar", "seed", "way"]


def simulated(site: int, lidar: str, seed: int, work: Path) -> Path:
    work.mkdir(parents=True, exist_ok=True)
    scene, out = work / f"site_{site}.yaml", work / f"{site}_{lidar}_{seed}"
    scene.write_text(yaml.safe_dump(make_site(site)))
    words = ["--preset", "datasheet", "--label-time", "scan", "--frames", FRAMES]
    words += ["--seed", str(seed), "--out", str(out), "--threads", "1"]
    infrasim("run", scene, "--lidar", lidar_file(lidar), *words)
    return out / lidar


def rows(folder: Path) -> Iterator[dict[str, object]]:
    frames = frame_numbers(folder, "all")
    files = [kitti.frame_file(folder, "velodyne", k) for k in frames]
    ground, region = detect.place_of(folder)
    found, _ = detect.detect(detect.detector_at(detect.model_file(MODEL), folder), files, None)
    ways = {
        "as it comes": found,
        "standing dropped": without_standing(files, found, region, ground),
    }
    for way, boxes in ways.items():
        out = folder.parent / way.replace(" ", "_")
        yield {"way": way, **figures(folder, files, boxes, out)}


def figures(
    folder: Path, files: list[Path], found: list[Detections], out: Path
) -> dict[str, object]:
    out.mkdir(exist_ok=True)
    for file, boxes in zip(files, found, strict=True):
        detect.write(out, file, boxes)
    (judgement,) = judged(folder, out, SETTINGS, frames=frame_numbers(folder, "all"))
    counted = judgement.hit | judgement.wrong
    shown = int((counted & (judgement.contest.predictions.scores >= CUT)).sum())
    return {"objects": judgement.objects, "boxes": shown, **at_cut(judgement)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--work", type=Path, required=True)
    parser.add_argument("--sites", type=int, default=28)
    parser.add_argument("--seed", type=int, default=1, help="of the traffic; default: 1")
    parser.add_argument("--out", type=Path, default=ROOT / "results/unlabelled.csv")
    args = parser.parse_args()
    about = {"version": __version__, "machine": machine(), "command": "benchmarks/unlabelled.py"}
    lidars = itertools.cycle((*STUDIED, *HELD_OUT))
    for site, lidar in zip(range(FIRST_SITE, FIRST_SITE + args.sites), lidars, strict=False):
        key = {"site": f"site_v{VERSION}_{site}", "lidar": lidar, "seed": args.seed}
        if store.has(store.read(args.out, KEY), {**key, "way": "standing dropped"}):
            continue
        folder = simulated(site, lidar, args.seed, args.work)
        for found in rows(folder):
            store.put(args.out, pd.DataFrame([{**key, **found, **about}]), KEY)
            print(*key.values(), *found.values(), flush=True)
        shutil.rmtree(folder.parent)


if __name__ == "__main__":
    main()
