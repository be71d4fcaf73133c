"""Fits and checks the probability that a detector finds an object, for `pyinfra plan`.

The command simulates generated sites from several poses each, with labels at the time of the scan,
and runs the pretrained detector and Background. It stores a file for each run in --work. Run it
again to resume. The laws are the fitted formulas for found objects and for false boxes. The command
fits them at the sites of --fit, and checks AP and recall at the sites of --check. There, prediction
and measurement use different traffic. With `--fit 0` it checks the laws of the package. It writes

- NAME.json, the file of pyinfra/experiments/planner, if there is a fit
- NAME.csv, predicted and measured figures of each checked pose and traffic seed
- NAME_summary.csv, errors, correlations and regret, with intervals
- NAME_reliability.csv, predicted and measured shares of detected objects

    python -m reproduction detectability --work out/detectability --out results/detectability.csv
"""

import json
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from pyinfra.core.arrays import FloatArray
from pyinfra.core.errors import Error
from pyinfra.core.version import machine
from pyinfra.dataset import simulation
from pyinfra.experiments.planner import detectability as laws
from pyinfra.models.inference.detect import model_file
from pyinfra.models.training import checkpoint
from reproduction import ROOT, provenance
from reproduction.arguments import Out, Work, command
from reproduction.detectability import check
from reproduction.detectability.fit import fit_detection, fit_false
from reproduction.detectability.runs import (
    DETECTORS,
    Run,
    check_runs,
    detection_ms,
    fit_runs,
    read,
    store,
)

REPLICATES = 40  # number of fits on resampled sites, from which intervals are computed
FEW_SITES = 40  # number of sites below which the fit is marked as a pilot
MOST_OBJECT_ROWS = 400  # maximum number of objects of one run in the fit; more do not improve it


def fit(
    runs: list[Run], detector: str, work: Path, *, person: bool
) -> dict[str, list[list[float]]]:
    """Returns the coefficients of each law: fitted to all sites, then to resampled sites.

    person: fit the laws of pedestrians and cyclists instead of those of vehicles
    """
    terms, scores, sites, false, seen, of_frames, of_site = [], [], [], [], [], [], []
    spinning = []
    rng = np.random.default_rng(1)
    for run in runs:
        outcome = read(run, work)
        objects = outcome.objects
        if person and not objects.person.any():
            continue
        some = objects[(objects.points > 0) & (objects.person == person)]
        boxes = (outcome.false_people if person else outcome.false)[detector]
        false.append([(boxes >= cut).sum() / outcome.frames for cut in laws.CUTS])
        seen.append(len(some) / outcome.frames)
        spinning.append(outcome.spinning)
        of_frames.append(float(outcome.frames))
        of_site.append(run.site)
        if len(some) > MOST_OBJECT_ROWS:
            some = some.iloc[rng.permutation(len(some))[:MOST_OBJECT_ROWS]]
        terms.append(laws.object_terms(some))
        scores.append(some[f"score_{detector}"].to_numpy(float))
        sites.append(np.full(len(some), run.site))
    x, y, site = np.concatenate(terms), np.concatenate(scores), np.concatenate(sites)
    counts, per_frame, weights = np.array(false), np.array(seen), np.array(of_frames)
    spins = np.array(spinning)
    places = np.unique(of_site)
    detection: list[FloatArray] = [fit_detection(x, y)]
    rates: list[FloatArray] = [fit_false(counts, per_frame, spins, weights)]
    for _ in range(REPLICATES):
        times = np.bincount(rng.integers(len(places), size=len(places)), minlength=len(places))
        of_row = times[np.searchsorted(places, site)].astype(float)
        detection.append(fit_detection(x, y, of_row))
        of_run = times[np.searchsorted(places, of_site)].astype(float)
        rates.append(fit_false(counts, per_frame, spins, weights * of_run))
    return {"detection": np.round(detection, 4).tolist(), "false": np.round(rates, 4).tolist()}


def stored(runs: list[Run], frames: int, work: Path) -> list[Run]:
    """Measures the runs that have no file yet; returns the runs without those of failed sites."""
    left_out = set()
    for run in runs:
        if run.site in left_out:
            continue
        try:
            store(run, frames, work)
        except (Error, IndexError) as error:  # the site has no traffic or too few poses
            print(f"site {run.site}: left out: {error}", flush=True)
            left_out.add(run.site)
    return [run for run in runs if run.site not in left_out]


@command
def main(
    *,
    work: Work,
    fit: int = 40,
    check: int = 12,
    frames: int = 30,
    only_errors: bool = False,
    out: Out = Path("detectability.csv"),
) -> None:
    """
    Parameters
    ----------
    work : folder of the runs
    fit : number of sites of the fit, 0 for no fit; default: 40
    check : number of sites of the check; default: 12
    frames : number of frames of a run; default: 30
    only_errors : only compute the errors at unseen sites again, from the recorded tables
    """
    warnings.simplefilter("ignore")
    plain = json.loads(laws.FILE.read_text(encoding="utf-8"))
    if only_errors:
        write(out, with_errors(plain, pd.read_csv(ROOT / "results/detectability.csv")))
        return
    if check < 1:
        raise Error(f"check: expected 1 or more sites, got {check}")
    fitted = stored([*fit_runs(fit)], frames, work)
    checked = stored([*check_runs(check)], frames, work)
    if fitted:
        plain = fit_all(fitted, frames, work)
    made_by = provenance(f"detectability --fit {fit} --check {check} --frames {frames}")
    tables = check_tables(checked, plain, frames, work)
    if fitted:
        write(out, with_errors(plain, tables[""]))
    for suffix, table in tables.items():
        file = out.with_name(f"{out.stem}{suffix}.csv")
        table.assign(**made_by).to_csv(file, index=False, float_format="%.4g")


def with_errors(plain: dict[str, dict[str, Any]], table: pd.DataFrame) -> dict[str, dict[str, Any]]:
    """Returns the content of the file of the laws with the errors at unseen sites.

    table: rows of `check.check_table`. The errors of the pretrained detector are those of the
    options of `plan_coverage.csv`. The gains by fine-tuning are those of `experiments.csv`, and of
    `fairness.csv` for other LiDARs.
    """
    for detector, law in plain.items():
        law["unseen_std"] = check.unseen_std(table[table.detector == detector])
    options = pd.read_csv(ROOT / "results/plan_coverage.csv")
    plain["generalist"]["unseen_std"] = check.unseen_std_of_options(options)
    fairness, experiments = (
        pd.read_csv(ROOT / f"results/{name}.csv") for name in ("fairness", "experiments")
    )
    plain["generalist"]["fine_tuning_ap"] = check.fine_tuning_ap(fairness, experiments)
    return plain


def fit_all(runs: list[Run], frames: int, work: Path) -> dict[str, dict[str, Any]]:
    """Fits the laws of each detector; returns the content of their file, by detector."""
    plain: dict[str, dict[str, Any]] = {}
    sites = len({run.site for run in runs})
    for detector in DETECTORS:
        plain[detector] = {
            "pilot": sites < FEW_SITES,
            "sites": sites,
            "frames": frames,
            "frames_version": str(simulation.frames_version()),
            "note": f"{len(runs)} poses at {sites} generated sites, labels at the scan's time",
            "model": ""
            if detector == "background"
            else checkpoint.digest(model_file(Path(detector))),
            "latency_ms": round(detection_ms(runs[0], detector, frames, work), 1),
            "machine": machine(),
            "vehicles": fit(runs, detector, work, person=False),
        }
        if detector != "background":
            plain[detector]["people"] = fit(runs, detector, work, person=True)
    return plain


def write(out: Path, plain: dict[str, dict[str, Any]]) -> None:
    """Writes the file of the laws beside the table `out`."""
    out.with_suffix(".json").write_text(json.dumps(plain, separators=(",", ":")) + "\n")


def check_tables(
    runs: list[Run], plain: dict[str, dict[str, Any]], frames: int, work: Path
) -> dict[str, pd.DataFrame]:
    """Returns the tables of the check by the suffix of their file's name."""
    own = [run for run in runs if run.seed == 0]
    other = [run for run in runs if run.seed > 0]
    empty = check.empty_scene_measures(own, frames, work)
    tables, summaries, curves = [], [], []
    for detector, law in plain.items():
        vehicles = laws.law_of(law["vehicles"], detector)
        table = check.check_table(runs, detector, vehicles, empty, work)
        tables.append(table)
        summaries.append(pd.DataFrame(check.summary(table)).assign(detector=detector))
        curves.append(check.reliability(other, detector, vehicles, work, person=False))
        if "people" in law:
            people = laws.law_of(law["people"], detector)
            curves.append(check.reliability(other, detector, people, work, person=True))
    return {
        "": pd.concat(tables),
        "_summary": pd.concat(summaries),
        "_reliability": pd.concat(curves),
    }
