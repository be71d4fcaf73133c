"""Thousands of spoilt configurations and data files: none may crash, hang, raise or mislead."""

from __future__ import annotations

import json
import random
import shutil
import subprocess
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import spoil
from checkout import Outcome
from doors import Finding
from small_site import LIDARS, Site

SHORT = ("--set", "duration_s=1", "--set", "traffic.warm_up_s=1", "--threads", "1")
SHOWN = 5  # of each kind


def configurations(site: Site, count: int, seed: int) -> Iterator[Finding]:
    """Scenes and LiDARs through the binary, benchmarks and detectors through Python."""
    draw = random.Random(seed)
    copy = site.folder / "configs"
    shutil.copytree(site.checkout.configs, copy, dirs_exist_ok=True)
    kinds = {k: sorted((copy / k).glob("*.yaml")) for k in ("scenes", "lidars")}
    bad: dict[str, list[str]] = {}
    seen: Counter[str] = Counter()
    for _ in range(count):
        kind = draw.choice(sorted(kinds))
        file = draw.choice(kinds[kind])
        source = file.read_text()
        text, done, poison = spoil.text(source, draw)
        file.write_bytes(text.encode(errors="surrogateescape"))
        lidar = file if kind == "lidars" else copy / "lidars/helios_16.yaml"
        scene = file if kind == "scenes" else copy / "scenes/flat.yaml"
        extra = SHORT if scene.stem != "flat" else SHORT[4:]
        outcome = site.checkout.infrasim(
            *("run", scene, "--lidar", lidar, "--preset", "datasheet", "--frames", "0:1"),
            *("--summary", site.folder / "summary.csv", *extra),
            patience_s=30,
        )
        verdict = judged(outcome, poison, site.folder / "summary.csv")
        seen[verdict] += 1
        if verdict not in ("taken", "refused"):
            bad.setdefault(verdict, []).append(f"{kind}/{file.name} {done}: {outcome.said}")
        file.write_text(source)
    yield from told("configurations", count, seen, bad)


def judged(outcome: Outcome, poison: bool, summary: Path) -> str:
    if outcome.is_broken:
        return "hang" if outcome.code is None else "crash"
    if outcome.code != 0:
        return "refused" if outcome.err.strip() else "no message"
    row = summary.read_text().splitlines()[1].split(",")
    numbers = [float(x) for x in row[2:7]]
    sane = numbers[1] > 0 and all(0 <= x < 1e9 for x in numbers)
    return "taken" if sane else "nonsense taken"


def files(site: Site, count: int, seed: int) -> Iterator[Finding]:
    """Files of a data set and of predictions, through evaluate and validate."""
    data, pred = site.folder / "few", site.folder / "few_pred"
    shutil.rmtree(data, ignore_errors=True)
    shutil.copytree(site.data, data)
    frames = sorted(p.stem for p in (data / LIDARS[0] / "training/velodyne").glob("*.bin"))[:3]
    shutil.copytree(site.pred, pred, dirs_exist_ok=True)
    for folder in (*data.glob("*/training/*"), pred):
        for file in folder.iterdir():
            if file.stem not in frames:
                file.unlink()
    for lists in data.glob("*/ImageSets"):
        shutil.rmtree(lists)
    script = Path(__file__).with_name("data_worker.py")
    seen: Counter[str] = Counter()
    bad: dict[str, list[str]] = {}
    done = 0
    while done < count:
        words = [script, data, LIDARS[0], pred, count - done, seed + done]
        rows = worker(site, list(map(str, words)))
        reference, *rows = rows
        for row in rows:
            verdict = verdict_of(row, reference)
            seen[verdict] += 1
            if verdict not in ("taken", "refused"):
                bad.setdefault(verdict, []).append(
                    f"{row['done']}: {row['evaluate'][1]} | {row['validate'][1]}"
                )
        done += len(rows)
        if done < count:  # the worker died of the next one
            seen["crash"] += 1
            bad.setdefault("crash", []).append(f"mutant {done} of seed {seed}")
            done += 1
    yield from told("data files", count, seen, bad)


def worker(site: Site, words: list[str]) -> list[dict]:
    python = site.checkout.root / ".venv/bin/python"
    code = f"import sys, runpy; sys.argv = {words!r}; runpy.run_path(sys.argv[0], None, '__main__')"
    done = subprocess.run(
        [python, "-c", code], cwd=site.checkout.root, capture_output=True, text=True
    )
    rows = [json.loads(line) for line in done.stdout.splitlines()]
    if not rows:
        raise RuntimeError(done.stderr[-300:])
    return rows


def verdict_of(row: dict, reference: dict) -> str:
    """nonsense taken: poison changed the AP and neither command said a word."""
    kinds = {row[c][0] for c in ("evaluate", "validate")}
    for kind in ("traceback", "hang"):
        if kind in kinds:
            return kind
    if row["evaluate"][0] == "refused":
        return "refused" if row["evaluate"][1] else "no message"
    silent = not row["evaluate"][1] and row["validate"][0] == "ok" and not row["validate"][1]
    if row.get("poison") and silent and row["ap"] != reference["ap"]:
        return "nonsense taken"
    return "taken"


def told(what: str, count: int, seen: Counter[str], bad: dict[str, list[str]]) -> Iterator[Finding]:
    totals = ", ".join(f"{number} {kind}" for kind, number in seen.most_common())
    yield Finding(0, f"{count} spoilt {what}", not bad, totals)
    for kind, cases in bad.items():
        for case in cases[:SHOWN]:
            yield Finding(0, f"a spoilt one of {what}: {kind}", False, case[:200])
