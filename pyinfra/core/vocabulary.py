"""Names that several packages share: presets, tiers, object classes, ground-truth subsets."""

from __future__ import annotations

from typing import Literal, get_args

# Settings of a LiDAR of the catalogue; the last are nearest to those of one that can be bought.
Preset = Literal["paper", "equal", "datasheet"]
PRESETS: tuple[Preset, ...] = get_args(Preset)

# Sizes of a training and of a benchmark.
Tier = Literal["smoke", "quick", "full"]
TIERS: tuple[Tier, ...] = get_args(Tier)

# When a box holds: in the middle of the frame, or at the mean time of its object's returns.
LabelTime = Literal["frame", "scan"]

# Which vehicles count, each inside the region. captured: at least some points of this LiDAR.
# common: inside the field of view and range of every LiDAR of the data set, and visible. all:
# visible. present: everyone, seen or not, the same for all LiDARs and mounts that share a region.
Subset = Literal["captured", "common", "all", "present"]
SUBSETS: tuple[Subset, ...] = get_args(Subset)

OBJECT_NAMES = {  # class_id of the simulator: type as in KITTI's label files
    10: "Car",
    11: "Van",
    12: "Truck",
    13: "Bus",
    14: "Motorcycle",
    15: "Pedestrian",
    16: "Cyclist",
}
# Types of label files. What is a vehicle; the last one is of unknown type.
VEHICLE_TYPES = ("Car", "Van", "Truck", "Bus", "Motorcycle", "vehicle")
PERSON_TYPES = ("Pedestrian", "Cyclist")
# What is known to be no vehicle.
OTHER_TYPES = ("Cyclist", "Pedestrian", "Person_sitting", "Tram", "Misc", "DontCare")

# What is detected and evaluated, and the types that make up each class.
ObjectClass = Literal["vehicle", "pedestrian", "cyclist"]
VEHICLES: tuple[ObjectClass, ...] = ("vehicle",)
OBJECT_CLASSES: dict[str, tuple[str, ...]] = {
    "vehicle": VEHICLE_TYPES,
    "pedestrian": ("Pedestrian",),
    "cyclist": ("Cyclist",),
}
