"""Each door: a thing that is wrong, handed in as a user would, and what the commands make of it."""

from __future__ import annotations

import re
import shutil
import signal
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from checkout import Outcome
from small_site import LIDARS, Site

ROWS = 100_000
LONGEST = 120  # of a line that is told


@dataclass(frozen=True)
class Finding:
    """What one try found; shut: nothing wrong comes through it."""

    door: int
    tried: str
    shut: bool
    found: str


Tries = Iterator[tuple[str, bool, str]]


def refused(tried: str, outcome: Outcome, *named: str) -> tuple[str, bool, str]:
    """Shut if the command ended with an error that names what is wrong."""
    text = outcome.err + outcome.out
    return tried, outcome.is_refused and all(name in text for name in named), outcome.said


def replaced(file: Path, old: str, new: str) -> None:
    text = file.read_text(encoding="utf-8")
    if not re.search(old, text, re.MULTILINE):
        raise ValueError(f"{file}: found no '{old}' to replace")
    file.write_text(re.sub(old, new, text, flags=re.MULTILINE), encoding="utf-8")


def benchmark_file(site: Site, detector: Path | str, lidar: str = LIDARS[0]) -> Path:
    file = site.folder / "benchmark.yaml"
    file.write_text(
        f"matrix: [{{scenes: [highway], lidars: [{lidar}], presets: [paper],"
        f" detectors: [{detector}]}}]\n"
        "frames: 0:400:10\nsplit: {train_until_s: 30, val_from_s: 31}\n"
    )
    return file


def benchmark(site: Site, file: Path, out: Path, *words: str, patience_s: float = 120) -> Outcome:
    return site.checkout.pyinfra(
        *("benchmark", file, "--tier", "smoke", "--jobs", 1, "--out", out),
        *("--work", site.folder / f"work_{out.name}", *words),
        patience_s=patience_s,
    )


def of_column(table: Path, column: str) -> str:
    """The last row's value, as text."""
    if not table.is_file():
        return "no table"
    heads, *rows = table.read_text().splitlines()
    return rows[-1].split(",")[heads.split(",").index(column)] if rows else "no row"


def door_1(site: Site) -> Tries:
    """A detector's file is edited between two runs of a benchmark."""
    own = site.folder / "own.yaml"
    out, fresh = site.folder / "edited", site.folder / "fresh"
    file = benchmark_file(site, own.name)
    own.write_text("detector: background\ntiers: {smoke: {}, quick: {}, full: {}}\n")
    benchmark(site, file, out)
    before = of_column(out / "smoke.csv", "ap")
    small = (
        "detector: background\ntiers: {smoke: {network: {ceiling_m: 0.3}}, quick: {}, full: {}}\n"
    )
    own.write_text(small)
    again = benchmark(site, file, out)
    benchmark(site, file, fresh)
    kept, new = of_column(out / "smoke.csv", "ap"), of_column(fresh / "smoke.csv", "ap")
    shut = kept == new or (again.is_refused and "own" in again.err)
    found = f"{before} kept" if kept == before else f"AP {kept}"
    yield "edited detector file", shut, f"{found}, a fresh run has {new}; {again.said}"


def door_2(site: Site) -> Tries:
    data = site.folder / "copied"
    shutil.rmtree(data, ignore_errors=True)
    shutil.copytree(site.data / LIDARS[0], data / LIDARS[0])
    whole, _ = site.ap(site.data)
    ap, outcome = site.ap(data)
    said = "roads.csv" in outcome.err
    yield (
        "LiDAR folder copied without roads.csv",
        said,
        f"AP {ap:.1f} for {whole:.1f}; {outcome.said}",
    )


def door_3(site: Site) -> Tries:
    data = site.copy("renamed")
    for file in (data / LIDARS[0] / "training/label_2").glob("*.txt"):
        replaced(file, r"\ACar |^Car |\Z", lambda m: m[0].replace("Car", "car")) if (
            "Car " in file.read_text()
        ) else None
    shutil.rmtree(data / LIDARS[0] / "training/objects")
    ap, outcome = site.ap(data)
    yield "labels of class car for Car", "car" in outcome.err, f"AP {ap:.1f}; {outcome.said}"


def door_4(site: Site) -> Tries:
    data = site.copy("hidden")
    shutil.copytree(data / LIDARS[1], data / f".{LIDARS[1]}.tmp")
    shutil.rmtree(data / LIDARS[1])
    before, _ = site.ap(data, LIDARS[0], "--ground-truth", "captured")
    outcome = site.checkout.pyinfra("statistics", data, "--out", site.folder / "statistics_hidden")
    table = site.folder / "statistics_hidden"
    listed = any(".tmp" in f.read_text() for f in table.glob("*.csv")) if table.is_dir() else False
    yield (
        "hidden folder beside a LiDAR",
        outcome.code == 0 and not listed,
        ("counted as a LiDAR" if listed else f"left out (AP {before:.1f}); {outcome.said}"),
    )


def door_5(site: Site) -> Tries:
    spoilt = {
        "a doubled id": lambda rows: [rows[0], rows[1], *rows[1:]],
        "visibility 100": lambda rows: [rows[0], re.sub(r"[^,]+$", "100", rows[1]), *rows[2:]],
        "points 0.9": lambda rows: [rows[0], with_cell(rows, "points", "0.9"), *rows[2:]],
    }
    for name, spoil in spoilt.items():
        data = site.copy("objects")
        file = next(
            f
            for f in sorted((data / LIDARS[0] / "training/objects").glob("*.csv"))
            if len(f.read_text().splitlines()) > 2
        )
        file.write_text("\n".join(spoil(file.read_text().splitlines())) + "\n")
        _, outcome = site.ap(data, LIDARS[0], "--split", "all", "--allow-missing")
        yield refused(f"objects with {name}", outcome, file.name)


def with_cell(rows: list[str], column: str, value: str) -> str:
    cells = rows[1].split(",")
    cells[rows[0].split(",").index(column)] = value
    return ",".join(cells)


def door_6(site: Site) -> Tries:
    data = site.copy("presets")
    replaced(data / LIDARS[1] / "lidar.yaml", r"^preset: .*$", 'preset: "datasheet"')
    for command in ("validate", "statistics"):
        words = ["--out", site.folder / "o"] if command == "statistics" else []
        outcome = site.checkout.pyinfra(command, data, *words)
        yield refused(f"LiDARs of two presets, {command}", outcome, "preset")
    for value in ("0", ".nan", "1000"):
        data = site.copy("period")
        replaced(data / LIDARS[0] / "lidar.yaml", r"^period_s: .*$", f"period_s: {value}")
        _, outcome = site.ap(data)
        yield refused(f"period_s of {value}", outcome, "period_s")


def results(site: Site, name: str) -> Path:
    """A copy of the committed tables, to spoil."""
    to = site.folder / name
    shutil.rmtree(to, ignore_errors=True)
    shutil.copytree(site.checkout.root / "results", to)
    return to


def recommend(site: Site, folder: Path, *words: object) -> Outcome:
    usual = ["--budget", 30000, "--min-ap", 50, "--range", 50]
    usual += ["--scene", "highway", "--preset", "paper"]
    return site.checkout.pyinfra("recommend", folder, *usual, *words)


def door_7(site: Site) -> Tries:
    for column, value in (("ap", "943"), ("ap_low", "99.9"), ("latency_p50_ms", "-1")):
        folder = results(site, "spoilt")
        rows = (folder / "quick.csv").read_text().splitlines()
        rows[1] = with_cell(rows, column, value)
        (folder / "quick.csv").write_text("\n".join(rows) + "\n")
        yield refused(f"quick.csv with {column} {value}", recommend(site, folder), column)
    folder = results(site, "spoilt")
    rows = (folder / "quick_value.csv").read_text().splitlines()
    rows[1] = with_cell(rows, "price_usd", "-1")
    (folder / "quick_value.csv").write_text("\n".join(rows) + "\n")
    yield refused("quick_value.csv with price_usd -1", recommend(site, folder), "price_usd")
    folder = results(site, "spoilt")
    with (folder / "quick.csv").open("a") as stream:
        stream.write((folder / "quick.csv").read_text().splitlines()[1] + "\n")
    yield refused("quick.csv with a row twice", recommend(site, folder), "quick.csv")


def door_8(site: Site) -> Tries:
    checkout, folder = site.checkout, site.folder
    cloud = folder / "recording/points"
    shutil.rmtree(cloud.parent, ignore_errors=True)
    cloud.mkdir(parents=True)
    head = "VERSION 0.7\nFIELDS x y z intensity\nSIZE 4 4 4 4\nTYPE F F F F\nCOUNT 1 1 1 1\n"
    head += "WIDTH 2\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 2\nDATA ascii\n"
    (cloud / "000000.pcd").write_text(head + "1 2 3 0.5\n3e38 3e38 3e38 0.5\n")
    outcome = checkout.pyinfra(
        "import",
        cloud.parent,
        "--from",
        "pcd",
        "--out",
        folder / "imported/pole",
        "--period-s",
        0.1,
    )
    yield refused("3e38 in an imported cloud", outcome, "000000.pcd")
    data = site.copy("nul")
    file = data / LIDARS[0] / "lidar.yaml"
    file.write_bytes(file.read_bytes() + b"\0\n")
    yield refused("NUL in lidar.yaml", site.ap(data)[1], "lidar.yaml")
    own = folder / "nul.yaml"
    own.write_bytes(b"detector: background\0\n")
    words = ["--data", site.data / LIDARS[0], "--out", folder / "nul_run"]
    yield refused("NUL in a detector file", checkout.pyinfra("train", own, *words), "nul.yaml")
    table = results(site, "twice")
    for name in ("quick.csv", "quick_value.csv"):
        with (table / name).open("a") as stream:
            stream.write((table / name).read_text().splitlines()[1] + "\n")
    outcome = checkout.pyinfra("report", table, "--out", folder / "report.html")
    yield refused("a repeated row in a table, report", outcome, "quick.csv")


def lidar_text(site: Site, old: str, new: str, lidar: str = "helios_16") -> Path:
    """A LiDAR of the catalogue with one thing changed."""
    shutil.copytree(site.checkout.configs / "lidars", site.folder / "lidars", dirs_exist_ok=True)
    file = site.folder / "lidars/own.yaml"
    shutil.copy(site.checkout.configs / f"lidars/{lidar}.yaml", file)
    replaced(file, old, new)
    return file


def one_frame(site: Site, lidar: Path, preset: str = "paper", **how: float) -> Outcome:
    scene = site.checkout.configs / "scenes/flat.yaml"
    words = ["--preset", preset, "--frames", "0:1", "--threads", 1]
    return site.checkout.infrasim("run", scene, "--lidar", lidar, *words, **how)


def door_9(site: Site) -> Tries:
    checkout, folder = site.checkout, site.folder
    file = lidar_text(site, r"^presets:(\n[ #].*)+", "presets: {equal: 5}")
    yield refused("presets: {equal: 5}", one_frame(site, file, "equal"), "presets")
    step = "azimuth_step_deg|columns_per_turn"  # how the shipped file says it, by version
    for old, key, value in (
        (step, "azimuth_step_deg", "1e-9"),
        (step, "azimuth_step_deg", "1e-300"),
        ("rate_hz", "rate_hz", "1e-9"),
    ):
        file = lidar_text(site, rf"({old}): [\d.e-]+", f"{key}: {value}")
        yield refused(f"{key}: {value}", one_frame(site, file, patience_s=20), key)
    scene = folder / "unknown.yaml"
    keys = "".join(f"key_{i}: 1\n" for i in range(ROWS))
    scene.write_text((checkout.configs / "scenes/flat.yaml").read_text() + keys)
    yield refused(f"{ROWS:,} unknown keys", checkout.infrasim("check", scene), "key_")
    words = ["--lidar", checkout.configs / "lidars/helios_16.yaml", "--preset", "paper"]
    flat = checkout.configs / "scenes/flat.yaml"
    outcome = checkout.infrasim("run", flat, *words, "--frames", f"0:{2**36}", patience_s=20)
    yield refused("2^36 frames", outcome, "frame")
    seeds = folder / "seeds.yaml"
    seeds.write_text(
        "matrix: [{scenes: [highway], lidars: [helios_16], presets: [paper], "
        f"detectors: [background], seeds: {list(range(200_000))}}}]\n"
    )
    outcome = benchmark(site, seeds, folder / "seeds", "--dry-run", patience_s=30)
    in_time = outcome.code == 0 or outcome.is_refused
    yield "200,000 seeds", in_time, f"{outcome.said} after {outcome.seconds:.0f} s"
    yield signals(site)


def signals(site: Site) -> tuple[str, bool, str]:
    """SIGTERM while the world is being built."""
    scene = site.checkout.configs / "scenes/crossroad.yaml"
    lidar = site.checkout.configs / "lidars/helios_16.yaml"
    words = ["--preset", "paper", "--frames", "0:1", "--set", "duration_s=20000"]
    process = site.checkout.start("run", scene, "--lidar", lidar, *words)
    time.sleep(1)
    process.send_signal(signal.SIGTERM)
    start = time.perf_counter()
    try:
        _, err = process.communicate(timeout=10)
    except BaseException:
        process.kill()
        process.communicate()
        return "SIGTERM before the first frame", False, "not heard within 10 s"
    seconds = time.perf_counter() - start
    # On a busy machine its libraries may not be loaded yet: then the signal ends it by itself.
    shut = (process.returncode == 143 and "resumes" in err) or process.returncode == -signal.SIGTERM
    return (
        "SIGTERM before the first frame",
        shut,
        f"exit {process.returncode} after {seconds:.1f} s",
    )


def door_10(site: Site) -> Tries:
    scene = site.checkout.configs / "scenes/highway.yaml"
    lidar = site.checkout.configs / "lidars/helios_16.yaml"
    common = ["run", scene, "--lidar", lidar, "--preset", "paper", "--frames", "0:60"]
    common += ["--threads", 1, "--set", "duration_s=20", "--set", "traffic.warm_up_s=5", "--out"]
    failed, wrong = [], 0
    alone = site.folder / "alone"
    site.checkout.infrasim(*common, alone)
    for i in range(5):
        out = site.folder / f"together_{i}"
        pair = [site.checkout.start(*common, out) for _ in range(2)]
        ends = [(p.communicate()[1], p.returncode) for p in pair]
        failed += [err.strip().splitlines()[-1] for err, code in ends if code != 0]
        wrong += not same_frames(alone, out)
    found = f"{len(failed)} of 10 runs died, {wrong} of 5 folders differ"
    yield "two identical runs into one folder, five times", not failed and not wrong, found


def same_frames(a: Path, b: Path) -> bool:
    def files(folder: Path) -> dict[str, bytes]:
        paths = (p for p in folder.rglob("*") if p.is_file() and p.name != "summary.csv")
        return {str(p.relative_to(folder)): p.read_bytes() for p in paths}

    return files(a) == files(b)


def door_11(site: Site) -> Tries:
    for name in ("007", "NA", "1e5", "null", "=1+1", "-rf"):
        file = lidar_text(site, r"^name: .*$", f'name: "{name}"')
        renamed = site.folder / f"lidars/{name}.yaml"
        shutil.copy(file, renamed)
        plan = site.folder / "lidars/benchmark.yaml"
        shutil.copy(benchmark_file(site, "background", f'"{name}.yaml"'), plan)
        out = site.folder / f"names_{name}"
        outcome = benchmark(site, plan, out)
        again = benchmark(site, plan, out)
        finished = outcome.code == 0 and again.code == 0
        shut = outcome.is_refused and "name" in outcome.err if name[0] in "=-" else finished
        yield f"a LiDAR named {name}", shut, outcome.said if outcome.code else again.said


def door_12(site: Site) -> Tries:
    file = site.folder / "empty.yaml"
    file.write_text(
        "matrix: [{scenes: [flat], lidars: [helios_16], presets: [paper],"
        " detectors: [background]}]\n"
        "frames: 0:400:20\nsplit: {train_until_s: 30, val_from_s: 31}\n"
    )
    outcome = benchmark(site, file, site.folder / "empty")
    yield refused("a cell without a vehicle", outcome, "flat", "vehicle")
    full = site.folder / "full"
    full.symlink_to("/dev/full")
    code = (
        "import resource, signal, sys; from pyinfra.cli import main;"
        "signal.signal(signal.SIGXFSZ, signal.SIG_IGN);"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (2000, 2000));"
    )
    data, out = site.data / LIDARS[0], site.folder / "small_disk"
    for command in (
        ["statistics", str(site.data), "--out", str(out)],
        ["evaluate", "--gt", str(data), "--pred", str(site.pred), "--out", str(out)],
        ["export", str(data), "--to", "openpcdet", "--out", str(out / "export")],
        ["view", str(data), "--out", str(out / "view.html")],
        ["detect", str(site.folder / "run"), "--data", str(data), "--out", str(out / "pred")],
    ):
        outcome = site.checkout.python(f"{code} sys.exit(main({command!r}))")
        yield refused(f"a full disk, {command[0]}", outcome, "small_disk", "File too large")


def door_13(site: Site) -> Tries:
    outcome = site.checkout.infrasim("check", "\x1b[31mno\x07.yaml")
    shut = "\\x1b" in outcome.err and "\x1b" not in outcome.err
    yield "control characters in a message, infrasim", shut, repr(outcome.err.strip())[:LONGEST]
    outcome = site.checkout.pyinfra("validate", "\x1b[31mno\x07")
    shut = "\\x1b" in outcome.err and "\x1b" not in outcome.err
    yield "control characters in a message, pyinfra", shut, repr(outcome.err.strip())[:LONGEST]
    file = lidar_text(site, r"max_range_m: 260", "max_range_m: 260, wrong_key: 1")
    yield refused(
        "a wrong key in a preset, check", site.checkout.infrasim("check", file), "wrong_key"
    )
    constraints = (site.checkout.root / "scripts").glob("*")
    hashed = any(f.is_file() and "--hash=sha256:" in f.read_text() for f in constraints)
    yield "hashes of what is installed", hashed, "hashes" if hashed else "no hash"


def door_14(site: Site) -> Tries:
    scene = site.checkout.configs / "scenes/highway.yaml"
    peaks = []
    for seconds in (500, 2000):
        out = site.folder / "trajectories.csv"
        words = ["trajectories", str(scene), "--set", f"duration_s={seconds}", "--out", str(out)]
        command = [str(site.checkout.root / "build/dev/cpp/infrasim"), *words]
        script = (
            f"import resource, subprocess; subprocess.run({command!r});"
            "print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss // 1024)"
        )
        done = site.checkout.python(script, patience_s=120)
        peaks.append(int(done.out.split()[-1]))
    found = f"{peaks[0]} MB for 500 s, {peaks[1]} MB for 2,000 s"
    yield "memory of trajectories", peaks[1] < 1.3 * peaks[0], found


def door_15(site: Site) -> Tries:
    folder = site.checkout.root / "results"
    slow = recommend(site, folder, "--scene", "crossroad", "--preset", "datasheet", "--min-ap", 60)
    named = [line for line in slow.out.splitlines() if re.match(r"\s*\d+\. ", line)]
    times = [max(map(float, re.findall(r"(\d+) ms a frame", line)), default=0) for line in named]
    late = sum(ms > 100 for ms in times)
    yield "an option slower than a frame", not late, f"{late} of {len(named)} named are slower"
    narrow = recommend(site, folder)
    top = next((x for x in narrow.out.splitlines() if re.match(r"\s*1\. ", x)), narrow.said)
    one_way = top.strip().startswith("1. livox_avia")
    yield "a LiDAR that looks one way comes first", not one_way, top.strip()[:LONGEST]
    none = recommend(site, folder, "--min-ap", 99)
    lines = [line.strip() for line in none.out.splitlines()]
    advice = next((line for line in lines if "--min-ap" in line), lines[0])
    yield "nothing meets the wish", "--min-ap" in none.out, advice[:LONGEST]
    yield refused("--min-ap 0.85", recommend(site, folder, "--min-ap", 0.85), "--min-ap")


def door_16(site: Site) -> Tries:
    scene = site.checkout.configs / "scenes/flat.yaml"
    words = ["--preset", "paper", "--frames", "0:1"]
    outcome = site.checkout.infrasim("run", scene, "--lidar", "livox_avia", *words)
    yield "infrasim run --lidar livox_avia", outcome.code == 0, outcome.said
    outcome = site.checkout.pyinfra("lidars")
    listed = "livox_avia" in outcome.out
    yield "pyinfra lidars", outcome.code == 0 and listed, outcome.said


DOORS: dict[int, Callable[[Site], Tries]] = {
    int(name.removeprefix("door_")): function
    for name, function in list(globals().items())
    if name.startswith("door_")
}


def findings(site: Site, number: int) -> Iterator[Finding]:
    """What is found at a door; a try that cannot be made is an open door."""
    try:
        for tried, shut, found in DOORS[number](site):
            yield Finding(number, tried, shut, found)
    except Exception as error:
        yield Finding(number, "the rest", False, f"could not be tried: {error!r}"[:200])
