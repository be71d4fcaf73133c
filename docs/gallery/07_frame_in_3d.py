"""
A frame in 3-D
==============

The picture shows a frame of a Ruby Plus at the crossroad, coloured by height, and the label boxes.
`pyinfra view` writes such a frame as an HTML page that can be turned and zoomed.
"""

import matplotlib.pyplot as plt
import numpy as np

import pyinfra as pi

frame = pi.simulate("crossroad", "ruby_plus", [200])[0]
x, y, z, _ = frame.points.T
near = (abs(x - 25) < 45) & (abs(y) < 45) & (z > -6.5)

ax = plt.figure(figsize=(9, 5)).add_subplot(projection="3d")
ax.scatter(x[near], y[near], z[near], s=0.4, c=z[near], cmap="viridis", vmin=-6, vmax=1)
corners = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1], [1, 1]]) / 2
for box in frame.labels.itertuples():
    if abs(box.x - 25) > 45 or abs(box.y) > 45:
        continue
    cos, sin = np.cos(box.heading), np.sin(box.heading)
    outline = corners * [box.dx, box.dy] @ [[cos, sin], [-sin, cos]] + [box.x, box.y]
    for level in (box.z - box.dz / 2, box.z + box.dz / 2):
        ax.plot(*outline.T, level, color="tab:red", linewidth=0.8)
ax.set_box_aspect((90, 90, 14), zoom=1.7)
ax.set_axis_off()
ax.view_init(elev=32, azim=-125)
