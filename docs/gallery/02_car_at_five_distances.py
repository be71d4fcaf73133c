"""
One car at five distances
=========================

Each row shows the points of a LiDAR on the same car, at five distances from the pole. The car is
shown as the sensor sees it. The number of points is roughly proportional to 1 / distance^2. With
the Ruby Plus, the number first rises, because its channels are dense near the horizon.
"""

import matplotlib.pyplot as plt
import numpy as np

import pyinfra as pi

DISTANCES_M = [20, 40, 60, 80, 100]
scene = pi.load_scene("highway", seed=1)
positions = {k: scene.objects(k) for k in range(300)}

# A car that drives past all distances in front of the sensor.
for car in np.unique(positions[150]["id"]):
    x = {k: rows["x"][rows["id"] == car] for k, rows in positions.items()}
    x = {k: float(value[0]) for k, value in x.items() if len(value)}
    if min(x.values()) < DISTANCES_M[0] and max(x.values()) > DISTANCES_M[-1]:
        break
numbers = [min(x, key=lambda k: abs(x[k] - distance)) for distance in DISTANCES_M]
lidars = ["helios_16", "livox_avia", "ruby_plus"]
frames = pi.simulate(scene, lidars, sorted(numbers))

figure, axes = plt.subplots(
    len(lidars), 5, figsize=(10, 4.2), sharex=True, sharey=True, layout="constrained"
)
for row, (name, sequence) in zip(axes, frames.items(), strict=True):
    for ax, number in zip(row, numbers, strict=True):
        frame = next(frame for frame in sequence if frame.number == number)
        points = frame.points[frame.fields["object_id"] == car, :3]
        box = frame.objects.set_index("id").loc[car]
        distance = np.hypot(box.x, box.y)
        across = (box.x * points[:, 1] - box.y * points[:, 0]) / distance
        ax.plot(across, points[:, 2] - box.z, ".", markersize=2)
        ax.set_title(f"{name}, {distance:.0f} m: {len(points)}", fontsize=8)
        ax.set(xlim=(2.5, -2.5), ylim=(-1.2, 1.2), aspect="equal")
figure.supxlabel("across the line of sight, m")
figure.supylabel("height, m")
