"""
Scan patterns of all LiDARs
===========================

Each panel shows the directions of a LiDAR's rays in one frame of 0.1 s, as seen from the sensor.
Spinning LiDARs repeat the same lines in each frame. The pattern of most Livox LiDARs does not
repeat, so the next frame has rays in other directions.
"""

import matplotlib.pyplot as plt
import numpy as np

import pyinfra as pi

NAMES = """helios_16 velodyne_vlp_16 hesai_xt32 velodyne_vlp_32c velodyne_hdl_64e pandar_64
    hesai_ot128 ruby_plus velodyne_vls_128 livox_mid_40 livox_mid_70 livox_tele_15 livox_horizon
    livox_avia bundle_5_livox_avia""".split()

figure, axes = plt.subplots(3, 5, figsize=(11, 7), sharex=True, sharey=True, layout="constrained")
for ax, name in zip(axes.flat, NAMES, strict=True):
    azimuth, elevation, _ = pi.load_lidar(name).pattern(0, 1, 1).T
    ax.plot(np.degrees(azimuth), np.degrees(elevation), ".", color="black", markersize=0.4)
    ax.set(xlim=(20, -20), ylim=(-20, 20), aspect="equal")
    ax.set_title(name, fontsize=9)
figure.supxlabel("azimuth, degrees")
figure.supylabel("elevation, degrees")
