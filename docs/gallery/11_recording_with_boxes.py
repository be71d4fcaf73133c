"""
A recording with boxes
======================

Two calls detect the vehicles in clouds of another tool. Here the recording is a folder of PCD
files, written from simulated frames with labels. The outline limits the boxes to the road. Without
an outline, the detector also reports boxes beside the road.
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
