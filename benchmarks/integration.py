"""AP against integration time: N frames of a fixed sensor stacked, by LiDAR and speed of traffic.

One world is learnt from and another is tested, both with all frames, so that each labelled frame
has its neighbours; another seed is two other worlds and another training. A network gets the
stacked points alone (`stacked`) or their age as well (`aged`), its labels those of the newest frame
or of the middle one. AP is that of the vehicles with a point in the labelled frame (`ap_fine`), and
of all (`ap_all`). Rows, with their draws, go to results/integration.csv as they come; what is there
is not computed again. At the end all rows are drawn as docs/pictures/integration.svg.
    .venv/bin/python benchmarks/integration.py --work data/integration
"""

from __future__ import annotations

import argparse
import itertools
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

from pyinfra.core.files import write
from pyinfra.core.version import __version__, machine
from pyinfra.dataset.catalogue import lidar_file, scene_file
from pyinfra.dataset.frames import PERIOD_S, frame_numbers
from pyinfra.dataset.runs import infrasim
from pyinfra.experiments import store
from pyinfra.formats import kitti
from pyinfra.metrics.evaluate import judged
from pyinfra.metrics.evaluation_tables import fine_ap, fine_columns
from pyinfra.metrics.match_results import Judgement, Settings
from pyinfra.metrics.replicates import draw_rows, same_of
from pyinfra.models.inference import detect
from pyinfra.models.training.accumulation import Accumulation, LabelAt
from pyinfra.models.training.recipe import Recipe, read_recipe
from pyinfra.models.training.sources import TIERS, Tier, read_source
from pyinfra.models.training.train import train

ROOT = Path(__file__).resolve().parent.parent
SCENE = "highway"
FRAMES = "0:2000"  # of each world, every one: neighbours are stacked
WAYS: tuple[tuple[str, LabelAt], ...] = (
    ("stacked", "newest"),
    ("aged", "newest"),
    ("aged", "middle"),
)
PARTS = ("learnt", "tested")
TEST_EVERY = 10  # frames that are tested on
SETTINGS = Settings(ground_truths=("captured", "all"))
BANDS_M = {"near": (0.0, 40.0), "mid": (40.0, 70.0), "far": (70.0, 1e9)}  # as of stress
KEY = "scene speed_km_h lidar preset detector input accumulate label_at seed".split()


@dataclass(frozen=True)
class Trial:
    """One network that learns and is tested."""

    scene: str
    speed_km_h: int
    lidar: str
    preset: str
    detector: str
    input: str  # stacked or aged
    accumulate: int
    label_at: LabelAt
    seed: int  # of the training; of the worlds: the two that are its own

    @property
    def name(self) -> str:
        return "_".join(map(str, asdict(self).values()))


def trials(args: argparse.Namespace) -> Iterator[Trial]:
    """One frame once; of more, each way of input and label."""
    every = itertools.product(args.seeds, args.speeds, args.lidars, args.frames)
    for seed, speed, lidar, frames in every:
        for way, label_at in WAYS if frames > 1 else WAYS[:1]:
            what = (args.preset, args.detector, way, frames, label_at, seed)
            yield Trial(SCENE, speed, lidar, *what)


def simulated(trial: Trial, part: str, work: Path) -> Path:
    """The LiDAR's folder of a world; a stopped run goes on."""
    world = 2 * trial.seed - 1 + PARTS.index(part)
    out = work / f"{trial.scene}_{trial.speed_km_h}_{world}_{trial.lidar}"
    words = ["--preset", trial.preset, "--label-time", "scan", "--seed", str(world)]
    words += ["--set", f"traffic.speed.mean_km_h={trial.speed_km_h}"]
    words += ["--frames", FRAMES, "--out", str(out), "--threads", "1"]
    infrasim("run", scene_file(trial.scene), "--lidar", lidar_file(trial.lidar), *words)
    folder = out / trial.lidar
    if part == "learnt":  # all of it: another world is tested
        (folder / "ImageSets").mkdir(exist_ok=True)
        names = "".join(f"{k:06d}\n" for k in kitti.frames(folder))
        write(folder / "ImageSets/train.txt", names)
    return folder


def recipe_of(trial: Trial, tier: Tier) -> Recipe:
    recipe = read_recipe(ROOT / f"configs/detectors/{trial.detector}.yaml", tier)
    return replace(recipe, network=replace(recipe.network, age=trial.input == "aged"))


def row(trial: Trial, tier: Tier, work: Path) -> dict[str, object]:
    """Learns and tests: AP with its draws, and recalls by distance."""
    accumulation = Accumulation(trial.accumulate, trial.label_at)
    learnt, tested = (simulated(trial, part, work) for part in PARTS)
    run = work / "runs" / trial.name
    source = read_source(learnt, tier, accumulation)
    train(recipe_of(trial, tier), [source], run, seed=trial.seed, quiet=True)
    chosen = frame_numbers(tested, "all")[::TEST_EVERY]
    files = [kitti.frame_file(tested, "velodyne", k) for k in chosen]
    ground, region = detect.place_of(tested)
    model = detect.load_detector(run, ground=ground, region=region, stacks=True)
    read = detect.stacking(tested, chosen, accumulation)
    _, times = detect.detect(model, files, run / "predictions", read=read)
    judgement, of_all = judged(tested, run / "predictions", SETTINGS, frames=chosen)
    found = fine_ap(judgement)
    every = fine_columns(of_all, fine_ap(of_all))
    same = same_of(judgement.contest.truth, judgement.contest.blocks, SETTINGS.seed)
    return {
        **asdict(trial),
        "seconds": round(trial.accumulate * PERIOD_S, 3),
        **{name: round(v, 3) for name, v in fine_columns(judgement, found).items()},
        "objects": judgement.objects,
        **{name.replace("fine", "all"): round(v, 3) for name, v in every.items()},
        "objects_all": of_all.objects,
        **recalls(judgement),
        "latency_p50_ms": round(float(np.median(times)), 1),
        **draw_rows(same, "captured", [("ap_fine", found)]).iloc[0].to_dict(),
    }


def recalls(judgement: Judgement) -> dict[str, float]:
    """Share of the vehicles of each band of distance that a box took."""
    boxes = judgement.contest.vehicles.boxes
    distance = np.hypot(boxes[:, 0], boxes[:, 1])
    taken = np.zeros(len(boxes), np.bool_)
    taken[judgement.took[judgement.hit]] = True
    found = {}
    for name, (low, high) in BANDS_M.items():
        here = judgement.counted & (distance >= low) & (distance < high)
        found[f"recall_{name}"] = round(float(taken[here].mean()), 4) if here.any() else np.nan
    return found


def draw(table: pd.DataFrame, file: Path) -> None:
    """AP over time, a part for each LiDAR and speed; one frame is the first point of each way.

    A dot is a seed, with its interval; the lines are the means.
    """
    cells = table.groupby(["lidar", "speed_km_h"], sort=False)
    figure, parts = plt.subplots(
        1, len(cells), figsize=(3 * len(cells), 3), sharey=True, layout="constrained", squeeze=False
    )
    for part, ((lidar, speed), own) in zip(parts[0], cells, strict=True):
        for number, (way, label_at) in enumerate(WAYS):
            of_way = (own.input == way) & (own.label_at == label_at)
            line = own[of_way | (own.accumulate == 1)].sort_values("seconds")
            ends = line[["ap_fine_low", "ap_fine_high"]].sub(line.ap_fine, axis=0).abs()
            seconds = line.seconds * 1.04 ** (number - 1)  # beside each other
            about = {"fmt": "os^"[number], "color": f"C{number}", "ms": 3, "lw": 0.6}
            part.errorbar(seconds, line.ap_fine, ends.T.to_numpy(), **about, alpha=0.6)
            mean = line.groupby("seconds").ap_fine.mean()
            part.plot(mean.index * 1.04 ** (number - 1), mean, lw=1.2, color=f"C{number}")
        part.set(title=f"{lidar}, {speed} km/h", xlabel="integration time (s)", xscale="log")
        part.set_xticks([0.1, 0.3, 1], ["0.1", "0.3", "1"])
        part.minorticks_off()
        part.grid(alpha=0.3)
    parts[0][0].set_ylabel("AP of captured vehicles")
    names = ("points alone", "with age", "with age, label in the middle")
    figure.legend(
        parts[0][0].lines[1::2], names, loc="outside lower center", ncols=3, frameon=False
    )
    with plt.rc_context({"svg.hashsalt": "integration"}):
        figure.savefig(file, metadata={"Date": None})


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--work", type=Path, required=True, help="folder of frames; about 18 GB")
    parser.add_argument("--out", type=Path, default=ROOT / "results" / "integration.csv")
    picture = ROOT / "docs/pictures/integration.svg"
    parser.add_argument("--picture", type=Path, default=picture)
    parser.add_argument("--lidars", nargs="+", default=["ruby_plus", "livox_avia", "helios_16"])
    parser.add_argument("--speeds", nargs="+", type=int, default=[20, 60], help="km/h")
    parser.add_argument("--frames", nargs="+", type=int, default=[1, 2, 3, 5, 10])
    parser.add_argument("--seeds", nargs="+", type=int, default=[1])
    parser.add_argument("--preset", default="datasheet")
    parser.add_argument("--detector", default="pointpillars", help="a network on pillars")
    parser.add_argument("--tier", choices=TIERS, default="quick")
    args = parser.parse_args()
    about = {"commit": __version__, "machine": machine()}
    about |= {"command": f"benchmarks/integration.py --tier {args.tier}"}
    for trial in trials(args):
        if store.has(store.read(args.out, KEY), asdict(trial)):
            continue
        found = {**row(trial, args.tier, args.work), **about}
        store.put(args.out, pd.DataFrame([found]), KEY)
        print(trial.name, found["ap_fine"], flush=True)
    draw(pd.read_csv(args.out), args.picture)


if __name__ == "__main__":
    main()
