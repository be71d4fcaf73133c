"""A small site that the doors are tried on: frames of two LiDARs, a detector's boxes."""

from __future__ import annotations

import csv
import shutil
from dataclasses import dataclass
from pathlib import Path

from checkout import Checkout, Outcome

LIDARS = ("helios_16", "livox_avia")


@dataclass(frozen=True)
class Site:
    """Where it lies; what is tried is tried on copies."""

    checkout: Checkout
    folder: Path
    data: Path  # data set of both LiDARs
    pred: Path  # predictions of Background on the first

    def copy(self, name: str) -> Path:
        """A data set to spoil."""
        to = self.folder / name
        shutil.rmtree(to, ignore_errors=True)
        shutil.copytree(self.data, to)
        return to

    def ap(self, data: Path, lidar: str = LIDARS[0], *words: str) -> tuple[float, Outcome]:
        """AP of the captured vehicles, NaN if there is none."""
        out = self.folder / "evaluation"
        shutil.rmtree(out, ignore_errors=True)
        options = ["--no-figures", "--draws", "20", *words]
        outcome = self.checkout.pyinfra(
            "evaluate", "--gt", data / lidar, "--pred", self.pred, "--out", out, *options
        )
        if not (out / "ap.csv").is_file():
            return float("nan"), outcome
        with (out / "ap.csv").open() as stream:
            return float(next(csv.DictReader(stream))["ap"]), outcome


def build(checkout: Checkout, folder: Path) -> Site:
    """Simulates, learns and detects. Raises RuntimeError if one of them fails."""
    data, run, pred = folder / "site", folder / "run", folder / "pred"
    lidars = [checkout.configs / f"lidars/{name}.yaml" for name in LIDARS]
    scene = checkout.configs / "scenes/highway.yaml"
    words = ["--preset", "paper", "--frames", "0:4400:80", "--fields", "--out", data]
    config = checkout.configs / "detectors/background.yaml"
    first = data / LIDARS[0]
    for outcome in (
        checkout.infrasim("run", scene, "--lidar", *lidars, *words),
        checkout.pyinfra("train", config, "--data", first, "--tier", "smoke", "--out", run),
        checkout.pyinfra("detect", run, "--data", first, "--out", pred),
    ):
        if outcome.code != 0:
            raise RuntimeError(outcome.said)
    return Site(checkout, folder, data, pred)
