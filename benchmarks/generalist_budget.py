"""AP of a network of many sites over what its training costs, at sites that it never saw.

The shipped network, and others of the same recipe that learnt for fewer or more steps or with
another precision, each with a whole fall of the rate. Sites, measures and intervals are those of
benchmarks/unseen.py; differences are to the shipped network. A stopped training goes on.
    .venv/bin/python benchmarks/generalist_budget.py --work data/generalist_budget
writes results/generalist_budget.csv.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import get_args

import numpy as np
import pandas as pd
import unseen

from pyinfra.core.config import read_config
from pyinfra.core.version import __version__, machine
from pyinfra.models.detectors.fuse_batchnorm import fused
from pyinfra.models.inference.detect import model_file
from pyinfra.models.training import checkpoint
from pyinfra.models.training.generated_sites import read_stream
from pyinfra.models.training.loop import Description
from pyinfra.models.training.recipe import Precision, read_recipe
from pyinfra.models.training.train import train

ROOT = Path(__file__).resolve().parents[1]
SHIPPED = Path("generalist")


def trained(steps: int, precision: Precision, work: Path) -> Path:
    """The run of so many steps."""
    recipe = read_recipe(ROOT / "configs/detectors/generalist.yaml", "full")
    recipe = recipe.for_budget(steps / recipe.learning.steps)
    run = work / f"{precision}_{steps}"
    stream = read_stream(ROOT / "configs/streams/generalist.yaml", recipe.classes)
    train(recipe, stream, run, precision=precision)
    return run


def learnt(run: Path) -> dict[str, object]:
    """How a run learnt, and for how long; nothing of a file, which does not say."""
    if not (run / "log.csv").is_file():
        return {}
    precision = read_config(run / "run.yaml", Description).precision
    seconds = round(pd.read_csv(run / "log.csv").cpu_seconds.sum())
    return {"precision": precision, "train_cpu_s": seconds}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--work", type=Path, required=True, help="folder of runs")
    parser.add_argument("--steps", type=int, nargs="*", default=[500, 2000])
    parser.add_argument("--precision", choices=get_args(Precision), default="float32")
    parser.add_argument("--models", type=Path, nargs="+", default=[], help="other runs and files")
    parser.add_argument("--packed", type=Path, help="the run that the shipped network was")
    parser.add_argument("--sites", type=int, default=60)
    parser.add_argument("--frames", type=int, default=5, help="of each LiDAR; default: 5")
    parser.add_argument("--out", type=Path, default=ROOT / "results/generalist_budget.csv")
    args = parser.parse_args()
    own = [trained(steps, args.precision, args.work) for steps in sorted(args.steps)]
    models = [SHIPPED, *args.models, *own]
    found = [checkpoint.load(model_file(model)) for model in models]
    networks = [fused(one.network()) for one in found]
    everywhere = {"all": np.ones(args.sites, np.bool_)}
    names = [model.name for model in models]
    runs = [args.packed or SHIPPED, *models[1:]]
    told = {
        name: {"steps": one.about.steps, **learnt(run)}
        for name, one, run in zip(names, found, runs, strict=True)
    }
    conditions = {unseen.AS_KNOWN: unseen.CONDITIONS[unseen.AS_KNOWN]}
    found_at = unseen.gathered("plain", args.sites, args.frames, networks, conditions)
    rows = unseen.rows(found_at, names, everywhere)
    table = pd.DataFrame([{**row, **told[str(row["model"])]} for row in rows])
    about = {"version": __version__, "machine": machine()}
    table = table.assign(**about, command="benchmarks/generalist_budget.py")
    table.to_csv(args.out, index=False, float_format="%.5g")
    print(table.iloc[:, :-3].to_string(index=False))


if __name__ == "__main__":
    main()
