"""Writes the answers of pages on models, faults, placement and tracks (see `sentences`)."""

import pandas as pd

from pyinfra.metrics.comparison import Interval
from reproduction.tables import integration as stacked
from reproduction.tables import rungs, stress
from reproduction.tables.common import LIDARS, results
from reproduction.tables.label_times import ANGLES_DEG, WIDE, of_setup, trained_at_angles
from reproduction.tables.networks import of_unseen_sites
from reproduction.tables.sentences import AVIA, known, span, within
from reproduction.tables.simulator import changes_of_models
from reproduction.tables.tracks import rows_of as tracked

LEAST_CHANGE = 3.0  # change of the number of points in percent below which a model changes little


def fidelity() -> str:
    changes = changes_of_models()
    none = changes["parts", "none"]
    glass = changes["parts", "glass"]
    plants = changes["vegetation", "none"]
    finer = [c for value in ("mid", "fine") for c in changes["detail", value].values()]
    higher = [LIDARS[name] for name, change in none.items() if change.is_significant]
    known(set(LIDARS.values()) - set(higher) == {"Ruby Plus"}, "AP depends on parts, but for one")
    known(not any(c.is_significant for c in finer), "finer bodies do not change AP significantly")
    besides = [LIDARS[name] for name, change in glass.items() if change.is_significant]
    exception = known(besides == ["Avia"], "except for the Avia")
    return (
        "If vehicles have no windows, no gap below them and no clear coat, the AP of "
        f"Background is {span(c.value for c in none.values() if c.is_significant)} too high. With "
        "the Ruby Plus (128 lines), the difference is not significant. If vehicles have windows, "
        f"the gap and the coat do not change the AP significantly, {exception}. If a scene has no "
        f"plants, the AP is {plants['livox_avia'].value:.0f} too high with the Avia and "
        f"{plants['helios_16'].value:.0f} too high with the Helios 16. Vehicle bodies with ten "
        "times as many triangles do not change the AP significantly: the intervals of the changes "
        f"lie within -{within(finer)} to {within(finer)}."
    )


def failures() -> str:
    falls = {name: stress.falls(name) for name in ("yaw_error", "height_error", "pitch_error")}
    networks = {key: at for key, at in falls["pitch_error"].items() if key[1] != "background"}
    background = [at for key, at in falls["pitch_error"].items() if key[1] == "background"]
    yaw, height = falls["yaw_error"].values(), falls["height_error"].values()
    return (
        f"With every detector, a yaw error of {span(yaw, 2)} degrees lowers the AP by 10. A height "
        f"error of {span(height, 1)} m also lowers the AP by 10. With networks, a pitch error of "
        f"{min(networks.values()):.1f} degrees can lower the AP by 10. With Background, a pitch "
        f"error of {min(background):.2f} degrees can lower it by 10. "
        f"{_tolerant(('rain', 'fog', 'drop_out'))}"
    )


def _tolerant(stressors: tuple[str, ...]) -> str:
    for name in stressors:
        at = stress.falls(name)
        for lidar in {lidar for lidar, _ in at}:
            tuned, other = at[lidar, "fine-tuned"], at[lidar, "background"]
            known(tuned > other, f"{name}, {lidar}: the fine-tuned detector tolerates more")
    return (
        "The fine-tuned detector tolerates more rain, more fog and more lost points than "
        "Background."
    )


def integration() -> str:
    cases = stacked.aps("captured")

    def change(speed: int, label_at: str) -> Interval:
        of_seeds = cases[speed, AVIA]
        (stack,) = (s for s in of_seeds if s != stacked.SINGLE and s[1] == label_at)
        return stacked.change(of_seeds, stack)

    def effects(label_at: str) -> str:
        slow, fast = (_effect(change(speed, label_at)) for speed in (20, 62))
        if slow == fast:
            return f"{slow} at 20 km/h or at 62 km/h"
        return f"{slow} at 20 km/h, and {fast} at 62 km/h"

    return (
        "The Avia's frames of 0.5 s are merged into one cloud. With the label "
        f"of the middle frame, the merging {effects('middle')}. Boxes are then available only "
        "after the last frame. Real-time detection needs the label of the last frame. With this "
        f"label, the merging {effects('newest')}."
    )


def _effect(change: Interval) -> str:
    """Describes a change of AP, as in `raises the AP by 1.2`."""
    if not change.is_significant:
        return "does not change the AP significantly"
    return f"{'raises' if change.low > 0 else 'lowers'} the AP by {abs(change.value):.1f}"


def label_times() -> str:
    aps = of_setup("fine-tuned")
    spinning = [lidar for lidar, _ in aps if "avia" not in lidar]
    own, others = [], []
    for lidar in dict.fromkeys(spinning):
        scan, frame = aps[lidar, "scan"].mean(), aps[lidar, "frame"].mean()
        own.append(scan[0] - frame[0])
        others += [scan[angle] - frame[angle] for angle in ANGLES_DEG[1:]]
    scan = aps[WIDE, "scan"].mean()
    for trained_at, tested in trained_at_angles(WIDE).items():
        own.append(scan[trained_at] - tested[trained_at])
        others += [scan[angle] - tested[angle] for angle in ANGLES_DEG if angle != trained_at]
    return (
        "With labels at mid-frame, the AP of a trained detector depends on the cut angle of the "
        f"LiDAR. At the cut angle of the training, the AP is {span(own)} lower than with labels "
        f"at scan time. At other cut angles, the AP is {span(others)} lower. With labels at scan "
        "time, the cut angle has no significant effect. Use `label_time: scan` unless your "
        "detector always runs with the cut angle of its training."
    )


def placement() -> str:
    table = results("placement_summary").set_index("quantity")
    gain = table.loc["chosen pose less mean pose, AP"]
    found = table.loc["helios_16 less ruby_plus, vehicles found within 60 m, percent"]
    ap = table.loc["helios_16 less ruby_plus, AP"]
    known(gain.low > 0, "the place matters")
    known(found.low < 0 < found.high, "the vehicles found do not differ significantly")
    known(ap.high < 0, "the AP of several Helios 16 is lower")
    units = table.loc["helios_16 less ruby_plus, number of LiDARs"].value + 1
    return (
        "At equal price, the pose that `pyinfra plan` predicts to be best has a higher AP than the "
        f"mean of six poses of the same LiDAR. The difference is {gain.value:.0f} AP "
        f"[{gain.low:.0f}, {gain.high:.0f}]. A plan with several Helios 16 has {units:.1f} units "
        "on average for the price of one Ruby Plus (128 lines). Within 60 m, the share of vehicles "
        "found does not differ significantly between the two kinds of plan. Over the whole region, "
        f"plans with the Helios 16 have an AP that is {-ap.value:.0f} lower."
    )


def lidar_models() -> str:
    table = rungs.changes()
    points = table.groupby(["lidar", "from_m"]).points_default.mean().unstack()
    largest = {
        str(name): abs(rungs.largest_relative(rung, points).change.value)
        for name, rung in table.groupby("rung", sort=False)
    }
    small = ("19 sub-rays", "sub-rays everywhere", "separation of 0.25 m", "separation of 1 m")
    most = max(largest[name] for name in small)
    known(most < LEAST_CHANGE, "more sub-rays and other separations change little")
    on = [largest[name] for name in ("one ray", "one range for all channels")]
    choices = [
        *("assumed beams of 0.05 degrees", "assumed beams of 0.2 degrees", "beams by FWHM"),
        *("first echo", "last echo", "two echoes", "exponent 0.5"),
    ]
    return (
        "A comparison needs the divergence of beams and the range of each channel. Without one of "
        f"these models, the ratio of two LiDARs' points per vehicle changes by up to {max(on):.0f} "
        "%. More rays per beam and a different separation of echoes change this ratio by at most "
        f"{most:.1f} %, so both are switched off by default. Assumed beam widths, the echo mode "
        "and the exponent of the range law change the ratio by "
        f"{span(largest[name] for name in choices)} %. Compare LiDARs with several values of these "
        "three settings."
    )


def tracks() -> str:
    table = tracked("detector")
    table = table[table.lidar.isin(("ruby_plus", "pandar_64"))]
    off = 100 * (table.passages - table.passages_true).abs() / table.passages_true
    return (
        f"With the Pandar64 and the Ruby Plus, the tracks have a HOTA of {span(table.hota)}. With "
        "these LiDARs, the counts of vehicles differ from the true counts by at most "
        f"{off.max():.0f} %."
    )


def follow() -> str:
    table = results("follow")
    dropped = 100 * table.dropped / (table.lines + table.dropped)
    growth = table.memory_mb.max() - table.memory_mb.min()
    return known(
        growth < 1,
        f"The memory of `pyinfra detect --follow` stays at {span(table.memory_mb)} MB for an hour. "
        f"On two busy cores (load average {span(table.load)}), the command drops "
        f"{span(dropped)} % of the clouds. The longest delay is "
        f"{table.delay_max_ms.max() / 1000:.1f} s.",
    )


def people() -> str:
    table = results("people")
    walkers = table[(table["class"] == "Pedestrian") & (table.points >= 5)]
    end = walkers.groupby("lidar").from_m.max() + 10
    wide = [end[name] for name in ("ruby_plus", "hesai_ot128", "velodyne_vls_128")]
    narrow = [end[name] for name in ("helios_16", "velodyne_vlp_16")]
    return (
        "LiDARs with 128 lines have at least 5 points per frame on a pedestrian up to a distance "
        f"of {span(wide)} m. LiDARs with 16 lines have at least 5 points up to {span(narrow)} m."
    )


def plan_intervals() -> str:
    table = results("plan_coverage_summary").query("lidar == 'all'")
    inside = table.set_index(["figure", "source"]).inside_percent
    options = table[table.figure == "recall"].options.max()
    share, ap, false = (
        [f"{inside[figure, source]:.0f}" for source in ("predicted", "simulated")]
        for figure in ("recall", "ap", "false_per_frame")
    )
    return (
        f"The intervals of {options} options were tested. Of the 95 % intervals of the share of "
        f"vehicles found, {share[0]} % of the predicted and {share[1]} % of the simulated "
        f"intervals contain the mean of further traffic. For the AP, {ap[0]} % of the predicted "
        f"and {ap[1]} % of the simulated intervals contain this mean. For the number of false "
        f"boxes, {false[0]} % of the predicted and {false[1]} % of the simulated intervals contain "
        "this mean."
    )


def unseen() -> str:
    table = of_unseen_sites()
    keep = (table.condition == "as known") & (table["class"] == "vehicle")
    ap: pd.Series = table[keep & (table["sites"] == "all")].set_index("set").ap_r1000
    return (
        f"The AP of vehicles is {ap['plain']:.0f} at plain sites and {ap['cluttered']:.0f} at "
        "cluttered sites."
    )


def unseen_pose() -> str:
    table = of_unseen_sites()
    cost: pd.Series = table[table["class"] == "vehicle"].set_index("condition").cost
    return (
        "At the plain sites, an error of 0.25 m in the sensor's height lowers the AP of vehicles "
        f"by {cost['height 0.25 m wrong']:.1f}. A pitch error of half a degree lowers the AP by "
        f"{cost['pitch 0.5 deg wrong']:.1f}."
    )
