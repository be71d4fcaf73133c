"""
A stress curve
==============

A stress test makes one condition worse step by step, and measures the AP at each severity. These
curves are from the recorded tests of two detectors with an Avia. `pyinfra stress` makes such a
table for your detector and data.
"""

import matplotlib.pyplot as plt
import pandas as pd

import pyinfra as pi

RESULTS = "../../results"  # seen from docs/gallery
rows = pd.read_csv(f"{RESULTS}/stress.csv", dtype={"severity": str, "seed": str})
rows = rows[rows.lidar == "livox_avia"]

figure, axes = plt.subplots(1, 3, figsize=(11, 4), sharey=True, layout="constrained")
for ax, stressor in zip(axes, ["rain", "yaw_error", "drop_out"], strict=True):
    pi.plot_stress(rows, stressor, ax=ax)
