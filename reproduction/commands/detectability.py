"""Fits and checks how likely a detector finds an object that a LiDAR sees, for `pyinfra plan`.

The command simulates generated sites from several poses each, with labels at the time of the scan,
runs the pretrained detector and Background, and stores a file for each experiment in --work. Run
it again to resume. It fits the laws on the sites of --fit and checks AP and recall on those of
--check. It writes out/detectability.json, the file of pyinfra/experiments/planner, and
out/detectability.csv with predicted and measured figures of each checked experiment.

    python -m reproduction detectability --work out/detectability --fit 40 --check 12
"""

from __future__ import annotations

import argparse
import json
import time
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import yaml

from pyinfra.core.arrays import FloatArray
from pyinfra.core.errors import Error
from pyinfra.core.files import replacing
from pyinfra.core.version import machine
from pyinfra.dataset.catalogue import lidar_file
from pyinfra.dataset.simulation import Lidar, load_lidar
from pyinfra.experiments.planner import detectability as laws
from pyinfra.experiments.planner.candidates import (
    POSE,
    PoseGrid,
    feasible,
    make_candidates,
    with_faults,
)
from pyinfra.experiments.planner.measure import Measured, detector_for, frames_at, measure
from pyinfra.experiments.planner.site import PlanSite, open_site
from pyinfra.models.inference.boxes_table import detect
from pyinfra.scenes.generator.generate import make_site
from reproduction import add_out

FIRST_SITE = 700_000  # seeds of sites that no training and no other measurement uses
LIDARS = (
    "ruby_plus", "helios_16", "pandar_64", "livox_avia", "hesai_xt32", "livox_horizon",
)  # fmt: skip
DETECTORS = ("generalist", "background")
REPLICATES = 40  # fits on resampled sites, for intervals
DURATION_S = 120.0
TIMED_FRAMES = 5
FEW_SITES = 40  # with fewer sites the fit is marked as a pilot
MOST_OBJECT_ROWS = 400  # rows of one experiment in the fit; more rows of one pose add little


@dataclass(frozen=True)
class Experiment:
    """One pose and LiDAR at a generated site."""

    site: int
    pose: int
    lidar: str
    detector: str

    @property
    def name(self) -> str:
        return f"{self.site}_{self.pose}_{self.lidar}_{self.detector}"


def experiments(sites: int, poses: int, first: int) -> Iterator[Experiment]:
    """Yields each pose of each site with one LiDAR; successive poses have different LiDARs."""
    for i in range(sites):
        for k in range(poses):
            lidar = LIDARS[(i * poses + k) % len(LIDARS)]
            for detector in DETECTORS:
                yield Experiment(first + i, k, lidar, detector)


def site_of(seed: int, frames: int, work: Path) -> PlanSite:
    file = work / f"site_{seed}.yaml"
    if not file.is_file():
        keys = make_site(seed) | {"duration_s": DURATION_S, "label_time": "scan"}
        keys["mounts"]["pole"].update({"pitch_deg": 0.0, "roll_deg": 0.0})
        with replacing(file) as beside:
            beside.write_text(yaml.safe_dump(keys))
    return open_site(file, frames)


def poses_of(site: PlanSite, count: int) -> FloatArray:
    """Returns the scene's pose, then random ones of the candidates within 60 m: (count, 5)."""
    mount = site.mount_keys
    own = [mount["x_m"], mount["y_m"], mount["z_m"], mount["yaw_deg"], mount["pitch_deg"]]
    grid = PoseGrid(every_m=8.0, heights_m=(4.0, 5.0, 6.0, 7.0, 8.0, 10.0))
    made = feasible(with_faults(make_candidates(site, 60.0, grid), site), site)
    rng = np.random.default_rng(int(site.keys["seed"]))
    others = made[POSE].to_numpy(float)[rng.permutation(len(made))]
    return np.concatenate([[own], others])[:count]


def run(experiment: Experiment, poses: int, frames: int, work: Path) -> None:
    """Measures an experiment and stores its objects and its false boxes."""
    file = work / f"{experiment.name}.npz"
    if file.is_file():
        return
    site = site_of(experiment.site, frames, work)
    pose = poses_of(site, poses)[experiment.pose]
    lidar = load_lidar(lidar_file(experiment.lidar), site.preset)
    started = time.process_time()
    result = measure(site, [([*pose], lidar)], site.frames, experiment.detector)
    seconds = time.process_time() - started
    objects = objects_of(site, pose, lidar, result)
    with replacing(file) as beside, beside.open("wb") as stream:
        np.savez_compressed(
            stream,
            objects=objects.to_records(index=False),
            false=result.false_scores(),
            false_people=result.false_scores(person=True),
            ap=float(result.vehicles.ap.ap_r1000.iloc[0]),
            frames=result.frames,
            seconds=seconds,
            present=int((~site.present.person).sum()),
        )
    print(f"{experiment.name}: {seconds:.1f} CPU s", flush=True)


def objects_of(site: PlanSite, pose: FloatArray, lidar: Lidar, result: Measured) -> pd.DataFrame:
    """Returns every present object with what the LiDAR sees of it, and its score (0: missed)."""
    seen = pd.DataFrame(site.observer.observe([*pose], [lidar], [*site.frames]))
    table = site.present.merge(seen.drop(columns="lidar"), how="left", on=["frame", "id"])
    detected = [result.detected(), result.detected(person=True)]
    scores = pd.concat([part for part in detected if len(part)] or detected[:1])
    table = table.merge(scores.astype({"frame": int, "id": int}), how="left", on=["frame", "id"])
    table["type"] = table["type"].astype("S12")
    return table.fillna({"points": 0, "score": 0.0})


def rows_of(experiment: Experiment, work: Path) -> dict[str, object]:
    with np.load(work / f"{experiment.name}.npz") as data:
        out: dict[str, object] = {name: data[name] for name in data.files}
    table = pd.DataFrame(out["objects"])
    table["type"] = table["type"].str.decode("ascii")
    return out | {"objects": table}


def fit(done: list[Experiment], work: Path, *, person: bool) -> dict[str, list[list[float]]]:
    """Returns the coefficients of a class: of all sites, then of resampled sites."""
    terms, scores, sites, false, seen, of_frames, of_site = [], [], [], [], [], [], []
    rng = np.random.default_rng(1)
    for one in done:
        data = rows_of(one, work)
        table = data["objects"]
        assert isinstance(table, pd.DataFrame)
        some = table[(table.points > 0) & (table.person == person)]
        frames = int(np.asarray(data["frames"]))
        scored = np.asarray(data["false_people" if person else "false"])
        if person and not table.person.any():
            continue
        false.append([(scored >= cut).sum() / frames for cut in laws.CUTS])
        seen.append(len(some) / frames)
        of_frames.append(float(frames))
        of_site.append(one.site)
        if len(some) > MOST_OBJECT_ROWS:
            some = some.iloc[rng.permutation(len(some))[:MOST_OBJECT_ROWS]]
        terms.append(laws.object_terms(some))
        scores.append(some.score.to_numpy(float))
        sites.append(np.full(len(some), one.site))
    x, y, site = np.concatenate(terms), np.concatenate(scores), np.concatenate(sites)
    counts, per_frame, weights = np.array(false), np.array(seen), np.array(of_frames)
    places = np.unique(of_site)
    detection_fits = [laws.fit_detection(x, y)]
    false_fits = [laws.fit_false(counts, per_frame, weights)]
    for _ in range(REPLICATES):
        times = np.bincount(rng.integers(len(places), size=len(places)), minlength=len(places))
        of_row = times[np.searchsorted(places, site)].astype(float)
        detection_fits.append(laws.fit_detection(x, y, of_row))
        of_run = times[np.searchsorted(places, of_site)].astype(float)
        false_fits.append(laws.fit_false(counts, per_frame, weights * of_run))
    return {"detection": np.round(detection_fits, 4).tolist(), "false": np.round(false_fits, 4).tolist()}


def checked(one: Experiment, law: laws.Law, work: Path) -> dict[str, object]:
    """Returns predicted and measured AP and recall of the vehicles of an experiment."""
    data = rows_of(one, work)
    table = data["objects"]
    assert isinstance(table, pd.DataFrame)
    vehicles = table[~table.person]
    seen = vehicles[vehicles.points > 0]
    terms, frames = laws.object_terms(seen), int(np.asarray(data["frames"]))
    p = laws.detection_probability(law.detection[0], terms, laws.CUT)
    ap = laws.average_precision(law.detection[0], law.false[0], terms, len(vehicles), frames)
    rate = laws.false_per_frame(law.false[0], laws.CUT, len(seen) / frames)[0]
    return {
        "site": one.site,
        "pose": one.pose,
        "lidar": one.lidar,
        "detector": one.detector,
        "objects": len(vehicles),
        "ap_predicted": ap,
        "ap_measured": float(np.asarray(data["ap"])),
        "recall_predicted": 100 * p.sum() / len(vehicles),
        "recall_measured": 100 * (vehicles.score >= laws.CUT).mean(),
        "false_predicted": rate,
        "false_measured": (np.asarray(data["false"]) >= laws.CUT).sum() / frames,
        "ten_points_percent": 100 * (vehicles.points >= 10).mean(),
    }


def timed(work: Path, experiment: Experiment, poses: int, frames: int) -> float:
    """Returns the CPU time (ms) of a detector per frame, without simulation and evaluation."""
    site = site_of(experiment.site, frames, work)
    pose = poses_of(site, poses)[experiment.pose]
    lidar = load_lidar(lidar_file(experiment.lidar))
    sequence = frames_at(site, pose, lidar, site.frames[:TIMED_FRAMES])
    model = detector_for(sequence, experiment.detector)
    detect(model, sequence)  # simulated frames stay in memory, and weights are read
    started = time.process_time()
    detect(model, sequence)
    return 1000 * (time.process_time() - started) / TIMED_FRAMES


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--work", type=Path, required=True, help="folder of the experiments")
    parser.add_argument("--fit", type=int, default=40, help="sites of the fit; default: 40")
    parser.add_argument("--check", type=int, default=12, help="sites of the check; default: 12")
    parser.add_argument("--poses", type=int, default=4, help="poses of a site; default: 4")
    parser.add_argument("--frames", type=int, default=30, help="frames of a pose; default: 30")
    add_out(parser, "detectability.csv")
    args = parser.parse_args()
    warnings.simplefilter("ignore")
    args.work.mkdir(parents=True, exist_ok=True)
    plans = {
        "fit": list(experiments(args.fit, args.poses, FIRST_SITE)),
        "check": list(experiments(args.check, args.poses, FIRST_SITE + 100_000)),
    }
    done: dict[str, list[Experiment]] = {"fit": [], "check": []}
    for part, plan in plans.items():
        for one in plan:
            try:
                run(one, args.poses, args.frames, args.work)
            except Error as error:
                print(f"{one.name}: left out: {error}", flush=True)
                continue
            done[part].append(one)
    files: dict[str, object] = {}
    rows = []
    for detector in DETECTORS:
        of_it = [one for one in done["fit"] if one.detector == detector]
        vehicles = fit(of_it, args.work, person=False)
        people = fit(of_it, args.work, person=True) if detector != "background" else None
        sites = len({one.site for one in of_it})
        first = of_it[0]
        files[detector] = {
            "pilot": sites < FEW_SITES,
            "sites": sites,
            "frames": args.frames,
            "note": f"{len(of_it)} poses at {sites} generated sites, labels at the scan's time",
            "latency_ms": round(timed(args.work, first, args.poses, args.frames), 1),
            "machine": machine(),
            "vehicles": vehicles,
            **({"people": people} if people else {}),
        }
        law = laws.Law(np.array(vehicles["detection"]), np.array(vehicles["false"]))
        of_check = [one for one in done["check"] if one.detector == detector]
        for part, some in (("fit", of_it), ("check", of_check)):
            rows += [{"part": part, **checked(one, law, args.work)} for one in some]
    table = pd.DataFrame(rows)
    table.to_csv(args.out, index=False, float_format="%.4g")
    args.out.with_suffix(".json").write_text(json.dumps(files, separators=(",", ":")) + "\n")
    for (part, detector), some in table.groupby(["part", "detector"]):
        gap = some.ap_predicted - some.ap_measured
        r = np.corrcoef(some.ap_predicted, some.ap_measured)[0, 1] if len(some) > 2 else np.nan
        print(
            f"{detector}, {part}: {len(some)} experiments, mean error of AP "
            f"{gap.abs().mean():.1f}, bias {gap.mean():+.1f}, r {r:.3f}"
        )
