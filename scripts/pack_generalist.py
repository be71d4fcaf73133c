"""Calibrates the scores of a network of many sites where it did not learn, and packs it.

    .venv/bin/python scripts/pack_generalist.py RUN

looks at sites that no training saw, fits the line of logits that makes scores shares of right
boxes, and writes pyinfra/models/generalist.safetensors: layers in half precision, the line and its
figures in the header. results/generalist_sites.csv has precision and recall of the boxes from the
cut on, by site and LiDAR, and what their scores say.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
from torch import Tensor

from pyinfra import __version__
from pyinfra.arrays import BoolArray, FloatArray
from pyinfra.detectors.fused import fused
from pyinfra.detectors.network import Network
from pyinfra.evaluation import matching
from pyinfra.sites import catalogue
from pyinfra.sites.stream import samples_of, world_of
from pyinfra.training import calibration, checkpoint
from pyinfra.training.detect import MODELS, model_file
from pyinfra.training.samples import SiteSample

ROOT = Path(__file__).resolve().parent.parent
FIRST_SITE = 1_000_000  # streams end before it
RAISED = 4.0  # of logits, so that boxes below the least score are seen and fitted too
CUT = 0.5  # of calibrated scores: from here on a box is shown
PRESET = "datasheet"


def looked_at(sites: int, frames: int) -> Iterator[tuple[str, str, list[SiteSample]]]:
    """Site, LiDAR and frames: four LiDARs a site, of all that the catalogue has."""
    everyone = catalogue.sensors(presets={PRESET: 1.0})
    for seed in range(FIRST_SITE, FIRST_SITE + sites):
        random = np.random.default_rng(seed)
        keys, world = world_of(seed, "scan")
        for lidar in everyone.draw(random, 4):
            chosen = sorted(random.choice(world.frames, frames, replace=False).tolist())
            yield keys["name"], lidar.name, samples_of(world, keys, lidar, chosen)


def found_in(network: Network, samples: list[SiteSample]) -> tuple[FloatArray, BoolArray, int]:
    """Scores of the boxes in the region, which are right, and how many vehicles there are."""
    scores, right, vehicles = [np.empty(0)], [np.empty(0, np.bool_)], 0
    for sample in samples:
        network.know(sample.region)
        found = network.predict(sample.points)
        inside = sample.region.holds(found.boxes, 0.0)
        truth = sample.boxes[sample.region.holds(sample.boxes, 0.0)]
        boxes = found.boxes[inside]
        frames = np.zeros(len(boxes), np.int64), np.zeros(len(truth), np.int64)
        scores.append(found.scores[inside])
        right.append(matching.hits(frames[0], boxes, scores[-1], frames[1], truth))
        vehicles += len(truth)
    return np.concatenate(scores), np.concatenate(right), vehicles


def row(
    site: str, lidar: str, scores: FloatArray, right: BoolArray, vehicles: int
) -> dict[str, object]:
    """Precision and recall from the cut on, and what calibrated scores say of them."""
    shown = scores >= CUT
    return {
        "site": site,
        "lidar": lidar,
        "vehicles": vehicles,
        "boxes": int(shown.sum()),
        "precision": right[shown].mean() if shown.any() else np.nan,
        "precision_said": scores[shown].mean() if shown.any() else np.nan,
        "recall": right[shown].sum() / vehicles if vehicles else np.nan,
        "recall_said": scores[shown].sum() / scores.sum() if len(scores) else np.nan,
    }


def halved(weights: dict[str, Tensor]) -> dict[str, Tensor]:
    """The weights of layers in half precision; what norms keep stays, as it may be large."""
    return {
        f"network.{name}": tensor.half() if tensor.ndim > 1 else tensor
        for name, tensor in weights.items()
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("run", type=Path, help="folder of `pyinfra train --sites`")
    parser.add_argument("--sites", type=int, default=60)
    parser.add_argument("--frames", type=int, default=5, help="of each LiDAR; default: 5")
    parser.add_argument("--out", type=Path, default=MODELS / "generalist.safetensors")
    parser.add_argument("--table", type=Path, default=ROOT / "results/generalist_sites.csv")
    args = parser.parse_args()
    found = checkpoint.load(model_file(args.run))
    network = fused(found.network())
    network.calibration = (1.0, RAISED)  # so that boxes of low scores are there as well
    cells = [
        (site, lidar, *found_in(network, samples))
        for site, lidar, samples in looked_at(args.sites, args.frames)
    ]
    a, b = calibration.fit(*(np.concatenate([cell[i] for cell in cells]) for i in (2, 3)))
    line = (a, b + a * RAISED)
    rows = [row(*cell[:2], calibration.calibrated(cell[2], (a, b)), *cell[3:]) for cell in cells]
    table = pd.DataFrame(rows).assign(version=__version__, command="scripts/pack_generalist.py")
    table.to_csv(args.table, index=False, float_format="%.4g")
    figures = {name: round(float(table[name].mean()), 3) for name in ("precision", "recall")}
    about = replace(
        found.about,
        anywhere=True,
        calibration=line,
        figures={"cut": CUT, "sites": args.sites, **figures},
    )
    args.out.parent.mkdir(exist_ok=True)
    checkpoint.write(args.out, halved(found.weights()), about)
    print(f"{args.out}: {args.out.stat().st_size / 1e6:.2f} MB, {line}, {figures}")


if __name__ == "__main__":
    main()
