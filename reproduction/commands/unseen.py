"""Measures the AP of a pretrained detector at unseen sites, by class, site type and pose error.

The sites are those of `frozen_sites`: 60 generated sites (`plain`), and 20 sites with much
street furniture. Each site has four LiDARs with preset `datasheet` and up to five frames per LiDAR.

Vehicles are matched by a BEV IoU of 0.5. Pedestrians and cyclists are matched by a centre distance
of 0.5 m. For them an IoU of 0.5 is too strict: a box of 0.6 m may be displaced by only 0.2 m. The
class `vulnerable road user` has pedestrians and cyclists. Its boxes may have either of the two
classes.

A condition is an error of the pose that the detector uses. Intervals (Student's t) are computed
from 1,000 bootstrap replicates of whole sites. The table also has the loss of AP under each
condition. The command writes out/unseen.csv:

    python -m reproduction unseen generalist
"""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from pyinfra.core.arrays import BoolArray, Points
from pyinfra.experiments.stress import clouds
from pyinfra.models.detectors.fuse_batchnorm import fused
from pyinfra.models.detectors.network import Network
from pyinfra.models.inference.detect import model_file
from pyinfra.models.training import checkpoint
from pyinfra.models.training.samples import lifted
from pyinfra.scenes.generator.layout import Keys
from pyinfra.scenes.generator.ranges import RANGES
from reproduction import frozen_sites, provenance
from reproduction.arguments import Out, command
from reproduction.site_boxes import (
    KINDS,
    REPLICATES,
    Boxes,
    Matches,
    gathered,
    scored_boxes,
    with_ends,
)

MEASURES = {"bev": "BEV IoU 0.5", "centre": "centre 0.5 m"}
AS_KNOWN = "as known"
RANDOM = np.random.default_rng(0)  # required argument; the pose errors use no random numbers
Fault = Callable[[Points], Points]
CONDITIONS: dict[str, Fault] = {
    AS_KNOWN: lambda points: points,
    "height 0.25 m wrong": partial(clouds.height_error, height_m=0.25, _=RANDOM),
    "pitch 0.5 deg wrong": partial(clouds.angle_error, degrees=0.5, _=RANDOM, axis="pitch"),
}
SITES: dict[str, Callable[[Keys], bool]] = {
    "all": lambda keys: True,
    "with a roundabout": lambda keys: any("roundabout" in j for j in keys.get("junctions", ())),
    "with signals": lambda keys: any("signal" in j for j in keys.get("junctions", ())),
    "without a junction": lambda keys: "junctions" not in keys,
    "with people": lambda keys: "people" in keys,
    "many motorcycles": lambda keys: many(keys, "Motorcycle"),
    "many buses": lambda keys: many(keys, "Bus"),
}


def many(keys: Keys, name: str) -> bool:
    """Returns True if a rare class has a large share of a site's traffic."""
    return bool(keys["traffic"]["class_shares"].get(name, 0) >= RANGES.fleet_weight[0])


Key = tuple[str, str]  # condition and kind of object of a result


def measured(
    network: Network, conditions: dict[str, Fault], samples: Sequence[frozen_sites.TestSample]
) -> dict[Key, list[Matches]]:
    """Returns the matches in each frame of a site, by condition and kind of object."""
    found: dict[Key, list[Matches]] = {}
    for condition, fault in conditions.items():
        for sample in samples:
            points = lifted(fault(lifted(sample.points, -sample.height_m)), sample.height_m)
            network.know(sample.region)
            detections = network.predict(points)
            for kind, (names, metric) in KINDS.items():
                if set(names) <= set(network.classes):
                    matches = scored_boxes(sample, detections, names, metric)
                    found.setdefault((condition, kind), []).append(matches)
    return found


def rows(
    pooled: dict[Key, Boxes], model: str, kinds: dict[str, BoolArray]
) -> Iterator[dict[str, object]]:
    random = np.random.default_rng(1)
    for kind, chosen in kinds.items():
        if not chosen.any():
            continue
        count = int(chosen.sum())
        counts = random.multinomial(count, np.ones(count) / count, REPLICATES)
        weights = np.zeros((1 + REPLICATES, len(chosen)), np.int64)
        weights[0, chosen], weights[1:, chosen] = 1, counts
        every = {key: boxes.ap(weights) for key, boxes in pooled.items()}
        for (condition, name), boxes in pooled.items():
            ap = every[condition, name]
            cost = every[AS_KNOWN, name] - ap if condition != AS_KNOWN else None
            yield {
                "model": model,
                "condition": condition,
                "class": name,
                "measure": MEASURES[KINDS[name][1]],
                "sites": kind,
                "count": count,
                "objects": int(boxes.objects[chosen].sum()),
                **with_ends("ap_r1000", ap, count),
                **with_ends("cost", cost, count),
                "recall_at_half": boxes.recalls_at_half(weights[:1])[0],
                **with_ends("false_per_frame", boxes.false_per_frame(weights), count),
            }


def tested(
    network: Network, model: str, sites: int | None, frames: int
) -> Iterator[dict[str, object]]:
    """Yields the rows of both sets of sites.

    Pose errors and site types are measured on the set `plain` only.
    """
    for name, conditions in (
        ("plain", CONDITIONS),
        ("cluttered", {AS_KNOWN: CONDITIONS[AS_KNOWN]}),
    ):
        keys = [keys for keys, _ in frozen_sites.read_visits(name)][:sites]
        kinds = {kind: np.array([holds(item) for item in keys]) for kind, holds in SITES.items()}
        pooled = gathered(name, sites, frames, partial(measured, network, conditions))
        all_of = {"all": kinds.pop("all")}
        yield from ({"set": name, **row} for row in rows(pooled, model, all_of))
        if name == "plain":
            as_known = {key: item for key, item in pooled.items() if key[0] == AS_KNOWN}
            yield from ({"set": name, **row} for row in rows(as_known, model, kinds))


@command
def main(
    model: Path,
    *,
    sites: int | None = None,
    frames: int = 5,
    out: Out = Path("unseen.csv"),
) -> None:
    """
    Parameters
    ----------
    model : name, model file or run folder
    sites : number of sites per set (default: all)
    frames : frames per LiDAR, at most 5 (default: 5)
    """
    network = fused(checkpoint.load(model_file(model)).network())
    words = f"unseen {model} --frames {frames}" + (f" --sites {sites}" if sites else "")
    rows = tested(network, model.stem, sites, frames)
    table = pd.DataFrame(rows).assign(**provenance(words))
    table.to_csv(out, index=False, float_format="%.4g")
    print(table[table.sites == "all"].iloc[:, :-3].to_string(index=False))
