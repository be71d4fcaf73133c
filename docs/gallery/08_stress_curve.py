"""
A stress curve
==============

A stress test makes one condition worse step by step, and measures the AP at each severity. These
curves are from the stored tests of three detectors with an Avia on the motorway. A line is the
mean over three traffic seeds, and a band is their range. `pyinfra stress` makes such a table for
your detector and data, and `pi.plot_stress` draws it.
"""

import matplotlib.pyplot as plt
import pandas as pd
import seaborn as sns

RESULTS = "../../results"  # seen from docs/gallery
table = pd.read_csv(f"{RESULTS}/stress_seeds.csv")
table = table[table.lidar == "livox_avia"]
unstressed = table[table.stressor == "none"]

figure, axes = plt.subplots(1, 3, figsize=(11, 4), sharey=True, layout="constrained")
for ax, stressor in zip(axes, ["rain", "yaw_error", "drop_out"], strict=True):
    rows = table[table.stressor == stressor]
    unit = rows.unit.iloc[0]
    curve = pd.concat([unstressed, rows]).astype({"severity": float})
    legend = "auto" if ax is axes[0] else False
    sns.lineplot(
        curve, x="severity", y="ap_r1000", hue="setup", errorbar=("pi", 100), ax=ax, legend=legend
    )
    ax.set(xlabel=f"{stressor}, {unit}", ylabel="AP (R1000)", ylim=(0, 100))
axes[0].legend(title="")
