"""`pyinfra recommend RESULTS --budget 8000 --min-ap 85 --range 100`: an answer in words.

Every figure is of the tables of `pyinfra benchmark` in RESULTS. Road counts as covered where the AP
of the ground truth `all` in a window of 20 m is above what is asked.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from pyinfra.benchmark.store import read
from pyinfra.benchmark.value import KEY, REGION_M, covered
from pyinfra.statistics.selection import first_seed
from pyinfra.training.sources import TIERS

PRESETS = ("datasheet", "equal", "paper")  # the first that was measured, unless one is asked for
MOST = 5


@dataclass(frozen=True)
class Wish:
    """What a site asks for. AP of the vehicles that a LiDAR captured, 0 to 100."""

    budget_usd: float
    min_ap: float
    range_m: float
    latency_ms: float


Option = dict[str, Any]  # a finished cell with price_usd, covered_m and road_m


def read_options(results: Path, tier: str, scene: str, preset: str, wish: Wish) -> list[Option]:
    """The finished cells of a scene, lowest seed, best first: most road covered, then lowest price.

    Raises FileNotFoundError without tables, ValueError for a scene that was not measured, or if the
    table of prices has not all cells.
    """
    files = [results / f"{tier}{name}.csv" for name in ("", "_value", "_distance")]
    for file in files:
        if not file.is_file():
            raise FileNotFoundError(2, "No such table; `pyinfra benchmark` writes it", str(file))
    cells, value, distance = map(read, files)
    done = first_seed(cells[cells.ap.notna()])
    table = done.merge(value[[*KEY, "price_usd"]], on=KEY)
    if len(table) < len(done):
        raise ValueError(
            f"{files[1]}: found {len(table)} of {len(done)} cells, allowed all; "
            "`pyinfra benchmark` once more writes it"
        )
    scene, preset = chosen(table, scene, preset)
    table = table[(table.scene == scene) & (table.preset == preset)]
    table = table.merge(covered(distance, wish.min_ap, wish.range_m), on=KEY)
    roads = distance[distance.scene == scene].road.nunique()
    table["road_m"] = 2 * wish.range_m * roads
    order = ["covered_m", "price_usd", "ap"]
    table = table.sort_values(order, ascending=[False, True, False])
    return [{str(k): v for k, v in row.items()} for row in table.to_dict("records")]


def chosen(table: pd.DataFrame, scene: str, preset: str) -> tuple[str, str]:
    """The scene and preset that are meant. Raises ValueError if they are not in the table."""
    pairs = set(zip(table.scene, table.preset, strict=True))
    scenes = sorted({s for s, _ in pairs})
    if scene not in scenes:
        if scene or len(scenes) != 1:
            raise ValueError(f"--scene: found '{scene}', allowed {', '.join(scenes)}")
        (scene,) = scenes
    presets = [p for p in PRESETS if (scene, p) in pairs]
    if preset and preset not in presets:
        raise ValueError(f"--preset: found '{preset}', allowed {', '.join(presets)}")
    return scene, preset or presets[0]


def shortfalls(option: Option, wish: Wish) -> list[str]:
    """Why an option does not meet the wish; nothing if it does."""
    found = []
    if option["price_usd"] > wish.budget_usd:
        found.append(f"costs {option['price_usd']:,.0f} USD")
    if option["ap"] < wish.min_ap:
        found.append(f"AP {option['ap']:.1f}")
    if option["latency_p50_ms"] > wish.latency_ms:
        found.append(f"{option['latency_p50_ms']:.0f} ms a frame")
    return found


def answer(options: Sequence[Option], wish: Wish) -> list[str]:
    """Sentences: what to take, what cannot be told apart, what was left out and why."""
    good = [option for option in options if not shortfalls(option, wish)]
    if not good:
        return ["No option meets this.", *left_out(options, wish)]
    lines = [f"{i}. {sentence(o, wish)}" for i, o in enumerate(good[:MOST], 1)]
    return [*lines, *doubts(good[:MOST], wish), *left_out(options, wish)]


def name(option: Option) -> str:
    return f"{option['lidar']} with {option['detector']}"


def sentence(option: Option, wish: Wish) -> str:
    o = option
    return (
        f"{name(o)}: {o['price_usd']:,.0f} USD; AP {o['ap']:.1f} [{o['ap_low']:.1f}, "
        f"{o['ap_high']:.1f}] of the vehicles it captures, {o['ap_all']:.1f} of all; AP above "
        f"{wish.min_ap:g} of all on {o['covered_m']:.0f} of {o['road_m']:.0f} m of road; "
        f"{o['latency_p50_ms']:.0f} ms a frame on one core"
    )


def doubts(good: Sequence[Option], wish: Wish) -> Iterator[str]:
    """What the data does not decide about the options that are named."""
    first = good[0]
    equal = [o for o in good[1:] if overlap(o, first)]
    if equal:
        names = ", ".join(map(name, equal))
        yield f"AP does not tell {name(first)} from {names}: 95 % intervals overlap."
    unsure = [o for o in good if o["ap_low"] < wish.min_ap]
    if unsure:
        names = ", ".join(map(name, unsure))
        yield f"Not sure to reach AP {wish.min_ap:g}: {names}: the interval begins below it."
    if first["covered_m"] < first["road_m"]:
        more = "several LiDARs, a higher budget or a lower AP might"
        yield f"None of these covers the whole of the road; {more}."


def overlap(a: Option, b: Option) -> bool:
    """Whether the intervals of AP do; also if one is not known."""
    return not (a["ap_low"] > b["ap_high"] or b["ap_low"] > a["ap_high"])


def left_out(options: Sequence[Option], wish: Wish) -> Iterator[str]:
    """The options that fall short, with the reasons."""
    for option in options:
        reasons = shortfalls(option, wish)
        if reasons:
            yield f"Left out: {name(option)}: {', '.join(reasons)}."


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = "Says which LiDAR and detector suit a budget, by a benchmark's tables."
    parser.epilog = "example: pyinfra recommend results --scene highway --budget 8000 --min-ap 85"
    parser.add_argument("results", type=Path, help="folder of `pyinfra benchmark`")
    parser.add_argument("--budget", type=float, required=True, help="USD for LiDAR and site")
    parser.add_argument("--min-ap", type=float, default=85.0, help="0 to 100; default: 85")
    parser.add_argument(
        "--range", type=float, default=100.0, help="metres of road to either side; default: 100"
    )
    parser.add_argument("--latency", type=float, default=math.inf, help="milliseconds, at most")
    parser.add_argument("--scene", default="", help="needed if several were measured")
    parser.add_argument("--preset", default="", help=f"default: the first of {', '.join(PRESETS)}")
    parser.add_argument("--tier", choices=TIERS, default="quick")


def run(args: argparse.Namespace) -> int:
    for key, value, top in (
        ("--budget", args.budget, math.inf),
        ("--min-ap", args.min_ap, 100),
        ("--range", args.range, REGION_M),
        ("--latency", args.latency, math.inf),
    ):
        if not 0 < value <= top:
            raise ValueError(f"{key}: found {value:g}, allowed above 0 to {top:g}")
    wish = Wish(args.budget, args.min_ap, args.range, args.latency)
    options = read_options(args.results, args.tier, args.scene, args.preset, wish)
    first = options[0]
    print(
        f"{first['scene']}, preset {first['preset']}, {args.tier} tier: at most "
        f"{wish.budget_usd:,.0f} USD, AP {wish.min_ap:g}, {wish.range_m:g} m either way."
    )
    print(*answer(options, wish), sep="\n")
    return 0
