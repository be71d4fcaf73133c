"""
Two poles against one
=====================

The lines show the share of vehicles near a crossroad that have 10 points or more, for one pole and
for two poles. Each pole has a LiDAR with 16 lines. The second pole is on the other side, and sees
vehicles that other vehicles hide from the first pole.
"""

import numpy as np
import pandas as pd
import seaborn as sns

import pyinfra as pi

NUMBERS = range(0, 900, 47)
LEAST = 10
points = {}
for mount in ("west", "east"):
    scene = pi.load_scene("crossroad_poles", seed=1, mount=mount)
    table = pi.simulate(scene, "helios_16", NUMBERS).objects
    points[mount] = table.set_index(["frame", "id"])[["points", "x", "y"]]
table = points["west"].join(points["east"].points.rename("east"), how="left").fillna({"east": 0})
distance = np.hypot(table.x - 25, table.y - 10)  # from the middle of the junction
table["distance, m"] = 10 * (distance // 10) + 5
near = table[distance < 80]
shares = pd.concat(
    {
        "west pole": near.points >= LEAST,
        "east pole": near.east >= LEAST,
        "both poles": near.points + near.east >= LEAST,
    },
    names=["seen from"],
)
shares = (100 * shares).rename("share").reset_index().merge(near.reset_index(), on=["frame", "id"])
ax = sns.lineplot(
    shares, x="distance, m", y="share", hue="seen from", style="seen from", markers=True
)
ax.set(
    xlabel="distance from the middle of the junction, m",
    ylabel=f"vehicles with {LEAST} points or more, %",
    ylim=(0, 102),
)
