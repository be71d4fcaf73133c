"""Measures tracks and counts of the pretrained detector against simulated truth.

The command simulates a minute of each scene with each LiDAR, runs the pretrained detector, tracks
its boxes, and compares tracks and passages with the truth:

    python -m reproduction tracks --work out/tracks --scenes highway --seeds 1 2 3

It keeps boxes and truth of each run in the working folder, so that a second run only tracks. It
writes out/tracks.csv with one row per run for the boxes of the detector, and one for true boxes.
"""

import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated

import numpy as np
import pandas as pd

import pyinfra as pi
from pyinfra.dataset.frame_sequence import FrameSequence, RecordedFrames
from pyinfra.dataset.frames import recorded_s
from pyinfra.experiments import store
from pyinfra.models.inference.folder import Place, detector_at_place
from pyinfra.tracking.evaluation import compare_with, true_objects
from pyinfra.tracking.lines import lines_of
from reproduction import provenance
from reproduction.arguments import Out, Work, command
from reproduction.simulate import simulate

SCENES = ("highway", "crossroad", "curve")
LIDARS = ("ruby_plus", "pandar_64", "helios_16", "livox_avia")
FRAMES = 600
TIMED = 8  # number of frames in which the detector is timed
WITHIN_M = 80.0
POLES, POLES_LIDAR = "crossroad_poles", "pandar_64"
LASTING = 5  # true boxes of vehicles that exist in 5 frames or fewer are left out
KEY = ["scene", "lidar", "seed", "boxes"]


def case_of(
    scene: str, lidar: str, seed: int, work: Path
) -> tuple[FrameSequence, pd.DataFrame, pd.DataFrame]:
    """Returns the frames of a run, the boxes of the detector, and the truth.

    Boxes and truth are read from the working folder if they are there.
    """
    frames = frames_of(scene, lidar, seed, work)
    stem = work / f"{scene}_{lidar}_{seed}"
    boxes, truth = (stem.with_name(f"{stem.name}_{n}.csv") for n in ("boxes", "truth"))
    if not truth.is_file():
        found = pi.detect(pi.load_detector("generalist", threads=1), frames)
        found.to_csv(boxes, index=False, float_format="%.6g")
        true_objects(frames).to_csv(truth, index=False, float_format="%.7g")
    return frames, pd.read_csv(boxes), pd.read_csv(truth)


def detector_ms(frames: FrameSequence) -> float:
    """Returns the processor time of the detector per frame, in milliseconds."""
    detector = detector_at_place(
        pi.load_detector("generalist").file, Place(frames.ground, frames.region)
    )
    times = []
    for number in frames.numbers[:TIMED]:
        points = frames.frame(number).points
        start = time.process_time()
        detector.predict(points)
        times.append(1000 * (time.process_time() - start))
    return float(np.median(times))


def frames_of(scene: str, lidar: str, seed: int, work: Path) -> FrameSequence:
    if scene != POLES:
        return pi.simulate(pi.load_scene(scene, seed=seed), lidar, range(FRAMES))
    data = work / f"{scene}_{seed}"
    simulate(
        scene, [lidar], data, preset="datasheet", seed=seed, fuse=True, mount="west,east",
        frames=f"0:{FRAMES}",
    )  # fmt: skip
    return RecordedFrames(data / "fused" / lidar, tuple(range(FRAMES)))


def rows(scene: str, lidar: str, seed: int, work: Path) -> Iterator[dict[str, object]]:
    """Yields the row of the detector's boxes and that of true boxes."""
    frames, detected, all_truth = case_of(scene, lidar, seed, work)
    lines = lines_of(frames)
    seconds = recorded_s(frames.numbers, frames.period_s)
    detector_time = detector_ms(frames)
    keys = {"scene": scene, "lidar": lidar, "preset": "datasheet", "seed": seed}
    truth = all_truth[all_truth.visibility >= 0].reset_index(drop=True)
    lasting = truth.groupby("id").frame.transform("size") > LASTING
    perfect = truth[lasting].assign(score=0.95).reset_index(drop=True)
    for name, boxes in (("detector", detected), ("true", perfect)):
        start = time.process_time()
        tracks = pi.track(boxes.drop(columns="t_s", errors="ignore"), frames)
        tracker_ms = 1000 * (time.process_time() - start) / FRAMES
        found = compare_with(all_truth, tracks, lines, within_m=WITHIN_M, seconds=seconds)
        per_frame = len(tracks) / FRAMES
        yield {
            **keys,
            "boxes": name,
            **{key: round(float(v), 3) for key, v in found.measures.items()},
            "all_vehicles": boxes.id.nunique() if name == "true" else "",
            "all_tracks": tracks.id.nunique(),
            "passages_true": int(found.passages.shape[0] - (found.passages.true_id < 0).sum())
            + len(found.missed),
            "passages": len(found.passages),
            "never": len(found.missed),
            "extra": int((found.passages.true_id < 0).sum()),
            "detector_ms": round(detector_time, 1),
            "tracker_ms": round(tracker_ms, 2),
            "tracks_per_frame": round(per_frame, 1),
        }


@command
def main(
    *,
    work: Work,
    scenes: Annotated[Sequence[str], {"choices": (*SCENES, POLES)}] = SCENES,
    lidars: Annotated[Sequence[str], {"choices": LIDARS}] = LIDARS,
    seeds: Sequence[int] = (1, 2, 3),
    out: Out = Path("tracks.csv"),
) -> None:
    """
    Parameters
    ----------
    work : working folder for frames, about 5 GB
    seeds : traffic seeds (default: 1 2 3)
    """
    for scene in scenes:
        for lidar in (POLES_LIDAR,) if scene == POLES else lidars:
            for seed in seeds:
                made_by = provenance(f"tracks --work WORK --scenes {scene} --lidars {lidar}")
                table = pd.DataFrame(rows(scene, lidar, seed, work)).assign(**made_by)
                print(table.iloc[0][["scene", "lidar", "seed", "hota", "never", "extra"]])
                store.put(out, table, KEY)
