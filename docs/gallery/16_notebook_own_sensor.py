"""
Notebook: own sensor
====================

A LiDAR is a dict of keys, or a LiDAR of the package with other values. A function of your own can
replace its model of returns, and several poles give fused frames.
"""

# %%
# The keys are those of a LiDAR's file: 24 channels, 20 frames a second, up to 60 m, no loss.
import matplotlib.pyplot as plt
import numpy as np

import pyinfra as pi

channels = {"count": 24, "upper_deg": 3, "lower_deg": -40}
keys = {
    "name": "short_24",
    "model": "own LiDAR",
    "price_usd": {"low": 1000, "high": 1000, "source": "a guess", "date": "2026"},
    "pattern": {"spinning": {"rate_hz": 20, "columns_per_turn": 900, "channels": channels}},
    "returns": {"max_range_m": 60},
}
lidar = pi.load_lidar(keys)
print(lidar.name, lidar.period_s)

# %%
# A model of returns gets the hits of all rays and a random generator, and returns the points. In
# this model, fog removes far hits more often than near hits.


def fog(hits, rng):
    """Keeps a hit with a probability that falls with its range."""
    range_m = np.sqrt(hits["x"] ** 2 + hits["y"] ** 2 + hits["z"] ** 2)
    return hits[rng.random(len(hits)) < np.exp(-range_m / 20)]


scene = pi.load_scene("highway", seed=1)
clear = pi.simulate(scene, lidar, [0])
foggy = pi.simulate(scene, lidar, [0], returns=fog)
print(f"{len(clear[0].points)} points, {len(foggy[0].points)} in fog")

# %%
# Two poles see the crossroad from two sides. `fields["mount"]` is the pole of each point.
poles = pi.simulate("crossroad_poles", "helios_16", [0], mount=["west", "east"], fuse=True)
points, mount = poles[0].points, poles[0].fields["mount"]
figure, axes = plt.subplots(1, 3, figsize=(12, 4), layout="constrained")
for ax, frame, title in zip(axes[:2], (clear[0], foggy[0]), ("clear", "fog"), strict=True):
    pi.plot_frame(frame, ax=ax)
    ax.set_title(title)
axes[2].scatter(*points[:, :2].T, c=mount, s=0.2, cmap="coolwarm")
axes[2].set(title="two poles", xlim=(-50, 100), ylim=(-50, 60), xlabel="x, m", ylabel="y, m")
