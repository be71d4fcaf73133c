"""
Motion inside a frame
=====================

A frame takes 0.1 s. A car at 60 km/h moves 1.7 m in this time. The upper picture shows where the
Avia's points lie when each ray is cast at its own firing time. The lower picture freezes the car
at the middle of the frame, as many simulators do. The box shows the car at mid-frame.
"""

import matplotlib.pyplot as plt
import numpy as np

import pyinfra as pi

figure, axes = plt.subplots(2, 1, figsize=(8, 5), sharex=True, layout="constrained")
for ax, aggregation in zip(axes, ["exact", "instant"], strict=True):
    keys = {"aggregation": aggregation, "label_time": "frame"}
    scene = pi.load_scene("highway", seed=1, set=keys)
    frame = pi.simulate(scene, "livox_avia", [20])[0]
    cars = frame.labels[(frame.labels.type == "Car") & frame.labels.x.between(35, 80)]
    car = cars.sort_values("points").iloc[-1]
    on_car = frame.fields["object_id"] == car.id
    x, y = frame.points[on_car, 0], frame.points[on_car, 1]
    dots = ax.scatter(x, y, s=6, c=1000 * frame.fields["time_s"][on_car], vmin=0, vmax=100)
    corners = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1], [1, 1]]) * [car.dx / 2, car.dy / 2]
    cos, sin = np.cos(car.heading), np.sin(car.heading)
    ax.plot(*(corners @ [[cos, sin], [-sin, cos]] + [car.x, car.y]).T, color="black")
    ax.set(title=f"aggregation: {aggregation}", ylabel="y, m", aspect="equal")
axes[1].set_xlabel("x, m")
figure.colorbar(dots, ax=axes, label="firing time in the frame, ms")
