"""AP of networks of many sites where none of them learnt, by class and by what is new at the sites.

Generated sites that neither training nor calibration saw, four LiDARs of the catalogue each as the
vendors' sheets say, some frames of each. Vehicles by BEV IoU 0.5; pedestrians and cyclists by IoU
0.25 and by centres within 0.5 m, as half of a box of 0.6 m is an offset of 0.2 m. Intervals
(Student's) and paired differences to the first model are of 1,000 draws of whole sites.
    .venv/bin/python benchmarks/unseen.py generalist older.safetensors
writes results/unseen.csv.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "scripts"))
import pack_generalist

from pyinfra import __version__, machine
from pyinfra.arrays import BoolArray, FloatArray, IntArray
from pyinfra.detectors import Detections
from pyinfra.detectors.classes import ObjectClass
from pyinfra.detectors.fused import fused
from pyinfra.detectors.network import Network
from pyinfra.evaluation import matching
from pyinfra.evaluation.ap import average_precision, rank
from pyinfra.sites.generator import make_site
from pyinfra.sites.layout import Keys
from pyinfra.sites.ranges import RANGES
from pyinfra.statistics import intervals
from pyinfra.training import checkpoint
from pyinfra.training.detect import model_file
from pyinfra.training.samples import SiteSample

ROOT = Path(__file__).resolve().parents[1]
FINE = 1000  # recalls
DRAWS = 1000
# How an object of a class is found: name, metric, threshold.
MEASURES: dict[ObjectClass, list[tuple[str, matching.Metric, float]]] = {
    "vehicle": [("BEV IoU 0.5", "bev", 0.5)],
    "pedestrian": [("BEV IoU 0.25", "bev", 0.25), ("centre 0.5 m", "centre", 0.5)],
    "cyclist": [("BEV IoU 0.25", "bev", 0.25), ("centre 0.5 m", "centre", 0.5)],
}
KINDS: dict[str, Callable[[Keys], bool]] = {
    "all": lambda keys: True,
    "with a roundabout": lambda keys: any("roundabout" in j for j in keys.get("junctions", ())),
    "with signals": lambda keys: any("signal" in j for j in keys.get("junctions", ())),
    "without a junction": lambda keys: "junctions" not in keys,
    "with people": lambda keys: "people" in keys,
    "many motorcycles": lambda keys: many(keys, "Motorcycle"),
    "many buses": lambda keys: many(keys, "Bus"),
}


def many(keys: Keys, name: str) -> bool:
    """Whether a class that is rare elsewhere is much of the traffic."""
    return bool(keys["traffic"]["class_shares"].get(name, 0) >= RANGES.fleet_weight[0])


@dataclass(frozen=True, eq=False)
class Found:
    """What a model has of a class at all sites, by one measure."""

    slot: IntArray  # (n,) place of the site
    scores: FloatArray
    right: BoolArray
    objects: IntArray  # (sites,)

    def ap(self, weights: IntArray) -> FloatArray:
        """weights: (draws, sites)."""
        return average_precision(
            rank(self.scores, self.right, self.objects, self.slot), FINE, weights
        )


def looked_at(
    sites: int, frames: int, networks: list[Network]
) -> Iterator[tuple[int, SiteSample, list[Detections]]]:
    """Place of the site, a sample, and what each network finds in it."""
    places: dict[str, int] = {}
    for site, _, samples in pack_generalist.looked_at(sites, frames, tuple(MEASURES)):
        place = places.setdefault(site, len(places))
        for sample in samples:
            for network in networks:
                network.know(sample.region)
            yield place, sample, [network.predict(sample.points) for network in networks]


def gathered(
    args: argparse.Namespace, networks: list[Network]
) -> dict[tuple[int, ObjectClass, str], Found]:
    parts: dict[tuple[int, ObjectClass, str], list[tuple[IntArray, FloatArray, BoolArray]]] = {}
    objects: dict[tuple[int, ObjectClass, str], IntArray] = {}
    for place, sample, found in looked_at(args.sites, args.frames, networks):
        for model, network in enumerate(networks):
            for name in network.classes:
                for label, metric, limit in MEASURES[name]:
                    key = (model, name, label)
                    scores, right, there = pack_generalist.right_of(
                        sample, found[model], list(MEASURES).index(name), name, metric, limit
                    )
                    slot = np.full(len(scores), place)
                    parts.setdefault(key, []).append((slot, scores, right))
                    objects.setdefault(key, np.zeros(args.sites, np.int64))[place] += there
    out = {}
    for key, rows in parts.items():
        slot, scores, right = (np.concatenate(column) for column in zip(*rows, strict=True))
        out[key] = Found(slot, scores, right, objects[key])
    return out


def rows(
    found: dict[tuple[int, ObjectClass, str], Found], names: list[str], kinds: dict[str, BoolArray]
) -> Iterator[dict[str, object]]:
    random = np.random.default_rng(1)
    for kind, chosen in kinds.items():
        if not chosen.any():
            continue
        draws = random.multinomial(chosen.sum(), np.ones(chosen.sum()) / chosen.sum(), DRAWS)
        weights = np.zeros((1 + DRAWS, len(chosen)), np.int64)
        weights[0, chosen], weights[1:, chosen] = 1, draws
        for (model, name, label), own in found.items():
            ap, first = own.ap(weights), found.get((0, name, label))
            less = ap - first.ap(weights) if model and first is not None else None
            yield {
                "model": names[model],
                "class": name,
                "measure": label,
                "sites": kind,
                "count": int(chosen.sum()),
                "objects": int(own.objects[chosen].sum()),
                **with_ends("ap_fine", ap, chosen.sum()),
                **with_ends("difference", less, chosen.sum()),
            }


def with_ends(name: str, values: FloatArray | None, sites: int) -> dict[str, float]:
    """The value, and the ends of its interval, of the draws of sites that follow it."""
    keys = (name, f"{name}_low", f"{name}_high")
    if values is None:
        return dict.fromkeys(keys, np.nan)
    ends = intervals.interval(values[0], values[1:], sites)
    return dict(zip(keys, (float(values[0]), *map(float, ends)), strict=True))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("models", nargs="+", type=Path, help="names, files or runs")
    parser.add_argument("--sites", type=int, default=60)
    parser.add_argument("--frames", type=int, default=5, help="of each LiDAR; default: 5")
    parser.add_argument("--out", type=Path, default=ROOT / "results/unseen.csv")
    args = parser.parse_args()
    networks = [fused(checkpoint.load(model_file(model)).network()) for model in args.models]
    first = pack_generalist.FIRST_SITE
    keys = [make_site(seed) for seed in range(first, first + args.sites)]
    kinds = {kind: np.array([holds(own) for own in keys]) for kind, holds in KINDS.items()}
    found = rows(gathered(args, networks), [model.stem for model in args.models], kinds)
    table = pd.DataFrame(found).assign(
        version=__version__, machine=machine(), command="benchmarks/unseen.py"
    )
    table.to_csv(args.out, index=False, float_format="%.4g")
    print(table.iloc[:, :-3].to_string(index=False))


if __name__ == "__main__":
    main()
