"""
Glass and plants
================

Under the preset `datasheet`, rays pass through windows, and leaves stop a part of the rays. Under
`equal`, vehicles are solid, the scene has no plants, and the channels are evenly spaced. The upper
pictures show a car as the sensor sees it. The lower ones show one frame from above.
"""

import matplotlib.pyplot as plt
import numpy as np

import pyinfra as pi

VEGETATION = 4  # class of the background; of an object, object_id is 0 or more

figure, axes = plt.subplots(2, 2, figsize=(10, 7), sharex="row", sharey="row", layout="constrained")
car_id = None
for (car_ax, plan_ax), preset in zip(axes.T, ["equal", "datasheet"], strict=True):
    scene = pi.load_scene("crossroad", seed=1, preset=preset)
    frame = pi.simulate(scene, pi.load_lidar("ruby_plus", preset=preset), [200])[0]
    labels = frame.labels
    if car_id is None:  # the same car in both pictures
        near = labels[(labels.type == "Car") & (np.hypot(labels.x, labels.y) > 15)]
        car_id = near.sort_values("points").id.iloc[-1]
    car = labels.set_index("id").loc[car_id]
    points = frame.points[frame.fields["object_id"] == car_id, :3]
    across = (car.x * points[:, 1] - car.y * points[:, 0]) / np.hypot(car.x, car.y)
    car_ax.plot(across, points[:, 2] - car.z, ".", markersize=2)
    car_ax.set(title=f"{preset}: {len(points)} points on a car", aspect="equal")
    background = frame.fields["object_id"] < 0
    plants = background & (frame.fields["class"] == VEGETATION)
    for name, rows, colour in (
        ("ground and structures", background & ~plants, "lightgrey"),
        ("plants", plants, "tab:green"),
        ("vehicles", ~background, "tab:blue"),
    ):
        x, y = frame.points[rows, :2].T
        plan_ax.plot(x, y, ".", color=colour, markersize=0.8, label=f"{name}: {rows.sum()}")
    plan_ax.set(xlim=(-40, 100), ylim=(-50, 50), aspect="equal", xlabel="x, m", ylabel="y, m")
    plan_ax.legend(markerscale=8, fontsize=8, loc="upper right")
