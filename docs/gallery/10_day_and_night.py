"""
A day and a night
=================

Sunlight raises the noise of a LiDAR's detector, so a LiDAR has more far points by night. The lines
show the share of vehicles with five points or more by day (100 klx) and by night (0 klx).
"""

import pandas as pd
import seaborn as sns

import pyinfra as pi

tables = {}
for light, klux in (("day", 100), ("night", 0)):
    scene = pi.load_scene("highway", seed=1, set={"weather.sunlight_klux": klux})
    for name, frames in pi.simulate(scene, ["livox_avia", "helios_16"], range(0, 500, 47)).items():
        tables[name, light] = frames.objects
table = pd.concat(tables, names=["LiDAR", "light"]).reset_index(["LiDAR", "light"])
distance = (table.x**2 + table.y**2) ** 0.5
table["share"] = 100 * (table.points >= 5)
table["distance, m"] = 30 * (distance // 30) + 15
ax = sns.lineplot(
    table[distance.between(30, 240)],
    x="distance, m",
    y="share",
    hue="LiDAR",
    style="light",
    markers=True,
)
ax.set(ylim=(0, 102), ylabel="vehicles with five points or more, %")
