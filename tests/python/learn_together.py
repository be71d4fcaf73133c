"""One of the processes of test_processes.py. It trains together with the other processes, or alone.

    python learn_together.py FOLDER_OF_LIDAR OUT

Writes OUT/RANK.pt with the weights and the statistics of the norms after one step of gradient
descent, by detector and name. Several processes also write OUT/whole, an uninterrupted training,
and OUT/killed, a training that was stopped and resumed.
"""

import dataclasses
import os
import sys
import warnings
from pathlib import Path

import torch
from detector_data import SITE, road_sample
from torch import Tensor

from pyinfra.models.detectors import distributed
from pyinfra.models.detectors.batch import make_batch
from pyinfra.models.detectors.sample import Sample
from pyinfra.models.training import checkpoint, loop, train
from pyinfra.models.training.recipe import Recipe, read_recipe
from pyinfra.models.training.samples import Augmentation
from pyinfra.models.training.sources import read_source

ROOT = Path(__file__).resolve().parents[2]
# PointRCNN is left out, because it samples other points if the number of processes is different.
SAME = ("pointpillars", "centerpoint-pillar", "dsvt", "pv-rcnn")


class Killed(Exception):
    pass


def recipe(detector: str) -> Recipe:
    original = read_recipe(ROOT / f"configs/detectors/{detector}.yaml", "smoke")
    learning = dataclasses.replace(original.learning, steps=5, batch=2, validate_frames=2)
    augmentation = Augmentation(flip=True, rotation_deg=5, scale=0.05, pasted=3)
    return dataclasses.replace(original, learning=learning, augmentation=augmentation)


def one_step(detector: str, samples: list[Sample]) -> dict[str, Tensor]:
    """Takes one step of plain gradient descent. The weights then differ by no more than the
    gradients."""
    torch.manual_seed(1)
    network = checkpoint.build(detector, recipe(detector).network, SITE).train()
    distributed.share_norms(network)
    rank_samples = samples[distributed.rank() :: distributed.count()]
    parts = network.losses(make_batch(rank_samples, network.site.area))
    torch.stack(list(parts.values())).sum().backward()
    distributed.average_gradients(network)
    torch.optim.SGD(network.parameters(), 0.01).step()
    return {f"{detector} {name}": tensor for name, tensor in network.state_dict().items()}


def meet_elsewhere() -> None:
    """Takes the next free port, because each process group needs its own port."""
    here, _, others = os.environ["PORTS"].partition(" ")
    os.environ |= {"MASTER_PORT": here, "PORTS": others}


def run(folder: Path, out: Path) -> None:
    meet_elsewhere()
    train.train(recipe("centerpoint-pillar"), [read_source(folder, "smoke")], out, quiet=True)


def main(folder: Path, out: Path) -> None:
    torch.set_num_threads(1)
    few = road_sample(3, 1)
    odd = Sample(few.points[:1], few.boxes[:0])  # the second process has a single point
    meet_elsewhere()
    with distributed.joined(torch.device("cpu")):
        rank, many = distributed.rank(), distributed.count() > 1
        tensors = {}
        for detector in SAME:
            tensors |= one_step(detector, [road_sample(1), road_sample(2, 2)])
        odd_step = one_step("pointpillars", [road_sample(1), odd])
        tensors |= {f"odd {name}": tensor for name, tensor in odd_step.items()}
    torch.save(tensors, out / f"{rank}.pt")
    if many:
        run_twice(folder, out, rank)


def run_twice(folder: Path, out: Path, rank: int) -> None:
    if rank > 0:
        checkpoint.save = None  # type: ignore[assignment]  # only the first one writes
    run(folder, out / "whole")
    real = loop.batch_of

    def dies(*words: object) -> object:
        if words[-1] == 3:
            raise Killed
        return real(*words)  # type: ignore[arg-type]

    loop.batch_of = dies  # type: ignore[assignment]
    try:
        run(folder, out / "killed")
    except Killed:
        loop.batch_of = real
    run(folder, out / "killed")


if __name__ == "__main__":
    warnings.simplefilter("error")
    main(*map(Path, sys.argv[1:]))
