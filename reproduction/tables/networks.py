"""Makes tables about the pretrained detector: accuracy, stability and latency."""

import itertools
from dataclasses import astuple

import numpy as np
import pandas as pd

from pyinfra.metrics.comparison import over_replicates
from reproduction.tables.common import (
    LEAST_BOXES,
    LIDARS,
    Rows,
    ends,
    of_rows,
    results,
    with_heads,
    with_interval_of_ap,
)

ARMS = {
    "none": "not fine-tuned",
    "tuned_30": "fine-tuned, 30 steps",
    "tuned_120": "fine-tuned, 120 steps",
    "site_trained": "site-trained",
}
HELD_OUT = (
    "hesai_ot128",
    "hesai_xt32",
    "livox_horizon",
)  # LiDARs that configs/streams/generalist.yaml excludes from training
PARTS = ("reading", "pillars", "layers", "boxes")  # parts of the pretrained detector's time
MANY_LABELS = 200  # minimum number of labels in the test frames


@with_heads(
    "LiDAR",
    "sites",
    "vehicles",
    "precision",
    "range at 80 % of the sites",
    "predicted precision",
    "recall",
)
def generalist_sites() -> Rows:
    """Returns a table of the pretrained detector's precision and recall of vehicles by LiDAR.

    The sites were not used in training.
    """
    table = results("generalist_sites")
    for lidar, group in table[table["class"] == "vehicle"].groupby("lidar", sort=True):
        totals = group[["boxes", "objects"]].sum()
        right = (group.precision * group.boxes).sum()
        predicted = (group.precision_predicted * group.boxes).sum() / totals.boxes
        low, high = group[group.boxes >= LEAST_BOXES].precision.quantile([0.1, 0.9])
        spread = f"{low:.2f} to {high:.2f}"
        shares = (
            f"{right / totals.boxes:.2f}",
            spread,
            f"{predicted:.2f}",
            f"{right / totals.objects:.2f}",
        )
        yield [str(lidar), str(group.site.nunique()), f"{totals.objects:.0f}", *shares]


@with_heads(
    "class",
    "objects",
    "boxes",
    "precision",
    "predicted precision",
    "recall",
    "sites with an error up to 0.05",
)
def generalist_classes() -> Rows:
    """Returns a table of the pretrained detector's precision and recall by class.

    The sites were not used in training.
    """
    table = results("generalist_sites")
    for name, group in table.groupby("class", sort=False):
        group = group.assign(
            right=group.precision * group.boxes,
            predicted=group.precision_predicted * group.boxes,
        )
        objects, boxes, right, predicted = group[["objects", "boxes", "right", "predicted"]].sum()
        sites = group.groupby("site")[["right", "predicted", "boxes"]].sum()
        sites = sites[sites.boxes >= LEAST_BOXES]
        off = (sites.predicted - sites.right).abs() / sites.boxes
        shares = (f"{v:.2f}" for v in (right / boxes, predicted / boxes, right / objects))
        close = f"{100 * (off <= 0.05).mean():.0f} % of {len(sites)}"
        yield [str(name), f"{objects:.0f}", f"{boxes:.0f}", *shares, close]


@with_heads("site", "LiDAR", "seed", *ARMS.values())
def generalist() -> Rows:
    """Returns a table of AP (R1000) of pretrained, fine-tuned and site-trained detectors."""
    table = results("generalist")
    for (site, lidar, seed), group in table.groupby(["site", "lidar", "seed"], sort=False):
        by_arm = group.set_index("arm")
        cells = (
            with_interval_of_ap(*ends(by_arm.loc[arm], "ap_r1000")) if arm in by_arm.index else ""
            for arm in ARMS
        )
        yield [str(site), str(lidar), str(seed), *cells]


@with_heads("sites", "detector", "experiments", "mean of sites", "median", "range")
def compared_with_site_trained() -> Rows:
    """Returns a table of differences in AP (R1000) to a site-trained detector.

    Each site is one replicate. Its value is the mean over its traffic seeds, because results of
    different seeds at one site are not independent.
    """
    table = results("generalist")
    key = ["site", "seed", "lidar"]
    by_arm = table.pivot_table("ap_r1000", key, "arm")
    objects = table.groupby(key).objects.max()
    kinds = {
        "all": objects > 0,
        f"{MANY_LABELS} labels or more": objects >= MANY_LABELS,
        "LiDARs excluded from training": by_arm.index.isin(HELD_OUT, level="lidar"),
    }
    for (kind, chosen), arm in itertools.product(kinds.items(), list(ARMS)[:-1]):
        selected = by_arm[chosen]
        less = (selected[arm] - selected.site_trained).dropna()
        of_sites = less.groupby("site").mean().to_numpy()
        least, middle, most = (f"{v:+.1f}" for v in np.percentile(less, [0, 50, 100]))
        spread = f"{least} to {most}"
        mean = with_interval_of_ap(*astuple(over_replicates(of_sites)))
        counts = f"{len(less)} of {len(of_sites)} sites"
        yield [kind, ARMS[arm], counts, mean, middle, spread]


def of_unseen_sites() -> pd.DataFrame:
    """Returns the rows of the pretrained detector at unseen sites, of its current version.

    Vehicles are matched by BEV IoU 0.5, pedestrians and cyclists by centre distance 0.5 m.
    """
    table = results("unseen")
    matched = table.measure.isin(["BEV IoU 0.5", "centre 0.5 m"])
    return table[matched & (table.model == table.model.iloc[-1])]


def unseen() -> str:
    """Returns a table of AP (R1000) by class at unseen sites."""
    table = of_unseen_sites()
    table = table[(table.condition == "as known") & (table.objects > 0)]
    return of_rows(
        table[(table["sites"] == "all") | (table["class"] == "vehicle")],
        {
            "sites": "{set}, {sites} ({count})",
            "class": "{class}",
            "objects": "{objects}",
            "AP (R1000)": lambda row: with_interval_of_ap(*ends(row, "ap_r1000")),
        },
    )


def unseen_pose() -> str:
    """Returns a table of the AP that an unknown pose error costs at the plain sites."""
    table = of_unseen_sites()
    cost = "{cost:+.1f} [{cost_low:.1f}, {cost_high:.1f}]"
    columns = {"error": "{condition}", "class": "{class}", "cost in AP": cost}
    return of_rows(table[table.condition != "as known"], columns)


def unseen_shown() -> str:
    """Returns a table of false positives per frame and of recall at a precision of 0.5.

    Only boxes with a score of at least 0.5 count as false positives.
    """
    table = of_unseen_sites()
    ends_of_false = "[{false_per_frame_low:.2f}, {false_per_frame_high:.2f}]"
    return of_rows(
        table[(table.condition == "as known") & (table["sites"] == "all")],
        {
            "sites": "{set}",
            "class": "{class}",
            "false positives per frame": f"{{false_per_frame:.2f}} {ends_of_false}",
            "recall at a precision of 0.5": "{recall_at_half:.2f}",
        },
    )


@with_heads("scene", "seed", "LiDAR", "not fine-tuned", "fine-tuned, 120 steps", "gain")
def fairness() -> Rows:
    """Returns a table of each LiDAR's gain in AP from 120 training steps at a scene."""
    for (site, seed, lidar), group in results("fairness").groupby(
        ["site", "seed", "lidar"], sort=False
    ):
        before, after = group.set_index("arm").ap_r1000[["none", "tuned_120"]]
        yield [site, str(seed), lidar, f"{before:.1f}", f"{after:.1f}", f"{after - before:+.1f}"]


@with_heads("scene", "LiDAR", "points, thousands", "PyTorch", "one thread", "two threads", *PARTS)
def detector_latency() -> Rows:
    """Returns a table of the time of a frame by scene and LiDAR, and of its parts."""
    table = results("detector_latency")
    table["name"] = table.engine + " " + table.threads.astype(str)
    for (scene, lidar), group in table.groupby(["scene", "lidar"], sort=False):
        ms = group.set_index(["name", "part"]).ms_p50
        whole = [f"{ms[name, 'all']:.0f}" for name in ("pytorch 1", "package 1", "package 2")]
        parts = [f"{ms['package 1', part]:.1f}" for part in PARTS]
        title = f"four LiDARs of {LIDARS[lidar]}" if scene == "crossroad_poles" else LIDARS[lidar]
        points = f"{group.points.iloc[0] / 1000:.0f}"
        yield [scene.partition("_")[0], title, points, *whole, *parts]


@with_heads(
    "detector",
    "LiDAR",
    "AP",
    "AP of the file",
    "AP without suppression",
    "time, ms",
    "time of the file, ms",
    "of which suppression, ms",
)
def onnx_files() -> Rows:
    """Returns a table of AP and time of detectors and of their ONNX files."""
    for (lidar, detector), group in results("onnx_files").groupby(
        ["lidar", "detector"], sort=False
    ):
        by = group.set_index("engine")
        ap = [f"{by.ap_r1000[name]:.1f}" for name in ("pytorch", "file", "without suppression")]
        ms = [f"{by.ms_p50['pytorch']:.0f}", f"{by.ms_p50['file']:.0f}"]
        yield [detector, LIDARS[lidar], *ap, *ms, f"{by.ms_more_p50['file']:.1f}"]
