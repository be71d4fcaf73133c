"""Artificial results for the tests of the report, and a parser for its pages."""

import re
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from benchmark_data import r1000_name, with_r1000

HOSTILE = "<img src=x onerror=\"document.title='taken'\">&amp;</td></script>$x_"
EXPERIMENT = {"scene": "highway", "preset": "paper", "tier": "quick", "seed": 1}
EXTRA = {"command": "pyinfra benchmark", "version": "0.1.0", "machine": "2 x x86_64"}
LIDARS = ("livox_avia", "ruby_plus")
DETECTORS = ("pointpillars", "background")


def experiment(lidar: str, detector: str, ap: float | None, **more: Any) -> dict[str, Any]:
    """Returns a row of a benchmark. An experiment without an AP has failed."""
    row = {**EXPERIMENT, "lidar": lidar, "detector": detector, "ap": ap}
    if ap is not None:
        row |= {"ap_low": ap - 2, "ap_high": ap + 1, "ap_common": ap, "ap_all": ap / 2}
        row |= {"objects": 100, "train_seconds": 30.0 * (detector != "background")}
        row |= {"latency_p50_ms": 10.0, "latency_p95_ms": 12.0}
    names = ("ap_low", "ap_high", "ap_common", "ap_all", "objects")
    times = ("train_seconds", "latency_p50_ms", "latency_p95_ms")
    whole = dict.fromkeys((*names, *times)) | row | EXTRA | more
    return {r1000_name(k): v for k, v in whole.items() if r1000_name(k)} | whole


def experiments() -> pd.DataFrame:
    """Returns experiments of two LiDARs and two detectors. One of these experiments has failed."""
    return pd.DataFrame(
        [
            experiment("livox_avia", "pointpillars", 91.25, latency_p50_ms=60.0),
            experiment("ruby_plus", "pointpillars", 92.5, latency_p50_ms=70.0),
            experiment("livox_avia", "background", 84.0),
            experiment("ruby_plus", "background", None, reason="MemoryError: none <left> & gone"),
        ]
    )


def along_the_road(name: str) -> pd.DataFrame:
    """Returns rows of `areas` or `distance` for the experiments that have not failed."""
    rows = []
    for row in experiments().dropna(subset="ap").itertuples():
        key = {**EXPERIMENT, "lidar": row.lidar, "detector": row.detector}
        for truth in ("captured", "common", "all"):
            of = key | {"ground_truth": truth, "road": "motorway"}
            if name == "areas":
                counts = {"n_tda": 4, "n_hqda": 2, "undecided": 1, "objects": 200}
                rows.append(of | counts | {"p_hqda": 50.0, "p_low": 25.0, "p_high": 75.0})
                continue
            for s, quality in zip(
                (-50, 0, 50, 100), ("few", "low", "undecided", "high"), strict=True
            ):
                ap = None if quality == "few" else 80.0 + s / 10
                ends = {"ap_low": ap and ap - 3, "ap_high": ap and ap + 3}
                rows.append(
                    of
                    | {"s": s, "ap": ap, **ends, "quality": quality}
                    | {"objects": 30, "predictions": 31}
                )
    return with_r1000(pd.DataFrame(rows))


def value() -> pd.DataFrame:
    rows = []
    for row in experiments().dropna(subset="ap").itertuples():
        key = {**EXPERIMENT, "lidar": row.lidar, "detector": row.detector}
        usd = {"livox_avia": 2079.0, "ruby_plus": 24000.0}[row.lidar]
        beaten = "livox_avia pointpillars" if row.detector == "background" else ""
        bought = {"ap_per_1000_usd": 1000 * row.ap / usd, "usd_per_hq_area": usd / 2}
        bought |= {"usd_per_m_road": None, "points_per_1000_usd": 10.0}
        rows.append(
            {**key, "price_usd": usd, "site_usd": 0, "ap": row.ap, "ap_all": row.ap_all, **bought}
            | {"pareto": beaten == "", "dominated_by": beaten}
        )
    return with_r1000(pd.DataFrame(rows))


def lidars() -> pd.DataFrame:
    price = {"price_source": "a table", "price_date": 2025, "range_m": 100.0}
    return pd.DataFrame(
        [
            {"lidar": name, "preset": "paper", "model": model, "units": 1, **price}
            | {"price_low_usd": usd, "price_high_usd": usd}
            for name, model, usd in (
                ("livox_avia", "Livox Avia", 2079),
                ("ruby_plus", "RoboSense Ruby Plus", 24000),
            )
        ]
    )


def stress() -> pd.DataFrame:
    key = {"detector": "pointpillars", "lidar": "ruby_plus", "scene": "highway", "seed": 1}
    key |= {"run": "a", "preset": "paper", "frames": 36}
    rows = [("none", "0", "", 90.0), ("rain", "50", "mm/h", 80.0), ("rain", "100", "mm/h", 60.0)]
    rows += [("density", "2", "times", 85.0), ("unseen_scene", "curve", "name", 40.0)]
    rows += [("training_frames", "200", "frames", 70.0)]
    return with_r1000(
        pd.DataFrame(
            [
                {
                    **key,
                    "stressor": name,
                    "severity": severity,
                    "unit": unit,
                    "ap": ap,
                    "ap_low": ap - 2,
                }
                | {"ap_high": ap + 2, "trained_frames": 800}
                for name, severity, unit, ap in rows
            ]
        )
    )


def replicates(rows: pd.DataFrame, value: str, half: float) -> pd.DataFrame:
    """Returns replicates for the rows. The interval of `value` extends `half` to either side."""
    same = {
        "measure": "ap_r1000",
        "blocks": 1e6,
        "block_s": 10.0,
        "replicates": 50,
        "replicates_seed": 1,
    }
    same |= {"vehicles_digest": "w", "ground_truth": "captured", "version": "1"}
    waves = [np.sin(2 * np.pi * (i + 1) * (np.arange(50) + 0.5) / 50) for i in range(len(rows))]
    records = [
        {f"replicate_{k + 1}": v + x * half / 1.96 / wave.std(ddof=1) for k, x in enumerate(wave)}
        for v, wave in zip(rows[value], waves, strict=True)
    ]
    return pd.concat([rows.reset_index(drop=True), pd.DataFrame(records)], axis=1).assign(
        value=rows[value].to_numpy(), **same
    )


def experiment_replicates() -> pd.DataFrame:
    done = experiments().dropna(subset="ap")[[*EXPERIMENT, "lidar", "detector", "ap"]]
    return replicates(done.assign(frames=180, label_time="frame"), "ap", 1.5).drop(columns="ap")


def hits() -> pd.DataFrame:
    key = {"scene": "highway", "preset": "paper", "frames": 1000}
    by_lidar = {"livox_avia": 10529 * 1.1, "ruby_plus": 46723 * 0.9}
    return pd.DataFrame([{**key, "lidar": n, "hits_per_frame": h} for n, h in by_lidar.items()])


def points() -> pd.DataFrame:
    rows = [(lidar, low, 1000 / low) for lidar in LIDARS for low in (30, 35, 40)]
    return pd.DataFrame(
        [
            {"scene": "highway", "preset": "paper", "set": "common", "lidar": lidar}
            | {"from_m": low, "to_m": low + 5, "vehicles": 9, "apv": apv}
            | {"ci_low": apv - 1, "ci_high": apv + 1}
            for lidar, low, apv in rows
        ]
    )


def tables() -> dict[str, pd.DataFrame]:
    """Returns every table of a folder of results, by file name."""
    return {
        "quick.csv": experiments(),
        "quick_areas.csv": along_the_road("areas"),
        "quick_distance.csv": along_the_road("distance"),
        "quick_hits.csv": hits(),
        "quick_replicates.csv": experiment_replicates(),
        "quick_points_per_vehicle.csv": points(),
        "quick_value.csv": value(),
        "lidars.csv": lidars(),
        "stress.csv": stress(),
        "stress_summary.csv": pd.DataFrame([{"detector": "pointpillars", "gentleness": 0.8}]),
    }


def write(folder: Path, some: dict[str, pd.DataFrame] | None = None) -> Path:
    """Writes a folder of results with all tables, or with the given tables."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, table in (tables() if some is None else some).items():
        table.to_csv(folder / name, index=False)
    return folder


class Read(HTMLParser):
    """Parses a page: its ids, links, titles, pictures and visible words."""

    def __init__(self, file: Path) -> None:
        super().__init__()
        self.ids: list[str] = []
        self.links: list[str] = []
        self.origins: list[str] = []
        self.unnamed: list[str] = []
        self.tags: set[str] = set()
        self.words: list[str] = []
        self.inside: list[str] = []
        self.feed(file.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        has = dict(attrs)
        self.tags.add(tag)
        self.inside.append(tag)
        self.ids += [has["id"] or ""] if "id" in has else []
        self.links += [has["href"] or ""] if tag == "a" else []
        self.origins += [has["title"] or ""] if "title" in has else []
        if tag == "svg" and not has.get("aria-label") and has.get("aria-hidden") != "true":
            self.unnamed.append(str(attrs))

    def handle_data(self, data: str) -> None:
        if not set(self.inside[-1:]) & {"script", "style"}:
            self.words.append(data)

    def handle_endtag(self, tag: str) -> None:
        if tag in self.inside:
            del self.inside[len(self.inside) - 1 - self.inside[::-1].index(tag) :]

    @property
    def text(self) -> str:
        return re.sub(r"\s+", " ", " ".join(self.words))
