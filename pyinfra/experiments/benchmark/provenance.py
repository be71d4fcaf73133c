"""What a cell depends on: its row and its training say so, and nothing old is taken for new."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import pandas as pd

from pyinfra.core.config import canonical
from pyinfra.core.errors import ConfigError
from pyinfra.core.files import replacing
from pyinfra.core.vocabulary import Subset
from pyinfra.experiments import store
from pyinfra.experiments.benchmark.inputs import FRAMES_OF, digests
from pyinfra.experiments.benchmark.matrix import Cell, Plan
from pyinfra.experiments.benchmark.measure import SETTINGS
from pyinfra.experiments.pool import Say, silent
from pyinfra.experiments.value import KEY
from pyinfra.models.inference.detect import model_file
from pyinfra.models.training.recipe import Recipe, read_recipe

SHOWN = 5  # cells that a message names
# What version 0.3 measured: those added since change none of its figures.
FIRST_TRUTHS: tuple[Subset, ...] = ("captured", "common", "all")


def recipe_digest(recipe: Recipe) -> str:
    """Of what a cell depends on beside frames and seed: the recipe, and how AP is counted.

    Raises FileNotFoundError for a recipe that starts with a network that is not there.
    """
    plain = [canonical(recipe), canonical(replace(SETTINGS, ground_truths=FIRST_TRUTHS))]
    start = plain[0]["learning"].pop("start")
    if start:  # else as the rows of earlier versions
        plain.append(hashlib.sha256(model_file(Path(start)).read_bytes()).hexdigest())
    return hashlib.sha256(json.dumps(plain, sort_keys=True).encode()).hexdigest()[:16]


def inputs_of(cell: Cell, recipe: Recipe, digests: pd.DataFrame) -> dict[str, str]:
    """The columns of a cell's row that say what it depends on; digests: of the frames."""
    frames = digests[store.among(digests, pd.DataFrame([vars(cell)]), FRAMES_OF)]
    return {"inputs": str(frames.inputs.item()), "recipe": recipe_digest(recipe)}


def stale(plan: Plan, table: pd.DataFrame) -> pd.DataFrame:
    """The rows of finished cells that are of another recipe or of other frames than now.

    They are those of the plan's detectors, also of scenes and LiDARs that it has not: one name
    stands for one recipe. Rows of an earlier version, without digests, are taken for the same.
    Raises ConfigError for a wrong file of a detector.
    """
    rows = table[knows(table)]
    if rows.empty:
        return rows
    ours = {(cell.detector, cell.tier) for cell in plan.cells}
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
    """Which rows are of a finished cell, and say what it depends on."""
    if "recipe" not in table:
        return pd.Series(False, index=table.index)
    return table.ap.notna() & table.recipe.notna()


def check_cells(cells: Path, plan: Plan, say: Say = silent) -> None:
    """Raises ConfigError if the table has stale rows; warns of those that do not say."""
    table = store.read(cells)
    old = stale(plan, table)
    if len(old):
        names = [" ".join(map(str, row)) for row in old[KEY].head(SHOWN).to_numpy()]
        more = f" and {len(old) - SHOWN} more" if len(old) > SHOWN else ""
        raise ConfigError(
            f"{cells}: {', '.join(names)}{more}: found rows of another recipe or other frames of "
            "these names, allowed those of this benchmark, no such rows, or another `out`"
        )
    unknown = int(table.ap.notna().sum() - knows(table).sum()) if len(table) else 0
    if unknown:
        say(
            f"pyinfra: warning: {cells}: {unknown} rows of an earlier version do not say of which "
            "recipe they are; taken for that of now"
        )


def claim_run(run: Path, inputs: Mapping[str, str]) -> None:
    """Writes beside a training what it depends on.

    Raises ConfigError if one of other inputs began there; one of an earlier version, which does
    not say, is taken for the same.
    """
    file, text = run / "inputs.txt", "".join(f"{k} {v}\n" for k, v in inputs.items())
    begun = (run / "last.safetensors").exists() and file.exists()
    if begun and file.read_text(encoding="utf-8") != text:
        raise ConfigError(
            f"{run}: found a training of another recipe or other frames, allowed the same, no "
            "such folder, or another `work`"
        )
    run.mkdir(parents=True, exist_ok=True)
    with replacing(file) as beside:
        beside.write_text(text, encoding="utf-8")
