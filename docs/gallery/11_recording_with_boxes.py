"""
A recording with boxes
======================

Clouds of another tool become boxes in two calls. Here the recording is a folder of PCD files,
written from simulated frames. Their labels are drawn for comparison. The outline says where
vehicles can be. Without it, the detector also reports boxes beside the road.
"""

import tempfile

import pyinfra as pi

ROAD = [(-100, -18), (100, -18), (100, 18), (-100, 18)]

with tempfile.TemporaryDirectory() as folder:
    clouds = pi.export(pi.simulate("highway", "pandar_64", range(30)), "pcd", f"{folder}/clouds")
    frames = pi.import_recording(clouds, "pcd", f"{folder}/motorway/pole")
    detections = pi.detect("generalist", frames.of([15]), region=ROAD)
    ax = pi.plot_frame(frames.frame(15), detections)
ax.set(xlim=(-60, 60), ylim=(-25, 25))
