"""
Range against reflectance and light
===================================

A LiDAR detects bright paint at longer ranges than dark paint. By day, most of the noise is sunlight
that the target itself reflects, so the range grows with the fourth root of the reflectance. In the
dark it grows with the square root. The curves are the range law of the preset `datasheet`, at
normal incidence and in clear air. Circles are published ranges; for most LiDARs there is only one.
The simulator fits the law to all published ranges. This fit changes the curves of the Avia by up
to 1 %.
"""

import matplotlib.pyplot as plt
import numpy as np
import yaml

import pyinfra as pi

LIDARS = ("livox_avia", "ruby_plus", "pandar_64", "helios_16")
PAINTS = {
    "black paint": 0.05,
    "target of the data sheet": 0.1,
    "silver paint": 0.4,
    "white paint": 0.7,
}
DAY_KLUX = 100  # sunlight at which the noise of a 10 % target equals that of the detector


def range_m(returns, reflectance, klux):
    """Returns the range at which half of the rays give a point; at most the device's limit."""
    noise = np.maximum(1, np.sqrt(reflectance / 0.1 * klux / DAY_KLUX))
    at_10_percent_m = returns["detection"]["range_at_10_percent_m"]
    range_m = at_10_percent_m * np.sqrt(reflectance / 0.1 / noise)
    return np.minimum(range_m, returns["max_range_m"])


figure, (left, right) = plt.subplots(1, 2, figsize=(11, 4.5), sharey=True, layout="constrained")
reflectance, klux = np.linspace(0.02, 1, 200), np.linspace(0, 120, 200)
for name in LIDARS:
    returns = yaml.safe_load(pi.load_lidar(name, preset="datasheet").dump())["returns"]
    (line,) = left.plot(100 * reflectance, range_m(returns, reflectance, DAY_KLUX), label=name)
    left.plot(100 * reflectance, range_m(returns, reflectance, 0), "--", color=line.get_color())
    published = [{"range_m": returns["detection"]["range_at_10_percent_m"], "reflectance": 0.1}]
    for one in [*published, *returns["detection"].get("further_ranges", [])]:
        night = one.get("sunlight_klux", DAY_KLUX) == 0
        fill = "none" if night else line.get_color()
        left.plot(
            100 * one["reflectance"],
            one["range_m"],
            "o",
            color=line.get_color(),
            markerfacecolor=fill,
        )
    if name == "livox_avia":
        for paint, share in PAINTS.items():
            right.plot(klux, range_m(returns, share, klux), label=f"{paint}, {100 * share:.0f} %")
left.set(title="by day (lines) and in the dark (dashes)", xlabel="reflectance, %", ylim=(0, None))
left.set_ylabel("range, m")
right.set(title="livox_avia", xlabel="sunlight, klx")
for ax in (left, right):
    ax.grid(alpha=0.4)
    ax.legend(fontsize=8)
