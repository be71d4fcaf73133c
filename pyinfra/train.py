"""`pyinfra train CONFIG --data DATA/LIDAR... --tier TIER --out RUN`."""

from __future__ import annotations

import argparse
import dataclasses
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import yaml
from tqdm import tqdm

from pyinfra import kitti, split
from pyinfra.config import as_plain
from pyinfra.detectors.background import Background
from pyinfra.detectors.catalogue import DETECTORS
from pyinfra.kitti import Lidar, read_yaml
from pyinfra.training.recipe import TIERS, Recipe, Tier, read_recipe
from pyinfra.training.samples import Frames, joined, read_frames

# Of the train and test frames of 500 s, how many there are, evenly spread.
FRAMES: dict[Tier, tuple[int, int]] = {"smoke": (200, 45), "quick": (800, 180), "full": (4000, 900)}
BACKGROUND_FRAMES = 100


@dataclass(frozen=True)
class Source:
    """The folder of a LiDAR and its frames to learn from."""

    folder: Path
    lidar: Lidar
    scene: str
    frames: tuple[int, ...]


def read_source(folder: Path, tier: Tier) -> Source:
    """The train frames of a tier: those of ImageSets/train.txt, else the split by time.

    Raises FileNotFoundError, FormatError and ValueError.
    """
    lidar = kitti.read_lidar(folder)
    listed = folder / "ImageSets/train.txt"
    if listed.is_file():
        numbers = tuple(int(line) for line in listed.read_text().split())
    else:
        numbers = split.by_time(kitti.frames(folder), lidar.period_s).train
    description = folder.parent / "dataset.yaml"
    scene = read_yaml(description).at("name").text() if description.is_file() else "unknown"
    return Source(folder, lidar, scene, spread(numbers, FRAMES[tier][0]))


def spread(numbers: Sequence[int], most: int) -> tuple[int, ...]:
    """At most so many of the numbers, evenly spread."""
    if len(numbers) <= most:
        return tuple(numbers)
    return tuple(numbers[i * len(numbers) // most] for i in range(most))


def train(
    recipe: Recipe,
    sources: Sequence[Source],
    out: Path,
    *,
    seed: int = 1,
    device: str = "cpu",
    quiet: bool = False,
) -> Path:
    """Trains a detector into the folder `out`, or goes on there; returns the model's file.

    Raises what reading frames and training raise.
    """
    out.mkdir(parents=True, exist_ok=True)
    if recipe.detector == "background":
        return _learn_background(recipe, sources, out)
    return _train_network(recipe, sources, out, seed, device, quiet)


def _learn_background(recipe: Recipe, sources: Sequence[Source], out: Path) -> Path:
    if len(sources) != 1:
        raise ValueError(f"background: found {len(sources)} LiDARs, allowed one: it stands there")
    (source,) = sources
    frames = spread(source.frames, BACKGROUND_FRAMES)
    clouds = [kitti.read_points(kitti.frame_file(source.folder, "velodyne", k)) for k in frames]
    file = out / "background.npz"
    Background.learn(clouds, recipe.network).save(file)
    return file


def _train_network(
    recipe: Recipe, sources: Sequence[Source], out: Path, seed: int, device: str, quiet: bool
) -> Path:
    import torch
    from torch.utils.tensorboard import SummaryWriter

    from pyinfra.detectors.site import site_of
    from pyinfra.training import checkpoint, loop

    frames: Frames = joined([read_frames(s.folder, s.frames) for s in sources])
    torch.manual_seed(seed)
    site = site_of(frames.boxes)
    network = checkpoint.build(recipe.detector, recipe.network, site)
    about = checkpoint.About(
        detector=recipe.detector,
        network=as_plain(recipe.network),
        site=site,
        lidar=" ".join(sorted({s.lidar.name for s in sources})),
        preset=" ".join(sorted({s.lidar.preset for s in sources})),
        scene=" ".join(sorted({s.scene for s in sources})),
        seed=seed,
        step=0,
        steps=recipe.learning.steps,
    )
    last = out / "last.safetensors"
    done = checkpoint.load(last).about.step if last.exists() else 0
    description = {**as_plain(about), "learning": as_plain(recipe.learning)}
    description["augmentation"] = as_plain(recipe.augmentation)
    description["frames"] = len(frames)
    (out / "run.yaml").write_text(yaml.safe_dump(description, sort_keys=False))
    log = loop.Log(out / "log.csv", done)
    board = SummaryWriter(str(out / "tensorboard"), purge_step=done + 1)
    # Without `quiet`, None: on a terminal only.
    bar = tqdm(total=about.steps, initial=done, unit="step", disable=quiet or None, file=sys.stderr)

    def report(progress: loop.Progress) -> None:
        log(progress)
        values = {"loss": progress.loss, "rate": progress.rate, **progress.parts}
        for name, value in values.items():
            board.add_scalar(name, value, progress.step)
        bar.set_postfix(loss=f"{progress.loss:.3f}", refresh=False)
        bar.update()

    with bar, board:
        loop.train(network, frames, recipe, about, out, device=torch.device(device), report=report)
    return last


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = "Trains a detector on frames; the same command goes on after a stop."
    parser.epilog = (
        "example: pyinfra train configs/detectors/pointpillars.yaml "
        "--data data/highway/ruby_plus --tier quick --out runs/pillars"
    )
    parser.add_argument("config", type=Path, help="file of configs/detectors")
    parser.add_argument("--data", nargs="+", type=Path, required=True, help="folders of LiDARs")
    parser.add_argument("--tier", choices=TIERS, default="quick", help="default: quick")
    parser.add_argument("--out", type=Path, required=True, help="folder of the run")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--device", default="cpu", help="cpu, cuda, cuda:1, ...")
    parser.add_argument(
        "--budget", type=float, default=1.0, help="share of the tier's steps, the schedule with it"
    )


def run(args: argparse.Namespace) -> int:
    if not 0 < args.budget <= 100:
        raise ValueError(f"--budget: found {args.budget:g}, allowed above 0 to 100")
    if args.config.stem in DETECTORS and not args.config.suffix:
        raise ValueError(f"{args.config}: found a name, allowed a file of configs/detectors")
    recipe = read_recipe(args.config, args.tier)
    if DETECTORS[recipe.detector].learnt:
        steps = max(1, round(args.budget * recipe.learning.steps))
        learning = dataclasses.replace(recipe.learning, steps=steps)
        recipe = dataclasses.replace(recipe, learning=learning)
    sources = [read_source(folder, args.tier) for folder in args.data]
    print(train(recipe, sources, args.out, seed=args.seed, device=args.device))
    return 0
