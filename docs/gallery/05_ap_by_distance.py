"""
AP by distance, with intervals
==============================

The pretrained detector runs on frames of two LiDARs. The lines show its AP in rings of 20 m around
the pole, and the bands the 95 % intervals. Fewer frames give wider intervals.
"""

import pyinfra as pi

scene = pi.load_scene("highway", seed=1)
results = {}
for name, frames in pi.simulate(scene, ["helios_16", "ruby_plus"], range(0, 5000, 200)).items():
    results[name] = pi.evaluate(frames, pi.detect("generalist", frames))
ax = pi.plot_ap_by_distance(results, ground_truth="captured")
ax.set_title("vehicles with one point or more")
