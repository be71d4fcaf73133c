"""Makes the table of AP with stacked frames."""

from reproduction.report.ladder import interval
from reproduction.tables.common import LIDARS, markdown, mean_of_ap, results, signed

PERIOD_S = 0.1  # of a frame
LABELS_AT = {"newest": "", "middle": ", middle labelled"}


def integration(subset: str = "captured") -> str:
    """Returns AP (R1000) with single frames, and its change with stacked frames.

    Values are means over traffic seeds. Changes are paired by seed.
    """
    table = results("integration")
    table = table[table.subset == subset]
    stacks = table[["accumulate", "label_at"]].drop_duplicates().apply(tuple, axis=1).to_list()
    (single,) = (stack for stack in stacks if stack[0] == 1)
    longer = [stack for stack in stacks if stack != single]
    rows = []
    for (speed, lidar), part in table.groupby(["speed_km_h", "lidar"], sort=False):
        aps = part.pivot(index="seed", columns=["accumulate", "label_at"], values="ap_r1000")
        changes = (
            signed(interval(aps[stack] - aps[single])) if stack in aps else "" for stack in longer
        )
        rows.append([f"{speed} km/h", LIDARS[str(lidar)], mean_of_ap(aps[single]), *changes])
    heads = [f"change, {PERIOD_S * n:g} s{LABELS_AT[label_at]}" for n, label_at in longer]
    return markdown(["speed", "LiDAR", f"AP, {PERIOD_S:g} s", *heads], rows)
