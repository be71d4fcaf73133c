"""Makes the tables of the study's verdicts, from results/experiments.csv and derived tables."""

import math
from collections.abc import Iterator, Sequence
from typing import Any

import pandas as pd

from pyinfra.metrics.comparison import over_replicates
from pyinfra.metrics.intervals import student
from reproduction.claims.two_detectors import (
    BOTH,
    DEPENDS,
    NOT_KNOWN,
    ONE,
    PRIMARY,
    TOO_FEW,
    UNDECIDED,
)
from reproduction.commands.experiments import LAW_EXPONENTS, at_catalogue_law, at_own_cut_angle
from reproduction.commands.variance import DIFFERENCE
from reproduction.commands.verdicts import (
    CLAIMS,
    LEAST_REPLICATES,
    LEVEL,
    LEVEL_AP,
    WIDE,
    planned,
)
from reproduction.tables.common import (
    DETECTORS,
    LIDARS,
    Rows,
    markdown,
    mean_of_ap,
    results,
    rows_with,
    with_heads,
)

SETUPS = {
    "fine-tuned": "fine-tuned",
    "background": "Background",
    "pretrained": "pretrained, not fine-tuned",
}
NETWORK = {"from scratch": "PointPillars, trained at the scene"}
TRAININGS = {"fine-tuned": SETUPS["fine-tuned"], **NETWORK, BOTH: "both", **SETUPS}
TRAINED = {  # names of trained detectors, by (training, detector)
    ("fine-tuned", "generalist"): "pretrained, fine-tuned",
    ("pretrained", "generalist"): "pretrained, not fine-tuned",
    **{("from scratch", name): words for name, words in DETECTORS.items()},
    ("background", "background"): "Background",
}
AVIA = "livox_avia"
COMPONENTS = {
    "detector": "detector",
    "scene": "scene",
    "preset": "preset",
    "label_time": "label time",
    "training": "training and its traffic",
    "seed": "test traffic",
    "frames": "frames of one test",
}
SITE_COSTS_USD = (0, 10_000, 20_000)
REPLICATES = (3, 5, 10)
FALSE_BY_CHANCE = 0.05  # upper bound of the probability of a false verdict with one detector


def verdicts(claim: str, subset: str = "captured") -> str:
    """Returns a table with one row per scene and preset, and one column per training.

    Of the networks that were trained from scratch, it has PointPillars. The column of both
    detectors has the verdict of the study.
    """
    rows = shown_verdicts(claim, subset).set_index(["scene", "preset", "training"])
    pairs = rows.index.droplevel("training").unique()
    trainings = rows.index.unique("training")
    columns = {training: words for training, words in TRAININGS.items() if training in trainings}
    return markdown(
        ["scene", "preset", *columns.values()],
        [[*pair, *(_verdict(rows, (*pair, training)) for training in columns)] for pair in pairs],
    )


def shown_verdicts(claim: str, subset: str) -> pd.DataFrame:
    """Returns the rows of a claim with boxes at scan time. PointPillars is the only network."""
    table = _claims_with_enough_replicates()
    shown = (table["training"] != "from scratch") | (table.detector == "pointpillars")
    return table[
        shown & (table.claim == claim) & (table.subset == subset) & (table.label_time == "scan")
    ]


def _claims_with_enough_replicates() -> pd.DataFrame:
    """Returns the claims that have enough replicates for a verdict, by the catalogue's law."""
    table = at_catalogue_law(results("claims"))
    return table[table.verdict != TOO_FEW]


def _verdict(rows: pd.DataFrame, key: tuple[str, ...]) -> str:
    if key not in rows.index:
        return ""
    row = rows.loc[key]
    if math.isnan(row.value):
        return str(row.verdict)
    return f"{with_interval(row.claim, row.value, row.low, row.high)}, {row.verdict}"


def with_interval(claim: str, value: float, low: float, high: float) -> str:
    """Formats a value and interval, with enough decimals to tell the ends from the limits."""
    limits = next((c.low, c.high) for c in CLAIMS if c.name == claim)
    ends = [(end, limit) for end in (low, high) for limit in limits if end != limit]
    digits = next(k for k in range(1, 17) if all(round(end, k) != limit for end, limit in ends))
    return f"{value:+.{digits}f} [{low:.{digits}f}, {high:.{digits}f}]"


def aps_of(
    subset: str, setup: str = "fine-tuned"
) -> Iterator[tuple[tuple[str, str], pd.DataFrame]]:
    """Yields the AP of each scene and preset: one row per replicate and one column per LiDAR.

    The replicates are those of the verdicts.
    """
    table = at_catalogue_law(at_own_cut_angle(results("experiments")))
    table = rows_with(table, subset=subset, training=setup, label_time="scan")
    for (scene, preset), rows in table.groupby(["scene", "preset"], sort=False):
        wide = rows.pivot_table(index="replicate", columns="lidar", values="ap_r1000").dropna()
        if len(wide) >= LEAST_REPLICATES:
            yield (str(scene), str(preset)), wide[: planned(len(wide))]


def _name(lidar: str) -> str:
    return LIDARS.get(lidar, "5 Avias" if "avia" in lidar else lidar)


@with_heads("scene", "preset", "Ruby Plus", "Avia (crossroad: 5)", "Pandar64", "Helios 16")
def average_precision(subset: str = "captured") -> Rows:
    """Returns the AP of the fine-tuned detector: one row per scene and preset."""
    for pair, aps in aps_of(subset):
        avia = next((name for name in aps if "avia" in name), "livox_avia")
        names = ["ruby_plus", avia, "pandar_64", "helios_16"]
        yield [*pair, *(mean_of_ap(aps[name]) if name in aps else "" for name in names)]


def detectors(scene: str, preset: str, subset: str = "captured") -> str:
    """Returns the AP of each detector with the Ruby Plus and the Avia, and the paired difference.

    A detector with one or two replicates has no interval. The CPU seconds of the training, and the
    milliseconds of a frame on one thread, are means over both LiDARs.
    """
    table, ms_of = _of_scene(scene, preset, subset)
    timed = len(ms_of) > 0
    rows = []
    for (setup, name), words in TRAINED.items():
        part = table[(table["training"] == setup) & (table.detector == name)]
        aps = part.pivot_table(index="replicate", columns="lidar", values="ap_r1000")
        if {WIDE, AVIA} <= set(aps):
            aps = aps.dropna(subset=[WIDE, AVIA])
            cells = [mean_of_ap(ap) for ap in (aps[WIDE], aps[AVIA], aps[AVIA] - aps[WIDE])]
            seconds = part[part.lidar.isin([WIDE, AVIA])].train_cpu_s.mean()
            times = [f"{seconds:.0f}" if seconds else ""]
            if timed:
                times.append(f"{ms_of[setup, name]:.0f}" if (setup, name) in ms_of else "")
            rows.append([words, *cells, str(len(aps)), *times])
    heads = ["detector", "Ruby Plus", "Avia", "Avia minus Ruby Plus", "replicates"]
    heads += ["training, CPU s", "frame, ms"] if timed else ["training, CPU s"]
    return markdown(heads, rows)


def _of_scene(scene: str, preset: str, subset: str) -> tuple[pd.DataFrame, pd.Series]:
    """Returns the experiments of a scene, and the ms of a frame by training and detector."""
    table = at_catalogue_law(at_own_cut_angle(results("experiments")))
    latency = rows_with(results("latency"), scene=scene, preset=preset)
    times = latency.groupby(["training", "detector"]).latency_p50_ms.mean()
    of_scene = rows_with(table, scene=scene, preset=preset, subset=subset, label_time="scan")
    return of_scene, times


def means_of_detectors(scene: str, preset: str) -> tuple[pd.DataFrame, pd.Series, pd.Series]:
    """Returns AP (`captured`) by LiDAR, training CPU seconds, and milliseconds of a frame.

    The rows are pairs of training and detector. The times are means over Ruby Plus and Avia.
    """
    table, times = _of_scene(scene, preset, "captured")
    table = table[table.lidar.isin((WIDE, AVIA))]
    aps = table.groupby(["training", "detector", "lidar"]).ap_r1000.mean().unstack()
    return aps, table.groupby(["training", "detector"]).train_cpu_s.mean(), times


def _of_detectors(row: Any) -> str:
    if row.verdict == TOO_FEW:
        return f"{row.value:.1f}, {row.verdict} ({row.replicates})"
    return f"{row.value:.1f} [{row.low:.1f}, {row.high:.1f}], {row.verdict}"


@with_heads("claim", "Ruby Plus", "Avia")
def claims_of_detectors() -> Rows:
    """Returns the verdicts of the claims about detectors: a row per claim, a column per LiDAR."""
    table = results("claims").dropna(subset="lidar")
    for claim, group in table.groupby("claim", sort=False):
        by_lidar = {row.lidar: _of_detectors(row) for row in group.itertuples()}
        yield [f"`{claim}`", *(by_lidar.get(name, "") for name in (WIDE, "avia"))]


def bias() -> str:
    """Returns by how much the AP of the pretrained detector rises when it is fine-tuned."""
    before = dict(aps_of("captured", "pretrained"))
    gains = [
        (pair, (aps - before[pair]).dropna(how="all"))
        for pair, aps in aps_of("captured")
        if pair in before
    ]
    heads = ["scene", "preset", "LiDAR", "AP gained by fine-tuning"]
    rows = [
        [*pair, _name(lidar), mean_of_ap(gain[lidar])]
        for pair, gain in gains
        for lidar in gain.columns
    ]
    return markdown(heads, rows)


@with_heads(
    "scene",
    "LiDAR",
    "price, USD",
    "AP of `present`",
    f"AP {LEVEL_AP:g} reached",
    *(f"AP per 1,000 USD, site costs {cost:,}" for cost in SITE_COSTS_USD),
)
def value(preset: str) -> Rows:
    """Returns the AP of all vehicles (`present`) of each LiDAR, beside its price."""
    prices = results("lidars").drop_duplicates("lidar").set_index("lidar").price_high_usd
    for (scene, of), aps in aps_of("present"):
        for lidar in prices[list(aps)].sort_values().index if of == preset else ():
            per = [1000 * aps[lidar].mean() / (prices[lidar] + cost) for cost in SITE_COSTS_USD]
            cells = [scene, _name(lidar), f"{prices[lidar]:,.0f}", mean_of_ap(aps[lidar])]
            yield [*cells, _reached(aps[lidar]), *(f"{ratio:.1f}" for ratio in per)]


def _reached(values: pd.Series) -> str:
    mean = over_replicates(values.to_list(), LEVEL)
    return "yes" if mean.low > LEVEL_AP else "no" if mean.high < LEVEL_AP else "undecided"


def variance() -> str:
    """Returns the standard deviations of AP by component, for the fine-tuned detector."""
    table = results("variance")
    table = (
        table[table["training"].isin(("all", "fine-tuned"))].set_index(["component", "quantity"]).sd
    )
    names = {"ruby_plus": "Ruby Plus", "avia": "Avia", "pandar_64": "Pandar64"}
    names |= {"helios_16": "Helios 16", DIFFERENCE: "Avia minus Ruby Plus"}
    rows = [
        [text, *("" if pd.isna(sd) else f"{sd:.1f}" for sd in table[component].reindex([*names]))]
        for component, text in COMPONENTS.items()
        if component in table.index.get_level_values(0)
    ]
    return markdown(["component", *names.values()], rows)


def costs() -> str:
    """Returns the number of trained detectors by scene, and the CPU time of their training.

    CPU s is the mean of the trainings on the most used machine. CPU h is the sum of all.
    """
    table = results("experiments")
    key = "training detector scene preset label_time replicate lidar training_cut_angle_deg".split()
    table = table[table.train_cpu_s > 0].drop_duplicates(key)
    rows = []
    for key, part in table.groupby(["training", "detector", "scene"], sort=False):
        training, detector, scene = map(str, key)
        machine = part.machine.mode()[0]
        seconds = part.train_cpu_s[part.machine == machine].mean()
        hours = part.train_cpu_s.sum() / 3600
        figures = (f"{len(part)}", f"{seconds:.0f}", machine, f"{hours:.1f}")
        rows.append([TRAINED[training, detector], scene, *figures])
    heads = ["detector", "scene", "trainings", "CPU s of a training", "machine", "CPU h"]
    return markdown(heads, rows)


def seeds() -> str:
    """Returns the half-width of the interval of the Avia's AP minus that of the Ruby Plus."""
    halves = half_widths()
    rows = [
        [str(count), *(f"{by_count[count]:.1f}" for by_count in halves.values())]
        for count in REPLICATES
    ]
    return markdown(["replicates", *(SETUPS[setup] for setup in halves)], rows)


def half_widths() -> dict[str, pd.Series]:
    """Returns the half-widths of the table `seeds` by number of replicates, for each training."""
    table = results("variance")
    table = table[table.quantity == DIFFERENCE].set_index(["training", "component"]).sd
    return {
        setup: pd.Series({count: _half_width(table[setup], count) for count in REPLICATES})
        for setup in SETUPS
        if (setup, "seed") in table.index
    }


def _half_width(sd: pd.Series, replicates: int, tests: int = 2) -> float:
    variance_of_mean = (sd["training"] ** 2 + sd["seed"] ** 2 / tests) / replicates
    return math.sqrt(variance_of_mean) * student(replicates)


@with_heads("claim", "vehicles", *(f"exponent {e:g}" for e in LAW_EXPONENTS))
def law_of_range() -> Rows:
    """Returns the fine-tuned detector's verdicts on the highway at both exponents of the range law.

    The presets without a range law have no row.
    """
    where = {"scene": "highway", "preset": "datasheet", "label_time": "scan"}
    table = rows_with(results("claims"), training=PRIMARY[0][0], **where)
    for (claim, subset), part in table.groupby(["claim", "subset"], sort=False):
        by_exponent = part.set_index("law_exponent").verdict
        ends = [by_exponent.get(exponent, "not measured") for exponent in LAW_EXPONENTS]
        yield [f"`{claim}`", f"`{subset}`", *ends]


@with_heads(
    "preset",
    "detector",
    "rows",
    "`holds` or `fails`",
    "`depends on the detector`",
    "narrow intervals",
    "false verdicts expected, at most",
)
def decided(subsets: Sequence[str] = ("captured", "common", "present")) -> Rows:
    """Returns how many primary rows each detector decides, and how many both decide."""
    table = _claims_with_enough_replicates()
    table = table[table.subset.isin(subsets) & (table.label_time == "scan")]
    for key, part in table[table.primary].groupby(["preset", "training"], sort=False):
        yield [str(key[0]), TRAININGS[str(key[1])], *_counts(part)]
    for preset, part in table[table.training == BOTH].groupby("preset", sort=False):
        yield [str(preset), TRAININGS[BOTH], *_counts(part[part.verdict != ONE])]


def _counts(rows: pd.DataFrame) -> list[str]:
    """Returns the cells of rows of one detector, or of both.

    The verdict of both is false if either one is, so its bound of false verdicts is twice as high.
    """
    both = bool((rows["training"] == BOTH).all())
    open_rows = rows.verdict.isin([UNDECIDED, NOT_KNOWN]).sum()
    depends = (rows.verdict == DEPENDS).sum()
    known = "" if both else str(int(rows.known.sum()))
    cells = [len(rows), len(rows) - open_rows - depends, depends if both else ""]
    return [*map(str, cells), known, f"{FALSE_BY_CHANCE * (1 + both) * len(rows):.1f}"]
