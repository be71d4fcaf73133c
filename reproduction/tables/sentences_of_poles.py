"""Writes the answers of the page on several poles (see `sentences`)."""

from pyinfra.metrics.comparison import Interval
from reproduction.tables import sites
from reproduction.tables.common import results
from reproduction.tables.sentences import joined, known, span

PRODUCTS = {"hesai_xt32": "the XT32", "hesai_ot128": "the OT128"}
NO_ERROR = "none"


def places() -> str:
    table = results("places").fillna({"minus": ""})
    table = table[table.ground_truth == "present"]
    keyed = table.set_index(["measure", "lidar", "place", "minus"])[["value", "low", "high"]]

    def difference(lidar: str, place: str, other: str) -> Interval:
        return Interval(*keyed.loc["ap_r1000", lidar, place, other])

    hidden = table[table.measure == "hidden_percent"].groupby("place").value.mean()
    higher = [difference(lidar, "8m", "6m") for lidar in PRODUCTS]
    tilted = [difference(lidar, "8m_down", "6m") for lidar in PRODUCTS]
    second = {name: difference(lidar, "two", "6m") for lidar, name in PRODUCTS.items()}
    known(all(d.high < 0 for d in higher), "a pole of 8 m has a lower AP than one of 6 m")
    known(all(d.high < 0 for d in tilted), "a tilted LiDAR at 8 m has a lower AP than one at 6 m")
    gains = {name: d for name, d in second.items() if d.low > 0}
    adds = joined([f"{d.value:.0f} with {name}" for name, d in gains.items()])
    known(bool(gains), "a second pole raises the AP with a LiDAR")
    others = "".join(
        f" With {name}, the gain of {d.value:.0f} AP is not significant."
        for name, d in second.items()
        if name not in gains
    )
    return (
        f"Houses hide {hidden['back']:.0f} % of the vehicles from the pole before the crossing, "
        f"and {hidden['6m']:.0f} % from the pole at the corner. Only the AP of all vehicles "
        "includes hidden vehicles. At the corner, a LiDAR at 8 m has fewer hidden vehicles "
        "than a LiDAR at 6 m. But the AP of all vehicles is lower with the LiDAR at 8 m, even if "
        "this LiDAR is tilted down. "
        f"A second pole of 6 m raises the AP by {adds}.{others}"
    )


def poles() -> str:
    changes = {
        (lidar, count): sites.change_of(aps, (count, NO_ERROR), (count // 2, NO_ERROR))
        for (lidar, detector), aps in sites.ap_of_poles()
        for count in (2, 4)
        if detector == "Background"
    }

    def added(by_count: int) -> str:
        of_count = {lidar: d for (lidar, count), d in changes.items() if count == by_count}
        equal = [lidar for lidar, d in of_count.items() if not d.is_significant]
        more = span(d.value for lidar, d in of_count.items() if lidar not in equal)
        besides = f"; with the {joined(equal)}, the change is not significant" if equal else ""
        return f"{more}{besides}"

    return (
        f"With the detector Background, a second pole raises the AP by {added(2)}. The third and "
        f"fourth pole together raise the AP by {added(4)}."
    )


def pole_errors() -> str:
    clocks: list[Interval] = []
    turned: dict[int, list[float]] = {2: [], 4: []}
    for _, aps in sites.ap_of_poles():
        for count, costs in turned.items():
            if (count, "clock_50_ms") in aps:
                clocks.append(sites.change_of(aps, (count, "clock_50_ms"), (count, NO_ERROR)))
                error = sites.change_of(aps, (count, "yaw_0.5_deg"), (count, NO_ERROR))
                costs.append(-error.value)
    most = max(abs(change.value) for change in clocks)
    known(most < 1, "late clocks change the mean AP by less than 1")
    return (
        f"Clocks that are up to 50 ms late change the mean AP by at most {most:.1f} at this "
        f"junction. A yaw error of 0.5 degrees lowers the mean AP by {span(turned[2])} with two "
        f"poles, depending on LiDAR and detector. With four poles, the same error lowers the mean "
        f"AP by {span(turned[4])}."
    )
