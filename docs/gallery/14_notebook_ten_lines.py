"""
Notebook: ten lines
===================

Ten lines simulate frames, detect vehicles and evaluate the boxes. This page is also a Jupyter
notebook: the link to the notebook is at the end of the page.
"""

# %%
# A scene and a LiDAR of the package give frames, which are simulated when they are used.
import pyinfra as pi

scene = pi.load_scene("highway", seed=1)
lidar = pi.load_lidar("ruby_plus", preset="datasheet")
frames = pi.simulate(scene, lidar, range(0, 2000, 200))
print(frames)

# %%
# A frame has points (n, 4) and labels, in the levelled frame of the LiDAR.
frames[3].labels.head()

# %%
# The pretrained detector returns a table of boxes, which is compared with the labels.
detections = pi.detect(pi.load_detector("generalist"), frames)
result = pi.evaluate(frames, detections)
result.by_distance[["ground_truth", "distance_m", "ap_r1000", "objects"]]

# %%
ax = pi.plot_frame(frames[3], detections)
