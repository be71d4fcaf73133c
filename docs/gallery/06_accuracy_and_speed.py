"""
Accuracy against speed and training
===================================

Each point is one detector with one LiDAR on the motorway, with the settings of the study. The left
picture compares the AP with the time that the detector takes for a frame on one thread of a CPU,
and the right one with the CPU time of its training. Good options are at the top left. The dashed
line is at 100 ms, the length of a frame. Detectors to its left need less time.
"""

import matplotlib.pyplot as plt
import pandas as pd
import seaborn as sns

RESULTS = "../../results"  # seen from docs/gallery
keys = ["scene", "preset", "lidar", "detector", "training"]
table = pd.read_csv(f"{RESULTS}/experiments.csv")
table = table[(table.subset == "captured") & (table.label_time == "scan")]
table = table[(table.cut_angle_deg == 0) & (table.training_cut_angle_deg == 0)]
columns = {"ap": ("ap_r1000", "mean"), "train_cpu_s": ("train_cpu_s", "mean")}
means = table.groupby(keys, as_index=False).agg(**columns)
means = means.merge(pd.read_csv(f"{RESULTS}/latency.csv"), on=keys)
means["LiDAR"] = means.lidar.map({"ruby_plus": "Ruby Plus", "livox_avia": "Avia"})
means["detector"] = means.detector.mask(means.detector == "generalist", means["training"])

figure, axes = plt.subplots(1, 2, figsize=(10, 4.5), sharey=True, layout="constrained")
for ax, column in zip(axes, ["latency_p50_ms", "train_cpu_s"], strict=True):
    legend = "auto" if ax is axes[1] else False
    sns.scatterplot(
        means, x=column, y="ap", hue="detector", style="LiDAR", s=80, ax=ax, legend=legend
    )
axes[0].axvline(100, color="grey", linestyle="--")
axes[0].set(xscale="log", xlabel="latency, ms a frame", ylabel="AP (R1000) of captured")
axes[1].set(xlabel="training, CPU s")
axes[0].xaxis.set_major_formatter("{x:,.0f}")
sns.move_legend(axes[1], "upper left", bbox_to_anchor=(1, 1), fontsize=8)
