"""Tests whether a pretrained detector compares LiDARs fairly, from the gain by fine-tuning.

The pretrained detector is tested in the study's scenes, before and after 120 training steps with
the labels of the same scene. The detector was trained with four of the LiDARs and without the other
two. A comparison of LiDARs with the pretrained detector is fair if all LiDARs gain the same AP from
fine-tuning. If a narrow LiDAR gains more AP than a wide one, the comparison is unfair to the narrow
LiDAR. The command adds each row to out/fairness.csv as soon as it is computed. Existing rows of the
same weights are not computed again.

    python -m reproduction fairness generalist --work data/fairness
"""

import itertools
import shutil
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import pandas as pd

from pyinfra.experiments import store
from reproduction import provenance
from reproduction.arguments import Out, Work, command
from reproduction.commands import generalist

# Four LiDARs that the training used, then a narrow and a wide LiDAR that were not used.
LIDARS = (
    *("helios_16", "livox_avia", "pandar_64", "ruby_plus"),
    *("livox_horizon", "hesai_ot128"),
)
ARMS = ("none", "tuned_120")
KEY = ["site", "seed", "lidar", "preset", "arm", "start"]
COLUMNS = [*KEY, "steps", "train_cpu_s", "ap_r1000", "objects"]


@command
def main(
    models: Sequence[Path],
    *,
    work: Work,
    scenes: Sequence[str] = tuple(generalist.SCENES),
    lidars: Sequence[str] = tuple(LIDARS),
    seeds: Sequence[int] = (1,),
    presets: Sequence[str] = ("datasheet",),
    out: Out = Path("fairness.csv"),
) -> None:
    """
    Parameters
    ----------
    models : run folders, model files or names
    work : working folder for frames, about 1 GB
    scenes : names of the scenes (default: all three)
    lidars : names of the LiDARs (default: helios_16 livox_avia pandar_64 ruby_plus livox_horizon
        hesai_ot128)
    seeds : traffic seeds (default: 1)
    presets : presets of the LiDARs (default: datasheet)
    """
    for seed, scene, lidar, preset in itertools.product(seeds, scenes, lidars, presets):
        experiment = generalist.Experiment(scene, seed, lidar, preset)
        folder = None
        for model, arm in itertools.product(models, ARMS):
            wanted = {**asdict(experiment), "arm": arm, "start": generalist.start_of(arm, model)}
            if store.has(store.read(out, KEY), wanted):
                continue
            folder = folder or generalist.simulated(experiment, work)
            record = {**generalist.row(folder, arm, model), **wanted}
            row = {name: record[name] for name in COLUMNS}
            words = f"fairness {model} --scenes {scene} --lidars {lidar} --seeds {seed}"
            words += "" if preset == "datasheet" else f" --presets {preset}"
            columns = {"model": model.stem, **row, **provenance(words)}
            store.put(out, pd.DataFrame([columns]), KEY)
            print(model.stem, *(row[name] for name in (*KEY[:5], "ap_r1000")), flush=True)
            for made in folder.parent.glob(f"{folder.name}_*"):
                shutil.rmtree(made)
        if folder is not None:
            shutil.rmtree(folder.parent)
