"""
Points per vehicle
==================

The lines show the median number of points on a vehicle, by its distance from the pole. The bands
contain the middle half of the vehicles. All LiDARs see the same vehicles on one motorway, with the
vendors' settings.
"""

import pandas as pd
import seaborn as sns

import pyinfra as pi

lidars = ["helios_16", "pandar_64", "ruby_plus", "livox_avia"]
frames = pi.simulate(pi.load_scene("highway", seed=1), lidars, range(0, 700, 47))
table = pd.concat({name: sequence.labels for name, sequence in frames.items()}, names=["LiDAR"])
distance = (table.x**2 + table.y**2) ** 0.5
table["distance, m"] = 20 * (distance // 20) + 10
ax = sns.lineplot(
    table[distance < 160].reset_index("LiDAR"),
    x="distance, m",
    y="points",
    hue="LiDAR",
    style="LiDAR",
    markers=True,
    estimator="median",
    errorbar=("pi", 50),
)
ax.set(yscale="log", ylabel="points on a vehicle")
