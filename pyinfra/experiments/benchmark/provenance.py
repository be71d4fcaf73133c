"""Digests of an experiment's inputs, which show whether a result is out of date.

The digests are stored in the row of the experiment and in the folder of its training.
"""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import pandas as pd

from pyinfra.core.config import canonical
from pyinfra.core.errors import ConfigError
from pyinfra.core.files import write
from pyinfra.core.vocabulary import Subset
from pyinfra.experiments import store
from pyinfra.experiments.benchmark.inputs import FRAMES_OF, digests
from pyinfra.experiments.benchmark.matrix import Experiment, Plan
from pyinfra.experiments.benchmark.measure import SETTINGS
from pyinfra.experiments.pool import Progress, silent
from pyinfra.experiments.value import KEY
from pyinfra.models.inference.detect import model_file
from pyinfra.models.training.recipe import Recipe, read_recipe

SHOWN = 5  # maximum number of experiments that a message names
# Ground-truth subsets of version 0.3. Digests leave out subsets that later versions added, because
# added subsets do not change the values of the others.
FIRST_TRUTHS: tuple[Subset, ...] = ("captured", "common", "all")


def recipe_digest(recipe: Recipe) -> str:
    """Returns a digest of the detector's recipe and of the evaluation settings.

    Recipe, evaluation settings, frames and seed determine an experiment. Raises FileNotFoundError
    if the recipe starts from a network that does not exist.
    """
    plain = [canonical(recipe), canonical(replace(SETTINGS, ground_truths=FIRST_TRUTHS))]
    start = plain[0]["learning"].pop("start")
    if start:  # a recipe without `start` keeps the digest that earlier versions computed
        plain.append(hashlib.sha256(model_file(Path(start)).read_bytes()).hexdigest())
    return hashlib.sha256(json.dumps(plain, sort_keys=True).encode()).hexdigest()[:16]


def inputs_of(experiment: Experiment, recipe: Recipe, digests: pd.DataFrame) -> dict[str, str]:
    """Returns the columns `inputs` and `recipe` of an experiment's row.

    digests: digests of the frames, the result of `inputs.digests`.
    """
    frames = digests[store.among(digests, pd.DataFrame([vars(experiment)]), FRAMES_OF)]
    return {"inputs": str(frames.inputs.item()), "recipe": recipe_digest(recipe)}


def stale(plan: Plan, table: pd.DataFrame) -> pd.DataFrame:
    """Returns the rows of finished experiments whose recipe or frames differ from the plan's.

    Rows of the plan's detectors are included even if their scene or LiDAR is not in the plan,
    because all rows of a detector must have the same recipe. Rows of earlier versions have no
    digests and count as up to date. Raises ConfigError for an invalid file of a detector.
    """
    rows = table[knows(table)]
    if rows.empty:
        return rows
    ours = {(experiment.detector, experiment.tier) for experiment in plan.experiments}
    names = list(zip(rows.detector, rows.tier, strict=True))
    now = {
        (name, tier): recipe_digest(read_recipe(plan.files["detectors", name], tier))
        for name, tier in ours.intersection(names)
    }
    recipes = pd.Series([now.get(at) for at in names], index=rows.index)
    frames = rows[FRAMES_OF].merge(digests(plan), on=FRAMES_OF, how="left").set_index(rows.index)
    other = (recipes.notna() & (rows.recipe != recipes)) | (
        frames.inputs.notna() & (rows.inputs != frames.inputs)
    )
    return rows[other]


def knows(table: pd.DataFrame) -> pd.Series:
    """Returns a boolean for each row: whether the experiment is finished and has digests."""
    if "recipe" not in table:
        return pd.Series(False, index=table.index)
    return table.ap.notna() & table.recipe.notna()


def check_experiments(experiments: Path, plan: Plan, progress: Progress = silent) -> None:
    """Raises ConfigError if the table has rows out of date; warns about rows without digests."""
    table = store.read(experiments)
    old = stale(plan, table)
    if len(old):
        names = [" ".join(map(str, row)) for row in old[KEY].head(SHOWN).to_numpy()]
        more = f" and {len(old) - SHOWN} more" if len(old) > SHOWN else ""
        raise ConfigError(
            f"{experiments}: {', '.join(names)}{more}: expected rows of this benchmark, got rows "
            "that were computed with other settings or frames; remove these rows or choose a "
            "different `out`"
        )
    unknown = int(table.ap.notna().sum() - knows(table).sum()) if len(table) else 0
    if unknown:
        progress(
            f"pyinfra: warning: {experiments}: {unknown} rows of an earlier version have no "
            "recipe; they are assumed to have the current recipe"
        )


def claim_run(run: Path, inputs: Mapping[str, str]) -> None:
    """Writes the digests of a training's inputs into its folder.

    Raises ConfigError if the folder has a training with other inputs. A training of an earlier
    version has no digests and is taken as up to date.
    """
    file, text = run / "inputs.txt", "".join(f"{k} {v}\n" for k, v in inputs.items())
    begun = (run / "last.safetensors").exists() and file.exists()
    if begun and file.read_text(encoding="utf-8") != text:
        raise ConfigError(
            f"{run}: expected a detector trained with this recipe on these frames, got a different "
            "recipe or different frames; remove the folder or choose a different `work`"
        )
    run.mkdir(parents=True, exist_ok=True)
    write(file, text)
