"""
Accuracy against speed and price
================================

Each point is one LiDAR with one detector on the motorway, from the tables of a benchmark. The
left picture compares the AP with the time that the detector takes for a frame, the right one with
the price of the LiDAR. Good options are at the top left. The dashed line is
the length of a frame, 100 ms.
"""

import matplotlib.pyplot as plt
import pandas as pd
import seaborn as sns

RESULTS = "../../results"  # seen from docs/gallery
keys = ["scene", "lidar", "preset", "detector", "tier", "seed"]
table = pd.read_csv(f"{RESULTS}/quick.csv").merge(
    pd.read_csv(f"{RESULTS}/quick_value.csv")[[*keys, "price_usd"]], on=keys
)
table = table[(table.scene == "highway") & (table.preset == "datasheet")]

figure, axes = plt.subplots(1, 2, figsize=(10, 4.5), sharey=True, layout="constrained")
for ax, column in zip(axes, ["latency_p50_ms", "price_usd"], strict=True):
    legend = "auto" if column == "price_usd" else False
    sns.scatterplot(
        table, x=column, y="ap_all", hue="lidar", style="detector", s=70, ax=ax, legend=legend
    )
    ax.set(xscale="log", ylabel="AP of all visible vehicles in the region")
    ax.minorticks_off()
axes[0].axvline(100, color="grey", linestyle="--")
axes[0].set(xlabel="latency, ms a frame", xticks=[2, 5, 10, 20, 50, 100])
axes[1].set(xlabel="price, USD", xticks=[2000, 5000, 10_000, 20_000])
for ax in axes:
    ax.xaxis.set_major_formatter("{x:,.0f}")
sns.move_legend(axes[1], "upper left", bbox_to_anchor=(1, 1), fontsize=8)
