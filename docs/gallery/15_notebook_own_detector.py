"""
Notebook: own detector and training
===================================

A detector of your own is a function or a class. Its boxes are evaluated and drawn like those of the
detectors of the package, and a network is trained on the same frames.
"""

# %%
# The detector puts a box with the size of a car on each cluster of points above the road.
import numpy as np
from scipy.cluster.hierarchy import fcluster, linkage

import pyinfra as pi

scene = pi.load_scene("highway", seed=1)
frames = pi.simulate(scene, "helios_16", range(0, 1000, 100))
height_m = frames.lidar.T_world_levelled.z


@pi.register_detector
def clusters(points):
    """Returns boxes (k, 8): x y z dx dy dz heading score."""
    above = points[(points[:, 2] > 0.3 - height_m) & (points[:, 2] < 2 - height_m)]
    near = above[np.abs(above[:, :2]).max(axis=1) < 40]
    if len(near) < 2:
        return np.empty((0, 8))
    groups = fcluster(linkage(near[:, :2]), 1.0, "distance")
    centres = [near[groups == k, :3].mean(axis=0) for k in np.unique(groups)]
    sizes = [np.count_nonzero(groups == k) for k in np.unique(groups)]
    rows = [
        [*centre[:2], 0.75 - height_m, 4.5, 1.8, 1.5, 0, min(1, size / 100)]
        for centre, size in zip(centres, sizes, strict=True)
        if size > 5
    ]
    return np.array(rows).reshape(-1, 8)


detections = pi.detect("clusters", frames)
detections.head()

# %%
# A network learns from frames in memory. This example has five steps; use a hundred or more. The
# training begins with the pretrained weights.
losses = []
model = pi.train(
    "generalist",
    frames,
    steps=5,
    augment=lambda points, boxes, rng: (points, boxes),
    progress=lambda done: losses.append(done.loss),
)
print(f"losses of the steps: {', '.join(f'{loss:.1f}' for loss in losses)}")

# %%
# The same function evaluates the two detectors. The picture has the AP of vehicles by distance.
result = pi.evaluate(frames, detections)
trained = pi.evaluate(frames, pi.detect(model, frames))
ax = pi.plot_ap_by_distance({"clusters": result, "trained": trained}, ground_truth="captured")
